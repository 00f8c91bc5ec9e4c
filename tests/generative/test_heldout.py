"""The split of held-out rows, and rings of real transitions."""

import pytest
import torch

from marl_cair.generative.heldout import TransitionRing, is_heldout
from tests.generative.plane_game import SPEC


def test_held_out_share_is_a_fixed_hash_of_the_index():
    index = torch.arange(50_000)
    held = is_heldout(index, 0.1, seed=3)
    assert float(held.float().mean()) == pytest.approx(0.1, abs=0.006)
    assert torch.equal(held[1000:2000], is_heldout(index[1000:2000], 0.1, seed=3))
    assert not torch.equal(held, is_heldout(index, 0.1, seed=4))
    # Neighbours are independent: a tenth of the held-out rows have a held-out successor.
    assert float(held[1:][held[:-1]].float().mean()) == pytest.approx(0.1, abs=0.02)


def number(rows, *indices):
    """The first of `rows`, with these indices, also as rewards."""
    numbered = rows[: len(indices)].clone()
    numbered["index"] = torch.tensor(indices)
    numbered["next", "reward"] = numbered["index"][:, None].float()
    return numbered


@pytest.mark.parametrize("threads", [1, 2])
def test_a_full_ring_keeps_the_last_rows_whole(real_rows, threads):
    """With two threads observation and index came from different rows."""
    torch.set_num_threads(threads)
    ring = TransitionRing(SPEC, 64)
    rows = number(real_rows, *range(3_000))
    ring.add(rows)
    torch.set_num_threads(1)
    assert ring.num_rows == 64
    stored = ring.select(torch.arange(64))
    assert sorted(stored["index"].tolist()) == list(range(2_936, 3_000))
    for key in (("observation"), ("next", "observation"), ("next", "reward")):
        assert torch.equal(stored[key], rows[key][stored["index"]])


def test_a_ring_holds_the_newest_copy_of_each_index(real_rows):
    ring = TransitionRing(SPEC, 3)
    ring.add(number(real_rows, 0, 1, 2))
    ring.add(number(real_rows, 3, 0))  # 3 overwrites 0, which is added again
    newer = number(real_rows, 2)
    newer["next", "reward"].fill_(0.5)
    ring.add(newer)
    held = ring.select(torch.arange(3))
    found = zip(held["index"].tolist(), held["next", "reward"].flatten().tolist(), strict=True)
    assert sorted(found) == [(0, 0.0), (2, 0.5), (3, 3.0)]
