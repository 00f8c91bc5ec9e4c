"""Games for one learner, as Gymnasium environments: bots or other agents play the other seats."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from marl_cair.games import make_engine
from marl_cair.games.action_forms import make_action_form
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.engine_checks import check_count, check_num_worlds, check_seed, read_index
from marl_cair.games.game import Agent
from marl_cair.games.mixed_agent import MixedAgent
from marl_cair.games.parallel_env import (
    RENDER_MODES,
    check_render_mode,
    look,
    make_action_space,
    make_observation_space,
)
from marl_cair.games.randomness import EpisodeSeeds

ANYBODY = "random"  # the opponent if not told
_METADATA = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # an instance has its game's


class _LearnerSeat:
    """B worlds in which the caller plays one seat and `opponent` all the others, if there are."""

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
        self.engine: BatchedEngine = make_engine(game, scenario, num_worlds, **options)
        self.form = make_action_form(action_form, game, self.engine.spec)
        self.seat = _check_seat(self.engine, seat)
        self.opponent = _find_opponent(self.engine, opponent)
        self.seeds = EpisodeSeeds(self.engine.num_worlds)
        self._members = np.zeros(self.engine.num_worlds, np.int64)  # of a mixture, who plays where
        self.restart(self.seeds.seed)

    def restart(self, seed: int) -> None:
        self.seeds.restart(seed)
        if self.opponent is not None:
            self.opponent.seed(seed)

    def start_games(self, worlds: NDArray[np.bool_]) -> None:
        """New games in worlds bool [B]."""
        if isinstance(self.opponent, MixedAgent):
            self._members[worlds] = self.opponent.draw(int(worlds.sum()))
        self.engine.reset(self.seeds.next(worlds), worlds)

    def _answer(
        self, opponent: Agent, seen: NDArray[Any], masks: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """The opponent's actions [B, ...] of what one seat sees in all worlds."""
        rows = np.ascontiguousarray(seen), np.ascontiguousarray(masks)
        if isinstance(opponent, MixedAgent):
            return opponent.act_as(self._members, *rows)
        return opponent.act(*rows)

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """Worlds [B] whose game is over for the learner: decided, or its seat is out; fresh."""
        return self.engine.terminated | self.engine.eliminated[:, self.seat]

    def numbers(self) -> dict[str, NDArray[Any]]:
        """The game's own numbers of the learner's seat by name, fresh arrays [B]."""
        return {name: values[:, self.seat] for name, values in self.engine.info().items()}

    def play(self, actions: NDArray[np.int64]) -> None:
        """One decision: the learner's actions [B, ...] in its form, the opponent's elsewhere.

        Raises:
            ValueError: wrong shape, not integers, or an action outside the space.
        """
        engine = self.engine
        expected = (engine.num_worlds, *self.form.sizes.shape)
        if actions.shape != expected or actions.dtype.kind not in "iu":
            axes = "worlds" + (", shape of an action" if self.form.sizes.shape else "")
            raise ValueError(
                f"{engine.game.name}: the learner's actions are {actions.dtype} "
                f"{list(actions.shape)}, they must be integers {list(expected)} ({axes})"
            )
        shape = (engine.num_worlds, engine.num_players, *engine.spec.action_shape)
        everyone = np.empty(shape, np.int64)
        everyone[:, self.seat] = self.form.to_engine(actions, self.seat)
        if self.opponent is not None:
            seen, masks = engine.observe(self.opponent.representation), engine.action_mask()
            for seat in range(engine.num_players):
                if seat != self.seat:
                    chosen = self._answer(self.opponent, seen[:, seat], masks[:, seat])
                    everyone[:, seat] = chosen
        engine.step(everyone)


def _check_seat(engine: BatchedEngine, seat: Any) -> int:
    last = engine.num_players - 1
    chosen = read_index(seat)
    if chosen is None or not 0 <= chosen <= last:
        raise ValueError(f"{engine.game.name}: seat is {seat!r}, allowed are 0..{last}")
    return chosen


def _find_opponent(engine: BatchedEngine, opponent: Any) -> Agent | None:
    """Who plays the other seats; None where there are none, whose game needs no bot."""
    game, is_alone = engine.game, engine.num_players == 1
    if is_alone and (opponent is None or opponent == ANYBODY):
        return None
    if isinstance(opponent, str):
        opponent = game.bot(opponent, engine.scenario)
    if not all(hasattr(opponent, part) for part in ("representation", "seed", "act")):
        raise ValueError(
            f"{game.name}: opponent is {opponent!r}, it must be the name of a bot (known are "
            f"{', '.join(game.bots) or 'none'}) or an agent, see games.game.Agent"
        )
    agent: Agent = opponent
    return None if is_alone else agent


class GameEnv(gymnasium.Env[Any, Any]):
    """One world for one learner.

    Args:
        game, scenario, options: as `make_engine`.
        opponent: a bot's name, or anything with the `Agent` protocol (a loaded checkpoint); it is
            not asked where the learner plays alone.
        seat: the learner's.
        representation, render_mode, mask_in_observation, vector, action_form: as
            `GameParallelEnv`; the mask is always in `info["action_mask"]`, int8 [A] (or the shape
            of the action form), and beside it the game's own numbers (`Game.info`).
    """

    metadata = _METADATA  # on the class: `gymnasium.make` reads it before there is an instance

    def __init__(  # noqa: PLR0913  # by the names that Gymnasium passes
        self,
        game: str,
        scenario: str | None = None,
        *,
        opponent: str | Agent | None = ANYBODY,
        seat: int = 0,
        representation: str = "planes",
        render_mode: str | None = None,
        mask_in_observation: bool = False,
        vector: bool = False,
        action_form: str = "flat",
        **options: Any,
    ) -> None:
        check_render_mode(game, render_mode)
        options = check_num_worlds(game, options, 1, "take gymnasium.make_vec(id, num_envs)")
        self._table = _LearnerSeat(game, scenario, 1, opponent, seat, action_form, options)
        self.engine = self._table.engine
        self.metadata = _METADATA | {"render_fps": self.engine.spec.render_fps}
        self.render_mode = render_mode
        self._seen_as = (representation, mask_in_observation, vector, self._table.form)
        self.observation_space = make_observation_space(self.engine, *self._seen_as)
        self.action_space = make_action_space(self._table.form)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start a game; the same seed gives the same game and the same opponent.

        Raises:
            ValueError: the seed is no whole number.
        """
        if seed is not None:
            seed = check_seed(self.engine.game.name, seed)
            super().reset(seed=seed)  # draws nothing: wrappers do
            self._table.restart(seed)
        self._table.start_games(np.ones(1, np.bool_))
        return self._look()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One decision; an illegal action (see the mask) does nothing.

        Raises:
            ValueError: the action is outside the space.
        """
        self._table.play(np.array([action]))
        observation, info = self._look()
        reward = float(self.engine.rewards[0, self._table.seat])
        ended = bool(self._table.terminated[0]), bool(self.engine.truncated[0])
        return observation, reward, *ended, info

    def render(self) -> Any:
        """The spectator's picture, uint8 [h, w, 3], in render mode "rgb_array"."""
        return self.engine.render(0) if self.render_mode == "rgb_array" else None

    def _look(self) -> tuple[Any, dict[str, Any]]:
        seat = self._table.seat
        seen = look(self.engine, *self._seen_as)
        if isinstance(seen, dict):
            observation: Any = {name: array[0, seat] for name, array in seen.items()}
        else:
            observation = seen[0, seat]
        mask = self._table.form.shape_mask(self.engine.action_mask()[0, seat])
        told = {name: values[0].item() for name, values in self._table.numbers().items()}
        return observation, {"action_mask": mask, **told}


class GameVectorEnv(VectorEnv[Any, Any, Any]):
    """B worlds for one learner, stepped together by one engine.

    Args:
        num_envs: B.
        autoreset_mode: NEXT_STEP (Gymnasium's default: the step after an end resets and ignores
            the action), SAME_STEP (the ending step returns the new game's observation and
            `infos["final_obs"]`), or DISABLED (`reset(options={"reset_mask": bool [B]})`).
        others: as `GameEnv`. `infos["action_mask"]` is int8 [B, A] (or [B, ...] of the form); the
            game's own numbers (`Game.info`) are [B].
    """

    metadata = _METADATA

    def __init__(  # noqa: PLR0913  # by the names that Gymnasium passes
        self,
        game: str,
        scenario: str | None = None,
        *,
        num_envs: int = 1,
        opponent: str | Agent | None = ANYBODY,
        seat: int = 0,
        representation: str = "planes",
        mask_in_observation: bool = False,
        render_mode: str | None = None,
        vector: bool = False,
        action_form: str = "flat",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        check_render_mode(game, render_mode)
        num_envs = check_count(game, "num_envs", num_envs)
        options = check_num_worlds(game, options, num_envs, "give num_envs")
        self._table = _LearnerSeat(game, scenario, num_envs, opponent, seat, action_form, options)
        self.engine = self._table.engine
        self.num_envs, self.render_mode = num_envs, render_mode
        self._mode = AutoresetMode(autoreset_mode)
        fps = self.engine.spec.render_fps
        self.metadata = _METADATA | {"render_fps": fps, "autoreset_mode": self._mode}
        self._seen_as = (representation, mask_in_observation, vector, self._table.form)
        self.single_observation_space = make_observation_space(self.engine, *self._seen_as)
        self.single_action_space = make_action_space(self._table.form)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Restart all worlds, or those of `options["reset_mask"]`.

        Raises:
            ValueError: a list of seeds (one seed gives every world its own), a seed that is no
                whole number, a reset mask that is not bool [B], or one that leaves worlds out of
                the first reset.
        """
        if isinstance(seed, list):
            raise ValueError(
                f"{self.engine.game.name}: seed is a list; pass one int, from which every world "
                "gets its own seed"
            )
        mask = self.engine.check_reset((options or {}).get("reset_mask"), "reset_mask")
        if seed is not None:
            seed = check_seed(self.engine.game.name, seed)
            super().reset(seed=seed)
            self._table.restart(seed)
        self._restart(mask)
        return self._look()

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One decision in every world: integer actions [B, ...]. Arrays in the result are fresh."""
        starting = self._ended.copy()
        self._table.play(np.asarray(actions))
        if self._mode is AutoresetMode.NEXT_STEP and starting.any():
            self._restart(starting)
        rewards = self.engine.rewards[:, self._table.seat].astype(np.float64)
        terminated, truncated = self._table.terminated, self.engine.truncated.copy()
        rewards[starting] = 0.0
        self._ended = terminated | truncated
        observations, infos = self._look()
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            final = self._pack_final(observations, infos)
            self._restart(self._ended.copy())
            observations, infos = self._look()
            infos |= final
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Any:
        """The spectator's pictures of all worlds, in render mode "rgb_array"."""
        if self.render_mode is None:
            return None
        return tuple(self.engine.render(world) for world in range(self.num_envs))

    def _pack_final(self, observations: Any, infos: dict[str, Any]) -> dict[str, Any]:
        """What the ended worlds showed last, in the form of Gymnasium's own vector environments.

        `final_obs` holds one object for each world, None where no game ended.
        """
        ended = self._ended
        final = np.full(self.num_envs, None, object)
        for world in np.flatnonzero(ended):
            if isinstance(observations, dict):
                final[world] = {name: array[world] for name, array in observations.items()}
            else:
                final[world] = observations[world]
        told: dict[str, Any] = {}
        for name, values in infos.items():
            told[name] = values & ended if name.startswith("_") else values.copy()
            told[name][~ended] = 0
        return {
            "final_obs": final,
            "_final_obs": ended.copy(),
            "final_info": told,
            "_final_info": ended.copy(),
        }

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        self._table.start_games(mask)
        self._ended = self._ended & ~mask

    def _look(self) -> tuple[Any, dict[str, Any]]:
        seat = self._table.seat
        seen = look(self.engine, *self._seen_as)
        if isinstance(seen, dict):
            observations: Any = {name: array[:, seat] for name, array in seen.items()}
        else:
            observations = seen[:, seat]
        masks = self._table.form.shape_mask(self.engine.action_mask()[:, seat])
        infos = {"action_mask": masks, **self._table.numbers()}
        present = {f"_{name}": np.ones(self.num_envs, np.bool_) for name in infos}
        return observations, infos | present
