"""Uniform and prioritised samplers: probabilities, importance weights, and the saved state."""

import numpy as np
import pytest
import torch
from scipy.stats import chisquare

from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.mixed import MixedReplay
from marl_cair.replay.sampler import (
    PrioritizedSampler,
    UniformSampler,
    draw_integers,
    find_slots,
    set_priorities,
)
from marl_cair.replay.storage import EpisodeStorage
from tests.replay.streams import SMALL, make_rollout, make_transitions

CAPACITY = 60


def fill_storage(num_rollouts=5, end_rate=0.2, num_streams=3, num_steps=8) -> EpisodeStorage:
    storage = EpisodeStorage(SMALL, CAPACITY)
    rng = np.random.default_rng(1)
    for _ in range(num_rollouts):
        storage.append(make_rollout(rng, num_steps, num_streams, end_rate=end_rate))
    return storage


def fill_sparsely() -> EpisodeStorage:
    """Most entries have no successor: fewer than half can be sampled."""
    storage = EpisodeStorage(SMALL, 40)
    storage.append(make_rollout(np.random.default_rng(1), 8, 5, end_rate=0.05, learned_rate=0.4))
    assert 2 <= storage.num_sampleable < 0.5 * len(storage)
    return storage


@pytest.mark.parametrize(
    "make_storage",
    [lambda: fill_storage(end_rate=0.1), lambda: fill_storage(5, 0.4, 5), fill_sparsely],
)
def test_uniform_draws_are_uniform_over_the_sampleable_slots_only(make_storage):
    storage = make_storage()
    slots = storage.sampleable_slots()
    sampler = UniformSampler(seed=5)
    draws = torch.stack([sampler.sample(storage, 100)[0] for _ in range(400)])
    for drawn in (draws.flatten(), draws[:, 2]):  # and each place of a batch
        counts = torch.bincount(drawn, minlength=len(storage)).numpy()
        assert counts.sum() == counts[slots].sum()
        assert chisquare(counts[slots]).pvalue > 0.01


def test_the_seed_decides_the_draws_and_the_global_generator_is_not_used():
    storage = fill_storage(end_rate=0.1)
    torch.manual_seed(0)
    before = torch.get_rng_state()
    draws = [UniformSampler(seed).sample(storage, 50)[0].tolist() for seed in (7, 7, 8)]
    assert draws[0] == draws[1] != draws[2]
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("sampler", [UniformSampler(0), PrioritizedSampler(0, 10)])
def test_nothing_is_sampled_before_a_transition_has_its_end(sampler):
    storage, rng = EpisodeStorage(SMALL, 10), np.random.default_rng(0)
    with pytest.raises(RuntimeError, match="no transition to sample yet: the replay holds 0"):
        sampler.sample(storage, 1)
    storage.append(make_rollout(rng, 1, 3, end_rate=0.0, learned_rate=1.1))
    with pytest.raises(RuntimeError, match="holds 3 entries, none of which has a next"):
        sampler.sample(storage, 1)
    storage.append(make_rollout(rng, 1, 3, end_rate=0.0, learned_rate=1.1))
    assert sampler.sample(storage, 1)[0].shape == (1,)


def test_integers_cover_exactly_their_range():
    drawn = draw_integers(7, 10_000, torch.Generator().manual_seed(0))
    assert drawn.dtype == torch.int64
    assert drawn.unique().tolist() == list(range(7))


def set_random_errors(sampler: PrioritizedSampler, storage: EpisodeStorage) -> np.ndarray:
    """Give all steps errors of their own; returns the resulting priorities [capacity]."""
    sampler.sample(storage, 1)  # adds the stored entries
    errors = np.random.default_rng(3).exponential(size=CAPACITY).astype(np.float32)
    steps = storage.sampleable_slots()
    sampler.update(steps, torch.from_numpy(errors)[steps])
    priorities = np.zeros(CAPACITY)
    priorities[steps] = (errors[steps].astype(np.float64) + 1e-3) ** sampler.alpha
    return priorities


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "batch_size"), [(0.4, 16), (1.0, 1), (1.0, 16)])
def test_draws_are_in_proportion_to_the_errors(alpha, batch_size):
    storage = fill_storage()
    sampler = PrioritizedSampler(5, CAPACITY, alpha)
    priorities = set_random_errors(sampler, storage)
    num_batches = 32_000 // batch_size
    draws = torch.cat([sampler.sample(storage, batch_size)[0] for _ in range(num_batches)])
    counts = np.bincount(draws, minlength=CAPACITY)
    slots = storage.sampleable_slots().numpy()
    assert counts.sum() == counts[slots].sum()
    expected = priorities[slots] / priorities[slots].sum() * counts.sum()
    # Draws from each n-th of the sum vary less than independent ones.
    assert chisquare(counts[slots], expected).pvalue > 0.01


def test_weights_undo_the_sampling_bias_by_beta():
    storage = fill_storage()
    sampler = PrioritizedSampler(5, CAPACITY, alpha=0.7, beta=0.4)
    priorities = set_random_errors(sampler, storage)
    shares = priorities / sampler._sums[1]  # the sum includes steps that cannot be sampled yet
    for done, beta in ((0.0, 0.4), (0.5, 0.7), (1.0, 1.0), (3.0, 1.0)):
        sampler.anneal(done)
        slots, info = sampler.sample(storage, 64)
        wanted = (storage.num_sampleable * shares[slots.numpy()]) ** -beta
        assert info["priority_weight"].dtype == torch.float32
        assert np.allclose(info["priority_weight"], wanted / wanted.max(), rtol=1e-5)
    values = np.random.default_rng(2).normal(size=CAPACITY)
    slots = np.concatenate([sampler.sample(storage, 64)[0].numpy() for _ in range(500)])
    weighted = np.average(values[slots], weights=1.0 / priorities[slots])
    assert weighted == pytest.approx(values[storage.sampleable_slots()].mean(), abs=0.03)


def test_new_steps_have_the_highest_priority_and_overwritten_ones_none():
    storage = fill_storage(1)
    sampler = PrioritizedSampler(5, CAPACITY, alpha=1.0)
    first = sampler.sample(storage, 1)[0]
    sampler.update(first, torch.tensor([-8.0]))  # of either sign
    rng = np.random.default_rng(4)
    written = storage.append(make_rollout(rng, 4, 3, end_rate=0.5, learned_rate=1.1))
    sampler.sample(storage, 1)
    assert np.allclose(sampler.priorities[written], 8.0 + 1e-3)
    for _ in range(20):  # at every position of the ring
        storage.append(make_rollout(rng, 5, 3, end_rate=0.3))
        slots = sampler.sample(storage, 30)[0]
        assert storage.is_sampleable(slots).all()
        sampler.update(slots, torch.zeros(len(slots)))
        is_start = storage.is_start(torch.arange(len(storage))).numpy()
        assert ((sampler.priorities[: len(storage)] > 0) == is_start).all()
        assert sampler._sums[1] == pytest.approx(sampler.priorities.sum())


@pytest.mark.parametrize("capacity", [2, 3, 64, 100])
def test_places_of_the_sum_are_in_the_slots_of_a_running_total(capacity):
    rng = np.random.default_rng(capacity)
    priorities = rng.exponential(size=capacity) * (rng.random(capacity) < 0.7)
    priorities[0] = 1.0
    sums = np.zeros(2 << (capacity - 1).bit_length())
    set_priorities(sums, np.arange(capacity), priorities)
    places = rng.random(500) * sums[1]
    wanted = np.searchsorted(np.cumsum(priorities), places, side="right")
    assert (find_slots(sums, places) == wanted).all()
    beyond = find_slots(sums, np.array([sums[1], sums[1] * 1.001]))
    assert (priorities[beyond] > 0.0).all()


def test_errors_that_are_not_finite_count_as_0():
    storage = fill_storage()
    sampler = PrioritizedSampler(5, CAPACITY)
    slots = sampler.sample(storage, 4)[0]
    sampler.update(slots, torch.tensor([float("nan"), float("inf"), 1.0, -1.0]))
    assert torch.isfinite(sampler.sample(storage, 50)[1]["priority_weight"]).all()
    assert np.isfinite(sampler._sums).all()


@pytest.mark.parametrize("name", ["alpha", "beta"])
@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_exponents_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=rf"{name} is .*, expected 0\.\.1"):
        PrioritizedSampler(0, 10, **{name: value})


def make_buffer(seed: int = 0, alpha: float = 0.6):
    config = ReplayConfig(CAPACITY, batch_size=16, n_steps=2, priority_alpha=alpha, seed=seed)
    return make_replay_buffer(config, SMALL)


def test_a_restored_buffer_continues_with_the_same_bits(tmp_path):
    rng = np.random.default_rng(0)
    buffer, copy = make_buffer(), make_buffer(seed=9)
    for _ in range(4):
        buffer.extend_rollout(make_rollout(rng, 9, 3))
        buffer.update_priority(buffer.sample(8)["index"], torch.randn(8), done=0.5)
    buffer.save(tmp_path / "replay")
    copy.load(tmp_path / "replay")
    for error in torch.randn(3, 16):
        rollout, drawn = make_rollout(rng, 9, 3), []
        for one in (buffer, copy):
            one.extend_rollout(rollout)
            rows = one.sample()
            one.update_priority(rows["index"], error, done=0.5)
            drawn.append(rows)
        for key in ("index", "priority_weight"):
            assert torch.equal(drawn[0][key], drawn[1][key])


def test_sample_steps_is_uniform_whatever_the_priorities():
    buffer = make_buffer()
    buffer.extend_rollout(make_rollout(np.random.default_rng(0), 18, 3, end_rate=0.05))
    first = buffer.sample(1)
    buffer.update_priority(first["index"], torch.tensor([1e6]), done=0.0)
    assert (buffer.sample(100)["index"] == first["index"]).float().mean() > 0.9
    drawn = torch.cat([buffer.sample_steps(100)["index"] for _ in range(300)])
    counts = torch.bincount(drawn, minlength=CAPACITY)[buffer.storage.sampleable_slots()]
    assert chisquare(counts.numpy()).pvalue > 0.01


def test_an_alpha_of_0_samples_uniformly_without_weights():
    buffer = make_buffer(alpha=0.0)
    assert type(buffer.sampler) is UniformSampler
    buffer.extend_rollout(make_rollout(np.random.default_rng(0), 8, 3))
    rows = buffer.sample(4)
    assert "priority_weight" not in rows
    buffer.update_priority(rows["index"], torch.ones(4), done=0.0)  # has no effect


def test_generated_rows_keep_their_share_of_the_loss_and_get_no_priority():
    buffer = make_buffer()
    rng = np.random.default_rng(0)
    buffer.extend_rollout(make_rollout(rng, 18, 3, end_rate=0.05))
    buffer.update_priority(buffer.sample(16)["index"], torch.rand(16), done=0.0)
    generated = GeneratedReplay(SMALL, capacity=20, seed=3)
    generated.extend(make_transitions(rng, 20))
    mixture = MixedReplay(buffer, generated, 0.25)
    batch = mixture.sample(40)
    weights, is_generated = batch["priority_weight"], batch["is_generated"].flatten()
    assert weights[is_generated].sum() == pytest.approx(float(weights.sum()) / 4)
    assert len(set(weights[~is_generated].tolist())) > 5
    batch["td_error"] = torch.where(is_generated, 100.0, -2.0)
    mixture.note_errors(batch, done=1.0)
    priorities = buffer.sampler.priorities
    assert np.allclose(priorities[batch["index"][~is_generated]], (2.0 + 1e-3) ** 0.6)
    assert priorities.max() < 2.0
    assert buffer.sampler.beta == 1.0
