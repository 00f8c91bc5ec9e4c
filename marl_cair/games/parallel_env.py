"""One world as a PettingZoo ParallelEnv: for PettingZoo users, evaluation by others, human play."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec

from marl_cair.games import make_engine
from marl_cair.games.action_forms import ContinuousActions, FlatActions, make_action_form
from marl_cair.games.checks.engine import check_count, check_num_worlds, check_seed, read_index
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.randomness import EpisodeSeeds

RENDER_MODES = ("rgb_array",)
VECTOR = "vector"
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
        max_cycles: time limit in steps (default: the scenario's).
        action_form: "flat" (Discrete, or MultiDiscrete [*action_shape]); "factored": actions are
            MultiDiscrete [kind, cell], see `action_forms.FactoredActions`; or "continuous": Box
            [kind, row, column] of numbers in -1..1, see `action_forms.ContinuousActions`.
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
        instead = "take marl_cair.make_torchrl_env or make_engine for several"
        options = check_num_worlds(game, options, 1, instead)
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
        self._form = make_action_form(action_form, game, self.engine.spec)
        self._view = SeatView(self.engine, self._form, representation, mask_in_observation, vector)
        self.possible_agents = [f"player_{seat}" for seat in range(self.engine.num_players)]
        self.agents: list[str] = []
        agents, view = self.possible_agents, self._view
        self.observation_spaces = dict.fromkeys(agents, view.make_space())
        self.action_spaces = dict.fromkeys(agents, view.make_action_space())
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
        """One step of every live agent.

        An agent that is out is terminated with its last reward and leaves `agents`; the others
        continue.

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
        """Free what the game holds, see `BatchedEngine.close`."""
        self.engine.close()

    def _read_action(self, agent: str, seat: int, action: Any) -> int | NDArray[np.int64]:
        """An agent's action as the engine takes it."""
        expected = self._form.sizes.shape
        of_agent = f"{self.engine.game.name}: the action of {agent}"
        if not expected:
            index = read_index(action)
            if index is None:
                allowed = f"a whole number in 0..{self.engine.num_actions - 1}"
                raise ValueError(f"{of_agent} is {action!r}, it must be {allowed}")
            return index
        action = np.asarray(action)
        if action.shape != expected or action.dtype.kind not in self._form.dtype_kinds:
            given = f"{action.dtype} {list(action.shape)}"
            allowed = f"{self._form.numbers} {list(expected)}"
            raise ValueError(f"{of_agent} is {given}, it must be {allowed}")
        chosen: NDArray[np.int64] = self._form.to_engine(action[None], seat)[0]
        return chosen

    def _observe(self) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        seen = self._view.observe()
        masks = self._form.shape_mask(self.engine.action_mask()[0])
        numbers = self.engine.info()
        observations: dict[str, Any] = {}
        infos: dict[str, dict[str, Any]] = {}
        for seat, agent in enumerate(self.possible_agents):
            if agent in self.agents:
                observations[agent] = self._view.pick(seen, (0, seat))
                infos[agent] = {} if self._view.with_mask else {"action_mask": masks[seat]}
                infos[agent] |= {name: of[0, seat].item() for name, of in numbers.items()}
        return observations, infos


class MaskedMultiDiscrete(spaces.MultiDiscrete):
    """MultiDiscrete whose `sample` also takes the mask as one array, as `infos` hold it."""

    def __init__(self, form: FlatActions) -> None:
        super().__init__(form.sizes)
        self._form = form

    def sample(self, mask: Any = None, probability: Any = None) -> NDArray[np.int64]:
        """A random action that `mask` allows: int8 [*action_shape, A], or [G, C] of factored ones.

        Gymnasium's tuples of masks and `probability` work as in `MultiDiscrete`.
        """
        if isinstance(mask, np.ndarray) and probability is None:
            return self._form.draw(mask, self.np_random)
        return super().sample(mask, probability)


class MaskedBox(spaces.Box):
    """Box of points whose `sample` also takes the mask, as `infos` hold it."""

    def __init__(self, form: ContinuousActions) -> None:
        super().__init__(-1.0, 1.0, form.sizes.shape, np.float32)
        self._form = form

    def sample(self, mask: Any = None, probability: Any = None) -> NDArray[Any]:
        """A random point; with a mask, int8 [G, C], that of a legal action."""
        if mask is not None:
            return self._form.draw(mask, self.np_random)
        return super().sample(None, probability)


class SeatView(NamedTuple):
    """What each seat observes: one representation, in a dict where the mask or the vector is added.

    Attributes:
        with_mask, with_vector: whether the dict has "action_mask" and "vector".
    """

    engine: BatchedEngine
    form: FlatActions
    representation: str
    with_mask: bool
    with_vector: bool

    def make_space(self) -> spaces.Space[Any]:
        """One seat's observation space: a Box, or a Dict with the mask or the vector."""
        box = self._make_box(self.representation)
        parts: dict[str, spaces.Space[Any]] = {"observation": box}
        if self.with_mask:
            parts["action_mask"] = spaces.Box(0, 1, self.form.mask_shape, np.int8)
        if self.with_vector:
            parts[VECTOR] = self._make_box(VECTOR)
        return spaces.Dict(parts) if len(parts) > 1 else box

    def make_action_space(self) -> spaces.Space[Any]:
        """One seat's actions: Discrete where an action is one number, Box of points, else
        MultiDiscrete.
        """
        sizes = self.form.sizes
        if isinstance(self.form, ContinuousActions):
            return MaskedBox(self.form)
        return MaskedMultiDiscrete(self.form) if sizes.shape else spaces.Discrete(int(sizes))

    def observe(self) -> NDArray[Any] | dict[str, NDArray[Any]]:
        """The observations of all seats in the form of `make_space`, fresh arrays [B, P, ...]."""
        parts = {"observation": self.engine.observe(self.representation)}
        if self.with_mask:
            parts["action_mask"] = self.form.shape_mask(self.engine.action_mask())
        if self.with_vector:
            parts[VECTOR] = self.engine.observe(VECTOR)
        return parts if len(parts) > 1 else parts["observation"]

    @staticmethod
    def pick(observations: Any, index: Any) -> Any:
        """`observations[index]`, in each entry of a dict."""
        if isinstance(observations, dict):
            return {name: array[index] for name, array in observations.items()}
        return observations[index]

    def _make_box(self, representation: str) -> spaces.Box:
        chosen = self.engine.representation(representation)
        return spaces.Box(*chosen.bounds(), chosen.shape, chosen.dtype)


def check_render_mode(game: str, render_mode: str | None) -> None:
    """Raise ValueError unless `render_mode` is None or one of RENDER_MODES."""
    if render_mode is not None and render_mode not in RENDER_MODES:
        allowed = ", ".join(RENDER_MODES)
        raise ValueError(f"{game}: render_mode is {render_mode!r}, allowed are None and {allowed}")


def make_aec_env(game: str, scenario: str | None = None, **options: Any) -> AECEnv[str, Any, Any]:
    """The game turn by turn: the players' actions are gathered, then played at once."""
    return parallel_to_aec(GameParallelEnv(game, scenario, **options))
