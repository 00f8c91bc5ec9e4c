"""Sessions: the game in the window is the game that agents were trained on; recordings; numbers."""

import csv
import json

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.replays import hash_state, read_replay, replay_steps
from marl_cair.viewer.values import ACTION_VALUES
from marl_cair.window.numbers import count_kills
from marl_cair.window.session import View
from tests.window.persons import make_session

DUELS = [
    ("deep_line_wars", "10x15", ("counter", "rusher")),
    ("deep_rts", "Skirmish-15x15-fog", ("mixed", "rusher")),
]


@pytest.mark.parametrize(("game", "scenario", "bots"), DUELS)
def test_tick_by_tick_is_the_same_game_as_by_decisions(game, scenario, bots):
    session = make_session(game, scenario, bots)
    engine = BatchedEngine(GAMES[game], GAMES[game].scenario(scenario))
    engine.reset(np.array([session.map_seed], np.uint64))
    agents = [GAMES[game].bot(name, engine.scenario) for name in bots]
    for seat, agent in enumerate(agents):
        agent.seed(seat)
    for _ in range(40):
        masks = engine.action_mask()
        actions = [
            agent.act(engine.observe(agent.representation)[:, seat], masks[:, seat])[0]
            for seat, agent in enumerate(agents)
        ]
        engine.step(np.array([actions]))
        for _ in range(engine.spec.ticks_per_step):
            session.advance()
        assert (session.engine.observe("vector") == engine.observe("vector")).all()
        assert (session.engine.observe("planes") == engine.observe("planes")).all()
    assert session.engine.spec.ticks_per_step == 1


def test_a_recording_is_played_again_to_the_same_state(tmp_path):
    session = make_session("deep_line_wars", None, ("counter", None), record=tmp_path / "a.replay")
    buy = session.spec.action_names.index("buy_militia")
    while not session.is_over:
        session.advance({1: buy} if len(session.history.actions) % 50 == 0 else {})
    replay = read_replay(tmp_path / "a.replay")
    assert replay.is_complete
    assert replay.players == ("counter", "person")
    assert replay.winner == 0
    *_, last = replay_steps(replay)
    assert hash_state(last) == hash_state(session.engine)
    session.start()
    session.advance()
    session.close()
    assert len(read_replay(tmp_path / "a-2.replay").actions) == 1


def test_recordings_hold_the_values_that_a_network_decided_by(tmp_path):
    session = make_session("deep_line_wars", None, (None, "random"), record=tmp_path / "a.replay")
    session.agents[1].values = lambda seen, mask, state: np.where(
        mask, len(session.history.actions), -np.inf
    )
    for _ in range(23):
        session.advance()
    session.save_replay(tmp_path / "b.replay")
    session.close()
    for path in (tmp_path / "a.replay", tmp_path / "b.replay"):
        values = read_replay(path).values[ACTION_VALUES]
        assert values.shape == (23, 2, session.spec.num_actions)
        assert np.isnan(values[:, 0]).all()  # a person
        noop = session.spec.noop_action
        assert values[:, 1, noop].tolist() == [0] * 10 + [10] * 10 + [20] * 3


def test_a_game_is_saved_as_it_stands(tmp_path):
    session = make_session("deep_maze", None, ("random",))
    for _ in range(3):
        session.advance()
    session.save_replay(tmp_path / "b.replay")
    replay = read_replay(tmp_path / "b.replay")
    assert (replay.actions == np.array(session.history.actions)).all()


def test_statistics_hold_the_numbers_over_time_and_the_result(tmp_path):
    session = make_session(
        "deep_line_wars", None, ("counter", "random"), statistics=tmp_path / "s" / "game"
    )
    while not session.is_over:
        session.advance()
    lines = (tmp_path / "s" / "game.csv").read_text("utf-8").splitlines()
    rows = list(csv.DictReader(lines))
    about = json.loads((tmp_path / "s" / "game.json").read_text())
    assert [row["player"] for row in rows[:2]] == ["0", "1"]
    assert {"health", "gold", "lumber", "income", "towers"} <= rows[0].keys()
    assert rows[0]["health"] == "50"
    assert rows[-1]["health"] == "0"
    assert about["winner"] == 0
    assert about["ending"] == "counter (player 0) won"
    assert about["steps"] == len(session.history.actions)
    decisions = -(-about["steps"] // 10)
    for player, counts in zip(about["players"], session.action_counts, strict=True):
        assert sum(player["actions"].values()) == counts.sum() == decisions


def test_a_game_ends_without_statistics_where_none_can_be_written(tmp_path):
    (tmp_path / "file").touch()
    session = make_session("deep_maze", statistics=tmp_path / "file" / "game", max_ticks=1)
    with pytest.warns(UserWarning, match="statistics are not saved: "):
        session.advance()
    assert session.is_over


def test_kills_are_counted_for_the_owner_of_a_unit_that_fought():
    session = make_session("deep_rts", "Skirmish-15x15", ("rusher", "rusher"))
    while not session.is_over:
        session.advance()
    units = session.read_numbers().resources["units"]
    assert session.kills.tolist() == (8 - units[::-1]).tolist()  # each began with eight
    assert session.kills.min() > 0


def test_units_that_vanish_without_a_fight_are_no_kills():
    session = make_session("deep_rts", "Skirmish-15x15", ("random", "random"))
    before, after = session.copy_world(), session.copy_world()
    after.units[0, 0, :] = -1
    assert (count_kills(before, after) == 0).all()


def test_a_person_acts_and_is_counted_only_when_ordering():
    session = make_session("deep_line_wars", None, (None, "random"))
    for _ in range(20):
        session.advance()
    assert session.action_counts[0].sum() == 0
    session.advance({0: session.spec.action_names.index("buy_footman")})
    assert session.action_counts[0].sum() == 1
    assert session.look(View(0)).numbers.resources["gold"][0] < 400


def test_seats_and_players_must_agree():
    with pytest.raises(ValueError, match="1 players for 2 seats: give one for each"):
        make_session("deep_line_wars", None, (None,))
