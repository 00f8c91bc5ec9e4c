"""Rings of real transitions."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from marl_cair.generative.heldout import TransitionRing
from tests.generative.plane_game import SPEC


def held(ring: TransitionRing) -> TensorDict:
    return ring.select(torch.arange(ring.num_rows))


def number(rows: TensorDict, *indices: int) -> TensorDict:
    """The first of `rows`, with these indices, which their rewards tell too."""
    numbered = rows[: len(indices)].clone()
    numbered["index"] = torch.tensor(indices)
    numbered["next", "reward"] = numbered["index"][:, None].float()
    return numbered


@pytest.mark.parametrize("threads", [1, 2])
def test_of_more_rows_than_there_is_room_for_the_last_stay_whole(
    real_rows: TensorDict, threads: int
) -> None:
    """With two threads observation and index came from different rows."""
    torch.set_num_threads(threads)
    ring = TransitionRing(SPEC, 64)
    rows = number(real_rows, *range(3_000))
    ring.add(rows)
    torch.set_num_threads(1)
    assert ring.num_rows == 64
    stored = held(ring)
    assert sorted(stored["index"].tolist()) == list(range(2_936, 3_000))
    for key in (("observation"), ("next", "observation"), ("next", "reward")):
        assert torch.equal(stored[key], rows[key][stored["index"]])


def test_a_row_that_was_pushed_out_meanwhile_is_added_again(real_rows: TensorDict) -> None:
    ring = TransitionRing(SPEC, 3)
    ring.add(number(real_rows, 0, 1, 2))
    ring.add(number(real_rows, 3, 0))  # 3 takes the place of 0
    assert sorted(held(ring)["index"].tolist()) == [0, 2, 3]
    assert torch.equal(held(ring)["next", "reward"].flatten(), held(ring)["index"].float())


def test_a_newer_copy_takes_the_place_of_the_older(real_rows: TensorDict) -> None:
    ring = TransitionRing(SPEC, 3)
    ring.add(number(real_rows, 0, 1))
    newer = number(real_rows, 1)
    newer["next", "reward"].fill_(0.5)
    ring.add(newer)
    assert held(ring)["index"].tolist() == [0, 1]
    assert held(ring)["next", "reward"].flatten().tolist() == [0.0, 0.5]
