"""Agents in processes of their own: they play, and their faults forfeit the game."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from marl_cair.cli import main
from marl_cair.cli.match_options import read_size
from marl_cair.league.agents.allowed_code import Limits, is_process
from marl_cair.league.agents.foreign import ForeignAgentError
from marl_cair.league.agents.load import describe_agent, is_checkpoint, load_agent
from marl_cair.league.agents.process import load_process
from marl_cair.league.agents.supervisor import find_below, is_running
from marl_cair.league.play.match import play_match
from tests.games.last_standing import GAME
from tests.league.players import GAME as LINES

BOT = Path(__file__).parents[1] / "process_bot.py"
SCENARIO = GAME.scenario("duel")
PLACE = ["--game", LINES.name, "--scenario", "11x11", "--games", "2"]


def load(habit="good", *words, seconds=20.0, limits=None):
    source = f"process:{sys.executable} -S {BOT} '{habit}' {' '.join(words)}"
    return load_process(source, GAME, SCENARIO, limits or Limits(seconds))


def play(agent, num_games=4):
    return play_match(agent, GAME.bots["idle"](None, None), GAME, SCENARIO, num_games, 3)


linux_only = pytest.mark.skipif(sys.platform != "linux", reason="agents have no supervisor")


def wait_for(is_done, seconds=60.0):
    """Whether it is done in time, on a loaded machine too."""
    end = time.monotonic() + seconds
    while not is_done() and time.monotonic() < end:
        time.sleep(0.01)
    return is_done()


def is_gone(number):
    return wait_for(lambda: not is_running(int(number)))


def test_a_process_plays():
    agent = load()
    assert (agent.name, agent.representation) == ("bot good", "vector")
    match = play(agent)
    assert (match.wins, match.forfeits) == (4, ())
    assert describe_agent("mine", agent, GAME).kind == "foreign"


@pytest.mark.parametrize(
    ("habit", "reason"),
    [
        ("prints", "wrote a line that is no JSON"),
        ("nests", "wrote a line that is no JSON"),
        ("lists", f"wrote {[3] * 8}, and no JSON object"),
        ("forgets", f'wrote {{"moves": {[3] * 8}}}, without `actions`'),
        ("gives up", "out of ideas"),
        ("dies", "ended with exit code 3"),
        ("cheats", "played the illegal action 99"),
        ("halves", "answered float64 of shape [8], asked for whole numbers of shape [8]"),
        ("talks", 'wrote {"actions": [0]} without being asked'),
    ],
)
def test_a_wrong_answer_forfeits_and_is_reported(habit, reason):
    agent = load(habit)
    answers = agent._agent._connection._answers
    assert habit != "talks" or wait_for(lambda: not answers.empty())
    match = play(agent, num_games=2)
    assert match.losses == 2
    assert set(match.forfeits) == {f"bot {habit} {reason}"}


@pytest.mark.slow
@linux_only
@pytest.mark.parametrize("habit", ["hangs", "escapes", "stops its supervisor"])
def test_a_process_that_hangs_is_killed_with_all_that_it_started(tmp_path, habit):
    agent = load(habit, str(tmp_path / "ids"), seconds=2.0)
    begun = time.monotonic()
    match = play(agent, num_games=2)
    assert time.monotonic() - begun < 60.0  # it sleeps for 600
    assert match.losses == 2
    assert match.forfeits[0] == f"bot {habit} gave no answer within 2 s"
    assert all(map(is_gone, (tmp_path / "ids").read_text().split()))


@linux_only
def test_a_process_that_always_moves_on_to_another_session_is_caught(tmp_path):
    agent = load("hops", str(tmp_path / "ids"), seconds=1.0)
    supervisor = agent._agent._connection._process.pid
    begun = time.monotonic()
    play(agent, num_games=2)
    assert time.monotonic() - begun < 60.0
    assert find_below(supervisor) == []
    assert is_gone(supervisor)


@linux_only
def test_a_process_that_a_list_of_children_misses_is_killed_too():
    """The kernel does not promise that the list is whole while processes end."""
    script = (
        "import os, subprocess; from marl_cair.league.agents import supervisor;"
        "child = subprocess.Popen(['sleep', '600'], stdout=-3, stderr=-3);"  # DEVNULL
        "find, left = supervisor.find_below, [[], []];"
        "supervisor.find_below = lambda root: left.pop() if left else find(root);"
        "supervisor.kill_below(os.getpid()); print(child.pid)"
    )
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert is_gone(done.stdout)


@pytest.mark.slow
@linux_only
def test_a_pipe_that_an_escaped_process_holds_is_not_waited_for(tmp_path):
    agent = load("kills its supervisor", str(tmp_path / "ids"), seconds=2.0)
    begun = time.monotonic()
    match = play(agent, num_games=2)
    assert time.monotonic() - begun < 60.0
    assert match.losses == 2
    child, escaped = (tmp_path / "ids").read_text().split()
    assert is_gone(child)
    os.kill(int(escaped), signal.SIGKILL)  # an agent that kills its supervisor escapes it


@pytest.mark.slow
@linux_only
def test_agents_end_with_a_program_that_is_killed(tmp_path):
    script = (
        "import os, signal, sys; from tests.league.agents.test_process import load;"
        "agent = load('good'); print(agent._agent._connection._process.pid, flush=True);"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert is_gone(done.stdout)


@linux_only
@pytest.mark.parametrize(
    ("habit", "limits", "reason"),
    [
        ("allocates", Limits(20.0, memory_bytes=1 << 30), "ended with exit code 1"),
        ("forks", Limits(20.0, processes=4), "started more than 4 processes"),
    ],
)
def test_memory_and_processes_are_limited(habit, limits, reason):
    match = play(load(habit, limits=limits), num_games=2)
    assert set(match.forfeits) == {f"bot {habit} {reason}"}


@linux_only
def test_an_agent_within_the_limits_plays():
    match = play(load(limits=Limits(20.0, memory_bytes=1 << 30, processes=4)))
    assert (match.wins, match.forfeits) == (4, ())


@pytest.mark.parametrize("name", ["memory_bytes", "processes"])
def test_invalid_limits_and_limits_that_cannot_be_enforced_are_refused(monkeypatch, name):
    with pytest.raises(ValueError, match="it must be 0 or more"):
        Limits(**{name: -1})
    monkeypatch.setattr("marl_cair.league.agents.allowed_code.IS_SUPERVISED", False)
    with pytest.raises(ValueError, match="only Linux can limit it"):
        Limits(**{name: 1})


def test_commands_take_the_limits(capsys):
    source = f"process:{sys.executable} -S {BOT.with_name('big_bot.py')}"
    words = ["match", source, "random", *PLACE, "--answer-memory"]
    assert main([*words, "1 GiB", "--answer-processes", "9"]) == 0
    assert "MemoryError" in capsys.readouterr().out
    assert main([*words, "lots"]) == 2
    assert "--answer-memory is 'lots', it must be a size" in capsys.readouterr().err
    assert main([*words, "1GiB", "--answer-seconds", "0"]) == 2
    assert "have no effect" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "number"), [("", 0), ("1KiB", 1024), ("1.5 GiB", 3 << 29), ("2G", 2 << 30)]
)
def test_sizes(text, number):
    assert read_size(text, "--answer-memory") == number


def test_what_an_agent_writes_is_shown_without_control_characters():
    match = play(load("paints"), num_games=2)
    shown = r"bot paints \x1b[31mred line \u202egnp.exe\u200b \ud800"
    assert set(match.forfeits) == {shown}


def test_an_agent_that_is_garbage_is_ended():
    agent = load()
    process = agent._agent._connection._process
    del agent
    assert process.poll() is not None


def test_an_agent_that_draws_from_the_seeds_repeats_its_games():
    first, second = (play(load("draws"), 8).results for _ in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("process:", "names no command"),
        ("process:'unfinished", "is no command"),
        ("process:/no/such/program", "cannot be started"),
        (f"process:{sys.executable} -S {BOT} 'never ready'", "and not that it is ready"),
        (f"process:{sys.executable} -S {BOT} 'dies at once'", "ended with exit code 7"),
        (f"process:{sys.executable} -S {BOT} 'wants gzip'", "wants arrays as 'gzip': there are"),
    ],
)
def test_an_agent_that_does_not_start_is_refused_before_any_game(source, message):
    with pytest.raises(ForeignAgentError, match=message):
        load_process(source, GAME, SCENARIO, Limits())


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_limit_is_a_time(seconds):
    with pytest.raises(ValueError, match="answer_seconds is"):
        load_agent(f"process:{sys.executable}", LINES.name, "11x11", answer_seconds=seconds)


def test_another_program_is_another_agent(tmp_path):
    prints = []
    for text in ("", "# changed"):
        (tmp_path / "bot.py").write_text(BOT.read_text("utf-8") + text, "utf-8")
        source = f"process:{sys.executable} -S {tmp_path / 'bot.py'} good"
        prints.append(load_process(source, GAME, SCENARIO, Limits()).fingerprint)
    assert prints[0] != prints[1]


def test_commands_are_no_folders():
    assert is_process("process:./bot")
    assert not is_process("my_module:make")
    assert not is_checkpoint("process:./bot")
