"""Arrays whose memory is reused when no view of them is left, and never before."""

import gc

import numpy as np
import torch

from marl_cair.games.torchrl_env import MAX_SPARE, ArrayPool


def address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def test_memory_returns_when_the_last_view_is_gone():
    pool = ArrayPool()
    array = pool.take((3, 4), np.uint8)
    first = address(array)
    tensor = torch.from_numpy(array)[1:]
    del array
    gc.collect()
    other = pool.take((3, 4), np.uint8)
    assert address(other) != first
    tensor[:] = 7
    other[:] = 1
    assert tensor.eq(7).all()
    del tensor
    gc.collect()
    assert address(pool.take((3, 4), np.uint8)) == first


def test_shapes_and_types_are_kept_apart():
    pool = ArrayPool()
    for shape, dtype in (((2, 3), np.uint8), ((3, 2), np.uint8), ((2, 3), np.bool_)):
        array = pool.take(shape, dtype)
        assert array.shape == shape
        assert array.dtype == dtype


def test_no_more_than_a_bounded_number_is_kept():
    pool = ArrayPool()
    held = [pool.take((2,), np.uint8) for _ in range(MAX_SPARE + 5)]
    held.clear()
    gc.collect()
    assert [len(spare) for spare in pool._spare.values()] == [MAX_SPARE]
