"""Checks of the fields of scenarios; errors name game, field, value and range."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np

from marl_cair.lookup import UnknownNameError, UnknownOptionError, find_by_name

Scenario = TypeVar("Scenario")

MAX_TICKS_PER_STEP = 100
MAX_TICKS = 1_000_000  # time limit of any game


def change_scenario(game: str, scenario: Scenario, options: dict[str, Any]) -> Scenario:
    """The scenario with other values of the fields that `options` name.

    A scenario with fields that follow others has `follow(options)`, which adds those to `options`.

    Raises:
        UnknownOptionError: no such field; names the nearest.
        ValueError: a value is not allowed.
    """
    fields = {field.name: field for field in dataclasses.fields(scenario)}  # type: ignore[arg-type]
    for option in options:
        try:
            find_by_name(f"{game} option", option, fields)
        except UnknownNameError as error:
            # TorchRL looks for these words, which are Python's own.
            raise UnknownOptionError(f"{error} (unexpected keyword argument {option!r})") from None
    follow: Callable[[dict[str, Any]], dict[str, Any]] = getattr(scenario, "follow", dict)
    return dataclasses.replace(scenario, **follow(options)) if options else scenario  # type: ignore[type-var]


def restore_fields(options: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a scenario from JSON: lists become tuples again."""
    return {name: _freeze(value) for name, value in options.items()}


def _freeze(value: Any) -> Any:
    return tuple(map(_freeze, value)) if isinstance(value, list) else value


def check_whole_number(game: str, scenario: Any, field: str, low: int, high: int) -> None:
    """Raise ValueError unless the field is a whole number in low..high (not True); NumPy's become
    Python's own.
    """
    value = getattr(scenario, field)
    if not _is_whole(value) or not low <= value <= high:
        raise ValueError(
            f"{game}: {field} is {value!r}, it must be a whole number in {low}..{high}"
        )
    _keep(scenario, field, int(value))


def read_whole_numbers(scenario: Any, field: str) -> tuple[int, ...] | None:
    """The whole numbers of a field, which becomes a tuple; None if it holds anything else."""
    value = getattr(scenario, field)
    try:
        numbers = tuple(value)
    except TypeError:
        return None
    if isinstance(value, str) or not all(map(_is_whole, numbers)):
        return None
    whole = tuple(map(int, numbers))
    _keep(scenario, field, whole)
    return whole


def read_number(scenario: Any, field: str) -> float | None:
    """The finite number in a field, which becomes Python's own; else None (also for True)."""
    value = getattr(scenario, field)
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        return None
    number = int(value) if isinstance(value, Integral) else float(value)
    _keep(scenario, field, number)
    return number


def check_switch(game: str, scenario: Any, field: str) -> None:
    """Raise ValueError unless the scenario's field is True or False."""
    value = getattr(scenario, field)
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{game}: {field} is {value!r}, it must be True or False")
    _keep(scenario, field, bool(value))


def check_time(game: str, scenario: Any) -> None:
    """Check `ticks_per_step` and `max_ticks`. Raises as `check_whole_number`."""
    check_whole_number(game, scenario, "ticks_per_step", 1, MAX_TICKS_PER_STEP)
    check_whole_number(game, scenario, "max_ticks", scenario.ticks_per_step, MAX_TICKS)


def check_shaping_discount(game: str, scenario: Any) -> None:
    """Raise ValueError unless `shaping_discount` is above 0 and at most 1."""
    value = scenario.shaping_discount
    discount = read_number(scenario, "shaping_discount")
    if discount is None or not 0.0 < discount <= 1.0:
        raise ValueError(
            f"{game}: shaping_discount is {value!r}, it must be above 0 and at most 1 (the "
            "discount of the learner that uses the rewards)"
        )


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _keep(scenario: Any, field: str, value: Any) -> None:
    """Set a field of a frozen dataclass while it is made."""
    object.__setattr__(scenario, field, value)
