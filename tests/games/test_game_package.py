"""What a game's package is filled in with."""

from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game_package import fill_record

Scalar = TypeVar("Scalar")


class Alias(Generic[Scalar]):
    """An annotation that holds the scalar's type alone, as NDArray does from NumPy 2.5 on."""


class Constants(NamedTuple):
    """One field of each kind."""

    speed: float
    number: int
    costs: NDArray[np.uint16]
    gains: Any


class Newer(NamedTuple):
    """An array as NumPy 2.5 annotates it."""

    costs: Alias[np.uint16]


def test_arrays_have_the_dtype_of_their_annotation() -> None:
    filled = fill_record(Constants, speed=2, number=3.0, costs=(5, 6), gains=None)
    assert (filled.speed, filled.number, filled.gains) == (2.0, 3, None)
    assert (type(filled.speed), type(filled.number)) == (float, int)
    np.testing.assert_array_equal(filled.costs, np.array([5, 6], np.uint16), strict=True)


def test_arrays_of_numpy_2_5_have_their_dtype_too() -> None:
    costs = fill_record(Newer, costs=(5, 6)).costs
    np.testing.assert_array_equal(costs, np.array([5, 6], np.uint16), strict=True)
