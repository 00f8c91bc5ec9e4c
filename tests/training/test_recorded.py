"""Recorded games fill the replay buffer as demonstrations."""

import dataclasses
import shutil

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.replays import read_replays, replay_steps
from marl_cair.league.play.match import play_match
from marl_cair.league.play.recording import Recording
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import ReplaySettings
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.trainer import iterate
from tests.training.runs import tiny, train

GAME = GAMES["deep_line_wars"]
OPTIONS = {"max_ticks": 300}  # as `tiny` plays: 30 steps


@pytest.fixture(scope="module")
def games(tmp_path_factory):
    """A folder of four games between `random` and `turtle`, none of which is won."""
    folder = tmp_path_factory.mktemp("games")
    scenario = GAME.scenario("11x11", **OPTIONS)
    agents = [GAME.bot(name, scenario) for name in ("random", "turtle")]
    play_match(*agents, GAME, scenario, 4, 0, record=Recording(folder, ("random", "turtle")))
    return folder


def make(tmp_path, source, *players, **changes):
    demonstration = DemonstrationSettings(replays=str(source), players=players)
    return tiny(tmp_path / "run", demonstration=demonstration, **changes)


def read_all(folder):
    return [replay for path in sorted(folder.iterdir()) for replay in read_replays(path)]


def test_the_steps_of_a_player_are_demonstrations(tmp_path, games):
    run = TrainingRun(make(tmp_path, games, "turtle"))
    run.close()
    replays = read_all(games)
    storage = run.replay.real.storage
    assert len(storage) == sum(len(one.actions) + 1 for one in replays)
    rows = storage.get_transitions(storage.sampleable_slots(), num_steps=1)
    played = np.concatenate([one.actions[:, one.players.index("turtle")] for one in replays])
    assert rows["expert_action"].tolist() == rows["action"].tolist()
    assert sorted(rows["action"].tolist()) == sorted(played.tolist())
    seen = {row.numpy().tobytes() for row in rows["observation"]}
    replay = replays[1]
    steps = [engine.observe("planes")[0] for engine in replay_steps(replay)]
    assert {one[replay.players.index("turtle")].tobytes() for one in steps[:-1]} <= seen
    assert not {one[replay.players.index("random")].tobytes() for one in steps[9:-1]} & seen
    assert rows["next", "done"].sum() == 4  # the time was up
    assert rows["next", "terminated"].sum() == 0


def test_a_game_that_is_in_two_files_is_learned_once(tmp_path, games):
    folder = tmp_path / "twice"
    shutil.copytree(games, folder)
    (path,) = folder.iterdir()
    torn = path.read_bytes()[:-40]
    path.with_name("a-torn.replay").write_bytes(torn)
    path.with_name("z-torn.replay").write_bytes(torn)
    run = TrainingRun(make(tmp_path, folder, "turtle"))
    run.close()
    assert len(run.replay.real.storage) == sum(len(one.actions) + 1 for one in read_all(games))


def test_rewards_are_those_of_the_run(tmp_path, games):
    config = make(tmp_path, games, "turtle")
    run = TrainingRun(config)
    run.close()
    storage = run.replay.real.storage
    rewards = storage.get_transitions(storage.sampleable_slots(), num_steps=1)["next", "reward"]
    scenario = run.env.engine.scenario
    assert scenario.reward == "shaped"
    expected = 0.0
    for replay in read_all(games):
        steps = replay_steps(dataclasses.replace(replay, scenario=scenario, hashes={}))
        expected += sum(one.rewards[0, replay.players.index("turtle")] for one in steps)
    assert rewards.sum().item() == pytest.approx(expected * config.learner.reward_scale, rel=1e-4)
    assert rewards.abs().sum() > 0


def test_the_generator_sees_them_too(tmp_path, games):
    run = TrainingRun(make(tmp_path, games, "turtle"))
    shown = int(run.replay.real.storage.step_slots().numel())
    assert shown > 100
    rounds = iterate(run, Timers())
    next(rounds)
    counted = run.generator.state_dict()["counts"]["counts"][0]
    run.close()
    assert counted >= shown


@pytest.mark.slow
def test_a_run_learns_from_them_and_resumes(tmp_path, games):
    config = make(tmp_path, games, "turtle", frames=512)
    result = train(config)
    assert result.frames == 512
    assert result.updates > 0
    assert result.last_row["loss/all"] > 0
    further = dataclasses.replace(config, total_frames=640)
    assert train(further, resume=True).frames == 640


def test_without_names_the_winners_demonstrate(tmp_path):
    scenario = GAME.scenario("11x11", max_ticks=3_000)
    agents = [GAME.bot(name, scenario) for name in ("rusher", "turtle")]
    folder = tmp_path / "games"
    play_match(*agents, GAME, scenario, 2, 0, record=Recording(folder, ("rusher", "turtle")))
    config = make(tmp_path, folder)
    config = dataclasses.replace(
        config, game=dataclasses.replace(config.game, options={"max_ticks": 3_000})
    )
    run = TrainingRun(config)
    run.close()
    replays = read_all(folder)
    assert all(one.winner is not None for one in replays)
    assert len(run.replay.real) == sum(len(one.actions) + 1 for one in replays)
    storage = run.replay.real.storage
    rows = storage.get_transitions(storage.sampleable_slots(), num_steps=1)
    assert rows["next", "terminated"].sum() == 2


@pytest.mark.parametrize(
    ("source", "players", "changes", "message"),
    [
        ("games", ("human",), {}, "players are human, who play in no game of .* random, turtle"),
        ("games", (), {}, "have 0 demonstrated steps and ends, allowed are 1..3000"),
        ("empty", (), {}, "a folder without replays .*--record FOLDER"),
        ("none", (), {}, "none"),
        (
            "games",
            ("turtle",),
            {"replay": ReplaySettings(100, 10, min_transitions=10)},
            "have 124 demonstrated steps and ends, allowed are 1..100",
        ),
    ],
)
def test_replays_that_do_not_fit_are_refused(tmp_path, games, source, players, changes, message):
    (tmp_path / "empty").mkdir()
    place = games if source == "games" else tmp_path / source
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        TrainingRun(make(tmp_path, place, *players, **changes))
    assert not (tmp_path / "run").exists()


def test_other_scenarios_and_games_are_refused(tmp_path, games):
    config = make(tmp_path, games, "turtle")
    longer = dataclasses.replace(config.game, options={"max_ticks": 400})
    message = "of another scenario: max_ticks is 300 there, 400 in this run"
    with pytest.raises(ValueError, match=message):
        TrainingRun(dataclasses.replace(config, game=longer))
    maze = GAMES["deep_maze"]
    scenario = maze.scenario("7x7-full_deterministic")
    from marl_cair.league.play.solo import play_alone

    record = Recording(tmp_path / "maze", ("oracle",))
    play_alone(maze.bot("oracle", scenario), maze, scenario, 1, 0, record=record)
    with pytest.raises(ValueError, match="is a game of deep_maze, the run plays deep_line_wars"):
        TrainingRun(make(tmp_path, tmp_path / "maze"))


def test_players_without_replays_are_refused():
    message = r"demonstration\.players.*\(\) without demonstration\.replays"
    with pytest.raises(ValueError, match=message):
        DemonstrationSettings(players=("turtle",))
