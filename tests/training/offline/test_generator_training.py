"""Collected data sets, and generators that are trained on them."""

import dataclasses
import math
import re

import numpy as np
import pytest
import torch

from marl_cair import files
from marl_cair.checkpoint import load_tensors
from marl_cair.cli import main
from marl_cair.cli.compose import compose_config
from marl_cair.games import GAMES
from marl_cair.generative.settings import GeneratorConfig, NetworkSize
from marl_cair.replay import load_dataset
from marl_cair.training.generating.generators import check_generator, make_generator
from marl_cair.training.offline.generator_training import (
    GeneratorTraining,
    describe_game,
    train_generator,
)
from marl_cair.training.settings.checks import DeviceError
from tests.games.flash.browser.flash_files import need_flash
from tests.training.offline.datasets import LINE_WARS, collect

SMALL = GeneratorConfig(size=NetworkSize(channels=4, depth=1, hidden=8))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("data") / "wars"
    collect(place)
    return place


def test_transitions_are_unique_and_no_episode_is_on_both_sides(folder):
    data = load_dataset(folder)
    assert (len(data.train), len(data.heldout)) == (360, 240)
    assert not set(data.train["episode"].tolist()) & set(data.heldout["episode"].tolist())
    both = torch.cat([data.train, data.heldout])
    keys = [key for key in both.keys(True, True) if key not in ("episode", "seat", "step")]
    rows = torch.cat([both[key].flatten(1).double() for key in keys if both[key].ndim > 1], 1)
    rows = torch.cat([rows, both["action"][:, None].double()], 1)
    assert len(np.unique(rows.numpy(), axis=0)) == 600


def test_rows_are_steps_of_the_game_with_the_actions_of_both_seats(folder):
    """The next observation of a step is the observation of the next one of that seat."""
    rows = load_dataset(folder).train
    place = {
        key: row
        for row, key in enumerate(
            zip(*(rows[name].tolist() for name in ("episode", "seat", "step")), strict=True)
        )
    }
    followed = 0
    for (episode, seat, step), row in place.items():
        mate, following = place.get((episode, 1 - seat, step)), place.get((episode, seat, step + 1))
        if mate is not None:
            assert rows["other_actions"][row].tolist() == [int(rows["action"][mate])]
        if following is not None:
            assert torch.equal(rows["next", "observation"][row], rows["observation"][following])
            assert not rows["next", "done"][row]
            followed += 1
    assert followed > 100
    assert rows["next", "done"].any()


def test_the_same_seed_collects_the_same_rows(folder, tmp_path):
    collect(tmp_path / "again")
    one, other = load_dataset(folder).train, load_dataset(tmp_path / "again").train
    assert all(torch.equal(one[key], other[key]) for key in one.keys(True, True))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_rows": 9}, "rows is 9, it must be 10 or more"),
        (
            {"game": GAMES["deep_rts"], "name": "1v1-15x15", "actions": "grid"},
            "action at each cell",
        ),
    ],
)
def test_what_cannot_be_collected_is_refused(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        collect(tmp_path / "data", **options)
    assert not (tmp_path / "data").exists()


def test_a_game_with_few_states_ends_with_an_error(tmp_path):
    maze = GAMES["deep_maze"]
    with pytest.raises(ValueError, match=r"only .* unique transitions .* ask for fewer rows"):
        collect(tmp_path / "data", 1_000, maze, "7x7-full_deterministic", max_ticks=4)


def test_a_generator_learns_from_a_data_set(folder, tmp_path):
    settings = GeneratorTraining(updates=12, batch_size=16, measurements=2, config=SMALL)
    numbers = list(train_generator(folder, tmp_path / "run", settings))
    assert [one["update"] for one in numbers] == [6, 12]
    for name in ("cells/changed_f1", "reward/explained", "mask/accuracy", "accepted/share"):
        assert -9.0 <= numbers[-1][name] <= 1.0
    assert "open_loop/1_changed_f1" in numbers[-1]
    assert numbers[-1]["open_loop/safe_steps"] in (0, 1, 2, 4, 8, 16)
    files = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"generator.pt", "quality.csv", "losses.csv", "predictions.png", "losses.png"} <= files
    assert (tmp_path / "run" / "losses.csv").read_text("utf-8").count("\n") == 1 + 12


def test_the_seed_is_of_weights_too(folder, tmp_path):
    weights = []
    for seed in (0, 1, 1):
        settings = GeneratorTraining(updates=1, batch_size=16, measurements=1, config=SMALL)
        settings = dataclasses.replace(settings, seed=seed)
        out = tmp_path / f"run_{len(weights)}"
        list(train_generator(folder, out, settings))
        weights.append(load_tensors(out / "generator.pt")["network"]["network"]["choose.weight"])
    assert torch.equal(weights[1], weights[2])
    assert not torch.allclose(weights[0], weights[1], atol=1e-2)


def test_a_trained_generator_begins_a_run(folder, tmp_path):
    settings = GeneratorTraining(updates=2, batch_size=16, measurements=1, config=SMALL)
    list(train_generator(folder, tmp_path / "run", settings))
    words = ("game.scenario=11x11", "game.options={max_ticks: 100}", "generator.model.size.depth=1")
    words += ("generator.model.size.channels=4", "generator.model.size.hidden=8")
    config = compose_config(words)
    seen = config.game.spec.representations["planes"]
    made = make_generator(config, seen, config.game.spec, 1, str(tmp_path / "run"))
    saved = load_tensors(tmp_path / "run" / "generator.pt")["network"]["network"]
    assert torch.equal(made.network.choose.weight, saved["choose.weight"])


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name == "flash")) for name in GAMES],
)
def test_every_game_has_data_sets_and_generators(name, tmp_path):
    """Transitions are predicted and judged."""
    if name == "flash":
        need_flash()  # a browser for each world
    game = GAMES[name]
    collect(tmp_path / "data", 80, game, game.default_scenario, max_ticks=60)
    settings = GeneratorTraining(
        updates=2, batch_size=8, measurements=1, measured_rows=20, config=SMALL
    )
    (numbers,) = train_generator(tmp_path / "data", tmp_path / "run", settings)
    assert 0.0 <= numbers["cells/exact"] <= 1.0
    assert 0.0 < numbers["accepted/share"] <= 1.0
    assert math.isfinite(numbers["reward/mae"])


def test_other_settings_do_not_replace_results(folder, tmp_path):
    settings = GeneratorTraining(updates=1, batch_size=4, measurements=1, config=SMALL)
    list(train_generator(folder, tmp_path / "run", settings))
    with pytest.raises(files.OutputFolderError, match="updates"):
        next(train_generator(folder, tmp_path / "run", dataclasses.replace(settings, updates=2)))


def test_a_missing_gpu_is_refused_before_the_data_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(DeviceError, match="device is 'cuda', .* finds 0 GPUs"):
        next(train_generator(tmp_path / "none", tmp_path / "run", GeneratorTraining(), "cuda"))


def test_the_thesis_generator_has_returns_of_one_step_only():
    words = ["representation=gray", "generator.name=ccdn_thesis", "learner.n_steps=3"]
    with pytest.raises(ValueError, match=r"learner.n_steps is 3.* 1 with .*ccdn_thesis"):
        check_generator(compose_config(words))


def test_the_commands_collect_describe_and_train(tmp_path, capsys):
    data, run = str(tmp_path / "data"), str(tmp_path / "run")
    words = f"dataset collect --game deep_maze --scenario 7x7-deterministic --rows 300 --out {data}"
    assert main(words.split()) == 0
    assert "180 transitions of" in capsys.readouterr().out
    assert main(["dataset", "show", data]) == 0
    assert "num_heldout: 120" in capsys.readouterr().out
    words = f"generator train {data} --out {run} --updates 2 --measurements 1 --set size.depth=1"
    assert main(words.split()) == 0
    assert "update 2, " in capsys.readouterr().out


@pytest.mark.slow  # its network, quick: tests/generative/networks/test_thesis.py
def test_the_thesis_generator_learns_grey_frames_and_nothing_else(tmp_path):
    collect(tmp_path / "grey", 60, representation="gray", max_ticks=20)
    settings = GeneratorTraining(
        "ccdn_thesis", updates=1, batch_size=2, measurements=1, measured_rows=4, config=SMALL
    )
    (numbers,) = train_generator(tmp_path / "grey", tmp_path / "run", settings)
    assert 0.0 <= numbers["cells/changed_f1"] <= 1.0
    assert (tmp_path / "run" / "predictions.png").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train", "nowhere", "--out", "x"], "nowhere holds no data set"),
        (["train", "x", "--out", "y", "--model", "cdcn"], "unknown generator 'cdcn'.*'ccdn'"),
        (["train", "x", "--out", "y", "--set", "size.dept=1"], "dept"),
        (["train", "x", "--out", "y", "--set", "size"], "--set size: write --set name=value"),
        (["wach"], "unknown generator command 'wach'"),
    ],
)
def test_wrong_words_are_refused(words, message, capsys):
    assert main(["generator", *words]) == 2
    assert re.search(message, capsys.readouterr().err)


class Silent:
    """A generator that cannot be measured."""

    spec = observe = hold_out = update = evaluate = generate = predict = last_report = None
    state_dict = load_state_dict = export_knowledge = import_knowledge = None

    def __init__(self, config, spec):
        pass


def test_a_generator_that_cannot_be_measured_is_refused(folder, tmp_path):
    settings = GeneratorTraining(
        "tests.training.offline.test_generator_training:Silent", config=SMALL
    )
    with pytest.raises(ValueError, match="Silent has no method `imagine"):
        next(train_generator(folder, tmp_path / "run", settings))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"observation_shape": (28, 11, 12)},
            r"observations \[28, 11, 12\], .* has \[28, 11, 11\]",
        ),
        ({"num_actions": 9}, r"9 actions and 2 players, .* has \[28, 11, 11\], 137 and 2: collect"),
        ({"num_players": 3}, "3 players, .* and 2: collect it again"),
    ],
)
def test_a_data_set_of_other_shapes_is_refused(folder, changes, message):
    with pytest.raises(ValueError, match=f"the data set holds .*{message}"):
        describe_game(dataclasses.replace(load_dataset(folder).about, **changes))


def test_a_loss_that_is_not_finite_ends_the_training(folder, tmp_path, capsys):
    config = dataclasses.replace(SMALL, learning_rate=1e30)
    settings = GeneratorTraining(updates=20, batch_size=8, measurements=1, config=config)
    with pytest.raises(
        FloatingPointError, match=r"the loss \w+ is (nan|inf) at update \d+: take a"
    ):
        list(train_generator(folder, tmp_path / "run", settings))
    assert not (tmp_path / "run" / "generator.pt").exists()
    words = f"generator train {folder} --out {tmp_path / 'cli'} --updates 20 --measurements 1"
    assert main([*words.split(), "--set", "learning_rate=1e30", "--set", "size.channels=4"]) != 0
    assert "smaller learning rate" in capsys.readouterr().err


def test_a_data_set_of_another_version_is_refused(folder, tmp_path, monkeypatch):
    other = dataclasses.replace(LINE_WARS, version="99", agents_of=())
    monkeypatch.setattr(
        "marl_cair.training.offline.generator_training.GAMES", {"deep_line_wars": other}
    )
    with pytest.raises(ValueError, match=r"is of deep_line_wars .*, here is 99: collect it again"):
        next(train_generator(folder, tmp_path / "run", GeneratorTraining(config=SMALL)))
    monkeypatch.setattr(f"{train_generator.__module__}.GAMES", {})
    with pytest.raises(ValueError, match="of deep_line_wars, which is not installed"):
        next(train_generator(folder, tmp_path / "run", GeneratorTraining(config=SMALL)))


def test_the_thesis_generator_refuses_planes(folder, tmp_path):
    settings = GeneratorTraining("ccdn_thesis", config=SMALL)
    with pytest.raises(
        ValueError, match=r"predicts one grey frame .* set game.representation=gray"
    ):
        next(train_generator(folder, tmp_path / "run", settings))
