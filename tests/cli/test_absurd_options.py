"""Numbers that no machine can serve are refused in one line, with what they would need."""

import contextlib
import math
import re

import pytest

from marl_cair.training.settings.config_file import build_config
from marl_cair.training.settings.options import list_options
from tests.refusals import assert_refused

BASE = ["train", "scenario=11x11", "generator=none"]
ABSURD = (
    *(-1, 0, 1e30, 10**30, 1e308, -1e308, math.nan, math.inf, 1.5),
    *(True, "x", None, [1], {"a": 1}),
)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        (
            "collector.num_worlds=1e9",
            "or more: two steps of each own seat and world .collector.num_worlds",
        ),
        ("collector.steps_per_batch=1e9", "needs [0-9,]+ bytes of memory, this machine has"),
        ("replay.capacity_transitions=99999999999999", "replay.capacity_transitions = 9+ needs"),
        ("replay.generated_capacity_transitions=1e15", "generated_capacity_transitions = 1"),
        ("policy.hidden_width=1e8", "the network .* needs [0-9,]+ bytes"),
        ("policy.hidden_width=1e17", "too large for any memory"),
        ("learner.batch_size=1e12", "learner.batch_size = 1000000000000 needs"),
        ("learner.n_steps=1e9", "learner.n_steps is 1000000000, it must be 1..10000"),
        ("torch_threads=1000000000", "torch_threads is 1000000000, it must be 1..1024"),
        ("collector.num_threads=1e9", "collector.num_threads is 1000000000, it must be 1..1024"),
    ],
)
def test_absurd_sizes(tmp_path, capsys, word, message):
    out = tmp_path / "a"
    assert re.search(message, assert_refused(capsys, "", *BASE, f"out={out}", word))
    assert not out.exists()


@pytest.mark.slow
def test_every_option_takes_or_refuses_absurd_values():
    numeric = [option for option in list_options() if type(option.default) in (int, float)]
    assert len(numeric) > 50
    for option in numeric:
        for value in ABSURD:
            nested = value
            for name in reversed(option.path.split(".")):
                nested = {name: nested}
            with contextlib.suppress(ValueError):  # anything else fails
                build_config(nested)
