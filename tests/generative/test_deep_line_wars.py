"""The generator on the real game: minutes of learning, so only `make test-all` runs it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from marl_cair import make_engine
from marl_cair.games.randomness import episode_seeds
from marl_cair.generative import CCDNGenerator, GeneratorConfig, GeneratorSpec
from marl_cair.replay.transition import NO_ACTION, check_transitions

NUM_WORLDS = 64


def read_spec(engine: Any) -> GeneratorSpec:
    spec = engine.spec
    planes = spec.representations["planes"]
    return GeneratorSpec(
        observation_shape=planes.shape,
        num_actions=engine.num_actions,
        num_uniform=planes.num_uniform,
        noop_action=spec.noop_action,
        action_kinds=spec.action_groups,
        action_cells=spec.action_cells,
        reward_range=(-spec.reward_bound, spec.reward_bound),
        static_planes=tuple(spec.static_planes),
        exclusive_plane_groups=tuple(spec.exclusive_planes),
        event_plane_groups=((6, 7, 8, 9, 14), (10, 11, 12, 13, 15)),
    )


def choose_actions(masks: Any, groups: Any, random: np.random.Generator) -> Any:
    """Random legal actions; units far more often than towers, so that games end."""
    is_group = np.eye(groups.max() + 1)[groups]
    sizes = np.maximum((masks @ is_group) @ is_group.T, 1.0)
    weights = masks / sizes * np.where(groups > 4, 0.1, 1.0)
    levels = random.random((*masks.shape[:2], 1)) * weights.sum(-1, keepdims=True)
    return (weights.cumsum(-1) <= levels).sum(-1)


def play_randomly(engine: Any, num_steps: int) -> TensorDict:
    """Transitions [B * num_steps] of the first seat."""
    random = np.random.default_rng(0)
    worlds, episodes = np.arange(NUM_WORLDS), np.zeros(NUM_WORLDS, np.int64)
    engine.reset(episode_seeds(0, worlds, episodes))
    steps = []
    for _ in range(num_steps):
        before = engine.observe("planes").copy(), engine.action_mask().copy()
        actions = choose_actions(before[1], engine.spec.action_groups, random)
        engine.step(actions.astype(np.int32))
        ends = engine.terminated.copy()
        done = ends | engine.truncated
        parts = {
            "observation": before[0][:, 0],
            "action_mask": before[1][:, 0],
            "action": actions[:, 0],
            "next": {
                "observation": engine.observe("planes")[:, 0].copy(),
                "action_mask": engine.action_mask()[:, 0].copy(),
                "reward": engine.rewards[:, :1].copy(),
                "terminated": ends[:, None],
                "done": done[:, None],
            },
            "steps_to_next_obs": np.ones((NUM_WORLDS, 1), np.int64),
            "is_generated": np.zeros((NUM_WORLDS, 1), bool),
            "expert_action": np.full(NUM_WORLDS, NO_ACTION),
            "opponent": np.zeros(NUM_WORLDS, np.int16),
            "index": worlds + NUM_WORLDS * len(steps),
        }
        steps.append(TensorDict(parts, batch_size=[NUM_WORLDS]))
        episodes[done] += 1
        engine.reset(episode_seeds(0, worlds, episodes), done)
    return torch.cat(steps)


@pytest.mark.slow
def test_gate_opens_on_deep_line_wars_within_3000_updates() -> None:
    engine = make_engine("deep_line_wars", "10x15", NUM_WORLDS, reward="shaped")
    rows, spec = play_randomly(engine, 300), read_spec(engine)
    generator = CCDNGenerator(GeneratorConfig(), spec)
    generator.observe(rows)
    assert not generator.evaluate().passed
    draws = torch.Generator().manual_seed(0)
    for _ in range(3000):
        generator.update(rows[torch.randint(rows.shape[0], (64,), generator=draws)])
    report = generator.evaluate()
    assert report.reasons == ()
    made = generator.generate(rows, 200)
    check_transitions(made, spec.transition)
    assert made.shape[0] > 150
