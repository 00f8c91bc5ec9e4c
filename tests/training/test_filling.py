"""Training on a data set: what fills replay, what is learned from, and what is refused."""

import dataclasses
import math

import pytest
import torch

from marl_cair.games import make_engine
from marl_cair.generative.gate import Acceptance, GateReport
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.replay import load_dataset
from marl_cair.training.collecting.filling import _check_game
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import GameSettings, GeneratorSettings
from marl_cair.training.settings.evaluation import CheckpointSettings
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.settings.offline import OfflineSettings
from marl_cair.training.trainer import Timers, iterate
from tests.training.offline.datasets import collect
from tests.training.runs import SMALL_GENERATOR, tiny, train, train_whole_and_in_parts

LENIENT = Acceptance(min_surety=-math.inf, certain=0.0, may_end=True, may_be_rare=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("data") / "wars"
    collect(place)
    return place


def offline(out, data, fraction=0.0, n_steps=1, options=None, **changes):
    """A run on the data set: 360 transitions; an update for each 64 steps."""
    generator = GeneratorSettings(
        name="ccdn" if fraction else "none",
        model=SMALL_GENERATOR,
        batch_size=16,
        open_frames_per_update=512,
        evaluate_every_frames=512,
        refill_every_frames=128,
        rows_per_refill=50,
    )
    return tiny(
        out,
        512,
        game=GameSettings(scenario="11x11", options={"max_ticks": 100, **(options or {})}),
        generator=generator,
        offline=OfflineSettings(str(data), generator_updates=3),
        synthetic_fraction=fraction,
        learner=LearnerSettings(batch_size=20, frames_per_update=64, n_steps=n_steps),
        **changes,
    )


def open_gate(monkeypatch):
    def look(generator):
        generator.last_report = GateReport(True, (), {}, LENIENT)
        return generator.last_report

    monkeypatch.setattr(CCDNGenerator, "evaluate", look)
    monkeypatch.setattr(
        "marl_cair.generative.generator.find_broken_structure",
        lambda rows, spec: torch.zeros(len(rows), dtype=torch.bool),
    )


def find_places(rows):
    """Numbers of rows by what they hold."""
    names = ("observation", ("next", "observation"), "action", ("next", "reward"))
    values = torch.cat([rows[name].double().reshape(len(rows), -1) for name in names], 1)
    return {tuple(row): place for place, row in enumerate(values.tolist())}


def test_replay_holds_the_transitions_to_train_on(folder, tmp_path):
    run = TrainingRun(offline(tmp_path / "run", folder, 0.5))  # which records other_actions
    real, rows = run.replay.real, load_dataset(folder).train
    stored = real.read_steps(real.storage.sampleable_slots())
    assert len(stored) == len(rows) == 360
    found, wanted = find_places(stored), find_places(rows)
    assert found.keys() == wanted.keys()
    assert len(found) == 360
    for row, place in found.items():
        for key in ("action_mask", "other_actions", ("next", "terminated")):
            assert torch.equal(stored[key][place], rows[key][wanted[row]])
    run.close()


def test_returns_of_several_steps_follow_the_episodes(folder, tmp_path):
    run = TrainingRun(offline(tmp_path / "run", folder, n_steps=3))
    real = run.replay.real
    stored = real.read_steps(real.storage.sampleable_slots(), 3)
    lengths = stored["steps_to_next_obs"].flatten().bincount().tolist()
    assert len(lengths) == 4
    assert lengths[3] > 200  # most steps are followed by others
    run.close()


def test_nothing_is_played_and_the_learner_learns(folder, tmp_path):
    result = train(offline(tmp_path / "run", folder))
    assert (result.frames, result.updates) == (512, 8)
    row = read_log(tmp_path / "run" / "log.csv")[-1]
    assert row["replay/transitions"] > 360  # with ends
    assert "seconds/collect" not in row
    assert row["batch/generated_share"] == 0.0


def test_with_a_fraction_of_1_no_real_row_is_in_a_batch(folder, tmp_path, monkeypatch):
    open_gate(monkeypatch)
    run = TrainingRun(offline(tmp_path / "run", folder, 1.0))
    steps = iterate(run, Timers())
    next(steps)
    assert run.generator.num_updates == 3  # before the learner's first
    assert len(run.replay.generated) == run.replay.generated.capacity
    assert run.learner.updates == 2
    assert run.replay.sample()["is_generated"].all()
    run.close()


@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_the_gate_holds_the_rows_that_the_data_set_holds_out(folder, tmp_path, scale):
    config = offline(tmp_path / "run", folder, 0.2)
    scaled = dataclasses.replace(config.learner, reward_scale=scale)
    run = TrainingRun(dataclasses.replace(config, learner=scaled))
    next(iterate(run, Timers()))
    held = run.generator._heldout
    kept = held.select(torch.arange(held.num_rows))
    every = run.replay.real.read_steps(run.replay.real.storage.step_slots())
    assert not run.generator._split(every).any()  # all others are learned from
    run.close()
    heldout = load_dataset(folder).heldout.to_tensordict()
    heldout["next", "reward"] *= scale
    assert len(kept) == len(heldout) == 240
    assert sorted(find_places(heldout)) == sorted(find_places(kept))


def test_while_its_gate_is_shut_nothing_is_learned_from_real_rows_instead(folder, tmp_path, capsys):
    result = train(offline(tmp_path / "run", folder, 1.0), show_progress=True)
    assert result.updates == 0
    shown = "".join(capsys.readouterr())
    assert "shut, nothing is learned: changed-cell F1 0.000 is below" in shown


@pytest.mark.slow
def test_an_offline_run_resumes_bit_for_bit(folder, tmp_path, monkeypatch):
    open_gate(monkeypatch)
    train_whole_and_in_parts(tmp_path, lambda out: offline(out, folder, 0.5), until=256)


def test_an_offline_run_without_saved_replay_generates_again(folder, tmp_path, monkeypatch):
    open_gate(monkeypatch)
    kept = CheckpointSettings(include_replay=False)
    config = offline(tmp_path / "run", folder, 1.0, checkpoint=kept)
    train(config, until_frames=256)
    run = TrainingRun(config, resume=True)
    before = len(run.replay.generated), run.generator.num_updates
    next(iterate(run, Timers()))
    assert before == (0, 3)
    assert len(run.replay.generated) >= 300
    assert run.replay.sample()["is_generated"].all()
    run.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"options": {"max_ticks": 90}}, "max_ticks is 100 there, 90 in this run.* --set"),
        ({"n_steps": 2, "fraction": 1.0}, r"rollout_steps is 1, it must be .*n_steps \(2\)"),
    ],
)
def test_a_run_that_does_not_fit_is_refused(folder, tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        TrainingRun(offline(tmp_path / "run", folder, **changes))
    assert not (tmp_path / "run").exists()


def test_without_a_data_set_the_gate_needs_held_out_rows(tmp_path):
    model = dataclasses.replace(SMALL_GENERATOR, heldout_share=0.0)
    with pytest.raises(ValueError, match="generator.model.heldout_share is 0.0, it must be above"):
        TrainingRun(tiny(tmp_path, 512, generator=GeneratorSettings(model=model)))


def test_what_needs_play_is_refused(folder, tmp_path):
    with pytest.raises(ValueError, match=r"synthetic_fraction is 1.0, .* 0..0.9 without offline"):
        tiny(tmp_path / "run", synthetic_fraction=1.0)
    config = offline(tmp_path / "run", folder)
    with pytest.raises(ValueError, match="generator.name is 'none', it must be a generator"):
        dataclasses.replace(config, synthetic_fraction=1.0)
    learner = dataclasses.replace(config.learner, algorithm="pqn")
    with pytest.raises(ValueError, match="algorithm is 'pqn', it must be dqn with offline.dataset"):
        dataclasses.replace(config, learner=learner)
    nfsp = dataclasses.replace(config.nfsp, enabled=True)
    with pytest.raises(ValueError, match=r"offline.dataset is .*, it must be null with nfsp"):
        dataclasses.replace(config, nfsp=nfsp)
    replay = dataclasses.replace(config.replay, capacity_transitions=301)
    with pytest.raises(ValueError, match="capacity_transitions is 301: set it to"):
        TrainingRun(dataclasses.replace(config, replay=replay))
    with pytest.raises(FileNotFoundError, match="holds no data set"):
        TrainingRun(offline(tmp_path / "run", tmp_path / "nowhere"))
    game = dataclasses.replace(config.game, representation="heatmap")
    off = dataclasses.replace(config, game=game, policy=QNetworkConfig(hidden_width=32))
    with pytest.raises(ValueError, match="is of deep_line_wars .* planes, this run of .* heatmap"):
        TrainingRun(off)


def test_a_field_that_is_newer_than_the_data_set_has_its_default_there(folder):
    about = load_dataset(folder).about
    held = {name: value for name, value in about.scenario_options.items() if name != "max_ticks"}
    older = dataclasses.replace(about, scenario_options=held)
    usual = make_engine("deep_line_wars", "11x11", reward="shaped")
    _check_game("data", older, usual, "planes")
    discounted = make_engine("deep_line_wars", "11x11", reward="shaped", shaping_discount=0.9)
    with pytest.raises(ValueError, match="shaping_discount is 0.99 there, 0.9 in this run"):
        _check_game("data", older, discounted, "planes")
    other = make_engine("deep_line_wars", "11x11", reward="shaped", max_ticks=70)
    message = f"max_ticks is {usual.scenario.max_ticks} there, 70 in this run"
    with pytest.raises(ValueError, match=message):
        _check_game("data", older, other, "planes")


def test_the_discount_of_shaping_matters_only_where_rewards_are_shaped(folder):
    about = load_dataset(folder).about
    plain = {**about.scenario_options, "reward": "sparse"}
    changes = {"max_ticks": 100, "reward": "sparse", "shaping_discount": 0.9}
    engine = make_engine("deep_line_wars", "11x11", **changes)
    _check_game("data", dataclasses.replace(about, scenario_options=plain), engine, "planes")
