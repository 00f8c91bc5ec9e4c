"""Invalid settings are refused; the error names the value and what is allowed."""

from dataclasses import replace

import numpy as np
import pytest

from marl_cair.generative.settings import (
    GateConfig,
    GeneratorConfig,
    GeneratorSpec,
    NetworkSize,
    ThesisSize,
)
from tests.generative.plane_game import NUM_ACTIONS, SPEC

FRAMES = {"observation_shape": (3, 16, 16), "num_uniform": 1, "num_frames": 2}


@pytest.mark.parametrize(
    ("valid", "changes", "message"),
    [
        (SPEC, {"num_uniform": 8}, r"num_uniform is 8, expected 0\.\.7"),
        (SPEC, {"noop_action": 99}, r"noop_action is 99, expected 0\.\.16"),
        (SPEC, {"reward_range": (1.0, -1.0)}, r"reward_range is \(1\.0, -1\.0\), .* \(lowest"),
        (SPEC, {"action_kinds": (0, 1)}, "action_kinds has 2 entries, .* each of the 17"),
        (SPEC, {"action_cells": (35,) * NUM_ACTIONS}, r"of action_cells is 35, .* -1\.\.34"),
        (SPEC, {"static_planes": (4,)}, r"plane is 4, expected a spatial plane, 0\.\.3"),
        (SPEC, {"event_plane_groups": ((0, 7),)}, r"plane is 7, expected a spatial plane"),
        (SPEC, FRAMES, "num_frames is 2, num_uniform 1: each of the 3 planes"),
        (GeneratorConfig(), {"heldout_capacity": 7}, "heldout_capacity is 7, expected 200 or"),
        (GeneratorConfig(), {"rare_capacity": 0}, "rare_capacity is 0, expected 1 or more"),
        (GeneratorConfig(), {"heldout_share": 1.0}, "1.0, expected a share above 0 and below 1"),
        (GeneratorConfig(), {"heldout_share": 0.6}, "is 0.6, expected heldout_ends, which is 0.5"),
        (GeneratorConfig(), {"heldout_ends": 0.05}, "is 0.1, expected heldout_ends, which is 0.05"),
        (GeneratorConfig(), {"learning_rate": 0.0}, "learning_rate is 0.0, expected a number abov"),
        (GeneratorConfig(), {"max_grad_norm": -1.0}, "max_grad_norm is -1.0, expected a number ab"),
        (GeneratorConfig(), {"counterfactual_share": 1.5}, r"share is 1.5, expected 0\.\.1"),
        (NetworkSize(), {"channels": 0}, "size.channels is 0, expected 1 or more"),
        (NetworkSize(), {"depth": 0}, "size.depth is 0, expected 1 or more"),
        (ThesisSize(), {"hidden": 0}, "thesis.hidden is 0, expected 1 or more"),
        (ThesisSize(), {"learning_rate": 0.0}, "thesis.learning_rate is 0.0, expected above 0"),
        (GateConfig(), {"tail": 0.5}, "tail is 0.5, expected a share above 0 and below 0.5"),
        (GateConfig(), {"min_terminals": 0}, "min_terminals is 0, expected 1 or more"),
        (GateConfig(), {"evaluation_rows": 1}, "evaluation_rows is 1, expected 200 or more"),
        (GateConfig(), {"min_rare_rows": 0}, "min_rare_rows is 0, expected 1 or more"),
    ],
)
def test_invalid_settings_are_refused(valid, changes, message):
    with pytest.raises(ValueError, match=message):
        replace(valid, **changes)


def test_a_spec_takes_an_engines_arrays():
    spec = GeneratorSpec((2, 3, 3), 2, 0, 0, action_kinds=np.array([0, 1], np.int16))
    assert spec.action_kinds == (0, 1)
    assert hash(spec) == hash(GeneratorSpec((2, 3, 3), 2, 0, 0, action_kinds=(0, 1)))


def test_actions_without_kinds_are_kinds_of_their_own():
    spec = GeneratorSpec((2, 3, 3), 4, 0, 0)
    assert spec.kinds == (0, 1, 2, 3)
    assert spec.cells == (-1, -1, -1, -1)
