"""Recurrent agents of others: in this process, and in their own, where messages have the states."""

import json
import sys

import numpy as np
import pytest

from marl_cair.league.agents.allowed_code import Limits
from marl_cair.league.agents.load import load_agent
from marl_cair.league.agents.process import load_process
from marl_cair.league.play.match import play_match
from tests.games import last_standing
from tests.league.players import GAME

SOURCE = "tests.recurrent_agents:make_recurrent"
COUNTING = "tests.recurrent_agents:make_counting"
SCENARIO = GAME.scenario("11x11", max_ticks=300)
SPEC = GAME.make_spec(SCENARIO)
BOT = """
import json, sys
habit = sys.argv[1]
hello = json.loads(sys.stdin.readline())
size = {"huge": 1 << 30, "half": 1.5}.get(habit, 1)
ready = {"type": "ready", "name": "bot", "representation": "vector", "state_size": size}
print(json.dumps(ready), flush=True)
for line in sys.stdin:
    asked = json.loads(line)
    steps = [state[0] for state in asked["state"]]
    right = [step == seen[2] for step, seen in zip(steps, asked["observations"])]
    answer = {"actions": [int(one) for one in right], "state": [[step + 1] for step in steps]}
    if habit == "forgets":
        del answer["state"]
    elif habit == "shortens":
        answer["state"] = answer["state"][1:]
    elif habit == "overflows":
        answer["state"] = [[float("inf")] for step in steps]
    elif habit == "packs":
        answer["state"] = "AAAA"
    print(json.dumps(answer), flush=True)
"""


def load(source, seconds=None):
    return load_agent(source, GAME.name, SCENARIO, answer_seconds=seconds)


def play(agent, num_games=8):
    return play_match(agent, GAME.bot("random", SCENARIO), GAME, SCENARIO, num_games, 3)


def make_rows(num_rows, seed=0):
    luck = np.random.default_rng(seed)
    seen = luck.normal(size=(num_rows, *SPEC.representations["vector"].shape))
    return seen.astype(np.float32), np.ones((num_rows, SPEC.num_actions), np.bool_)


@pytest.mark.slow
@pytest.mark.parametrize("source", [SOURCE, COUNTING])
def test_an_agent_in_a_process_plays_as_in_this_one(source):
    here, there = load(source), load(source, 60.0)
    assert here.state_size == there.state_size > 0
    assert here.fingerprint == there.fingerprint
    results = play(here).results
    assert play(there).results == results
    assert not any(result.forfeit for result in results)


@pytest.mark.slow
def test_a_process_that_starts_again_goes_on_with_the_states():
    here, there = load(SOURCE), load(SOURCE, 60.0)
    state = other = np.zeros((4, here.state_size), np.float32)
    for step in range(6):
        rows = make_rows(4, step)
        actions, state = here.act(*rows, state)
        if step == 3:
            there._agent._connection.close()
            there._agent._connection = None
        answer, other = there.act(*rows, other)
        assert answer.tolist() == actions.tolist()
        np.testing.assert_array_equal(other, state)
    assert state.any()


def load_bot(tmp_path, habit):
    script = tmp_path / "bot.py"
    script.write_text(BOT, "utf-8")
    scenario = last_standing.GAME.scenario("ffa-3")
    command = f"process:{sys.executable} -S {script} {habit}"
    return load_process(command, last_standing.GAME, scenario, Limits(20.0)), scenario


def test_states_travel_as_lists_in_any_language(tmp_path):
    """It scores only where its count is the game's tick."""
    agent, scenario = load_bot(tmp_path, "good")
    game = last_standing.GAME
    random = game.bots["random"](None, None)
    actions = []
    act = agent.act

    def keep(*arguments):
        answer = act(*arguments)
        actions.extend(answer[0].tolist())
        return answer

    agent.act = keep
    match = play_match(agent, random, game, scenario, 24, 3)
    assert match.forfeits == ()
    assert set(actions) == {last_standing.SCORE}
    assert len(actions) > 24  # more than one step in some games


@pytest.mark.parametrize(
    ("habit", "reason"),
    [
        ("forgets", "returned a state of shape [], it must be [4, 1]"),
        ("shortens", "returned a state of shape [3, 1], it must be [4, 1]"),
        ("overflows", "returned a state that is not finite"),
        ("packs", "buffer size must be a multiple of element size"),
    ],
)
def test_a_wrong_state_forfeits(tmp_path, habit, reason):
    agent, scenario = load_bot(tmp_path, habit)
    seen, mask = np.zeros((4, 4), np.float32), np.ones((4, 4), np.bool_)
    actions, state = agent.act(seen, mask, np.ones((4, 1), np.float32))
    assert actions.tolist() == [-1] * 4
    assert (state == 1).all()
    assert reason in agent.failure
    idle = last_standing.GAME.bots["idle"](None, None)
    match = play_match(agent, idle, last_standing.GAME, scenario, 3, 3)
    assert match.losses == 3
    assert all("crashed in act: ValueError: " in text for text in match.forfeits)


@pytest.mark.parametrize(("habit", "size"), [("huge", 1 << 30), ("half", 1.5)])
def test_a_wrong_size_of_the_state_is_refused(tmp_path, habit, size):
    with pytest.raises(ValueError, match=f"has the state_size {json.dumps(size)}, it must"):
        load_bot(tmp_path, habit)


@pytest.mark.slow
def test_a_wrong_state_is_the_same_fault_in_both_processes(tmp_path, monkeypatch):
    module = tmp_path / "wrong_states.py"
    module.write_text(
        "class Wrong:\n"
        "    representation, state_size = 'vector', 1\n"
        "    def act(self, seen, mask, state):\n"
        "        return mask.argmax(1), state[1:]\n"
        "def make(scenario, spec):\n"
        "    return Wrong()\n",
        "utf-8",
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    for seconds in (None, 60.0):
        agent = load("wrong_states:make", seconds)
        actions, _ = agent.act(*make_rows(2), np.zeros((2, 1), np.float32))
        assert actions.tolist() == [-1, -1]
        wanted = "crashed in act: ValueError: returned a state of shape [1, 1], it must be [2, 1]"
        assert agent.failure == wanted
