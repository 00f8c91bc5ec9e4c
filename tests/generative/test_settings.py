"""Numbers that do not fit are refused with their value, what is allowed, and the mend."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from marl_cair.generative import GateConfig, GeneratorConfig, GeneratorSpec
from marl_cair.generative.settings import NetworkSize
from tests.generative.plane_game import NUM_ACTIONS, SPEC


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_uniform": 8}, r"num_uniform is 8, expected 0\.\.7"),
        ({"noop_action": 99}, r"noop_action is 99, expected 0\.\.16"),
        ({"reward_range": (1.0, -1.0)}, r"reward_range is \(1\.0, -1\.0\), expected \(lowest"),
        ({"action_kinds": (0, 1)}, r"action_kinds has 2 entries, expected one for each of the 17"),
        (
            {"action_cells": (35,) * NUM_ACTIONS},
            r"an entry of action_cells is 35, expected -1\.\.34",
        ),
        ({"static_planes": (4,)}, r"plane is 4, expected a spatial plane, 0\.\.3"),
        ({"event_plane_groups": ((0, 7),)}, r"plane is 7, expected a spatial plane"),
    ],
)
def test_spec_refuses(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(SPEC, **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_members": 0}, "num_members is 0, expected 1 or more"),
        ({"heldout_capacity": 7}, "heldout_capacity is 7, expected 8 or more"),
        ({"rare_capacity": 1}, "rare_capacity is 1, expected 2 or more"),
        ({"heldout_share": 1.0}, "heldout_share is 1.0, expected a share above 0 and below 1"),
        ({"counterfactual_share": 1.5}, r"counterfactual_share is 1.5, expected 0\.\.1"),
    ],
)
def test_generator_config_refuses(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GeneratorConfig(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"channels": 0}, "size.channels is 0, expected 1 or more"),
        ({"readout": 8}, "size.factors is 12, expected at most size.readout, 8"),
        ({"reward_bins": 64}, "size.reward_bins is 64, expected an odd number"),
    ],
)
def test_network_size_refuses(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NetworkSize(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tail": 0.5}, "tail is 0.5, expected a share above 0 and below 0.5"),
        ({"certain_terminal": 0.4}, "certain_terminal is 0.4, expected 0.5 up to below 1"),
        ({"min_terminals": 1}, "min_terminals is 1, expected 2 or more"),
        ({"min_rare_rows": 0}, "min_rare_rows is 0, expected 1 or more"),
    ],
)
def test_gate_config_refuses(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GateConfig(**changes)


def test_spec_takes_an_engines_arrays() -> None:
    spec = GeneratorSpec((2, 3, 3), 2, 0, 0, action_kinds=np.array([0, 1], np.int16))
    assert spec.action_kinds == (0, 1)
    assert hash(spec) == hash(GeneratorSpec((2, 3, 3), 2, 0, 0, action_kinds=(0, 1)))


def test_actions_without_kinds_are_kinds_of_their_own() -> None:
    spec = GeneratorSpec((2, 3, 3), 4, 0, 0)
    assert spec.kinds == (0, 1, 2, 3)
    assert spec.cells == (-1, -1, -1, -1)
