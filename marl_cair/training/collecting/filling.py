"""Fills the replay buffer with the transitions of a data set."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.games.checks.scenario import restore_fields
from marl_cair.replay.dataset import EPISODE, SEAT, STEP, DatasetDescription, load_dataset
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import (
    EXPERT_ACTION,
    INDEX,
    NEXT_ACTION_MASK,
    NEXT_OBSERVATION,
    NO_ACTION,
    NO_OPPONENT,
    OPPONENT,
    OTHER_ACTIONS,
)
from marl_cair.training.collecting.recorded import list_differences

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine
    from marl_cair.training.settings.config import TrainConfig

SHAPED = ("shaped", "distance")  # rewards that look at `shaping_discount`
STORED_ROWS = 2_048  # at a time


def fill_from_dataset(storage: EpisodeStorage, config: TrainConfig, engine: BatchedEngine) -> None:
    """Store the transitions to train on of the data set `config.offline.dataset`.

    Steps that follow one another are linked; after any other step, the next observation is stored
    as if the episode were truncated there.

    Raises ValueError for a data set of another scenario or representation, or more transitions than
    the buffer holds; and as `load_dataset`.
    """
    source = config.offline.dataset or ""
    data = load_dataset(source)
    _check_game(source, data.about, engine, config.game.representation)
    rows, scale = data.train, config.learner.reward_scale
    order, is_last = _find_chains(rows)
    needed = len(order) + int(is_last.sum())
    if needed > storage.capacity:
        raise ValueError(
            f"the data set {source} has {len(order):,} transitions, which take {needed:,} entries, "
            f"but replay.capacity_transitions is {storage.capacity:,}: set it to {needed} or more"
        )
    for first in range(0, len(order), STORED_ROWS):
        part = slice(first, first + STORED_ROWS)
        chosen = rows[torch.from_numpy(order[part])]
        storage.append(_make_rollout(chosen, is_last[part], scale, storage.spec.num_others))
    storage.forget_streams()


def complete_rows(rows: TensorDict, places: torch.Tensor, reward_scale: float = 1.0) -> TensorDict:
    """The transitions at `places` of a data set, as one-step rows of replay."""
    chosen = rows[places].exclude(EPISODE, SEAT, STEP)
    num = len(chosen)
    chosen["next", "reward"] *= reward_scale
    chosen["steps_to_next_obs"] = torch.ones(num, 1, dtype=torch.int64)
    chosen["is_generated"] = torch.zeros(num, 1, dtype=torch.bool)
    chosen[EXPERT_ACTION] = torch.full((num,), NO_ACTION)
    chosen[OPPONENT] = torch.full((num,), NO_OPPONENT, dtype=torch.int16)
    chosen[INDEX] = places
    return chosen


def _check_game(
    source: str, about: DatasetDescription, engine: BatchedEngine, representation: str
) -> None:
    game, scenario = engine.game, engine.scenario
    held = about.game, about.game_version, about.representation
    wanted = game.name, game.version, representation
    if held != wanted:
        raise ValueError(
            f"the data set {source} is of {' '.join(held)}, this run of {' '.join(wanted)}: "
            "collect another one, or change the run"
        )
    recorded = game.scenario(None, **restore_fields(about.scenario_options))  # newer fields too
    fields = dict(vars(recorded))
    if "shaping_discount" in fields and scenario.reward not in SHAPED:
        fields["shaping_discount"] = scenario.shaping_discount  # it changes nothing there
    if differing := list_differences(fields, scenario):
        raise ValueError(
            f"the data set {source} is of another scenario, {about.scenario}: {differing}. Collect "
            "it with --set, or change game.scenario, game.options, game.reward or learner.gamma "
            "(shaping_discount)"
        )


def _find_chains(rows: TensorDict) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Places of the rows in the order of their steps, int64 [N], and which of them, bool [N], are
    not followed by the next one's step.
    """
    keys = [rows[name].numpy() for name in (STEP, SEAT, EPISODE)]
    order = np.lexsort(keys)
    step, seat, episode = (key[order] for key in keys)
    follows = (np.diff(step) == 1) & (np.diff(seat) == 0) & (np.diff(episode) == 0)
    done = rows["next", "done"].squeeze(1).numpy()[order]
    return order, ~np.append(follows, False) | done


def _make_rollout(
    rows: TensorDict, is_last: NDArray[np.bool_], reward_scale: float, num_others: int
) -> Rollout:
    """Consecutive steps of one stream, [N, 1]."""
    ends, terminated = torch.from_numpy(is_last), rows["next", "terminated"]
    num = len(rows)
    return Rollout(
        observation=rows["observation"][:, None],
        action_mask=rows["action_mask"][:, None],
        action=rows["action"][:, None],
        reward=rows["next", "reward"] * reward_scale,
        terminated=terminated,
        truncated=ends[:, None] & ~terminated,
        learned=torch.ones(num, 1, dtype=torch.bool),
        expert_action=torch.full((num, 1), NO_ACTION),
        opponent=torch.full((num, 1), NO_OPPONENT, dtype=torch.int16),
        final_step=ends.nonzero()[:, 0],
        final_observation=rows[NEXT_OBSERVATION][ends],
        final_action_mask=rows[NEXT_ACTION_MASK][ends],
        other_actions=rows[OTHER_ACTIONS][:, None] if num_others else None,
    )
