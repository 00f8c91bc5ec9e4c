"""Options of all commands: given once and in full, misspelt ones name the nearest; imports."""

import subprocess
import sys
from contextlib import closing

import pytest

from marl_cair.cli import COMMANDS, TASKS, describe_commands, main
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from tests.refusals import assert_refused

AGENTS = ("random", "counter")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["match", *AGENTS, "--scenario", "11x11", "--scenario=10x15"],
            "--scenario is given twice, as '--scenario 11x11' and as '--scenario=10x15'",
        ),
        (["match", *AGENTS, "games=2"], "unrecognized arguments: games=2"),
        (["evaluate", "random", "--seed", "1", "--seed=2"], "--seed is given twice"),
        (
            ["league", *AGENTS, "--scenari", "11x11"],
            "unknown option '--scenari': nearest are",
        ),
        (["evaluate", "random", "--aginst", "counter"], "nearest are '--against'"),
        (["league", "export", "--formt", "json"], "nearest are '--format'"),
        (["curves", "a", "--out", "a.png", "--out", "b.png"], "--out is given twice"),
    ],
)
def test_options_are_given_once_and_in_full(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


TWICE = ("--game", "deep_line_wars", "--set", "max_ticks=1", "--set=max_ticks=2")


@pytest.mark.parametrize(
    "words",
    [
        ["train", "seed=1", "seed=2"],
        ["train", "scenario=11x11", "game.scenario=10x15"],
        ["train", "resume=a", "resume=b"],
        ["evaluate", "random", *TWICE],
        ["league", *AGENTS, *TWICE],
    ],
)
def test_words_set_an_option_once(words, capsys):
    assert_refused(capsys, "set the same option", *words)


@pytest.mark.slow
def test_fields_of_the_scenario_are_set_alike_in_match_evaluate_and_league(tmp_path, capsys):
    words = ["--game", "deep_line_wars", "--scenario", "11x11", "--games", "2"]
    words += ["--set", "max_ticks=50", "--set", "preset=2017"]
    assert main(["match", *AGENTS, *words]) == 0
    assert main(["evaluate", "random", *words]) == 0
    out = tmp_path / "league"
    assert main(["league", *AGENTS, *words, "--out", str(out), "--no-replays"]) == 0
    with closing(LeagueStore(out / STORE_FILE)) as store:
        assert "'max_ticks': 50" in str(store.settings)
        assert "'preset': '2017'" in str(store.settings)


def test_the_commands_help_lists_few_tasks_in_order():
    text = describe_commands()
    assert len(TASKS) <= 15
    places = [text.index(f"  {task} ") for task in TASKS]
    assert places == sorted(places)
    assert all(name in text for name in COMMANDS)


HEAVY = ("torch", "torchrl", "tensordict", "matplotlib", "hydra", "omegaconf", "openskill")
REPORT = """
import contextlib, io, sys
from marl_cair.cli import main
code = 0
with contextlib.redirect_stdout(io.StringIO()) as printed:
    try:
        code = main(WORDS)
    except SystemExit as ended:
        code = ended.code
assert code == 0
assert "--help" not in WORDS or "usage: marl-cair" in printed.getvalue()
print(sorted(set(HEAVY) & set(sys.modules)))
"""


def imported_by(words, watched):
    code = f"WORDS, HEAVY = {words!r}, {watched!r}\n{REPORT}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        *("train", "curves", "evaluate", "match", "league", "games", "compile"),
        *("league train", "league psro", "league exploit", "league add", "league mix"),
        *("league status", "league report", "league export"),
    ],
)
def test_help_imports_no_library_that_takes_seconds(command):
    watched = HEAVY if command == "compile" else (*HEAVY, "scipy", "numba")
    assert imported_by([*command.split(), "--help"], watched) == "[]"


@pytest.mark.slow
def test_evaluation_of_bots_imports_no_torch():
    words = ["evaluate", "counter", "--game", "deep_line_wars", "--scenario", "11x11"]
    assert imported_by([*words, "--games", "2"], HEAVY) == "[]"
