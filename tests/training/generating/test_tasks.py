"""Weights of a generator name their game, and are refused by runs of another one."""

import dataclasses

import pytest
import torch

from marl_cair.checkpoint import load_tensors, save_tensors
from marl_cair.games import GAMES
from marl_cair.generative.settings import GeneratorConfig, NetworkSize, ThesisSize
from marl_cair.training.generating import generators
from marl_cair.training.generating.generators import GENERATOR_FILE, describe_task, make_generator
from marl_cair.training.settings.config import GameSettings, GeneratorSettings, TrainConfig
from marl_cair.training.settings.config_file import learned_fields
from marl_cair.training.settings.learner import LearnerSettings
from tests.processes import ROOT

SMALL = GeneratorConfig(
    size=NetworkSize(channels=4, depth=1, hidden=8), thesis=ThesisSize(hidden=4)
)
KINDS = {
    "ccdn": "planes",
    "ccgan": "planes",
    "ccdn_thesis": "gray",
    "generator:MemoryGenerator": "planes",  # of docs/extending
}


def configure(name, scenario, kind="ccdn", transfer=False, **options):
    return TrainConfig(
        game=GameSettings(name, scenario, KINDS[kind], options=options),
        generator=GeneratorSettings(kind, model=SMALL, transfer=transfer),
        learner=LearnerSettings(n_steps=1),
    )


def make(config, source=None):
    spec = config.game.spec
    seen = spec.representations[config.game.representation]
    return make_generator(config, seen, spec, 0, source and str(source))


def save(config, folder):
    task = describe_task(GAMES[config.game.name], learned_fields(config), config.game.spec)
    return generators.save_generator(make(config), folder, task)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_begin_a_run_of_their_own_game_alone(kind, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "extending")
    saved = configure("deep_maze", "9x9-deterministic", kind)
    rest = save(saved, tmp_path)
    make(saved, tmp_path)
    other = configure("deep_maze", "9x9-stochastic", kind)
    with pytest.raises(ValueError, match="scenario with .*mode=deterministic.*mode=stochastic"):
        make(other, tmp_path)
    moved = dataclasses.replace(other.generator, transfer=True)
    make(dataclasses.replace(other, generator=moved), tmp_path)
    with pytest.raises(ValueError, match="of deep_maze version .*, this run of flappy_bird vers"):
        make(configure("flappy_bird", "classic", kind, transfer=True), tmp_path)
    generators.restore_generator(make(saved), tmp_path, rest)  # a resumed run


@pytest.mark.parametrize(
    ("game", "scenario", "old", "new"),
    [
        ("deep_line_wars", "11x11", "2018", "balanced"),
        ("deep_rts", "1v1-15x15", "thesis", "balanced"),
    ],
)
def test_presets_of_a_game_are_scenarios(game, scenario, old, new, tmp_path):
    save(configure(game, scenario, preset=old), tmp_path)
    with pytest.raises(ValueError, match=f"preset={old}.*, this run's has preset={new}"):
        make(configure(game, scenario, preset=new), tmp_path)


def test_another_discount_is_no_other_scenario(tmp_path):
    config = configure("deep_line_wars", "11x11")
    save(config, tmp_path)
    make(dataclasses.replace(config, learner=LearnerSettings(gamma=0.9)), tmp_path)


def test_other_actions_versions_and_files_without_a_game_are_refused(tmp_path, monkeypatch):
    config = configure("deep_line_wars", "11x11", transfer=True)
    save(config, tmp_path)
    with pytest.raises(ValueError, match="it has 137 actions, this run 185: .*number 9, build"):
        make(configure("deep_line_wars", "10x15", transfer=True), tmp_path)
    newer = dataclasses.replace(GAMES["deep_line_wars"], version="99", agents_of=())
    with monkeypatch.context() as patch:
        patch.setattr(generators, "GAMES", {"deep_line_wars": newer})
        with pytest.raises(
            ValueError, match="of deep_line_wars version .*deep_line_wars version 99"
        ):
            make(config, tmp_path)
        patch.setitem(
            generators.GAMES, "deep_line_wars", dataclasses.replace(newer, agents_of=("1",))
        )
        make(config, tmp_path)
    weights = dict(load_tensors(tmp_path / GENERATOR_FILE))
    del weights["made_for"]
    save_tensors(weights, tmp_path / GENERATOR_FILE)
    made = make(config, tmp_path)
    assert torch.equal(made.network.choose.weight, weights["network"]["network"]["choose.weight"])
    with pytest.raises(ValueError, match=r"without its game: generator.transfer=true trusts it"):
        make(configure("deep_line_wars", "11x11"), tmp_path)
