"""Steps are drawn in proportion to their TD errors, and weights undo that where they are to."""

import numpy as np
import pytest
import torch
from scipy.stats import chisquare

from marl_cair.replay import (
    EpisodeStorage,
    GeneratedReplay,
    MixedReplay,
    PrioritizedSampler,
    ReplayConfig,
    UniformSampler,
    make_replay_buffer,
)
from marl_cair.replay.prioritized import find_slots, set_priorities
from tests.replay.streams import SMALL, make_rollout, make_transitions

CAPACITY = 60


def fill_storage(num_rollouts: int = 5, end_rate: float = 0.2) -> EpisodeStorage:
    storage = EpisodeStorage(SMALL, CAPACITY)
    rng = np.random.default_rng(1)
    for _ in range(num_rollouts):
        storage.append(make_rollout(rng, 8, 3, end_rate=end_rate))
    return storage


def rate_all(sampler: PrioritizedSampler, storage: EpisodeStorage, seed: int = 3) -> np.ndarray:
    """Give all steps errors of their own; returns the priorities [capacity] that follow."""
    sampler.sample(storage, 1)  # takes note of what is stored
    errors = np.random.default_rng(seed).exponential(size=CAPACITY).astype(np.float32)
    steps = storage.sampleable_slots()
    sampler.update_priority(steps, torch.from_numpy(errors)[steps])
    priorities = np.zeros(CAPACITY)
    priorities[steps] = (errors[steps].astype(np.float64) + 1e-3) ** sampler.alpha
    return priorities


@pytest.mark.parametrize("alpha", [0.4, 1.0])
@pytest.mark.parametrize("batch_size", [1, 16])
def test_draws_are_in_proportion_to_the_errors(alpha, batch_size):
    storage = fill_storage()
    sampler = PrioritizedSampler(5, CAPACITY, alpha)
    priorities = rate_all(sampler, storage)
    num_batches = 32_000 // batch_size
    draws = torch.cat([sampler.sample(storage, batch_size)[0] for _ in range(num_batches)])
    counts = np.bincount(draws, minlength=CAPACITY)
    slots = storage.sampleable_slots().numpy()
    assert counts.sum() == counts[slots].sum()
    expected = priorities[slots] / priorities[slots].sum() * counts.sum()
    # Draws from each n-th of the sum vary less than independent ones.
    assert chisquare(counts[slots], expected).pvalue > 0.01


def test_weights_undo_the_draw_as_far_as_beta_says():
    storage = fill_storage()
    sampler = PrioritizedSampler(5, CAPACITY, alpha=0.7, beta=0.4)
    priorities = rate_all(sampler, storage)
    shares = priorities / sampler._sums[1]  # of rows that cannot be sampled a little is left over
    for done, beta in ((0.0, 0.4), (0.5, 0.7), (1.0, 1.0), (3.0, 1.0)):
        sampler.anneal(done)
        slots, info = sampler.sample(storage, 64)
        wanted = (storage.num_sampleable * shares[slots.numpy()]) ** -beta
        assert info["priority_weight"].dtype == torch.float32
        assert np.allclose(info["priority_weight"], wanted / wanted.max(), rtol=1e-5)
    values = np.random.default_rng(2).normal(size=CAPACITY)
    drawn = [sampler.sample(storage, 64) for _ in range(500)]
    slots = np.concatenate([one.numpy() for one, _ in drawn])
    weighted = np.average(values[slots], weights=1.0 / priorities[slots])
    assert weighted == pytest.approx(values[storage.sampleable_slots()].mean(), abs=0.03)


def test_new_steps_have_the_highest_priority_and_old_ones_are_forgotten():
    storage = fill_storage(1)
    sampler = PrioritizedSampler(5, CAPACITY, alpha=1.0)
    first = sampler.sample(storage, 1)[0]
    sampler.update_priority(first, torch.tensor([-8.0]))  # of either sign
    rng = np.random.default_rng(4)
    written = storage.append(make_rollout(rng, 4, 3, end_rate=0.5, learned_rate=1.1))
    sampler.sample(storage, 1)
    leaves = sampler._export()["priorities"]
    assert np.allclose(leaves[written], 8.0 + 1e-3)
    for _ in range(20):  # wherever the ring stands, its leaves are of what it holds now
        storage.append(make_rollout(rng, 5, 3, end_rate=0.3))
        slots = sampler.sample(storage, 30)[0]
        assert storage.is_sampleable(slots).all()
        sampler.update_priority(slots, torch.zeros(len(slots)))
        leaves = sampler._export()["priorities"]
        is_step = storage.is_step(torch.arange(len(storage))).numpy()
        assert (leaves[: len(storage)][is_step] > 0).all()
        assert (leaves[: len(storage)][~is_step] == 0).all()
        assert sampler._sums[1] == pytest.approx(leaves.sum())


@pytest.mark.parametrize("capacity", [2, 3, 64, 100])
def test_places_of_the_sum_lie_in_the_slots_of_a_running_total(capacity):
    rng = np.random.default_rng(capacity)
    priorities = rng.exponential(size=capacity) * (rng.random(capacity) < 0.7)
    priorities[0] = 1.0
    leaves = 1 << (capacity - 1).bit_length()
    sums = np.zeros(2 * leaves)
    set_priorities(sums, np.arange(capacity), priorities)
    places = rng.random(500) * sums[1]
    wanted = np.searchsorted(np.cumsum(priorities), places, side="right")
    assert (find_slots(sums, places) == wanted).all()
    beyond = find_slots(sums, np.array([sums[1], sums[1] * 1.001]))
    assert (priorities[beyond] > 0.0).all()


def test_errors_that_are_no_numbers_do_no_harm():
    storage = fill_storage()
    sampler = PrioritizedSampler(5, CAPACITY)
    slots = sampler.sample(storage, 4)[0]
    sampler.update_priority(slots, torch.tensor([float("nan"), float("inf"), 1.0, -1.0]))
    slots, info = sampler.sample(storage, 50)
    assert torch.isfinite(info["priority_weight"]).all()
    assert np.isfinite(sampler._sums).all()


def test_an_empty_storage_is_refused():
    with pytest.raises(RuntimeError, match="no transition to sample yet"):
        PrioritizedSampler(0, CAPACITY).sample(EpisodeStorage(SMALL, CAPACITY), 1)


@pytest.mark.parametrize("name", ["alpha", "beta"])
@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_exponents_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=rf"{name} is .*, expected 0\.\.1"):
        PrioritizedSampler(0, 10, **{name: value})


def make_buffer(seed: int = 0, capacity: int = CAPACITY):
    config = ReplayConfig(capacity, batch_size=16, n_steps=2, priority_alpha=0.6, seed=seed)
    return make_replay_buffer(config, SMALL)


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_restored_buffer_draws_on_with_the_same_bits(tmp_path, on_disk):
    rng = np.random.default_rng(0)
    buffer, copy = make_buffer(), make_buffer(seed=9)
    for _ in range(4):
        buffer.extend_rollout(make_rollout(rng, 9, 3))
        rows = buffer.sample(8)
        buffer.update_priority(rows["index"], torch.randn(8))
    if on_disk:
        buffer.save(tmp_path / "replay")
        copy.load(tmp_path / "replay")
    else:
        copy.load_state_dict(buffer.state_dict())
    rollouts = [make_rollout(rng, 9, 3) for _ in range(3)]
    errors = torch.randn(3, 16)
    for rollout, error in zip(rollouts, errors, strict=True):
        drawn = []
        for one in (buffer, copy):
            one.extend_rollout(rollout)
            rows = one.sample()
            one.update_priority(rows["index"], error)
            drawn.append((rows["index"], rows["priority_weight"]))
        assert torch.equal(drawn[0][0], drawn[1][0])
        assert torch.equal(drawn[0][1], drawn[1][1])


def test_a_state_of_another_capacity_is_refused():
    state = make_buffer().state_dict()["sampler"]
    with pytest.raises(ValueError, match="priorities are of 60 entries, this replay has 61"):
        PrioritizedSampler(0, 61).load_state_dict(state)


def test_the_generator_still_learns_from_even_draws():
    buffer = make_buffer()
    buffer.extend_rollout(make_rollout(np.random.default_rng(0), 18, 3, end_rate=0.05))
    first = buffer.sample(1)
    buffer.update_priority(first["index"], torch.tensor([1e6]))
    assert (buffer.sample(100)["index"] == first["index"]).float().mean() > 0.9
    drawn = torch.cat([buffer.sample_steps(100)["index"] for _ in range(300)])
    counts = torch.bincount(drawn, minlength=CAPACITY)[buffer.storage.sampleable_slots()]
    assert chisquare(counts.numpy()).pvalue > 0.01


def test_without_priorities_nothing_is_weighted():
    buffer = make_replay_buffer(ReplayConfig(CAPACITY), SMALL)
    assert type(buffer.sampler) is UniformSampler
    buffer.extend_rollout(make_rollout(np.random.default_rng(0), 8, 3))
    rows = buffer.sample(4)
    assert "priority_weight" not in rows
    buffer.update_priority(rows["index"], torch.ones(4))  # does not count


def test_generated_rows_keep_their_share_of_the_loss_and_get_no_priority():
    buffer = make_buffer()
    rng = np.random.default_rng(0)
    buffer.extend_rollout(make_rollout(rng, 18, 3, end_rate=0.05))
    rows = buffer.sample(16)
    buffer.update_priority(rows["index"], torch.rand(16))
    generated = GeneratedReplay(SMALL, capacity=20, seed=3)
    generated.extend(make_transitions(rng, 20))
    mixture = MixedReplay(buffer, generated, 0.25)
    batch = mixture.sample(40)
    weights, is_generated = batch["priority_weight"], batch["is_generated"].flatten()
    assert weights[is_generated].sum() == pytest.approx(float(weights.sum()) / 4)
    assert len(set(weights[~is_generated].tolist())) > 5
    batch["td_error"] = torch.where(is_generated, 1e4, 4.0)[:, None]  # squares, as TorchRL's
    mixture.note_errors(batch, done=1.0)
    leaves = buffer.sampler._export()["priorities"]
    assert np.allclose(leaves[batch["index"][~is_generated]], (2.0 + 1e-3) ** 0.6)
    assert leaves.max() < 2.0
    assert buffer.sampler.beta == 1.0
