"""Games for one learner, as Gymnasium environments: bots or other agents play the other seats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from marl_cair.games.action_forms import FactoredActions
from marl_cair.games.checks.engine import check_count, check_num_worlds, check_seed, read_index
from marl_cair.games.game import Agent
from marl_cair.games.parallel_env import RENDER_MODES, SeatView, check_render_mode
from marl_cair.games.players.learner_seat import LearnerSeat
from marl_cair.games.players.random_player import RANDOM

NO_LIMIT = np.iinfo(np.int64).max  # of steps
_METADATA = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # an instance has its game's


class _LearnerEnv:
    """The parts that both environments share: the worlds, and what their learner observes."""

    metadata = _METADATA  # on the class: `gymnasium.make` reads it before there is an instance

    def _open(self, table: LearnerSeat, render_mode: str | None, *seen_as: Any) -> None:
        """seen_as: representation, mask_in_observation and vector."""
        self._table, self.engine, self.render_mode = table, table.engine, render_mode
        check_render_mode(self.engine.game.name, render_mode)
        self.metadata = _METADATA | {"render_fps": self.engine.spec.render_fps}
        self._view = SeatView(self.engine, table.form, *seen_as)

    def _observe_worlds(self) -> tuple[Any, dict[str, Any]]:
        """The learner's observations and infos, fresh arrays [B, ...]."""
        table = self._table
        observations = self._view.pick(self._view.observe(), (slice(None), table.seat))
        infos = {name: values[:, table.seat] for name, values in self.engine.info().items()}
        if not self._view.with_mask:
            infos["action_mask"] = table.form.shape_mask(table.mask())
        return observations, infos

    def action_masks(self) -> NDArray[np.bool_]:
        """The learner's legal actions for sb3-contrib's MaskablePPO, bool [B, A]; the masks of all
        places of an action shape in one row.

        Raises:
            ValueError: the action form is "factored" or "continuous".
        """
        if isinstance(self._table.form, FactoredActions):
            raise ValueError(
                f"{self.engine.game.name}: action_masks() has one mask for each number of an "
                "action, this form's mask holds pairs of kind and cell; leave out action_form"
            )
        return self._table.mask().reshape(self.engine.num_worlds, -1)


class GameEnv(_LearnerEnv, gymnasium.Env[Any, Any]):
    """One world for one learner.

    Args:
        game, scenario, options: as `make_engine`.
        opponent: a bot's name, or anything with the `Agent` protocol (a loaded checkpoint); not
            used where the learner plays alone.
        seat: the learner's.
        representation, render_mode, mask_in_observation, vector, action_form: as
            `GameParallelEnv`; the mask is in `info["action_mask"]`, int8 [A] (or the shape of the
            action form), unless it is in the observation, and with it the game's own numbers
            (`Game.info`). `action_masks()` gives it to sb3-contrib.
    """

    def __init__(  # noqa: PLR0913  # by the names that Gymnasium passes
        self,
        game: str,
        scenario: str | None = None,
        *,
        opponent: str | Agent | None = RANDOM,
        seat: int = 0,
        representation: str = "planes",
        render_mode: str | None = None,
        mask_in_observation: bool = False,
        vector: bool = False,
        action_form: str = "flat",
        **options: Any,
    ) -> None:
        options = check_num_worlds(game, options, 1, "take gymnasium.make_vec(id, num_envs)")
        table = LearnerSeat(game, scenario, 1, opponent, seat, action_form, options)
        self._open(table, render_mode, representation, mask_in_observation, vector)
        self.observation_space = self._view.make_space()
        self.action_space = self._view.make_action_space()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start a game; the same seed gives the same game and the same opponent.

        Raises:
            ValueError: the seed is no whole number.
        """
        if seed is not None:
            seed = check_seed(self.engine.game.name, seed)
            super().reset(seed=seed)  # for wrappers: the game draws nothing from `np_random`
        self._table.restart([seed], np.ones(1, np.bool_))
        return self._observe()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step; an illegal action (see the mask) does nothing.

        With factored actions and the mask in the observation one number is an action too: its index
        in the flattened mask. TorchRL's `GymEnv` gives actions so.

        Raises:
            ValueError: the action is outside the space.
            OpponentError: the opponent crashed, or returned an illegal action.
        """
        sizes = self._table.form.sizes
        index = read_index(action) if self._view.with_mask and sizes.shape == (2,) else None
        if index is not None:
            action = divmod(index, int(sizes[1]))
        self._table.play(np.array([action]), np.ones(1, np.bool_))
        observation, info = self._observe()
        reward = float(self.engine.rewards[0, self._table.seat])
        ended = bool(self._table.terminated[0]), bool(self.engine.truncated[0])
        return observation, reward, *ended, info

    def action_masks(self) -> NDArray[np.bool_]:
        """As of `GameVectorEnv`, of the one world: bool [A]."""
        masks: NDArray[np.bool_] = super().action_masks()[0]
        return masks

    def render(self) -> Any:
        """The spectator's picture, uint8 [h, w, 3], in render mode "rgb_array"."""
        return self.engine.render(0) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Free what the game holds, see `BatchedEngine.close`."""
        self.engine.close()

    def _observe(self) -> tuple[Any, dict[str, Any]]:
        observations, infos = self._observe_worlds()
        info = {n: v[0] if n == "action_mask" else v[0].item() for n, v in infos.items()}
        return self._view.pick(observations, 0), info


class GameVectorEnv(_LearnerEnv, VectorEnv[Any, Any, Any]):
    """B worlds for one learner, stepped together by one engine: the games of B `GameEnv`s.

    The same seed gives the games of `gymnasium.make_vec(id, B, vectorization_mode="sync")`. An
    opponent that draws at random acts for one world after the other.

    Args:
        num_envs: B.
        autoreset_mode: NEXT_STEP (Gymnasium's default: the step after an end resets and ignores
            the action), SAME_STEP (the ending step returns the new game's observation and
            `infos["final_obs"]`), or DISABLED (`reset(options={"reset_mask": bool [B]})`).
        max_episode_steps: truncate a game after so many steps, as Gymnasium's TimeLimit does.
        others: as `GameEnv`. `infos["action_mask"]` is int8 [B, A] (or [B, ...] of the form); the
            game's own numbers (`Game.info`) are [B].
    """

    def __init__(  # noqa: PLR0913  # by the names that Gymnasium passes
        self,
        game: str,
        scenario: str | None = None,
        *,
        num_envs: int = 1,
        opponent: str | Agent | None = RANDOM,
        seat: int = 0,
        representation: str = "planes",
        mask_in_observation: bool = False,
        render_mode: str | None = None,
        vector: bool = False,
        action_form: str = "flat",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        **options: Any,
    ) -> None:
        num_envs = check_count(game, "num_envs", num_envs)
        options = check_num_worlds(game, options, num_envs, "give num_envs")
        table = LearnerSeat(game, scenario, num_envs, opponent, seat, action_form, options)
        self._open(table, render_mode, representation, mask_in_observation, vector)
        self.num_envs, self.autoreset_mode = num_envs, AutoresetMode(autoreset_mode)
        self.metadata |= {"autoreset_mode": self.autoreset_mode}
        if max_episode_steps in (None, -1):  # as Gymnasium writes no limit
            self._max_steps = NO_LIMIT
        else:
            self._max_steps = check_count(game, "max_episode_steps", max_episode_steps)
        self.single_observation_space = self._view.make_space()
        self.single_action_space = self._view.make_action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, np.bool_)
        self._steps = np.zeros(num_envs, np.int64)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Restart all worlds, or those of `options["reset_mask"]`.

        World i gets the seed `seed + i`, or `seed[i]`; None begins the next game of its last seed.
        Worlds that are not restarted keep their observation and infos.

        Raises:
            ValueError: a list of another length than B, a seed that is no whole number, a reset
                mask that is not bool [B] or has no world, or one that leaves worlds out of the
                first reset.
        """
        mask = self.engine.check_reset((options or {}).get("reset_mask"), "reset_mask")
        if not mask.any():
            raise ValueError(
                f"{self.engine.game.name}: reset_mask has no world; call reset where a game ended"
            )
        seeds = self._table.read_seeds(seed)
        if seeds[0] is not None:
            super().reset(seed=seeds[0])
        self._restart(mask, seeds)
        return self._observe()

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One step in every world: integer actions [B, ...]. Returns fresh arrays.

        Raises:
            ValueError: wrong shape, not integers, or an action outside the space.
            RuntimeError: without autoreset, a game has ended and was not restarted.
            OpponentError: the opponent crashed, or returned an illegal action.
        """
        starting = self._ended.copy()
        if starting.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            raise RuntimeError(
                f"{self.engine.game.name}: step where the games of the worlds "
                f"{np.flatnonzero(starting).tolist()} have ended; call "
                'reset(options={"reset_mask": terminated | truncated}) first'
            )
        self._table.play(np.asarray(actions), ~starting)
        self._steps += 1
        if starting.any():
            self._restart(starting)
        rewards = self.engine.rewards[:, self._table.seat].astype(np.float64)
        rewards[starting] = 0.0
        terminated = self._table.terminated
        truncated = self.engine.truncated | (self._steps >= self._max_steps)
        self._ended = terminated | truncated
        observations, infos = self._observe()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            final = self._pack_final(observations, infos)
            self._restart(self._ended.copy())
            observations, infos = self._observe()
            infos |= final
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Any:
        """The spectator's pictures of all worlds, in render mode "rgb_array"."""
        if self.render_mode is None:
            return None
        return tuple(self.engine.render(world) for world in range(self.num_envs))

    def close_extras(self, **options: Any) -> None:
        """Free what the game holds, see `BatchedEngine.close`."""
        self.engine.close()

    def _pack_final(self, observations: Any, infos: dict[str, Any]) -> dict[str, Any]:
        """The last observations of the ended worlds, as Gymnasium's own vector environments give
        them: `final_obs` holds one object for each world, None where no game ended.
        """
        ended = self._ended
        final = np.full(self.num_envs, None, object)
        for world in np.flatnonzero(ended):
            final[world] = self._view.pick(observations, world)
        last: dict[str, Any] = {}
        for name, values in infos.items():
            last[name] = values & ended if name.startswith("_") else values.copy()
            last[name][~ended] = 0
        marks = {"_final_obs": ended.copy(), "_final_info": ended.copy()}
        return {"final_obs": final, "final_info": last, **marks}

    def _restart(self, mask: NDArray[np.bool_], seeds: Sequence[int | None] | None = None) -> None:
        self._table.restart(seeds or [None] * self.num_envs, mask)
        self._ended = self._ended & ~mask
        self._steps[mask] = 0

    def _observe(self) -> tuple[Any, dict[str, Any]]:
        observations, infos = self._observe_worlds()
        return observations, infos | {f"_{n}": np.ones(self.num_envs, np.bool_) for n in infos}
