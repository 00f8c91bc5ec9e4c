"""The generator on Deep Line Wars: learns for minutes, so only `make test-all` runs it."""

import numpy as np
import pytest
import torch

from marl_cair import make_engine
from marl_cair.games.randomness import episode_seeds
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.replay.transition import check_transitions
from tests.generative.plane_game import pack_rows

NUM_WORLDS = 64


def read_spec(engine):
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


def choose_actions(masks, groups, random):
    """Random legal actions; units far more often than towers, so that games end."""
    is_group = np.eye(groups.max() + 1)[groups]
    sizes = np.maximum((masks @ is_group) @ is_group.T, 1.0)
    weights = masks / sizes * np.where(groups > 4, 0.1, 1.0)
    levels = random.random((*masks.shape[:2], 1)) * weights.sum(-1, keepdims=True)
    return (weights.cumsum(-1) <= levels).sum(-1)


def play_randomly(engine, num_steps):
    """Transitions [B * num_steps] of the first seat."""
    random = np.random.default_rng(0)
    worlds, episodes = np.arange(NUM_WORLDS), np.zeros(NUM_WORLDS, np.int64)
    engine.reset(episode_seeds(0, worlds, episodes))
    steps = []
    for _ in range(num_steps):
        now, mask = engine.observe("planes").copy(), engine.action_mask().copy()
        actions = choose_actions(mask, engine.spec.action_groups, random)
        engine.step(actions.astype(np.int32))
        done = engine.terminated | engine.truncated
        later, next_mask = engine.observe("planes").copy(), engine.action_mask().copy()
        arrays = now, actions, later, engine.rewards.copy(), engine.terminated[:, None].copy()
        masks = torch.from_numpy(mask[:, 0]), torch.from_numpy(next_mask[:, 0])
        steps.append(pack_rows(*(torch.from_numpy(array)[:, 0] for array in arrays), masks))
        steps[-1]["next", "done"] = torch.from_numpy(done)[:, None]
        episodes[done] += 1
        engine.reset(episode_seeds(0, worlds, episodes), done)
    rows = torch.cat(steps)
    rows["index"] = torch.arange(len(rows))
    return rows


@pytest.mark.slow
def test_gate_opens_on_deep_line_wars_within_3000_updates():
    engine = make_engine("deep_line_wars", "10x15", NUM_WORLDS, reward="shaped")
    rows, spec = play_randomly(engine, 300), read_spec(engine)
    generator = CCDNGenerator(GeneratorConfig(), spec)
    generator.observe(rows)
    assert not generator.evaluate().passed
    draws = torch.Generator().manual_seed(0)
    passed = []
    for _ in range(6):
        for _ in range(500):
            generator.update(rows[torch.randint(rows.shape[0], (64,), generator=draws)])
        passed.append(generator.evaluate().passed)
    assert passed.index(True) <= 4
    assert all(passed[passed.index(True) :])  # it stays open
    made = generator.generate(rows, 200)
    check_transitions(made, spec.transition)
    assert made.shape[0] > 150
