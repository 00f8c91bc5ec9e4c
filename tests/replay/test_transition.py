"""Transitions are checked against one table of keys, shapes and dtypes."""

import numpy as np
import pytest
import torch

from marl_cair.replay.transition import (
    EXPERIENCE_KEYS,
    TRANSITION_KEYS,
    TransitionSpec,
    check_transitions,
)
from tests.replay.streams import SMALL, make_transitions


def sound():
    return make_transitions(np.random.default_rng(0), 6)


def test_sound_transitions_pass():
    check_transitions(sound(), SMALL, EXPERIENCE_KEYS)
    check_transitions(sound()[:0], SMALL, EXPERIENCE_KEYS)


def test_the_table_names_every_key():
    assert set(SMALL.fields()) == set(TRANSITION_KEYS)


def test_a_missing_label_is_named():
    with pytest.raises(ValueError, match="lack 'steps_to_next_obs'; they need 'observation', "):
        check_transitions(sound(), SMALL)


def test_a_wrong_shape_or_dtype_is_named_with_the_right_one():
    for key, change, message in (
        (("next", "reward"), lambda value: value.squeeze(1), r"float32 \[6\], .* \[6, 1\]"),
        ("action", lambda value: value.int(), r"'action'.* is int32 \[6\], expected int64 \[6\]"),
    ):
        rows = sound()
        rows[key] = change(rows[key])
        with pytest.raises(ValueError, match=message):
            check_transitions(rows, SMALL, EXPERIENCE_KEYS)


def test_an_illegal_action_is_refused_with_the_legal_ones():
    rows = sound()
    rows["action"][4] = 11
    with pytest.raises(ValueError, match="row 4: action is 11, expected 0..10"):
        check_transitions(rows, SMALL, EXPERIENCE_KEYS)
    rows = sound()
    rows["action_mask"][2] = torch.arange(11) < 2
    rows["action"][2] = 5
    with pytest.raises(ValueError, match=r"row 2: action 5 is not legal .* legal are \[0, 1\]"):
        check_transitions(rows, SMALL, EXPERIENCE_KEYS)


def test_a_running_row_needs_a_legal_next_action_and_a_terminated_one_does_not():
    rows = sound()
    rows["next", "action_mask"][3] = False
    rows["next", "terminated"][3] = True
    check_transitions(rows, SMALL, EXPERIENCE_KEYS)
    rows["next", "terminated"][3] = False
    with pytest.raises(ValueError, match="row 3: .* allows no action although"):
        check_transitions(rows, SMALL, EXPERIENCE_KEYS)


def test_rows_in_more_than_one_dimension_are_refused():
    with pytest.raises(ValueError, match=r"batch size \[2, 3\], expected \[N\]: flatten"):
        check_transitions(sound().reshape(2, 3), SMALL, EXPERIENCE_KEYS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((), 3), r"observation_shape is \(\), expected"),
        (((0, 2), 3), r"observation_shape is \(0, 2\), expected"),
        (((2, 2), 0), "num_actions is 0, expected 1 or more"),
        (((2, 2), 3, 3), "num_uniform is 3, expected 0..2"),
        (((2, 2), 3, 1, torch.float32), "num_uniform is 1, expected 0..0 .* only uint8 planes"),
    ],
)
def test_a_spec_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        TransitionSpec(*arguments)
