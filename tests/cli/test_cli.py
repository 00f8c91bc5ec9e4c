"""The console command: what it refuses, what it composes, and one small run from end to end."""

import contextlib
import json
import shutil
import signal
import subprocess
import sys
import threading
import time

import pytest
import yaml

from marl_cair.cli import main
from marl_cair.cli.compose import (
    CONF,
    compose_config,
    list_choices,
    list_games,
    list_opponents,
    run_hydra,
)
from marl_cair.cli.train import describe_options
from marl_cair.games import GAMES
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from marl_cair.lookup import UnknownNameError
from marl_cair.self_play.samplers import LEAGUE_SAMPLERS, SAMPLERS
from marl_cair.training.settings.config_file import build_config, load_config, save_config
from marl_cair.training.settings.options import list_options
from tests.refusals import assert_refused

SMALL = (
    *("scenario=11x11", "max_ticks=300", "torch_threads=1", "collector.num_worlds=16"),
    *("collector.steps_per_batch=8", "replay.min_transitions=200", "learner.batch_size=32"),
    *("replay.capacity_transitions=3000", "policy.hidden_width=16"),
    *("generator.model.size.channels=4", "generator.model.size.depth=1"),
    *("evaluation.every_frames=1024", "evaluation.games=2"),
)


def test_the_issues_example_composes():
    words = "game=deep_line_wars policy=capsule opponent=self_play synthetic_fraction=0.2 seed=3"
    config = compose_config(words.split())
    assert (config.policy.body, config.synthetic_fraction, config.seed) == ("capsule", 0.2, 3)
    assert config.opponent.mixture == {"latest": 0.5, "pfsp": 0.35, "uniform": 0.1, "bots": 0.05}


def test_no_words_give_the_defaults():
    from marl_cair.training.settings.config import TrainConfig

    assert compose_config([]) == TrainConfig()


@pytest.mark.slow
@pytest.mark.parametrize("group", ["game", "policy", "generator"])
def test_every_choice_of_a_group_composes(group):
    for choice in list_choices(group):
        compose_config([f"{group}={choice}"])


@pytest.mark.slow
def test_every_bot_and_every_way_of_self_play_is_a_choice_that_composes():
    games = {bot: name for name in GAMES for bot in GAMES[name].bots}
    choices = list_opponents()
    assert set(choices) == {*SAMPLERS, *games} - set(LEAGUE_SAMPLERS)
    for choice, settings in choices.items():
        game = games.get(choice, next(iter(GAMES)))
        config = compose_config([f"game={game}", f"opponent={choice}"])
        has_file = (CONF / "opponent" / f"{choice}.yaml").is_file()  # it may add others
        assert choice in config.opponent.mixture
        assert has_file or config.opponent.mixture == settings["mixture"]


@pytest.mark.parametrize("game", GAMES)
def test_opponents_in_a_game_are_its_bots_and_all_ways_of_self_play(game):
    own = {*SAMPLERS, *GAMES[game].bots}
    for choice, opponent in list_opponents().items():
        refused = pytest.raises(UnknownNameError, match=choice)
        with contextlib.nullcontext() if choice in own else refused:
            build_config({"game": list_games()[game], "opponent": opponent})


@pytest.mark.slow
def test_a_sweep_composes_one_job_for_each_combination(capsys):
    assert len(run_hydra(["-m", "learner.algorithm=dqn,pqn", "learner.batch_size=64"])) == 2
    jobs = run_hydra(["--multirun", "seed=0,1", "policy=conv,capsule", "total_frames=1e4"])
    assert [(job.config.seed, job.config.policy.body) for job in jobs] == [
        (0, "conv"),
        (0, "capsule"),
        (1, "conv"),
        (1, "capsule"),
    ]
    assert {job.config.total_frames for job in jobs} == {10_000}
    assert len({job.name for job in jobs}) == 4


@pytest.mark.slow
def test_a_sweep_trains_each_job_and_begins_none_again(tmp_path, capsys):
    out = tmp_path / "sweep"
    words = ["train", "--multirun", *SMALL, "seed=0,1", "total_frames=256", f"out={out}"]
    assert main(words) == 0
    logs = {load_config(folder).seed: (folder / "log.csv").read_text() for folder in out.iterdir()}
    assert set(logs) == {0, 1}
    assert main(words) == 0
    assert capsys.readouterr().out.count("job 2 of 2") == 2
    for folder in out.iterdir():
        assert (folder / "log.csv").read_text() == logs[load_config(folder).seed]


def test_the_configuration_is_printed_and_nothing_is_written(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["train", "--cfg", "job", "recipe=deep_rts_duel", "seed=5"]) == 0
    values = yaml.safe_load(capsys.readouterr().out)
    assert build_config(values) == compose_config(["recipe=deep_rts_duel", "seed=5"])
    assert main(["train", "--multirun", "seed=0,1", "policy=capsul"]) == 2
    for flags in (["--cfg", "job"], ["--cfg=job"], ["-c", "job"], ["--cfg", "job", "--resolve"]):
        assert main(["train", *flags, "synthetic_fraction=2"]) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("recipe", ["duel", "quick", "deep_rts_duel", "deep_rts_curriculum"])
def test_an_opponent_replaces_the_one_of_a_recipe(recipe):
    config = compose_config([f"recipe={recipe}", "opponent=random"])
    assert dict(config.opponent.mixture) == {"random": 1.0}


@pytest.mark.parametrize("game", ["deep_maze_9x9", "flappy_bird_gray", "quick"])
def test_a_recipe_with_memory_joins_that_of_a_game(game):
    assert compose_config([f"recipe=[{game},drqn]"]).policy.memory == "lstm"


def test_recipes_of_a_users_own_folder_are_found(tmp_path):
    (tmp_path / "recipe").mkdir()
    text = "# @package _global_\n# mine\ndefaults:\n  - override /policy: capsule\n\nseed: 9\n"
    (tmp_path / "recipe" / "mine.yaml").write_text(text, "utf-8")
    (job,) = run_hydra(["--config-dir", str(tmp_path), "recipe=mine"])
    assert (job.config.seed, job.config.policy.body) == (9, "capsule")


def test_shorthands_and_numbers_that_are_names():
    config = compose_config(
        ["scenario=30x11", "preset=2017", "actions=classic", "total_frames=1e6"]
    )
    assert config.game.scenario == "30x11"
    assert config.game.options == {"preset": "2017", "actions": "classic"}
    assert config.total_frames == 1_000_000


def test_a_mixture_takes_the_place_of_the_presets():
    config = compose_config(["opponent=self_play", "opponent.mixture={latest: 0.5, counter: 0.5}"])
    assert config.opponent.mixture == {"latest": 0.5, "counter": 0.5}


@pytest.mark.slow
@pytest.mark.parametrize("name", list_choices("recipe"))
def test_every_recipe_composes_and_is_listed(name):
    config = compose_config([f"recipe={name}", "policy=capsule", "seed=7"])
    assert (config.policy.body, config.seed) == ("capsule", 7)
    assert config != compose_config(["policy=capsule", "seed=7"])
    assert f"{name}: " in describe_options()


@pytest.mark.slow
def test_words_beside_a_recipe_go_before_its_own():
    plain = compose_config(["recipe=deep_rts_duel"])
    words = ["learner.gamma=0.9", "scenario=1v1-31x31", "opponent=self_play"]
    config = compose_config([words[0], "recipe=deep_rts_duel", *words[1:]])
    assert plain.learner.gamma != 0.9 == config.learner.gamma
    assert (config.game.name, config.game.scenario) == ("deep_rts", "1v1-31x31")
    assert config.opponent.mixture == compose_config(["opponent=self_play"]).opponent.mixture
    assert config.demonstration == plain.demonstration


@pytest.mark.slow
def test_a_single_weight_changes_a_mixture_that_is_given_whole():
    words = ["opponent.mixture={random: 1}", "opponent.mixture.latest=2"]
    assert compose_config(words).opponent.mixture == {"random": 1, "latest": 2}
    plain = compose_config(["recipe=deep_rts_duel"]).opponent.mixture
    config = compose_config(["recipe=deep_rts_duel", "opponent.mixture.archers=0.3"])
    assert config.opponent.mixture == {**plain, "archers": 0.3}


@pytest.mark.slow
def test_a_choice_beside_a_recipe_replaces_only_what_it_sets():
    config = compose_config(["recipe=deep_maze_9x9", "policy=capsule", "generator=none"])
    assert (config.policy.body, config.policy.distances) == ("capsule", True)
    assert config.generator.name == "none"
    every = config.generator.evaluate_every_frames
    assert every != compose_config([]).generator.evaluate_every_frames
    assert compose_config(["recipe=flappy_bird_gray", "policy=capsule"]).game.reward == "alive"


def test_scenarios_to_be_rated_on_are_mappings_of_options(tmp_path):
    """Under names of the user's own; text that looks like a number stays text."""
    whole = ["evaluation.scenarios={old: {preset: 2017}, short: {max_ticks: 100}}"]
    parts = ["evaluation.scenarios.old.preset=2017", "evaluation.scenarios.short.max_ticks=100"]
    for words in (whole, parts):
        config = compose_config([*words, f"out={tmp_path}", "preset=2018", "max_minutes=2"])
        expected = {"old": {"preset": "2017"}, "short": {"max_ticks": 100}}
        assert config.evaluation.scenarios == expected
        save_config(config)
        assert load_config(str(tmp_path)) == config


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--seed=3"], "write seed=3"),
        (["learing_rate=1"], "'learner.learning_rate'"),
        (["recipe=pqn", "learner.batch_size=64"], "no effect with learner.algorithm=pqn"),
        (["recipe=pqn", "replay.priority_alpha=0.6"], "no effect with learner.algorithm=pqn"),
        (["recipe=pqn", "generator=none", "replay.min_transitions=9"], "no effect with learner"),
        (["opponent=[random,counter]"], "'opponent.mixture={random: 1, counter: 1}'"),
        (["opponent=runs/a"], "'opponent.agents={mine: FOLDER}' 'opponent.mixture="),
        (["stop_score=95"], "stop_score is 95.0, it must be 1 or less: a share of the points"),
        (["evaluation.bots=[random,random]"], "evaluation.bots has 'random' twice"),
        (["gama=0.9"], "nearest are 'learner.gamma'"),
        (["learner.lr=0.1"], "here it is 'learner.learning_rate'"),
        (["collector=3"], "nearest are 'collector.num_worlds'"),
        (["nfsp.lr=0.1"], "nearest are 'nfsp."),
        (["policy=capsul"], "nearest are 'capsule'"),
        (["recipe=deep_rts_dule"], "nearest are 'deep_rts_duel'"),
        (["recipe=deep_rts_duel", "recipe=deep_rts_economy"], "give it once"),
        (["opponent=countr"], "nearest are 'counter'"),
        (
            ["opponent.mixture={main_agents: 1}"],
            "'main_agents', it must be another sampler outside",
        ),
        (["scenario=10x51"], "nearest are '10x15'"),
        (["preset=2016"], "nearest are '2018', '2017'"),
        (["synthetic_fraction=1.5"], "synthetic_fraction is 1.5"),
        (["seed=many"], "seed is 'many', it must be a whole number"),
        (["capsule"], "'capsule' is no option: write name=value"),
        (["resume=/nowhere"], "'/nowhere' holds no run to resume"),
        (["resume="], "resume names no folder: write resume=FOLDER"),
        (["torch_threads=0"], "torch_threads is 0"),
        (["game.options=5"], "game.options is 5, it must be values by name"),
        (["out=null"], "out is None, it must be a text"),
        (["learner.learning_rate=inf"], "learner.learning_rate is inf, it must be finite"),
        (["opponent.mixture=3"], "opponent.mixture is 3, it must be values by name"),
        (["seed=1,2"], "--multirun"),
        (["opponent.mixture={random:a}"], "opponent.mixture.random is 'a', it must be a number"),
        (["evaluation.bots=random"], "evaluation.bots is 'random', it must be a list"),
        (["evaluation.scenarios={a: {rwos: 11}}"], "unknown deep_line_wars option 'rwos'"),
        (["evaluation.scenarios.a.rows=11"], "the learner can only be rated where they are the sa"),
        (["evaluation.options={max_ticsk: 5}"], "nearest are 'max_ticks'"),
        (["map=train-15x15-2p"], "unknown deep_line_wars option 'map'"),
    ],
)
def test_train_refuses_with_one_line(words, message, capsys):
    assert_refused(capsys, message, "train", *words)


def test_help_has_every_option_with_default_and_meaning():
    text = describe_options()
    for option in list_options():
        assert len(option.comment) > 3, option.path
        line, meaning = f"  {option.path} = {option.default}\n", f"      {option.comment}\n"
        assert (line + meaning).replace("None", "null") in text
    assert "policy: capsule, conv, mlp" in text
    assert "generated share of each batch" in text


def test_an_unknown_command_of_the_package_names_the_nearest():
    command = [sys.executable, "-m", "marl_cair", "leage"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "nearest are 'league'" in done.stderr
    assert main([]) == main(["--version"]) == 0


def test_games_as_json_lists_ids_shapes_and_actions(capsys):
    assert main(["games", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["deep_line_wars"]
    assert shown["bots"] == list(GAMES["deep_line_wars"].bots)
    scenario = shown["scenarios"]["10x15"]
    assert scenario["gymnasium_id"] == "marl_cair/DeepLineWars-10x15-v0"
    assert scenario["representations"]["planes"] == {"shape": [28, 10, 15], "dtype": "uint8"}
    assert len(scenario["action_names"]) == scenario["num_actions"] == 185


def test_games_as_text_list_every_scenario(capsys):
    assert main(["games"]) == 0
    shown = capsys.readouterr().out
    for game in GAMES:
        assert GAMES[game].title in shown
        assert all(name in shown for name in GAMES[game].scenarios)
    assert "planes 28x10x15" in shown
    assert "score / 100" in shown


def test_train_resume_evaluate_and_league_from_end_to_end(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["train", *SMALL, f"out={out}", "total_frames=1024"]) == 0
    assert main(["train", *SMALL, f"out={out}", "total_frames=1024"]) == 2
    assert f"resume it with `marl-cair train resume={out}`" in capsys.readouterr().err
    assert_refused(capsys, "total_frames is 640, it must be 1024 or more, where", "train",
                   f"resume={out}", "total_frames=640")  # fmt: skip
    assert main(["train", f"resume={out}", "total_frames=1.28e3", "max_minutes=null"]) == 0
    assert main(["train", f"resume={out}", "seed=2"]) == 2
    assert "unknown option of a resumed run 'seed'" in capsys.readouterr().err
    shutil.copytree(out, tmp_path / "ended", ignore=shutil.ignore_patterns("resume"))
    assert main(["train", f"resume={tmp_path / 'ended'}", "total_frames=2000"]) == 2
    assert "has ended, and its state (resume) was deleted" in capsys.readouterr().err
    table = tmp_path / "table.csv"
    words = ["evaluate", f"{out}/latest", "--games", "2", "--out", str(table)]
    assert main(words) == 0
    assert table.read_text("utf-8").startswith("opponent,games,wins")
    league = ["league", f"{out}/latest", "random", "--games", "2", "--scenario", "11x11"]
    league += ["--set", "max_ticks=40"]
    assert main([*league, "--out", str(tmp_path / "league")]) == 0
    assert "Ladder" in capsys.readouterr().out
    with contextlib.closing(LeagueStore(tmp_path / "league" / STORE_FILE)) as store:
        assert store.settings["scenario"]["max_ticks"] == 40


@pytest.mark.slow
def test_an_interrupt_saves_and_exits_with_130(tmp_path, capsys):
    """Ctrl-C while it learns: the first agent has been saved."""
    run = tmp_path / "run"
    words = [*SMALL, f"out={run}", "total_frames=100000000", "checkpoint.every_frames=512"]

    is_over = threading.Event()

    def interrupt():
        deadline = time.monotonic() + 120
        while not (run / "latest").exists() and time.monotonic() < deadline:
            if is_over.wait(0.05):
                return
        signal.raise_signal(signal.SIGINT)  # which Python hears in the main thread

    terminal = threading.Thread(target=interrupt)
    terminal.start()
    try:
        assert main(["train", *words]) == 130
    finally:
        is_over.set()
        terminal.join()
    assert "marl-cair train resume=" in capsys.readouterr().err
    assert (run / "resume" / "state.pt").is_file()
