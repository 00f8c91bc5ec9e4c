"""Films of a generator: real and imagined play, from training runs and trained generators."""

import dataclasses
import shutil
from itertools import islice

import numpy as np
import pytest
import torch
from PIL import Image

from marl_cair.cli import main
from marl_cair.files import read_run_marker, write_json
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.training.offline.generator_training import GeneratorTraining, train_generator
from marl_cair.training.offline.watching import (
    draw_moment,
    film_generator,
    load_watched,
    watch_steps,
)
from marl_cair.training.settings.config import OpponentSettings
from tests.training.offline.datasets import collect
from tests.training.runs import tiny, train


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder of a generator of grey frames, trained for one update."""
    place = tmp_path_factory.mktemp("grey")
    game = GAMES["flappy_bird"]
    collect(place / "data", 60, game, game.default_scenario, "gray_stack", max_ticks=40)
    settings = GeneratorTraining(updates=1, batch_size=2, measurements=1, measured_rows=4)
    list(train_generator(place / "data", place / "run", settings))
    return place / "run"


def play(watched, num_open, num_steps):
    agents = [load_agent("random", watched.game.name, watched.scenario) for _ in range(2)]
    return list(
        islice(watch_steps(watched, agents[: watched.spec.num_players], num_open), num_steps)
    )


def test_imagined_play_begins_again_from_the_real_state(finished):
    watched = load_watched(finished)
    moments = play(watched, 3, 7)
    assert [one.num_imagined for one in moments] == [1, 2, 3, 1, 2, 3, 1]
    again = play(watched, 1, 7)
    assert all(torch.equal(one.real, other.real) for one, other in zip(moments, again, strict=True))
    for place in (0, 3, 6):  # the first step is imagined from the same real state
        assert torch.equal(moments[place].imagined, again[place].imagined)
    assert all(0.0 <= one.end <= 1.0 for one in moments)


def test_a_picture_shows_real_imagined_and_difference(finished):
    watched = load_watched(finished)
    (moment,) = play(watched, 3, 1)
    same = np.asarray(draw_moment(watched, moment._replace(imagined=moment.real)))
    side = (same.shape[1] - 40) // 3
    panels = [same[28 : 28 + side, 10 + n * (side + 10) :][:, :side] for n in range(3)]
    assert (panels[0] == panels[1]).all()
    assert panels[0].max() > 100
    assert panels[2].max() == 0
    other = moment.real.clone()
    other[0, 5] = 255 - other[0, 5]
    changed = np.asarray(draw_moment(watched, moment._replace(imagined=other)))
    assert changed[28 : 28 + side, 10 + 2 * (side + 10) :][:, :side].max() == 255


def test_the_command_films_a_training_run(finished, tmp_path, capsys):
    film = tmp_path / "film.gif"
    assert main(f"generator watch {finished} --to {film} --steps 5 --open 2".split()) == 0
    assert f"{film}: 5 steps" in capsys.readouterr().out
    with Image.open(film) as picture:
        assert picture.n_frames == 5


def test_frames_of_a_trained_generator_become_a_strip(trained, tmp_path):
    assert film_generator(trained, tmp_path / "strip.png", num_open=4) == 4
    strip = np.asarray(Image.open(tmp_path / "strip.png"))
    margin = strip.shape[1] - 4 * (168 + 6)
    assert 12 < margin < 100  # the names of the rows
    assert strip[:, margin:].shape == (3 * (168 + 6), 4 * (168 + 6), 3)


def test_what_cannot_be_filmed_is_refused(finished, trained, tmp_path):
    with pytest.raises(ValueError, match="holds no generator"):
        film_generator(tmp_path, "a.gif")
    with pytest.raises(ValueError, match=r"name is 'a.webm': give one that ends in .gif, .mp4"):
        film_generator(trained, "a.webm")
    with pytest.raises(ValueError, match="3 players, deep_line_wars has 2 seats"):
        film_generator(finished, "a.gif", players=["random"] * 3)
    with pytest.raises(ValueError, match="num_open is 0"):
        film_generator(trained, "a.gif", num_open=0)


def test_a_vector_has_no_picture(tmp_path):
    config = tiny(tmp_path / "run", 256)
    game = dataclasses.replace(config.game, name="flappy_bird", scenario="classic", options={})
    game = dataclasses.replace(game, representation="features")
    policy = dataclasses.replace(config.policy, body="mlp")
    opponent = OpponentSettings({"random": 1.0})
    train(dataclasses.replace(config, game=game, policy=policy, opponent=opponent))
    with pytest.raises(ValueError, match="vectors of .* numbers, which have no picture"):
        load_watched(tmp_path / "run")


def test_a_generator_whose_data_set_is_gone_says_so(trained, tmp_path):
    copy = shutil.copytree(trained, tmp_path / "copy")
    kind, marked = read_run_marker(copy / "run.json")
    record = {"kind": kind, "settings": {**marked, "dataset": "/nowhere/data"}}
    write_json(copy / "run.json", record)
    with pytest.raises(FileNotFoundError, match="/nowhere/data holds no data set"):
        load_watched(copy)
