"""`marl-cair explain` writes pictures, a film, and the agent's own numbers."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

from benchmarks import _networks
from marl_cair.checkpoint import load_network, save_agent
from marl_cair.cli import main
from marl_cair.cli.agent.explain import explain_game, read_discount
from marl_cair.cli.agent.pictures import MAX_FRAMES
from marl_cair.games.replays import replay_steps
from marl_cair.league.agents.load import load_agent
from marl_cair.policies import SAMPLED
from marl_cair.policies.config import QNetworkConfig
from tests.refusals import assert_refused
from tests.viewer.recorded import record

SCENARIO, MAX_TICKS = "11x11", 400


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    folder = tmp_path_factory.mktemp("agents") / "capsule"
    options = {"max_ticks": MAX_TICKS}
    config = QNetworkConfig(body="capsule")
    return _networks.save_network(folder, SCENARIO, "planes", config, options=options)


@pytest.mark.slow
def test_the_folder_holds_pictures_a_film_and_the_agents_numbers(agent, tmp_path, capsys):
    out = tmp_path / "why"
    words = ["explain", agent, "--opponent", "rusher", "--seed", "4", "--gamma", "0.9"]
    assert main([*words, "--steps", "3", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    pictures = ("values.png", "actions.png", "overestimation.png", "presence.png")
    assert {path.name for path in out.iterdir()} == {*pictures, "film.gif", "steps.npz"}
    for name in pictures:
        assert name in printed
        with Image.open(out / name) as opened:
            picture = np.asarray(opened.convert("L"))
        assert min(picture.shape) > 200
        assert picture.std() > 5  # no blank page
    with np.load(out / "steps.npz") as stored:
        steps = dict(stored)
    length = len(steps["action"])
    assert f"after {length} steps" in printed
    with Image.open(out / "film.gif") as film:
        assert 1 < film.n_frames <= MAX_FRAMES
        assert film.width > 800  # the game and the bars
    loaded = load_agent(agent)
    values = loaded.values(steps["observation"], steps["action_mask"])
    np.testing.assert_array_equal(values, steps["values"])
    np.testing.assert_array_equal(values.argmax(1), steps["action"])
    assert np.isneginf(values[~steps["action_mask"]]).all()
    assert np.isfinite(values[steps["action_mask"]]).all()
    weights = 0.9 ** np.arange(length)
    assert steps["discounted_return"][0] == pytest.approx((weights * steps["reward"]).sum())
    overestimation = (values.max(1) - steps["discounted_return"]).mean()
    assert f"overestimation {overestimation:+.3f}" in printed


@pytest.mark.slow
def test_values_of_a_recurrent_agent_are_those_that_it_played_by(tmp_path):
    config = QNetworkConfig(body="mlp", hidden_width=16, memory="gru", memory_width=8)
    folder = tmp_path / "gru"
    _networks.save_network(folder, SCENARIO, "vector", config, options={"max_ticks": 60})
    assert main(["explain", str(folder), "--steps", "2", "--out", str(tmp_path / "why")]) == 0
    with np.load(tmp_path / "why" / "steps.npz") as steps:
        np.testing.assert_array_equal(steps["values"].argmax(1), steps["action"])
        fresh = load_agent(folder).values(steps["observation"], steps["action_mask"])
        assert not np.allclose(fresh[1:], steps["values"][1:])
        np.testing.assert_array_equal(fresh[0], steps["values"][0])


@pytest.mark.parametrize("seat", [0, 1])
def test_a_recorded_game_is_valued_from_a_seat(agent, tmp_path, seat):
    path, loaded = tmp_path / "a.replay", load_agent(agent)
    options = {"game": "deep_line_wars", "scenario": SCENARIO, "bots": ("random", "rusher")}
    replay = record(path, steps=300, **options)
    explained = explain_game(loaded, replay, {"reward": "sparse"}, seat, every=1, scale=0.5)
    masks = [engine.action_mask()[0, seat] for engine in replay_steps(replay)]
    assert (explained.played == replay.actions[:, seat]).all()
    assert (explained.action_mask == masks[:-1]).all()
    values = loaded.values(explained.observation, explained.action_mask)
    np.testing.assert_array_equal(explained.values, values)
    won = replay.winner == seat
    assert explained.ending == ("won" if won else "lost")
    assert explained.rewards.tolist() == [0.0] * (len(masks) - 2) + [0.5 if won else -0.5]


@pytest.mark.slow
def test_a_game_of_the_window_is_discounted_by_ticks(agent, tmp_path, capsys):
    path, out = tmp_path / "a.replay", tmp_path / "why"
    options = {"scenario": SCENARIO, "bots": ("random", "rusher"), "ticks_per_step": 1}
    record(path, game="deep_line_wars", steps=40, **options)
    words = ["explain", agent, "--replay", str(path), "--seat", "1", "--gamma", "0.9"]
    assert main([*words, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert f"in seat 1 of {path}: not finished after 40 steps" in printed
    assert f"(gamma {0.9**0.1:g}, reward sparse)" in printed
    assert (out / "film.gif").is_file()


def test_presences_are_those_of_the_part_capsules(agent):
    loaded = load_agent(agent)
    rows = np.zeros((3, *loaded.network.observation_shape), np.uint8)
    presences = loaded.find_presences(rows)
    assert presences.shape[:2] == (3, loaded.network.config.capsule.num_part_types)
    assert ((presences > 0) & (presences < 1)).all()
    assert not any(part._forward_hooks for part in loaded.network.modules())


def test_the_discount_is_that_of_the_run(agent, tmp_path):
    assert read_discount(agent)[0] == pytest.approx(0.99)
    run = tmp_path / "run" / "latest"
    _networks.save_network(run, SCENARIO, "vector", QNetworkConfig(body="mlp", hidden_width=8))
    text = "learner:\n  gamma: 0.95\n  reward_scale: 0.1\n"
    (tmp_path / "run" / "config.yaml").write_text(text, "utf-8")
    assert read_discount(str(run)) == (0.95, 0.1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["deep_line_wars/rusher"], "has no action values"),
        (["SAMPLED"], "has no action values: give the folder of a greedy checkpoint"),
        (["AGENT", "--steps", "0"], "--steps is 0, it must be 1 or more"),
        (["AGENT", "--gamma", "1.5"], "--gamma is 1.5, it must be in 0..1"),
        (["AGENT", "--replay", "REPLAY", "--seat", "2"], "--seat is 2, it must be in 0..1"),
        (["AGENT", "--seat", "1"], "--seat has an effect only with --replay"),
        (
            ["AGENT", "--replay", "REPLAY", "--opponent", "x"],
            "--opponent has an effect only without",
        ),
        (["AGENT", "--replay", "REPLAY", "--set", "a=1"], "--set has an effect only without"),
        (["AGENT", "--replay", "EMPTY"], "has no steps"),
    ],
)
def test_other_agents_and_numbers_are_refused(words, message, agent, capsys, tmp_path):
    path = tmp_path / "a.replay"
    record(path, game="deep_line_wars", steps=1, scenario=SCENARIO, bots=("random", "random"))
    empty = tmp_path / "empty.replay"
    record(empty, game="deep_line_wars", steps=0, scenario=SCENARIO, bots=("random", "random"))
    sampled = tmp_path / "sampled"
    network, about = load_network(agent)
    save_agent(sampled, network, dataclasses.replace(about, plays=SAMPLED))
    named = {
        "AGENT": agent,
        "SAMPLED": str(sampled),
        "REPLAY": str(path),
        "EMPTY": str(empty),
    }
    words = [named.get(word, word) for word in words]
    assert_refused(capsys, message, "explain", *words, "--out", str(tmp_path / "why"))
    assert not (tmp_path / "why").exists()
