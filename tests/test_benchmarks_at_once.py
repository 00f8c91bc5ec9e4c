"""`python -m benchmarks` finds the scripts, and runs alone those that need no further words."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import __main__ as at_once

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def calls(monkeypatch):
    """The words of each script that would be run; one of seed 3 fails."""
    words = []

    def call(command, **_):
        words.append(command[2:])
        return SimpleNamespace(returncode=3 * ("--seed=3" in command))

    monkeypatch.setattr(at_once.subprocess, "run", call)
    return words


def needs_words(name):
    """Whether its usage begins with what must be named, as in `python -m benchmarks.x RUN ...`."""
    text = (FOLDER / f"{name}.py").read_text("utf-8")
    return re.search(rf"python -m benchmarks\.{name} +[A-Z<]", text) is not None


def test_without_a_name_all_run_but_those_of_hours_and_those_that_need_words(calls):
    assert at_once.main([]) == 0
    chosen = {words[0].removeprefix("benchmarks.") for words in calls}
    assert chosen == set(at_once.NAMES) - set(at_once.HOURS)
    assert not [name for name in chosen if needs_words(name)]
    assert needs_words("steps_to_level")


def test_those_of_hours_are_there_and_run_when_they_are_named(calls):
    assert set(at_once.HOURS) <= set(at_once.NAMES)
    assert at_once.main(["positions", "runs/a", "--games", "2"]) == 0
    assert calls == [["benchmarks.positions", "runs/a", "--games", "2"]]


def test_the_first_that_fails_ends_it_and_an_unknown_one_is_refused(calls, capsys):
    assert at_once.main(["--seed=3"]) == 3  # all, of which the first fails
    assert len(calls) == 1
    with pytest.raises(SystemExit):
        at_once.main(["engin"])
    assert "invalid choice: 'engin'" in capsys.readouterr().err
