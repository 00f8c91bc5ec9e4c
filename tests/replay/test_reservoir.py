"""The reservoir is a uniform sample of all rows, in whatever batches they came; exact resume."""

import numpy as np
import pytest
import torch

from marl_cair.replay.reservoir import Reservoir
from marl_cair.replay.transition import ACTION, ACTION_MASK, OBSERVATION, TransitionSpec

PLANES = TransitionSpec((3, 2, 4), num_actions=11, num_uniform=2)
VECTOR = TransitionSpec((5,), 3, 0, torch.float32)


def make_rows(spec, numbers):
    """Rows whose observation holds their number."""
    numbers = torch.as_tensor(numbers)
    shape = (len(numbers), *spec.observation_shape)
    seen = numbers.to(spec.observation_dtype).reshape(-1, *[1] * (len(shape) - 1)).expand(shape)
    seen = seen.clone()
    if spec.num_uniform:
        seen[:, 0] = torch.arange(8, dtype=torch.uint8).reshape(2, 4)
        seen[:, 2] = 255 - seen[:, 1]
    mask = torch.arange(spec.num_actions) != (numbers[:, None] + 1) % spec.num_actions
    return seen, mask, numbers % spec.num_actions


def numbers_in(reservoir, rows=4_000):
    return sorted(set(reservoir.sample(rows)[OBSERVATION].flatten(1)[:, -1].tolist()))


@pytest.mark.parametrize("spec", [PLANES, VECTOR], ids=["planes", "vector"])
def test_sampled_rows_equal_the_added_ones(spec):
    reservoir = Reservoir(spec, 100, 0)
    seen, mask, action = make_rows(spec, range(60))
    reservoir.extend(seen, mask, action)
    sampled = reservoir.sample(500)
    number = seen.flatten(1)[:, 4 if spec is VECTOR else 8]
    for row in sampled:
        at = int((number == row[OBSERVATION].flatten()[4 if spec is VECTOR else 8]).nonzero()[0])
        assert torch.equal(row[OBSERVATION], seen[at])
        assert torch.equal(row[ACTION_MASK], mask[at])
        assert row[ACTION] == action[at]
    assert sampled[OBSERVATION].dtype == spec.observation_dtype


@pytest.mark.slow
def test_every_row_is_kept_with_the_same_chance():
    """200 rows into 50 places: each is kept in a quarter of the trials, early or late."""
    kept = np.zeros(200)
    seen, mask, action = make_rows(VECTOR, range(200))
    for seed in range(2_000):
        reservoir = Reservoir(VECTOR, 50, seed)
        for start in range(0, 200, 40):
            part = slice(start, start + 40)
            reservoir.extend(seen[part], mask[part], action[part])
        np.add.at(kept, reservoir._rows.view(np.float32)[:, 0].astype(int), 1)
    expected, deviation = 500.0, (2_000 * 0.25 * 0.75) ** 0.5
    assert kept.sum() == 2_000 * 50
    assert np.abs(kept - expected).max() < 4.5 * deviation
    chi_square = (((kept - expected) / deviation) ** 2).sum() * 199 / 200
    assert 140 < chi_square < 265  # 99.9 % of a chi-square of 199


def test_batches_make_no_difference():
    whole, parts = Reservoir(VECTOR, 7, 3), Reservoir(VECTOR, 7, 3)
    rows = make_rows(VECTOR, range(50))
    whole.extend(*rows)
    for at in range(50):
        parts.extend(*(value[at : at + 1] for value in rows))
    assert (whole._rows == parts._rows).all()
    assert whole.num_seen == parts.num_seen == 50
    assert len(whole) == 7


def test_a_saved_reservoir_continues_with_the_same_bits(tmp_path):
    first, rows = Reservoir(PLANES, 20, 1), make_rows(PLANES, range(90))
    first.extend(*(value[:45] for value in rows))
    first.sample(8)
    first.save(tmp_path / "rows")
    again = Reservoir(PLANES, 20, 99)
    again.load(tmp_path / "rows")
    for reservoir in (first, again):
        reservoir.extend(*(value[45:] for value in rows))
    assert (first._rows == again._rows).all()
    assert torch.equal(first.sample(30)[OBSERVATION], again.sample(30)[OBSERVATION])


def test_invalid_rows_and_layouts_are_refused(tmp_path):
    with pytest.raises(ValueError, match="capacity is 0, it must be 1 or more"):
        Reservoir(VECTOR, 0, 0)
    reservoir = Reservoir(VECTOR, 4, 0)
    with pytest.raises(RuntimeError, match="the reservoir is empty"):
        reservoir.sample(1)
    seen, mask, action = make_rows(VECTOR, range(3))
    with pytest.raises(ValueError, match=r"observation is float64 .3, 5."):
        reservoir.extend(seen.double(), mask, action)
    with pytest.raises(ValueError, match="an action that its mask does not allow"):
        reservoir.extend(seen, ~mask, action)
    reservoir.extend(seen, mask, action)
    reservoir.save(tmp_path / "rows")
    with pytest.raises(ValueError, match=r"reservoir has layout \[4, 20, 3\], this one has"):
        Reservoir(VECTOR, 5, 0).load(tmp_path / "rows")
