"""Loads foreign agents: any object with `act`, named `package.module:function`.

A crash, a `sys.exit` or an answer of a wrong shape forfeits the games of that call; an illegal
action forfeits its own game. In training a forfeit ends the run (`require_answers`). In this
process a function has no time limit, and one that kills the process ends everything; in a process
of its own (`process.load_hosted`) it forfeits its games. It plays the same either way.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.players.recurrent import check_state, find_state_size
from marl_cair.lookup import find_by_name
from marl_cair.outside import read_code, search_current_folder
from marl_cair.text import clean_text

_MAX_NAME = 200  # characters

FORFEIT = -1  # in place of an action: the game is lost


class AgentFault(Exception):  # noqa: N818  # the agent's, no error of this package
    """A fault of an agent that did not answer, as the end of a sentence about the agent."""

    def __init__(self, text: str) -> None:
        super().__init__(clean_text(text))


class ForeignAgentError(ValueError):
    """A foreign agent that cannot be found or made, or that forfeits where it must not.

    failure: the reason of the forfeit, as the end of a sentence about the agent.
    """

    failure = ""

    def __init__(self, text: str) -> None:
        super().__init__(clean_text(text))


class ForeignAgent:
    """An object with `act(observation, action_mask)` as an agent that may forfeit.

    `act` returns FORFEIT in each row that is lost; `failure` has the reason. The object may have
    `name`, `representation` (default: the game's first) and `seed`, which is called with another
    number below 2**32 before each `act`, so that random agents are repeatable. Calls are
    independent: the games of one call are not those of the last. An object with `state_size` S
    above 0 gets what it remembers of each game as a third argument, float32 [N, S], 0 when a game
    begins, and returns (actions, the next state).

    Args:
        agent: the object.
        source: its name where it has none.
        spec: of the scenario.
        fingerprint: of its code.

    Raises:
        UnknownNameError: the game has no such representation.
        ValueError: its `state_size` is no allowed number.
    """

    def __init__(self, agent: Any, source: str, spec: GameSpec, fingerprint: str) -> None:
        self.name = clean_text(str(getattr(agent, "name", source)))[:_MAX_NAME]
        first = next(iter(spec.representations))
        self.representation = str(getattr(agent, "representation", first))
        find_by_name(f"representation of {source}", self.representation, spec.representations)
        self.state_size = find_state_size(agent)
        self.fingerprint = fingerprint
        self.failure = ""
        self._agent, self._shape, self._broken = agent, spec.action_shape, ""
        self._seed, self._step = 0, 0

    def seed(self, seed: int) -> None:
        self._seed, self._step, self._broken = seed, 0, ""

    def state_dict(self) -> dict[str, Any]:
        return {"seed": self._seed, "step": self._step, "broken": self._broken}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._seed, self._step, self._broken = state["seed"], state["step"], state["broken"]

    def act(
        self,
        observation: NDArray[Any],
        action_mask: NDArray[np.bool_],
        state: NDArray[np.float32] | None = None,
    ) -> Any:
        arguments = (observation, action_mask, *(() if state is None else (state,)))
        answer, after = None, state
        if not self._broken:
            answer, after = self._ask(*(array.copy() for array in arguments))
        self.failure = self._broken
        actions = self._check_actions(answer, action_mask)
        return actions if state is None else (actions, after)

    def _check_actions(self, answer: Any, action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        lost = np.full((len(action_mask), *self._shape), FORFEIT, np.int64)
        if self._broken:
            return lost
        try:
            actions = np.asarray(answer)
        except ValueError:  # rows of different lengths
            actions = np.array(None)
        if actions.shape != lost.shape or not np.issubdtype(actions.dtype, np.integer):
            self.failure = clean_text(
                f"answered {actions.dtype} of shape {list(actions.shape)}, asked for whole numbers "
                f"of shape {list(lost.shape)}"
            )
            return lost
        is_known = (actions >= 0) & (actions < action_mask.shape[-1])
        chosen = np.where(is_known, actions, 0).astype(np.int64)
        is_legal = is_known & np.take_along_axis(action_mask, chosen[..., None], -1)[..., 0]
        if not is_legal.all():
            self.failure = f"played the illegal action {actions[~is_legal].flat[0]}"
        return np.where(is_legal, chosen, FORFEIT)

    def _ask(self, *arguments: NDArray[Any]) -> tuple[Any, Any]:
        """The object's answer, and its next states if it is recurrent."""
        self._step += 1
        text = f"{self._seed} {self._step}".encode()
        try:
            drawn = hashlib.blake2b(text, digest_size=4).digest()
            seed_agent(self._agent, int.from_bytes(drawn, "big"))
            answer = self._agent.act(*arguments)
            if not self.state_size:
                return answer, None
            actions, state = answer
            return actions, check_state(state, (len(arguments[0]), self.state_size))
        except AgentFault as fault:
            self._broken = str(fault)
        except (Exception, SystemExit) as error:  # noqa: BLE001  # whatever foreign code raises
            self._broken = describe_crash(error)
        return None, arguments[-1]


def describe_crash(error: BaseException, method: str = "act") -> str:
    """The fault of an agent whose method raised `error`."""
    return f"crashed in {method}: {type(error).__name__}: {clean_text(str(error))[:200]}"


def seed_agent(agent: Any, seed: int) -> None:
    """Call the object's `seed`, if it has one. Raises AgentFault where it fails."""
    if hasattr(agent, "seed"):
        try:
            agent.seed(seed)
        except (Exception, SystemExit) as error:
            raise AgentFault(describe_crash(error, "seed")) from error


def require_answers(agent: Agent, actions: NDArray[np.int64], role: str = "opponent") -> None:
    """Raise ForeignAgentError if the agent has forfeited one of `actions` [N, ...]. role: opponent
    or demonstration, whose settings name it.
    """
    if (actions == FORFEIT).any():
        failure = getattr(agent, "failure", "gave up")
        error = ForeignAgentError(
            f"{role} {agent.name} {failure}: fix it, or leave it out of {role}.agents"
            f"{' and opponent.mixture' if role == 'opponent' else ''}"
        )
        error.failure = failure
        raise error


def load_foreign(source: str, scenario: Any, spec: GameSpec) -> ForeignAgent:
    """The agent that `package.module:function` returns for (scenario, spec), in this process.

    Modules are found as Python finds them, and in the current folder. The fingerprint is of the
    module's source and the name: changed code is another agent.

    Raises ForeignAgentError: no such module or function, or the function has failed.
    """
    try:
        agent, code = make_foreign(source, scenario, spec)
    except AgentFault as fault:
        raise refuse_function(source, fault) from fault
    return ForeignAgent(agent, source, spec, f"foreign {digest_code(source, code)}")


def refuse_function(source: str, fault: AgentFault) -> ForeignAgentError:
    """The error about a `module:function` that makes no agent."""
    return ForeignAgentError(
        f"{source} {fault}: give module:function, called with (scenario, spec), of a module that "
        "Python finds"
    )


def digest_code(source: str, *files: bytes) -> str:
    """32 hexadecimal digits of an agent's name and of the files of its code."""
    return hashlib.blake2b(b"\0".join((source.encode(), *files)), digest_size=16).hexdigest()


def make_foreign(source: str, scenario: Any, spec: GameSpec) -> tuple[Any, bytes]:
    """The object that the function of `load_foreign` returns, and the source of its module.

    Raises AgentFault: no such module or function, or it returns no agent.
    """
    module_name, _, name = source.partition(":")
    search_current_folder()
    try:
        module = import_module(module_name)
        make: Callable[[Any, GameSpec], Any] = getattr(module, name)
        agent = make(scenario, spec)
    except (Exception, SystemExit) as error:
        raise AgentFault(f"cannot be made ({type(error).__name__}: {error})") from error
    if not callable(getattr(agent, "act", None)):
        raise AgentFault(f"gave {type(agent).__name__} without `act(observation, action_mask)`")
    if not callable(getattr(agent, "seed", seed_agent)):
        raise AgentFault(f"gave {type(agent).__name__} whose `seed` is no method `seed(number)`")
    return agent, read_code(source)
