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
from tests.league.players import GAME as LINES

SPEC = LINES.make_spec(LINES.scenario("11x11"))
TWO_GAMES = (
    np.ones((2, *SPEC.representations["vector"].shape), np.float32),
    np.ones((2, SPEC.num_actions), np.bool_),
)
PLACE = ["--game", LINES.name, "--scenario", "11x11", "--games", "2"]


class TestHost:
    """Python functions behind the same protocol."""

    MODULE = """
import os
import numpy as np
class Mine:
    representation = "vector"
    def seed(self, seed):
        self.drawn = seed
    def act(self, observation, action_mask):
        if not observation.any():
            raise KeyError("nothing there")
        assert observation.dtype == np.float32 and action_mask.dtype == bool
        return np.full(len(observation), self.drawn % 3)
class Slow(Mine):
    def act(self, observation, action_mask):
        import time
        time.sleep(600)
def make(scenario, spec):
    assert scenario.max_ticks == 120 and isinstance(scenario, type(scenario))
    return Mine()
def make_slow(scenario, spec):
    return Slow()
class Killer(Mine):
    def act(self, observation, action_mask):
        os._exit(5)
class Leaver(Mine):
    def act(self, observation, action_mask):
        raise SystemExit(5)
class Teller(Mine):
    def act(self, observation, action_mask):
        raise RuntimeError(f"I am {os.getpid()}")
class Talker(Mine):
    def act(self, observation, action_mask):
        assert os.read(0, 1) == b""
        os.write(1, b"thinking ...")
        return np.zeros(len(observation), int)
def make_killer(scenario, spec):
    return Killer()
def make_leaver(scenario, spec):
    return Leaver()
def make_teller(scenario, spec):
    return Teller()
def make_talker(scenario, spec):
    return Talker()
def make_nothing(scenario, spec):
    return None
"""

    @pytest.fixture
    def module(self, tmp_path, monkeypatch):
        (tmp_path / "hosted_agents.py").write_text(self.MODULE, "utf-8")
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.setenv(
            "PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
        )
        return "hosted_agents"

    def test_it_answers_line_by_line(self, module):
        hello = {
            "type": "hello",
            "game": "deep_line_wars",
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

        asked = [hello, ask(2, 1), ask(1, 0)]
        told = io.StringIO()
        serve(f"{module}:make", io.StringIO("\n".join(map(json.dumps, asked))), told)
        answers = [json.loads(line) for line in told.getvalue().splitlines()]
        assert answers == [
            {
                "type": "ready",
                "name": "hosted_agents:make",
                "representation": "vector",
                "digest": digest_code("hosted_agents:make", self.MODULE.encode()),
                "arrays": "base64",
            },
            {"actions": [2, 2]},
            {"error": "crashed in act: KeyError: 'nothing there'"},
        ]

    def test_a_function_with_a_limit_runs_in_a_process_of_its_own(self, module):
        agent = load_agent(f"{module}:make_slow", "deep_line_wars", "11x11", answer_seconds=2.0)
        spec = agent._shape
        assert spec == ()
        lost = agent.act(*TWO_GAMES)
        assert lost.tolist() == [-1, -1]
        assert agent.failure == "gave no answer within 2 s"

    @pytest.mark.parametrize("words", [["match"], ["evaluate", "--against"]], ids=lambda w: w[0])
    def test_every_command_that_plays_can_set_the_limit(self, module, capsys, words):
        command, *against = words
        agents = [f"{module}:make_slow", *against, "random"]
        assert main([command, *agents, *PLACE, "--answer-seconds", "2"]) == 0
        assert "gave no answer within 2 s" in capsys.readouterr().out

    def test_a_function_that_cannot_be_made_is_refused(self, module):
        with pytest.raises(ForeignAgentError, match="nobody cannot be made .AttributeError"):
            load_agent(f"{module}:nobody", "deep_line_wars", "11x11", answer_seconds=60.0)

    def test_what_makes_no_agent_is_refused(self, module):
        with pytest.raises(ForeignAgentError, match="make_nothing gave NoneType without `act"):
            load_agent(f"{module}:make_nothing", "deep_line_wars", "11x11", answer_seconds=60.0)

    def test_it_is_the_same_agent_and_plays_the_same_as_in_this_process(self, module):
        scenario = LINES.scenario("11x11", max_ticks=120)
        rival = load_agent("rusher", LINES.name, scenario)
        found = []
        for limit in (None, 60.0):
            agent = load_agent(f"{module}:make", LINES.name, scenario, answer_seconds=limit)
            found.append((agent.fingerprint, play_match(agent, rival, LINES, scenario, 16, 3)))
        assert found[0] == found[1]
        assert found[0][1].distinct_games > 2  # it draws

    @pytest.mark.parametrize(
        ("make", "reason"),
        [("make_killer", "ended with exit code 5"), ("make_leaver", "crashed in act: SystemExit")],
    )
    @pytest.mark.parametrize("words", [["match"], ["evaluate", "--against"], ["league"]])
    def test_who_ends_the_process_ends_no_command(
        self, module, capsys, tmp_path, make, reason, words
    ):
        command, *against = words
        agents = [f"{module}:{make}", *against, "random"]
        out = ["--no-replays", "--out", str(tmp_path / "out")] if command == "league" else []
        assert main([command, *agents, *PLACE, *out]) == 0
        assert reason in capsys.readouterr().out

    @pytest.mark.parametrize("words", [[], ["--answer-seconds", "0"]])
    def test_without_a_limit_it_runs_in_this_process(self, module, capsys, words):
        assert main(["match", f"{module}:make_teller", "random", *PLACE, *words]) == 0
        told = re.findall(r"I am (\d+)", capsys.readouterr().out)
        assert [int(number) == os.getpid() for number in told] == [bool(words)]

    def test_what_it_prints_and_reads_is_none_of_the_protocol(self, module):
        agent = load_agent(f"{module}:make_talker", "deep_line_wars", "11x11", answer_seconds=60.0)
        chosen = agent.act(*TWO_GAMES)
        assert chosen.tolist() == [0, 0]

    PACKAGED = """
class Mine:
    def act(self, observation, action_mask):
        return action_mask.argmax(-1)
def make(scenario, spec):
    return Mine()
"""

    def test_other_code_is_another_agent_wherever_the_command_is_from(self, tmp_path, monkeypatch):
        """The console script does not look for modules in the current folder; the host does."""
        (tmp_path / "bots").mkdir()
        (tmp_path / "bots" / "__init__.py").write_text("IMPORTED = True", "utf-8")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
        prints = []
        for text in (self.PACKAGED, f"{self.PACKAGED}# changed"):
            (tmp_path / "bots" / "mine.py").write_text(text, "utf-8")
            agent = load_agent("bots.mine:make", "deep_line_wars", "11x11", answer_seconds=60.0)
            prints.append(agent.fingerprint)
        assert prints[0] != prints[1]
        assert all(one.startswith("foreign ") for one in prints)
        assert "bots" not in sys.modules  # nobody's code runs here, where it would have no limit

    def test_code_that_changes_before_a_restart_forfeits(self, module, tmp_path):
        agent = load_agent(f"{module}:make_slow", "deep_line_wars", "11x11", answer_seconds=60.0)
        (tmp_path / "hosted_agents.py").write_text(f"{self.MODULE}# changed", "utf-8")
        agent._agent._fail("")
        with pytest.raises(AgentFault, match="its code has changed"):
            agent._agent.act(*TWO_GAMES)

    def test_a_module_without_a_file_is_refused(self, tmp_path, monkeypatch):
        (tmp_path / "fileless.py").write_text(f"{self.PACKAGED}del __file__", "utf-8")
        monkeypatch.chdir(tmp_path)
        with pytest.raises(ForeignAgentError, match="its module has no file"):
            load_agent("fileless:make", "deep_line_wars", "11x11", answer_seconds=60.0)
