"""Check values from files against shapes, types and ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST = 1 << 53  # of a count: whole numbers up to it are exact in every format
LARGEST = float(np.finfo(np.float32).max)  # of rewards and the like: finite, and no NaN


class Range(NamedTuple):
    """The allowed values of a stored field: least..greatest, and the type of single numbers."""

    least: float
    greatest: float
    kind: type = int


COUNT = Range(0, MOST)
FLAG = Range(0, 1, bool)
NUMBER = Range(-LARGEST, LARGEST, float)
SCORE = Range(0.0, 1.0, float)
WEIGHT = Range(0.0, LARGEST, float)


def read_number(values: Mapping[Any, Any], name: Any, allowed: Range) -> Any:
    """The single number `name` of `values`; a whole number is a float too. Raises ValueError where
    it is missing, of another type, or out of range.
    """
    if not isinstance(values, Mapping) or name not in values:
        raise ValueError(f"{name} is missing")
    return check_number(values[name], str(name), allowed)


def check_number(value: Any, name: str, allowed: Range) -> Any:
    """`value`, if it is allowed. Raises ValueError that names it."""
    kinds = (int, float) if allowed.kind is float else (allowed.kind,)
    if type(value) not in kinds or not allowed.least <= value <= allowed.greatest:
        raise ValueError(f"{name} is {value!r:.80}, it must be {_describe(allowed.kind, allowed)}")
    return value


def read_array(
    values: Mapping[str, Any],
    name: str,
    like: tuple[np.dtype[Any] | type, tuple[int, ...]],
    allowed: Range | None = None,
) -> NDArray[Any]:
    """The array `name` of `values` (NumPy or torch), not copied.

    like: its dtype and shape. allowed: of its numbers; None: all of the dtype. Bytes other than 0
    and 1 are no booleans. Raises ValueError where it is missing or something else.
    """
    if not isinstance(values, Mapping) or name not in values:
        raise ValueError(f"{name} is missing")
    value = values[name]
    if not isinstance(value, np.ndarray) and not hasattr(value, "numpy"):
        raise ValueError(f"{name} is {value!r:.80}, it must be an array")
    array: NDArray[Any] = value if isinstance(value, np.ndarray) else value.numpy()
    dtype, shape = np.dtype(like[0]), tuple(like[1])
    if array.dtype != dtype or array.shape != shape:
        raise ValueError(
            f"{name} is {array.dtype} {list(array.shape)}, it must be {dtype} {list(shape)}"
        )
    if array.size and dtype == np.bool_:
        check_extremes(array.view(np.uint8), name, FLAG)
    elif array.size and allowed is not None:
        check_extremes(array, name, allowed)
    return array


def check_extremes(array: NDArray[Any], name: str, allowed: Range) -> None:
    """Raise ValueError where a number of the array, of one or more, is out of range or NaN."""
    low, high = array.min().item(), array.max().item()  # NaN, where there is one
    if not allowed.least <= low or not high <= allowed.greatest:
        raise ValueError(
            f"{name} holds {low:g}..{high:g}, it must be {_describe(array.dtype, allowed)}"
        )


def take_arrays(
    values: Mapping[str, Any],
    own: Mapping[str, NDArray[Any]],
    ranges: Mapping[str, Range],
) -> dict[str, NDArray[Any]]:
    """Copies of the arrays of `values` with dtypes and shapes of `own`, by name, each in its range.
    Raises ValueError as `read_array`.
    """
    return {
        name: read_array(values, name, (held.dtype, held.shape), ranges.get(name)).copy()
        for name, held in own.items()
    }


def read_numbers(values: Any, name: str, allowed: Range) -> list[Any]:
    """A list of single numbers. Raises ValueError as `read_number`."""
    if not isinstance(values, list | tuple):
        raise ValueError(f"{name} is {values!r:.80}, it must be a list")
    return [check_number(value, name, allowed) for value in values]


def _describe(kind: Any, allowed: Range) -> str:
    names = {int: "a whole number in ", float: "a number in "}
    if kind is bool:
        return "true or false"
    if allowed.greatest in (LARGEST, math.inf):
        ends = "finite" if allowed.least < 0 else "finite and 0 or more"
        return ends if kind not in names else f"a number, {ends}"
    return f"{names.get(kind, 'in ')}{allowed.least:g}..{allowed.greatest:g}"
