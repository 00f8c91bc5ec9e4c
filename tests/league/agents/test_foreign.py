"""Foreign agents: their faults forfeit the game, and are reported."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.games.game import NO_WINNER
from marl_cair.league.agents.allowed_code import is_foreign
from marl_cair.league.agents.foreign import ForeignAgent, ForeignAgentError
from marl_cair.league.agents.load import describe_agent, load_agent
from marl_cair.league.play.blocks import Entrant, Plan, make_design, play_blocks, seat_line_up
from marl_cair.league.play.match import play_match
from tests.games import last_standing
from tests.games.last_standing import FINISH, GAME, NOOP

MODULE = """
import numpy as np
class Waiter:
    representation = "vector"
    def act(self, observation, action_mask):
        return np.zeros(len(observation), int)
def make(scenario, spec):
    return Waiter()
def fail(scenario, spec):
    raise KeyError("weights")
def leave(scenario, spec):
    raise SystemExit(0)
class Leaver(Waiter):
    def act(self, observation, action_mask):
        raise SystemExit(0)
def make_leaver(scenario, spec):
    return Leaver()
class Numbered(Waiter):
    seed = 3
def make_numbered(scenario, spec):
    return Numbered()
"""


def wrap(act, scenario="duel"):
    spec = GAME.make_spec(GAME.scenario(scenario))
    return ForeignAgent(SimpleNamespace(act=act), "mine", spec, "print")


def play(act, scenario="duel", rival="idle", num_games=8):
    chosen = GAME.scenario(scenario)
    return play_match(wrap(act, scenario), GAME.bots[rival](None, None), GAME, chosen, num_games, 3)


def crash(observation, mask):
    raise RuntimeError("out of\nmemory")


def leave(observation, mask):
    sys.exit("no licence")


def fail_at_the_seed(seed):
    raise RuntimeError("no dice")


def test_a_crash_in_seed_is_named():
    spec = GAME.make_spec(GAME.scenario("duel"))
    broken = SimpleNamespace(act=crash, seed=fail_at_the_seed)
    agent = ForeignAgent(broken, "mine", spec, "print")
    agent.act(np.zeros((1, 2), np.float32), np.ones((1, spec.num_actions), np.bool_))
    assert agent.failure == "crashed in seed: RuntimeError: no dice"


def test_an_object_with_act_plays():
    match = play(lambda observation, mask: np.full(len(mask), FINISH))
    assert (match.wins, match.forfeits) == (8, ())
    assert play(lambda observation, mask: [FINISH] * len(mask)).wins == 8


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (crash, "mine crashed in act: RuntimeError: out of memory"),
        (leave, "mine crashed in act: SystemExit: no licence"),
        (lambda o, mask: np.full(len(mask), 4), "mine played the illegal action 4"),
        (lambda o, mask: np.full(len(mask), -1), "mine played the illegal action -1"),
        (lambda o, mask: np.zeros(len(mask)), "mine answered float64 of shape [8]"),
        (lambda o, mask: 0, "mine answered int64 of shape [], asked for whole numbers of sha"),
        (lambda o, mask: None, "mine answered object of shape []"),
        (lambda o, mask: [[1], [2, 3]], "mine answered object of shape []"),
    ],
)
def test_a_failing_agent_forfeits_and_the_reason_is_kept(act, reason):
    match = play(act)
    assert (match.wins, match.losses, len(match.forfeits)) == (0, 8, 8)
    assert match.forfeits[0].startswith(reason)
    assert {result.winner for result in match.results} == {0, 1}
    assert {result.decisions for result in match.results} == {0}


def test_the_user_may_interrupt_an_agent():
    def interrupt(observation, mask):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play(interrupt)


def test_an_illegal_action_costs_the_one_game_that_it_was_meant_for():
    def act(observation, mask):
        rows = np.arange(len(mask))
        return np.where((rows == 0) & (len(mask) > 3), 9, FINISH)

    match = play(act)
    assert len(match.forfeits) == match.losses == 1
    assert match.wins == 7


def test_in_a_free_for_all_a_forfeit_is_last_and_the_others_share():
    match = play(crash, "ffa-4", num_games=4)
    assert (match.losses, match.score) == (4, 0.0)
    assert {result.winner for result in match.results} == {NO_WINNER}


def test_a_seat_that_was_out_by_the_rules_ranks_above_one_that_forfeits():
    """The quitter leaves in the first step, the foreign agent forfeits in the second."""
    scenario = GAME.scenario("ffa-4")

    def act(observation, mask):
        return np.full(len(mask), NOOP if observation[0, 2].max() == 0 else 7)

    bots = [GAME.bots[name](None, None) for name in ("quitter", "idle", "idle")]
    line_up = [Entrant(agent.name, agent.name, agent) for agent in (wrap(act, "ffa-4"), *bots)]
    design = make_design(4, "ring", 0)
    games = play_blocks(seat_line_up(line_up), GAME, scenario, 0, (0,), Plan(design, 1))
    for game in games:
        by_entry = np.argsort(game.entries)
        assert np.array(game.ranks)[by_entry].tolist() == [4.0, 3.0, 1.5, 1.5]
        assert np.array(game.points)[by_entry].tolist() == [0.0, 0.0, 0.5, 0.5]
        assert np.array(game.forfeited)[by_entry].tolist() == [True, False, False, False]


def test_observations_cannot_be_changed_by_an_agent():
    def act(observation, mask):
        observation[:] = 0
        mask[:] = False
        return np.full(len(mask), NOOP)

    assert play(act).forfeits == ()


def crash_once(action):
    """Plays `action` after a crash in the first call."""
    calls = []

    def act(observation, mask):
        calls.append(len(mask))
        if len(calls) == 1:
            raise ValueError("warming up")
        return np.full(len(mask), action)

    return act


def test_an_agent_that_crashed_once_forfeits_that_chunk_only():
    match = play(crash_once(FINISH), num_games=16)
    assert (len(match.forfeits), match.wins) == (8, 8)


def test_a_forfeited_game_is_the_same_beside_longer_ones():
    """Chunk 0 ends with the crash; beside longer chunks its worlds are stepped to their end."""
    alone = play(crash_once(NOOP), num_games=8).results
    beside = play(crash_once(NOOP), num_games=16).results
    assert [result.decisions for result in beside[:8]] == [0] * 8
    assert max(result.decisions for result in beside[8:]) > 0
    assert not any(result.is_truncated for result in beside[:8])
    assert alone == beside[:8]


class TestLoading:
    @pytest.fixture(autouse=True)
    def _known(self, monkeypatch, tmp_path):
        last_standing.register(monkeypatch)
        (tmp_path / "my_agents.py").write_text(MODULE, "utf-8")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "path", list(sys.path))
        yield
        sys.modules.pop("my_agents", None)

    def load(self, source):
        return load_agent(source, game=last_standing.NAME, scenario="duel")

    def test_a_function_of_a_module_makes_an_agent(self):
        agent = self.load("my_agents:make")
        assert (agent.name, agent.representation) == ("my_agents:make", "vector")
        record = describe_agent("mine", agent, GAME)
        assert (record.kind, record.rules_version) == ("foreign", GAME.version)
        assert record.fingerprint.startswith("foreign ")

    def test_other_code_is_another_agent(self, tmp_path):
        before = self.load("my_agents:make").fingerprint
        (tmp_path / "my_agents.py").write_text(MODULE + "\n# changed", "utf-8")
        assert self.load("my_agents:make").fingerprint != before

    @pytest.mark.parametrize(
        ("source", "message"),
        [
            ("my_agents:fail", "my_agents:fail cannot be made .KeyError: 'weights'.: give module"),
            ("my_agents:leave", "my_agents:leave cannot be made .SystemExit: 0.: give module"),
            ("my_agents:none", "cannot be made .AttributeError"),
            ("no_agents:make", "cannot be made .ModuleNotFoundError"),
            ("my_agents:MODULE_LEVEL", "cannot be made"),
            ("builtins:slice", "gave slice without `act"),
            ("my_agents:make_numbered", "gave Numbered whose `seed` is no method"),
        ],
    )
    def test_a_function_that_makes_no_agent_is_refused(self, source, message):
        with pytest.raises(ForeignAgentError, match=message):
            self.load(source)

    @pytest.mark.slow
    def test_an_agent_that_exits_ends_neither_match_nor_league(self, capsys, tmp_path):
        """They must not end silently with exit code 0."""
        about = [f"--game={last_standing.NAME}", "--scenario=duel", "--games=8"]
        about.append("--answer-seconds=0")  # other processes do not know this game
        assert main(["match", "my_agents:make_leaver", "idle", *about]) == 0
        reason = "my_agents:make_leaver crashed in act: SystemExit: 0"
        assert reason in capsys.readouterr().out
        out = ["--no-replays", "--out", str(tmp_path / "league")]
        assert main(["league", "my_agents:make_leaver", "idle", *about, *out]) == 0
        text = capsys.readouterr().out
        assert reason in text
        assert "my_agents:make_leaver forfeited 8 of its 8 games" in text
        assert main(["match", "my_agents:leave", "idle", *about]) == 2
        assert "my_agents:leave cannot be made" in capsys.readouterr().err

    def test_only_module_and_function_are_foreign(self):
        assert is_foreign("a.b:c")
        assert not any(map(is_foreign, ("rusher", "runs/a:b", "C:/runs", "deep_rts/rusher", ":f")))
