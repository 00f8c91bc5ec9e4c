"""Python functions behind the protocol of processes: `league.agents.host` and its limits."""

import base64
import io
import json
import os
import re
import sys

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.league.agents.foreign import AgentFault, ForeignAgentError, digest_code
from marl_cair.league.agents.host import serve
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from tests.league.players import GAME

SPEC = GAME.make_spec(GAME.scenario("11x11"))
TWO_GAMES = (
    np.ones((2, *SPEC.representations["vector"].shape), np.float32),
    np.ones((2, SPEC.num_actions), np.bool_),
)
PLACE = ["--game", GAME.name, "--scenario", "11x11", "--games", "2"]
MODULE = """
import os, sys, time
import numpy as np
class Mine:
    representation = "vector"
    def __init__(self, act=None):
        self.act = act or self.act
    def seed(self, seed):
        self.drawn = seed
    def act(self, observation, action_mask):
        if not observation.any():
            raise KeyError("nothing there")
        assert observation.dtype == np.float32 and action_mask.dtype == bool
        return np.full(len(observation), self.drawn % 3)
def make(scenario, spec):
    assert scenario.max_ticks == 120 and isinstance(scenario, type(scenario))
    return Mine()
def make_slow(scenario, spec):
    return Mine(lambda observation, action_mask: time.sleep(600))
def make_killer(scenario, spec):
    return Mine(lambda observation, action_mask: os._exit(5))
def make_leaver(scenario, spec):
    return Mine(lambda observation, action_mask: sys.exit(5))
def fail(observation, action_mask):
    raise RuntimeError(f"process {os.getpid()}")
def make_failing(scenario, spec):
    return Mine(fail)
def print_something(observation, action_mask):
    assert os.read(0, 1) == b""
    os.write(1, b"thinking ...")
    return np.zeros(len(observation), int)
def make_printing(scenario, spec):
    return Mine(print_something)
class Unseeded(Mine):
    def seed(self, seed):
        raise RuntimeError("no dice")
def make_unseeded(scenario, spec):
    return Unseeded()
def make_nothing(scenario, spec):
    return None
"""
PACKAGED = """
class Mine:
    def act(self, observation, action_mask):
        return action_mask.argmax(-1)
def make(scenario, spec):
    return Mine()
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "hosted_agents.py").write_text(MODULE, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    places = f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    monkeypatch.setenv("PYTHONPATH", places)
    return "hosted_agents"


def load(source, seconds=60.0):
    return load_agent(source, GAME.name, "11x11", answer_seconds=seconds)


def test_it_answers_line_by_line(module):
    hello = {
        "type": "hello",
        "game": GAME.name,
        "scenario": {"max_ticks": 120},
        "actions": ["noop", "left", "right"],
        "action_shape": [],
        "representations": {
            "planes": {"shape": [3, 4, 4], "dtype": "uint8"},
            "vector": {"shape": [2], "dtype": "float32"},
        },
    }

    def ask(num, value):
        seen = np.full((num, 2), value, np.float32)
        arrays = {"observations": seen, "masks": np.ones((num, 3), np.bool_)}
        packed = {k: base64.b64encode(v.tobytes()).decode() for k, v in arrays.items()}
        return {"type": "act", "seed": 5, "num": num, **packed}

    questions = [hello, ask(2, 1), ask(1, 0)]
    written = io.StringIO()
    serve(f"{module}:make", io.StringIO("\n".join(map(json.dumps, questions))), written)
    assert [json.loads(line) for line in written.getvalue().splitlines()] == [
        {
            "type": "ready",
            "name": "hosted_agents:make",
            "representation": "vector",
            "digest": digest_code("hosted_agents:make", MODULE.encode()),
            "arrays": "base64",
        },
        {"actions": [2, 2]},
        {"error": "crashed in act: KeyError: 'nothing there'"},
    ]


@pytest.mark.slow
def test_a_crash_in_seed_is_named(module):
    agent = load(f"{module}:make_unseeded", 10.0)
    assert agent.act(*TWO_GAMES).tolist() == [-1, -1]
    assert agent.failure == "crashed in seed: RuntimeError: no dice"


@pytest.mark.slow
def test_a_function_with_a_limit_runs_in_a_process_of_its_own(module):
    agent = load(f"{module}:make_slow", 2.0)
    assert agent.act(*TWO_GAMES).tolist() == [-1, -1]
    assert agent.failure == "gave no answer within 2 s"


FAULTS = (
    ("make_slow", ["--answer-seconds", "1"], "gave no answer within 1 s"),
    ("make_killer", [], "ended with exit code 5"),
    ("make_leaver", [], "crashed in act: SystemExit"),
)
COMMANDS = (["match"], ["evaluate", "--against"], ["league"])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        # Each fault, and each command, once: a fault is handled below all commands.
        pytest.param(fault, words, marks=() if at == place else pytest.mark.slow)
        for at, fault in enumerate(FAULTS)
        for place, words in enumerate(COMMANDS)
    ],
    ids=lambda value: value[0],
)
def test_an_agent_that_hangs_or_ends_its_process_ends_no_command(
    module, capsys, tmp_path, fault, words
):
    make, limit, reason = fault
    command, *against = words
    agents = [f"{module}:{make}", *against, "random"]
    out = ["--no-replays", "--out", str(tmp_path / "out")] if command == "league" else []
    assert main([command, *agents, *PLACE, *limit, *out]) == 0
    assert reason in capsys.readouterr().out


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        ("missing", "missing cannot be made .AttributeError"),
        ("make_nothing", "make_nothing gave NoneType without `act"),
    ],
)
def test_a_function_that_makes_no_agent_is_refused(module, make, reason):
    with pytest.raises(ForeignAgentError, match=reason):
        load(f"{module}:{make}")


@pytest.mark.slow
def test_it_is_the_same_agent_and_plays_the_same_as_in_this_process(module):
    scenario = GAME.scenario("11x11", max_ticks=120)
    rival = load_agent("rusher", GAME.name, scenario)
    found = []
    for limit in (None, 60.0):
        agent = load_agent(f"{module}:make", GAME.name, scenario, answer_seconds=limit)
        found.append((agent.fingerprint, play_match(agent, rival, GAME, scenario, 16, 3)))
    assert found[0] == found[1]
    assert found[0][1].distinct_games > 2  # it draws


@pytest.mark.slow
@pytest.mark.parametrize("words", [[], ["--answer-seconds", "0"]])
def test_without_a_limit_it_runs_in_this_process(module, capsys, words):
    assert main(["match", f"{module}:make_failing", "random", *PLACE, *words]) == 0
    numbers = re.findall(r"process (\d+)", capsys.readouterr().out)
    assert [int(number) == os.getpid() for number in numbers] == [bool(words)]


@pytest.mark.slow
def test_it_prints_beside_the_protocol_and_reads_nothing(module):
    assert load(f"{module}:make_printing").act(*TWO_GAMES).tolist() == [0, 0]


@pytest.mark.slow
def test_other_code_is_another_agent_wherever_the_command_is_from(tmp_path, monkeypatch):
    """The console script does not look for modules in the current folder; the host does."""
    (tmp_path / "bots").mkdir()
    (tmp_path / "bots" / "__init__.py").write_text("IMPORTED = True", "utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    prints = []
    for text in (PACKAGED, f"{PACKAGED}# changed"):
        (tmp_path / "bots" / "mine.py").write_text(text, "utf-8")
        prints.append(load("bots.mine:make").fingerprint)
    assert prints[0] != prints[1]
    assert all(one.startswith("foreign ") for one in prints)
    assert "bots" not in sys.modules  # foreign code would have no limit in this process


@pytest.mark.slow
def test_code_that_changes_before_a_restart_forfeits(module, tmp_path):
    agent = load(f"{module}:make_slow")._agent
    (tmp_path / "hosted_agents.py").write_text(f"{MODULE}# changed", "utf-8")
    agent._fail("")
    with pytest.raises(AgentFault, match="its code has changed"):
        agent.act(*TWO_GAMES)


@pytest.mark.slow
def test_a_module_without_a_file_is_refused(tmp_path, monkeypatch):
    (tmp_path / "fileless.py").write_text(f"{PACKAGED}del __file__", "utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ForeignAgentError, match="its module has no file"):
        load("fileless:make")
