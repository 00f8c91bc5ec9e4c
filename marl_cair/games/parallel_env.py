"""One world as a PettingZoo ParallelEnv: for PettingZoo users, evaluation by others, human play."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec

from marl_cair.games import make_engine
from marl_cair.games.action_forms import ActionForm, make_action_form
from marl_cair.games.checks.engine import check_count, check_num_worlds, check_seed, read_index
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Representation
from marl_cair.games.randomness import EpisodeSeeds

RENDER_MODES = ("rgb_array",)
VECTOR = "vector"
SEVERAL_WORLDS = "take marl_cair.make_torchrl_env or make_engine for several"
STATE_BOUND = 2.0**31  # all numbers of a state are 32-bit integers, or fewer bits


class GameParallelEnv(ParallelEnv[str, Any, Any]):
    """One game in which all players act at once.

    Args:
        game: a name in GAMES.
        scenario: a name in the game's scenarios.
        representation: what agents observe; the default `planes` is uint8 [C, H, W].
        render_mode: None or "rgb_array".
        mask_in_observation: observations become {"observation", "action_mask"}. Without, the mask
            is in `infos[agent]["action_mask"]`. It is int8 as `action_space(agent).sample(mask)`
            takes it: [A], [*action_shape, A] where actions have a shape, or [G, C] in the factored
            form. `infos` hold the game's own numbers too, as `optimal_steps` of a maze (see
            `Game.info`).
        vector: observations become a dict with the float32 economy vector under "vector".
        max_cycles: time limit in decisions (default: the scenario's).
        action_form: "flat" (Discrete, or MultiDiscrete [*action_shape]), or "factored": actions
            are MultiDiscrete [kind, cell], see `action_forms.FactoredActions`.
        options: fields of the scenario to change, for example `preset="2017"`.

    A legal action does what its name says, an illegal one nothing (it is counted in
    `env.engine.illegal_actions`).

    Raises:
        UnknownNameError: an unknown name anywhere; names the nearest.
        ValueError: a value that is not allowed.
    """

    def __init__(
        self,
        game: str,
        scenario: str | None = None,
        *,
        representation: str = "planes",
        render_mode: str | None = None,
        mask_in_observation: bool = False,
        vector: bool = False,
        max_cycles: int | None = None,
        action_form: str = "flat",
        **options: Any,
    ) -> None:
        check_render_mode(game, render_mode)
        options = check_num_worlds(game, options, 1, SEVERAL_WORLDS)
        self.engine = make_engine(game, scenario, **options)
        if max_cycles is not None:
            cycles = check_count(game, "max_cycles", max_cycles)
            options["max_ticks"] = cycles * self.engine.spec.ticks_per_step
            self.engine = make_engine(game, scenario, **options)
        self.metadata = {
            "name": f"{game}_v{self.engine.game.version}",
            "render_modes": list(RENDER_MODES),
            "render_fps": self.engine.spec.render_fps,
            "is_parallelizable": True,
        }
        self.render_mode = render_mode
        self.representation = representation
        self._form = make_action_form(action_form, game, self.engine.spec)
        self._mask_in_observation = mask_in_observation
        self._seen_as = (representation, mask_in_observation, vector, self._form)
        self.possible_agents = [f"player_{seat}" for seat in range(self.engine.num_players)]
        self.agents: list[str] = []
        seen = make_observation_space(self.engine, *self._seen_as)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        actions = make_action_space(self._form)
        self.action_spaces = dict.fromkeys(self.possible_agents, actions)
        self._seeds = EpisodeSeeds(1)
        self.engine.reset(np.zeros(1, np.uint64))
        size = self.engine.public_state(0).shape
        self.state_space = spaces.Box(-STATE_BOUND, STATE_BOUND, size, np.float32)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Start a game; the same seed (0 included) gives the same game.

        Without a seed the next game of the last seed begins.

        Raises:
            ValueError: the seed is no whole number.
        """
        if seed is not None:
            seed = check_seed(self.engine.game.name, seed)
            self._seeds.restart(seed)
        if seed is not None or not hasattr(self, "np_random"):
            # Ours draws nothing from it: wrappers do (SuperSuit's frame_skip).
            self.np_random, _ = seeding.np_random(seed)
        self.engine.reset(self._seeds.next())
        self.agents = list(self.possible_agents)
        return self._observe()

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """One decision of every live agent.

        Who is out is terminated with its last reward and leaves `agents`; the others play on.

        Raises:
            ValueError: an agent's action is missing, of a wrong shape, or outside its space.
            RuntimeError: before the first reset.
        """
        if not self._seeds.episodes[0]:
            raise RuntimeError(f"{self.engine.game.name}: step before reset; call reset() first")
        if not self.agents:
            return {}, {}, {}, {}, {}
        if missing := [agent for agent in self.agents if agent not in actions]:
            raise ValueError(
                f"{self.engine.game.name}: step has no actions of {', '.join(missing)}; give "
                "one for every agent in env.agents"
            )
        live = self.agents
        spec = self.engine.spec
        chosen = np.full((1, spec.num_players, *spec.action_shape), spec.noop_action, np.int64)
        for seat, agent in enumerate(self.possible_agents):
            if agent in live:
                chosen[0, seat] = self._read_action(agent, seat, actions[agent])
        self.engine.step(chosen)
        observations, infos = self._observe()
        seats = {agent: self.possible_agents.index(agent) for agent in live}
        rewards = {agent: float(self.engine.rewards[0, seat]) for agent, seat in seats.items()}
        is_over = self.engine.terminated[0] | self.engine.eliminated[0]
        terminations = {agent: bool(is_over[seat]) for agent, seat in seats.items()}
        truncations = dict.fromkeys(live, bool(self.engine.truncated[0]))
        self.agents = [a for a in live if not (terminations[a] or truncations[a])]
        return observations, rewards, terminations, truncations, infos

    def state(self) -> NDArray[np.float32]:
        """The full state, float32 [S]: for centralised critics, not for players."""
        return self.engine.public_state(0)

    def render(self) -> NDArray[np.uint8] | None:
        """The spectator's picture, uint8 [h, w, 3], in render mode "rgb_array"."""
        return self.engine.render(0) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Nothing is held open."""

    def _read_action(self, agent: str, seat: int, action: Any) -> int | NDArray[np.int64]:
        """An agent's action as the engine takes it."""
        expected = self._form.sizes.shape
        if not expected:
            index = read_index(action)
            if index is None:
                raise ValueError(
                    f"{self.engine.game.name}: the action of {agent} is {action!r}, it must be a "
                    f"whole number in 0..{self.engine.num_actions - 1}"
                )
            return index
        action = np.asarray(action)
        if action.shape != expected or action.dtype.kind not in "iu":
            raise ValueError(
                f"{self.engine.game.name}: the action of {agent} is {action.dtype} "
                f"{list(action.shape)}, it must be integers {list(expected)}"
            )
        chosen: NDArray[np.int64] = self._form.to_engine(action[None], seat)[0]
        return chosen

    def _observe(self) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        seen = observe_seats(self.engine, *self._seen_as)
        shown = {name: values[0] for name, values in self.engine.info().items()}
        masks = self._form.shape_mask(self.engine.action_mask()[0])
        observations: dict[str, Any] = {}
        infos: dict[str, dict[str, Any]] = {}
        for seat, agent in enumerate(self.possible_agents):
            if agent not in self.agents:
                continue
            if isinstance(seen, dict):
                observations[agent] = {name: array[0, seat] for name, array in seen.items()}
            else:
                observations[agent] = seen[0, seat]
            infos[agent] = {} if self._mask_in_observation else {"action_mask": masks[seat]}
            infos[agent] |= {name: values[seat].item() for name, values in shown.items()}
        return observations, infos


class MaskedMultiDiscrete(spaces.MultiDiscrete):
    """MultiDiscrete whose `sample` also takes the mask as one array, as `infos` hold it."""

    def __init__(self, form: ActionForm) -> None:
        super().__init__(form.sizes)
        self._form = form

    def sample(self, mask: Any = None, probability: Any = None) -> NDArray[np.int64]:
        """A random action that `mask` allows: int8 [*action_shape, A], or [G, C] of factored ones.

        Gymnasium's tuples of masks and `probability` work as in `MultiDiscrete`.
        """
        if isinstance(mask, np.ndarray) and probability is None:
            return self._form.draw(mask, self.np_random)
        return super().sample(mask, probability)


def make_action_space(form: ActionForm) -> spaces.Space[Any]:
    """One seat's space: Discrete where an action is one number, else MultiDiscrete."""
    return MaskedMultiDiscrete(form) if form.sizes.shape else spaces.Discrete(int(form.sizes))


def make_observation_space(
    engine: BatchedEngine,
    representation: str,
    with_mask: bool,
    with_vector: bool,
    form: ActionForm,
) -> spaces.Space[Any]:
    """One seat's space: a Box, or a Dict where the mask or the vector is asked for."""
    box = _make_box(engine.representation(representation))
    if not with_mask and not with_vector:
        return box
    parts: dict[str, spaces.Space[Any]] = {"observation": box}
    if with_mask:
        parts["action_mask"] = spaces.Box(0, 1, form.mask_shape, np.int8)
    if with_vector:
        parts[VECTOR] = _make_box(engine.representation(VECTOR))
    return spaces.Dict(parts)


def observe_seats(
    engine: BatchedEngine,
    representation: str,
    with_mask: bool,
    with_vector: bool,
    form: ActionForm,
) -> NDArray[Any] | dict[str, NDArray[Any]]:
    """What all seats see, fresh arrays [B, P, ...] in the form of `make_observation_space`."""
    seen = engine.observe(representation)
    if not with_mask and not with_vector:
        return seen
    parts = {"observation": seen}
    if with_mask:
        parts["action_mask"] = form.shape_mask(engine.action_mask())
    if with_vector:
        parts[VECTOR] = engine.observe(VECTOR)
    return parts


def _make_box(representation: Representation) -> spaces.Box:
    low, high = representation.bounds()
    return spaces.Box(low, high, representation.shape, representation.dtype)


def check_render_mode(game: str, render_mode: str | None) -> None:
    """Raise ValueError unless `render_mode` is None or one of RENDER_MODES."""
    if render_mode is not None and render_mode not in RENDER_MODES:
        allowed = ", ".join(RENDER_MODES)
        raise ValueError(f"{game}: render_mode is {render_mode!r}, allowed are None and {allowed}")


def make_parallel_env(game: str, scenario: str | None = None, **options: Any) -> GameParallelEnv:
    """What `marl_cair.games.<game>.parallel_env` calls."""
    return GameParallelEnv(game, scenario, **options)


def make_aec_env(game: str, scenario: str | None = None, **options: Any) -> AECEnv[str, Any, Any]:
    """The game turn by turn: the players' actions are gathered, then played at once."""
    return parallel_to_aec(make_parallel_env(game, scenario, **options))
