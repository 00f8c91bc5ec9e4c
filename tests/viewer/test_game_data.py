"""What the viewer is given: actions, measures, events, agents' values, and a limit of its size."""

import base64
import json
import zlib

import numpy as np
import pytest

from marl_cair.games.replays import replay_steps
from marl_cair.viewer.game_data import pack_game
from tests.viewer.recorded import record

STEPS = 30
LINE_WARS = {"game": "deep_line_wars", "scenario": "11x11"}


def numbers(text, *shape):
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(4, -1)
    return np.ascontiguousarray(planes.T).view("<f4").reshape(*shape)


def series(data):
    steps, players = data["steps"] + 1, len(data["players"])
    return {one["name"]: numbers(one["values"], steps, players) for one in data["series"]}


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    path = tmp_path_factory.mktemp("game") / "a.replay"
    return record(path, bots=("rusher", "turtle"), steps=STEPS, **LINE_WARS)


@pytest.fixture(scope="module")
def data(replay):
    return json.loads(pack_game(replay))


def test_actions_are_named(replay, data):
    places = numbers(data["actions"]["numbers"], STEPS, 2).astype(int)
    named = np.array(data["actions"]["texts"])[places]
    np.testing.assert_array_equal(named, np.array(replay.spec.action_names)[replay.actions])


def test_measures_are_those_of_the_engine(replay, data):
    found = series(data)
    owned = replay.spec.resources
    columns = [replay.spec.representations["vector"].plane_names.index(f"own {o}") for o in owned]
    for step, engine in enumerate(replay_steps(replay)):
        expected = engine.observe("vector")[0][:, columns]
        np.testing.assert_array_equal(np.stack([found[o][step] for o in owned], 1), expected)
        living = (engine.state_dict()["world.unit_health"][0] > 0).sum(1)
        np.testing.assert_array_equal(found["units"][step], living)
    assert {one["name"] for one in data["series"] if one["isResource"]} == set(owned)


def test_events_are_where_the_measures_say(replay, data):
    found, events = series(data), {event["text"]: event for event in data["events"]}
    first = events["first unit, by rusher"]
    assert first["seat"] == 0
    assert found["units"][first["step"], 0] > 0
    assert not found["units"][: first["step"]].any()
    hit = events["turtle loses health for the first time"]["step"]
    assert np.diff(found["health"][: hit + 1, 1]).tolist() == [0] * (hit - 1) + [
        found["health"][hit, 1] - found["health"][0, 1]
    ]
    assert data["events"][-1] == {"step": STEPS, "text": "the end, without a winner", "seat": None}


def test_events_of_deep_rts(tmp_path):
    options = {"game": "deep_rts", "scenario": "Skirmish-31x31-fog", "bots": ("rusher", "archers")}
    played = record(tmp_path / "a.replay", steps=400, **options)
    data = json.loads(pack_game(played, every=200, views=[0]))
    texts = [event["text"] for event in data["events"]]
    assert texts[0].startswith("first attack, by ")
    assert any(text.endswith(" is out") for text in texts)
    assert [event["step"] for event in data["events"]] == sorted(e["step"] for e in data["events"])
    attack = data["events"][0]
    damage = series(data)["damage done"]
    assert damage[attack["step"], attack["seat"]] > 0
    assert not damage[: attack["step"]].any()


@pytest.fixture(scope="module")
def fallen(tmp_path_factory):
    """A game of Deep RTS until a town hall falls."""
    path = tmp_path_factory.mktemp("fallen") / "a.replay"
    options = {"game": "deep_rts", "scenario": "1v1-15x15", "bots": ("turtle", "rusher")}
    return record(path, steps=300, **options)


def test_a_town_hall_is_lost_where_the_engine_has_one_less(fallen):
    events = json.loads(pack_game(fallen, every=300, views=[0]))["events"]
    found = [(e["step"], e["seat"]) for e in events if e["text"] == "turtle loses a town hall"]
    column = fallen.spec.representations["vector"].plane_names.index("own town_hall")
    halls = np.stack([one.observe("vector")[0, :, column] for one in replay_steps(fallen)])
    falls = np.argwhere(np.diff(halls, axis=0) < 0)
    assert found == [(step + 1, seat) for step, seat in falls if seat == 0]
    assert found


def test_equal_views_are_stored_once(data):
    """The spectator of Deep Line Wars sees what seat 0 sees."""
    assert [view["pictures"] for view in data["views"]] == [0, 0, 1]
    assert [view["seat"] for view in data["views"]] == [None, 0, 1]
    first, second = data["views"][1]["colours"], data["views"][2]["colours"]
    assert first == second[::-1]
    assert data["numLeftOut"] == 0


def test_views_are_left_out_and_then_pictures_until_it_fits(replay, data):
    whole = len(json.dumps(data, separators=(",", ":")))
    less = json.loads(pack_game(replay, max_bytes=whole - 1000))
    assert (len(less["views"]), less["numLeftOut"], less["every"]) == (2, 1, 1)
    text = pack_game(replay, max_bytes=whole // 4)
    assert len(text) <= whole // 4
    assert json.loads(text)["every"] > 1


def test_a_seat_that_does_not_exist_is_refused(replay):
    with pytest.raises(ValueError, match=r"there is no seat 2: the game has the seats 0 to 1"):
        pack_game(replay, views=[2])


def test_the_best_actions_by_an_agents_values_are_kept(tmp_path):
    options = {**LINE_WARS, "bots": ("random", "random"), "names": ("a<b", "a<b")}
    bare = record(tmp_path / "a.replay", steps=2, **options)
    values = np.random.default_rng(0).normal(size=(2, 2, bare.spec.num_actions))
    values[0, 1, :7] = np.nan, *[9] * 6
    kept = {"action values": values, "value": values[..., 0], "other": np.zeros((2, 2, 3))}
    kept["value"] = np.array([[1, 2], [3, 4]])
    data = json.loads(
        pack_game(record(tmp_path / "b.replay", steps=2, values=kept, **options), views=[None])
    )
    (best,) = data["values"]
    assert best["name"] == "action values"
    shape = 2, 2, best["count"]
    names = np.array(best["texts"])[numbers(best["choices"], *shape).astype(int)]
    assert names[0, 1].tolist() == list(bare.spec.action_names[1:6])
    assert (numbers(best["values"], *shape)[0, 1] == 9).all()
    assert series(data)["value"].tolist() == [[1, 2], [1, 2], [3, 4]]
    assert data["players"] == ["a<b (seat 0)", "a<b (seat 1)"]


def test_many_orders_in_a_step_are_counted(tmp_path):
    options = {"game": "deep_rts", "scenario": "1v1-15x15", "actions": "grid"}
    played = record(tmp_path / "a.replay", bots=("random", "random"), steps=3, **options)
    data = json.loads(pack_game(played, views=[0]))
    texts = data["actions"]["texts"]
    assert any(" x " in text for text in texts)
    assert numbers(data["actions"]["numbers"], 3, 2).max() == len(texts) - 1
