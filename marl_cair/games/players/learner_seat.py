"""B worlds in which one seat is the learner's and an opponent plays all the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import make_engine
from marl_cair.games.action_forms import make_action_form
from marl_cair.games.checks.engine import check_seed, read_index
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.games.players.random_player import RANDOM
from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.games.randomness import EpisodeSeeds


class OpponentError(RuntimeError):
    """An opponent that crashed, or returned an illegal action."""


class LearnerSeat:
    """B worlds in which the caller plays one seat and `opponent` all the others, if there are.

    Each world has its own seed, and its opponent its own random stream, as in B environments.
    """

    def __init__(
        self,
        game: str,
        scenario: str | None,
        num_worlds: int,
        opponent: str | Agent | None,
        seat: int,
        action_form: str,
        options: dict[str, Any],
    ) -> None:
        self.engine = make_engine(game, scenario, num_worlds, **options)
        self.form = make_action_form(action_form, game, self.engine.spec)
        self.seat = _check_seat(self.engine, seat)
        agent = _find_opponent(self.engine, opponent)
        self.opponent = None if agent is None else OpponentCopies(agent, self.engine)
        self.seeds = [EpisodeSeeds(1) for _ in range(self.engine.num_worlds)]
        if self.opponent is not None:
            for world, seeds in enumerate(self.seeds):
                self.opponent.seed(world, seeds.seed)

    def read_seeds(self, seed: Any) -> list[int | None]:
        """A seed for each world, None where the next game of the last seed follows.

        Args:
            seed: None, a whole number (world i gets seed + i), or a list of B of these.

        Raises:
            ValueError: another length, or a seed that is no whole number.
        """
        game, num_worlds = self.engine.game.name, self.engine.num_worlds
        if seed is None:
            return [None] * num_worlds
        if not isinstance(seed, list):
            first = check_seed(game, seed)
            return [(first + world) % 2**64 for world in range(num_worlds)]
        if len(seed) != num_worlds:
            raise ValueError(
                f"{game}: seed is a list of {len(seed)}, it must be one of {num_worlds} (worlds), "
                "or one whole number"
            )
        return [None if one is None else check_seed(game, one) for one in seed]

    def restart(self, seeds: Sequence[int | None], worlds: NDArray[np.bool_]) -> None:
        """New games in worlds bool [B], the first ones of their seeds where these are not None."""
        following = np.zeros(self.engine.num_worlds, np.uint64)
        for world in np.flatnonzero(worlds).tolist():
            seed = seeds[world]
            if seed is not None:
                self.seeds[world].restart(seed)
                if self.opponent is not None:
                    self.opponent.seed(world, seed)
            if self.opponent is not None:
                self.opponent.start_game(world)
            following[world] = self.seeds[world].next()[0]
        self.engine.reset(following, worlds)

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """Worlds [B] whose game is over for the learner: decided, or its seat is out; fresh."""
        return self.engine.terminated | self.engine.eliminated[:, self.seat]

    def mask(self) -> NDArray[np.bool_]:
        """The learner's legal actions, bool [B, *action_shape, A]; fresh."""
        return self.engine.action_mask()[:, self.seat]

    def play(self, actions: NDArray[Any], worlds: NDArray[np.bool_]) -> None:
        """One step: the learner's actions [B, ...] in its form, the opponent's elsewhere.

        Args:
            actions: of all worlds.
            worlds: bool [B], the worlds that play; the caller is to restart the others.

        Raises:
            ValueError: wrong shape or dtype, or an action outside the space.
            OpponentError: the opponent crashed, or returned an illegal action.
        """
        engine = self.engine
        expected = (engine.num_worlds, *self.form.sizes.shape)
        if actions.shape != expected or actions.dtype.kind not in self.form.dtype_kinds:
            axes = "worlds" + (", shape of an action" if self.form.sizes.shape else "")
            raise ValueError(
                f"{engine.game.name}: the learner's actions are {actions.dtype} "
                f"{list(actions.shape)}, they must be {self.form.numbers} {list(expected)} ({axes})"
            )
        shape = (engine.num_worlds, engine.num_players, *engine.spec.action_shape)
        everyone = np.full(shape, engine.spec.noop_action, np.int64)
        everyone[:, self.seat] = self.form.to_engine(actions, self.seat)
        asked = np.flatnonzero(worlds)
        if self.opponent is not None and len(asked):
            seen, masks = engine.observe(self.opponent.representation), engine.action_mask()
            for seat in range(engine.num_players):
                if seat != self.seat:
                    rows = seen[asked, seat], masks[asked, seat]
                    everyone[asked, seat] = self.opponent.act(seat, asked, *rows)
        engine.step(everyone)


class OpponentCopies:
    """One agent that plays in B worlds as B agents would, each with its own seed.

    An agent without randomness (an empty `state_dict`, or `is_deterministic`) acts in all worlds at
    once; another in one world after the other, each with that world's random state.
    """

    def __init__(self, agent: Agent, engine: BatchedEngine) -> None:
        self.representation = agent.representation
        self._agent, self._game, self._num_actions = agent, engine.game.name, engine.num_actions
        self._members = agent.members if isinstance(agent, MixedAgent) else (agent,)
        self._playing = np.zeros(engine.num_worlds, np.int64)  # the member in each world
        seats = engine.num_worlds, engine.num_players
        self._memory = np.zeros((*seats, find_state_size(agent)), np.float32)
        # Of each world the random states of all members, and of a mixture its own.
        self._states: list[dict[str, Any]] = [{} for _ in range(engine.num_worlds)]

    def seed(self, world: int, seed: int) -> None:
        """Begin the random stream of a world."""
        self._agent.seed(seed)
        state = self._agent.state_dict() if hasattr(self._agent, "state_dict") else {}
        is_mixture = isinstance(self._agent, MixedAgent)
        self._states[world] = state if is_mixture else {"members": [state]}

    def start_game(self, world: int) -> None:
        """Clear the recurrent states of a world, and draw the member of a mixture that plays its
        next game.
        """
        self._memory[world] = 0.0
        if isinstance(self._agent, MixedAgent):
            self._agent.load_state_dict(self._states[world])
            self._playing[world] = self._agent.draw(1)[0]
            self._states[world] = self._agent.state_dict()

    def act(
        self, seat: int, worlds: NDArray[np.int64], seen: NDArray[Any], masks: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Legal actions [N, *action_shape] of one seat in the worlds int64 [N], which see
        [N, *shape] of the agent's representation and have the masks bool [N, *action_shape, A].

        Raises:
            OpponentError: the agent crashed, or returned an illegal action.
        """
        actions = np.zeros(masks.shape[:-1], np.int64)
        playing = self._playing[worlds]
        for number in np.unique(playing).tolist():
            rows, member = np.flatnonzero(playing == number), self._members[number]
            states = [self._states[world]["members"] for world in worlds[rows].tolist()]
            together = getattr(member, "is_deterministic", False) or not states[0][number]
            for part in [rows] if together else rows[:, None]:
                if not together:
                    held: list[Mapping[str, Any]] = self._states[int(worlds[part[0]])]["members"]
                    member.load_state_dict(held[number])
                actions[part] = self._ask(member, seat, worlds[part], seen[part], masks[part])
                if not together:
                    held[number] = member.state_dict()
        return actions

    def _ask(
        self,
        member: Agent,
        seat: int,
        worlds: NDArray[np.int64],
        seen: NDArray[Any],
        masks: NDArray[np.bool_],
    ) -> NDArray[np.int64]:
        """A member's legal actions; arguments and errors as of `act`."""
        try:
            actions = call_agent(member, self._memory, (worlds, seat), seen, masks)
        except Exception as error:
            cause = f"crashed in act: {type(error).__name__}: {error}"
            raise self._describe(member, seat, worlds[0], cause) from error
        if actions.shape != masks.shape[:-1] or actions.dtype.kind not in "iu":
            wanted = f"integers {list(masks.shape[:-1])}"
            cause = f"returned {actions.dtype} {list(actions.shape)}, it must be {wanted}"
            raise self._describe(member, seat, worlds[0], cause)
        is_known = (actions >= 0) & (actions < self._num_actions)
        chosen = np.where(is_known, actions, 0).astype(np.int64)
        is_legal = is_known & np.take_along_axis(masks, chosen[..., None], -1)[..., 0]
        if not is_legal.all():
            row, *place = np.argwhere(~is_legal)[0].tolist()
            # A league's agent that has failed already returns an action outside the range.
            illegal = f"played the illegal action {actions[row, *place]}"
            cause = getattr(member, "failure", "") or illegal
            raise self._describe(member, seat, worlds[row], cause)
        return chosen

    def _describe(self, member: Agent, seat: int, world: Any, cause: str) -> OpponentError:
        name = getattr(member, "name", type(member).__name__)
        return OpponentError(
            f"{self._game}: the opponent {name!r}, player {seat} in world {world}, {cause}. "
            "Fix it, or choose another `opponent`"
        )


def _check_seat(engine: BatchedEngine, seat: Any) -> int:
    last = engine.num_players - 1
    chosen = read_index(seat)
    if chosen is None or not 0 <= chosen <= last:
        raise ValueError(f"{engine.game.name}: seat is {seat!r}, allowed are 0..{last}")
    return chosen


def _find_opponent(engine: BatchedEngine, opponent: Any) -> Agent | None:
    """The agent of the other seats; None where there are none, even if the game has no bot."""
    game, is_alone = engine.game, engine.num_players == 1
    if is_alone and opponent in (None, RANDOM):
        return None
    if isinstance(opponent, str):
        opponent = game.bot(opponent, engine.scenario)
    if not all(hasattr(opponent, part) for part in ("representation", "seed", "act")):
        raise ValueError(
            f"{game.name}: opponent is {opponent!r}, it must be the name of a bot (known are "
            f"{', '.join(game.bots)}) or an agent, see games.game.Agent"
        )
    return None if is_alone else opponent
