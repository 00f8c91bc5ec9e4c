"""Random rollouts, and a slow replay on Python lists that the fast one must equal."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from marl_cair.replay.rollout import Rollout
from marl_cair.replay.transition import NO_ACTION, TransitionSpec

SMALL = TransitionSpec((5, 2, 3), num_actions=11, num_uniform=2)


def make_rollout(
    rng: np.random.Generator,
    num_steps: int,
    num_streams: int,
    spec: TransitionSpec = SMALL,
    end_rate: float = 0.3,
    learned_rate: float = 0.9,
) -> Rollout:
    """Make random legal steps; `end_rate` of them terminate and as many are truncated."""
    shape = (num_steps, num_streams)
    truncated, terminated = (rng.random(shape) < end_rate for _ in range(2))
    final_step = np.flatnonzero(truncated | terminated)
    mask = make_masks(rng, (*shape,), spec)
    first_legal = mask.numpy().argmax(-1)
    return Rollout(
        observation=make_observations(rng, shape, spec),
        action_mask=mask,
        action=torch.from_numpy(np.argmax(rng.random(mask.shape) * mask.numpy(), axis=-1)),
        reward=torch.from_numpy(rng.normal(size=shape).astype(np.float32)),
        terminated=torch.from_numpy(terminated),
        truncated=torch.from_numpy(truncated),
        learned=torch.from_numpy(rng.random(shape) < learned_rate),
        expert_action=torch.from_numpy(np.where(rng.random(shape) < 0.2, first_legal, NO_ACTION)),
        opponent=torch.from_numpy(rng.integers(-1, 9, shape).astype(np.int16)),
        final_step=torch.from_numpy(final_step),
        final_observation=make_observations(rng, final_step.shape, spec),
        final_action_mask=make_masks(rng, final_step.shape, spec),
    )


def make_observations(
    rng: np.random.Generator, batch: tuple[int, ...], spec: TransitionSpec
) -> torch.Tensor:
    """Make observations [*batch, *shape] whose last planes are uniform."""
    shape = spec.observation_shape
    if spec.observation_dtype != torch.uint8:
        values = rng.normal(size=(*batch, *shape))
        return torch.from_numpy(values).to(spec.observation_dtype)
    planes = rng.integers(0, 256, (*batch, *shape), dtype=np.uint8)
    first_uniform = shape[0] - spec.num_uniform
    tail = planes[..., first_uniform:, :, :]
    tail[...] = tail[..., :1, :1]
    return torch.from_numpy(planes)


def make_masks(
    rng: np.random.Generator, batch: tuple[int, ...], spec: TransitionSpec
) -> torch.Tensor:
    """Make masks [*batch, A] with at least one legal action."""
    mask = rng.random((*batch, spec.num_actions)) < 0.4
    mask[..., 0] |= ~mask.any(axis=-1)
    return torch.from_numpy(mask)


def make_transitions(
    rng: np.random.Generator, num_rows: int, spec: TransitionSpec = SMALL
) -> TensorDict:
    """Make whole random one-step transitions, without labels."""
    mask = make_masks(rng, (num_rows,), spec)
    terminated = torch.from_numpy(rng.random((num_rows, 1)) < 0.3)
    following = {
        "observation": make_observations(rng, (num_rows,), spec),
        "action_mask": make_masks(rng, (num_rows,), spec),
        "reward": torch.from_numpy(rng.normal(size=(num_rows, 1)).astype(np.float32)),
        "terminated": terminated,
        "done": terminated.clone(),
    }
    return TensorDict(
        {
            "observation": make_observations(rng, (num_rows,), spec),
            "action_mask": mask,
            "action": torch.argmax(mask.long(), dim=1),
            "next": TensorDict(following, [num_rows]),
        },
        [num_rows],
    )


def assert_same_rows(first: TensorDict, second: TensorDict) -> None:
    """Assert that both hold the same keys with the same dtypes and bits."""
    keys = set(first.keys(include_nested=True, leaves_only=True))
    assert keys == set(second.keys(include_nested=True, leaves_only=True))
    for key in keys:
        assert first[key].dtype == second[key].dtype, key
        assert torch.equal(first[key], second[key]), key


@dataclass
class Episode:
    """Consecutive stored steps of one stream, and how they ended."""

    steps: list[dict[str, Any]] = field(default_factory=list)
    final: tuple[torch.Tensor, torch.Tensor] | None = None  # what its last step led to
    is_over: bool = False


class ListReplay:
    """The slow, clear replay: episodes as lists of steps, each with the number of its entry."""

    def __init__(self, capacity: int, n_steps: int, gamma: float) -> None:
        self.capacity = capacity
        self.n_steps = n_steps
        self.gamma = gamma
        self.num_written = 0
        self.episodes: list[Episode] = []
        self.running: dict[int, Episode] = {}

    def append(self, rollout: Rollout) -> list[int]:
        """Store the learned steps; return their slots."""
        num_steps, num_streams = rollout.action.shape
        slots = []
        for t in range(num_steps):
            for s in range(num_streams):
                if rollout.learned[t, s]:
                    slots.append(self.append_step(rollout, t, s))
                else:
                    self.running.pop(s, None)
        return slots

    def append_step(self, rollout: Rollout, t: int, s: int) -> int:
        """Store one step in its stream's running episode; return its slot."""
        if s not in self.running:
            self.running[s] = Episode()
            self.episodes.append(self.running[s])
        episode = self.running[s]
        names = ("observation", "action_mask", "action", "reward", "terminated")
        names += ("expert_action", "opponent")
        step = {name: getattr(rollout, name)[t, s].clone() for name in names}
        slot = self.num_written % self.capacity
        episode.steps.append({**step, "entry": self.num_written})
        self.num_written += 1
        if rollout.terminated[t, s] or rollout.truncated[t, s]:
            row = rollout.final_step.tolist().index(t * rollout.num_streams + s)
            episode.final = (rollout.final_observation[row], rollout.final_action_mask[row])
            episode.is_over = True
            self.num_written += 1  # the tail
        if episode.is_over:
            del self.running[s]
        return slot

    def transitions(self) -> dict[int, dict[Any, Any]]:
        """Return the fields of each transition that can be sampled, by slot."""
        rows = {}
        for episode in self.episodes:
            for position, step in enumerate(episode.steps):
                is_there = step["entry"] >= self.num_written - self.capacity
                has_end = episode.is_over or position + 1 < len(episode.steps)
                if is_there and has_end:
                    rows[step["entry"] % self.capacity] = self.join(episode, position)
        return rows

    def join(self, episode: Episode, position: int) -> dict[Any, Any]:
        """Join up to n_steps steps from `position` on."""
        complete = len(episode.steps) if episode.is_over else len(episode.steps) - 1
        chain = episode.steps[position : min(position + self.n_steps, complete)]
        last = position + len(chain) - 1
        is_end = last == len(episode.steps) - 1
        terminated = bool(chain[-1]["terminated"])
        if is_end:
            assert episode.final is not None
            reached = episode.final
        else:
            following = episode.steps[last + 1]
            reached = (following["observation"], following["action_mask"])
        reward = sum(self.gamma**k * float(step["reward"]) for k, step in enumerate(chain))
        return {
            "observation": chain[0]["observation"],
            "action_mask": chain[0]["action_mask"],
            "action": chain[0]["action"],
            ("next", "observation"): reached[0],
            ("next", "action_mask"): reached[1],
            ("next", "reward"): torch.tensor([reward], dtype=torch.float32),
            ("next", "terminated"): torch.tensor([terminated]),
            ("next", "done"): torch.tensor([is_end]),
            "steps_to_next_obs": torch.tensor([len(chain)]),
            "is_generated": torch.tensor([False]),
            "expert_action": chain[0]["expert_action"],
            "opponent": chain[0]["opponent"],
        }
