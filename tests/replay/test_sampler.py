"""Slots are drawn uniformly from those that start a transition, and from no others."""

import numpy as np
import pytest
import torch
from scipy.stats import chisquare

from marl_cair.replay import EpisodeStorage, UniformSampler
from marl_cair.replay.sampler import draw_integers
from tests.replay.streams import SMALL, make_rollout


def fill_storage(end_rate: float, num_streams: int, capacity: int = 60) -> EpisodeStorage:
    storage = EpisodeStorage(SMALL, capacity)
    rng = np.random.default_rng(1)
    for _ in range(5):
        storage.append(make_rollout(rng, 8, num_streams, end_rate=end_rate))
    return storage


def fill_sparsely() -> EpisodeStorage:
    """Most entries are open ends for ever: fewer than half can be sampled."""
    storage = EpisodeStorage(SMALL, 40)
    rng = np.random.default_rng(1)
    for length in (1, 1, 1, 1, 1, 2):
        storage.append(make_rollout(rng, length, 5, end_rate=0.05, learned_rate=1.1))
        storage.close_streams()
    assert 2 <= storage.num_sampleable < 0.5 * len(storage)
    return storage


@pytest.mark.parametrize(
    "make_storage", [lambda: fill_storage(0.1, 3), lambda: fill_storage(0.4, 5), fill_sparsely]
)
def test_draws_are_uniform_over_the_sampleable_slots_only(make_storage):
    storage = make_storage()
    slots = storage.sampleable_slots()
    sampler = UniformSampler(seed=5)
    draws = torch.cat([sampler.sample(storage, 100)[0] for _ in range(400)])
    counts = torch.bincount(draws, minlength=len(storage)).numpy()
    assert counts.sum() == counts[slots].sum() == 40_000
    assert chisquare(counts[slots]).pvalue > 0.01


def test_each_place_of_a_batch_is_uniform_too():
    storage = fill_storage(0.4, 5)
    sampler = UniformSampler(seed=6)
    last = torch.stack([sampler.sample(storage, 3)[0][2] for _ in range(10_000)])
    counts = torch.bincount(last, minlength=len(storage))[storage.sampleable_slots()]
    assert chisquare(counts.numpy()).pvalue > 0.01


def test_the_same_seed_draws_the_same_slots_and_another_does_not():
    storage = fill_storage(0.1, 3)
    draws = [UniformSampler(seed).sample(storage, 50)[0].tolist() for seed in (7, 7, 8)]
    assert draws[0] == draws[1] != draws[2]


def test_draws_do_not_touch_the_global_generator():
    storage = fill_storage(0.1, 3)
    torch.manual_seed(0)
    before = torch.get_rng_state()
    UniformSampler(0).sample(storage, 10)
    assert torch.equal(torch.get_rng_state(), before)


def test_nothing_is_drawn_before_a_transition_has_its_end():
    storage = EpisodeStorage(SMALL, 10)
    with pytest.raises(RuntimeError, match="no transition to sample yet: the replay holds 0"):
        UniformSampler(0).sample(storage, 1)
    rng = np.random.default_rng(0)
    storage.append(make_rollout(rng, 1, 3, end_rate=0.0, learned_rate=1.1))
    with pytest.raises(RuntimeError, match="holds 3 entries, none of which has a next"):
        UniformSampler(0).sample(storage, 1)
    storage.append(make_rollout(rng, 1, 3, end_rate=0.0, learned_rate=1.1))
    assert UniformSampler(0).sample(storage, 1)[0].shape == (1,)


def test_integers_cover_exactly_their_range():
    drawn = draw_integers(7, 10_000, torch.Generator().manual_seed(0))
    assert drawn.dtype == torch.int64
    assert drawn.unique().tolist() == list(range(7))
