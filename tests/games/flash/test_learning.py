"""Agents learn, resume and play a league on Flash games; a generator learns from their pictures."""

import pytest
import torch

from marl_cair.checkpoint import load_network
from marl_cair.cli.compose import compose_config
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.training.collecting.dataset import collect_dataset
from tests.games.flash.browser.flash_files import need_flash
from tests.training.runs import train


@pytest.fixture(scope="module", autouse=True)
def _needs_browsers():
    need_flash()


def compose(folder, *words):
    """A run in two browsers that learns from its 64th transition on."""
    return compose_config(
        [
            *(f"out={folder}", "total_frames=384", "torch_threads=1", "policy.hidden_width=16"),
            *("collector.num_worlds=2", "collector.steps_per_batch=16", "learner.batch_size=16"),
            *("collector.stagger_steps=0", "replay.min_transitions=64"),
            *words,
        ]
    )


def test_duel_is_trained_resumed_and_played_in_a_league(tmp_path):
    options = {"transport": "numbers", "max_ticks": 120}  # games of 60 steps
    config = compose(
        tmp_path / "run",
        *("game=flash", "scenario=duel", "game.representation=vector", "policy=mlp"),
        f"game.options={options}".replace("'", ""),
        *("opponent.mixture={latest:0.5,duelist:0.5}", "opponent.snapshot_every_frames=128"),
        *("evaluation.every_frames=384", "evaluation.games=2", "generator=none"),
    )
    agent, resumed = tmp_path / "run" / "latest", []

    def note_beginning(run):
        if not resumed:
            saved = load_network(agent)[0].state_dict()
            resumed.append((run.frames, len(run.replay.real)))
            torch.testing.assert_close(run.rated_network.state_dict(), saved, rtol=0, atol=0)
        return True

    first = train(config, until_frames=192)
    assert first.updates > 0
    last = train(config, resume=True, watch=note_beginning)
    assert resumed == [(192, first.last_row["replay/transitions"])]
    assert (last.frames, last.updates) == (384, 2 * first.updates)
    assert last.last_row["replay/transitions"] >= 384  # of one or two seats in each of 384 steps
    assert 0.0 <= last.last_row["win_rate/random"] <= 1.0

    league = LeagueConfig(
        ("random", "duelist", str(agent)),
        game="flash",
        scenario="duel",
        scenario_options=options,
        games_per_pair=2,
        out=str(tmp_path / "league"),
        replays=False,
    )
    rated = run_league(league, show_progress=False).ratings
    assert {one.name: one.games for one in rated} == {"random": 4, "duelist": 4, "run": 4}


def test_a_generator_learns_from_the_frames_of_multitask_and_resumes(tmp_path):
    config = compose(
        tmp_path / "run",
        *("recipe=flash", "evaluation.every_frames=1000000", "generator.batch_size=8"),
        *("generator.frames_per_update=2", "generator.model.size.channels=8"),
    )
    assert config.game.representation == "gray_stack"
    first = train(config, until_frames=192).last_row
    last = train(config, resume=True).last_row
    assert last["generator/cells"] < 0.95 * first["generator/cells"]  # mean losses of each part
    assert last["generator/reward"] < 0.9 * first["generator/reward"]
    assert last["generator/failures"] == 0


def test_a_data_set_is_collected_in_few_browsers(tmp_path, monkeypatch):
    opened = []
    close = BatchedEngine.close
    monkeypatch.setattr(
        BatchedEngine, "close", lambda engine: (opened.append(engine.num_worlds), close(engine))
    )
    game = GAMES["flash"]
    scenario = game.scenario("duel", transport="numbers", max_ticks=120)
    agents = [game.bots["duelist"](scenario, game.make_spec(scenario)) for _ in range(2)]
    about = collect_dataset(
        tmp_path / "data", game, ("duel", scenario), "vector", agents, 600, seed=0
    )
    assert (about.num_train, about.num_heldout) == (360, 240)
    assert about.train_episodes + about.heldout_episodes >= 4
    assert opened == [4]
