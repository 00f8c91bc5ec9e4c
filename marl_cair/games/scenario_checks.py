"""Checks that the scenarios of all games share; errors name game, field, value and range."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from marl_cair.lookup import find_by_name

Scenario = TypeVar("Scenario")

MAX_TICKS_PER_STEP = 100
MAX_TICKS = 1_000_000  # time limit of any game


def change_scenario(game: str, scenario: Scenario, options: dict[str, Any]) -> Scenario:
    """The scenario with other values of the fields that `options` name.

    Raises:
        UnknownNameError: no such field; names the nearest.
        ValueError: a value is not allowed.
    """
    fields = {field.name: field for field in dataclasses.fields(scenario)}  # type: ignore[arg-type]
    for option in options:
        find_by_name(f"{game} option", option, fields)
    return dataclasses.replace(scenario, **options) if options else scenario  # type: ignore[type-var]


def restore_fields(options: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a scenario that JSON has held: its lists as the tuples that they were."""
    return {name: _freeze(value) for name, value in options.items()}


def _freeze(value: Any) -> Any:
    return tuple(map(_freeze, value)) if isinstance(value, list) else value


def check_whole_number(game: str, scenario: Any, field: str, low: int, high: int) -> None:
    """Raise ValueError unless the scenario's field is an int in low..high (True is none)."""
    value = getattr(scenario, field)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ValueError(
            f"{game}: {field} is {value!r}, it must be a whole number in {low}..{high}"
        )


def check_time(game: str, scenario: Any) -> None:
    """Check `ticks_per_step` and `max_ticks`. Raises as `check_whole_number`."""
    check_whole_number(game, scenario, "ticks_per_step", 1, MAX_TICKS_PER_STEP)
    check_whole_number(game, scenario, "max_ticks", scenario.ticks_per_step, MAX_TICKS)


def check_shaping_discount(game: str, scenario: Any) -> None:
    """Raise ValueError unless `shaping_discount` is above 0 and at most 1."""
    if not 0.0 < scenario.shaping_discount <= 1.0:
        raise ValueError(
            f"{game}: shaping_discount is {scenario.shaping_discount}, it must be above 0 and at "
            "most 1 (the discount of the learner that uses the rewards)"
        )
