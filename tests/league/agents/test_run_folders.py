"""The folder of a run as an agent: leagues take its agents, other commands its newest."""

import shutil
from contextlib import closing

import pytest

from marl_cair import checkpoint
from marl_cair.checkpoint import CheckpointError
from marl_cair.cli import main
from marl_cair.files import claim_output_folder, read_run_kind
from marl_cair.league.agents.load import describe_agent, find_fingerprint, load_agent, read_source
from marl_cair.league.agents.mixtures import read_mixture, save_mixture
from marl_cair.league.agents.run_folders import expand_runs
from marl_cair.league.store.store import LeagueStore
from marl_cair.training.settings.config import EvaluationSettings, OpponentSettings
from marl_cair.training.trainer import train
from tests.league.leagues import count_games
from tests.league.players import GAME, save_network
from tests.refusals import assert_refused
from tests.training.runs import NEVER, tiny


def make_run(folder, seeds=(), latest=0, kind="training"):
    """A run of networks from `seeds`: its snapshots, and its newest agent."""
    with claim_output_folder(folder, kind, {}):
        for number, seed in enumerate(seeds):
            save_network(folder / "snapshots" / f"frames_{number:010}", seed=seed)
        if latest is not None:
            save_network(folder / "latest", seed=latest)
    return str(folder)


def list_names(run, found):
    return [agent.removeprefix(f"{run}/") for agent in found.agents[run]]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs of seconds, each with snapshots of itself."""
    folder = tmp_path_factory.mktemp("runs")
    never = EvaluationSettings(every_frames=NEVER, bots=())
    for seed, name in enumerate("ab"):
        pool = OpponentSettings({"latest": 0.5, "uniform": 0.5}, snapshot_every_frames=256)
        config = tiny(folder / name, 512, seed=seed, opponent=pool, evaluation=never)
        train(config, show_progress=False)
    return folder


@pytest.mark.slow
def test_a_league_of_runs_rates_what_they_have_saved(runs, capsys, monkeypatch):
    monkeypatch.chdir(runs.parent)
    shutil.copytree(runs, runs.parent / "runs", dirs_exist_ok=True)
    words = ["league", "runs/a", "runs/b", "rusher", "random", "--games", "2", "--no-replays"]
    assert main([*words, "--out", "ladder"]) == 0
    text = capsys.readouterr()
    (first, second) = (line for line in text.err.splitlines() if " is a run" in line)
    assert first.startswith("runs/a is a run, of which the league takes latest, snapshots/frames_")
    assert second.startswith("runs/b is a run, of which the league takes latest")
    with closing(LeagueStore(runs.parent / "ladder" / "league.sqlite")) as store:
        names = {record.name for record in store.read_agents().values()}
    assert {"a", "b", "rusher", "random"} < names
    others = names - {"a", "b", "rusher", "random"}
    assert others
    assert all(name.startswith(("a/frames_", "b/frames_")) for name in others)
    curves = (runs.parent / "ladder" / "training.csv").read_text("utf-8")
    assert curves.count("\n") == 1 + len(others) + 2  # a rating for each age of each run


def test_a_league_takes_few_of_many_snapshots_from_first_to_last(tmp_path):
    run = make_run(tmp_path / "a", range(1, 31))
    found = expand_runs([run, "random"])
    assert found.agents["random"] == ("random",)
    newest, *snapshots = list_names(run, found)
    assert newest == "latest"
    ages = [int(name.rpartition("_")[2]) for name in snapshots]
    assert ages == [29, 25, 21, 17, 12, 8, 4, 0]
    assert found.notes[0].endswith("frames_0000000000 (of 30 snapshots)")
    assert found.list_agents(["random", run]) == ("random", *found.agents[run])


def test_agents_that_are_the_same_are_taken_once(tmp_path):
    run = make_run(tmp_path / "a", (1, 2, 3), latest=3)
    found = expand_runs([run])
    old = ["snapshots/frames_0000000001", "snapshots/frames_0000000000"]
    assert list_names(run, found) == ["latest", *old]
    assert "; 1 left out, as the same agents are there already" in found.notes[0]
    named = f"{run}/snapshots/frames_0000000002"  # an agent that is named stays
    found = expand_runs([run, named])
    assert (list_names(run, found), found.agents[named]) == (old, (named,))


def test_each_learner_of_a_league_training_is_taken(tmp_path):
    folder = tmp_path / "league"
    with claim_output_folder(folder, "league training", {}):
        for seed, name in enumerate(("main_0", "main_1", ".main_0.marl_cair.old")):
            save_network(folder / "shared" / "live" / name, seed=seed)
    found = expand_runs([str(folder)])
    assert list_names(str(folder), found) == ["shared/live/main_0", "shared/live/main_1"]


def test_a_marker_that_cannot_be_read_is_none(tmp_path):
    assert read_run_kind(tmp_path) == ""
    run = make_run(tmp_path / "a", kind="exploit")
    assert read_run_kind(run) == "exploit"
    (tmp_path / "a" / "run.json").write_text("[]")
    assert read_run_kind(run) == ""


def test_other_sources_stay_as_they_are(tmp_path):
    net = save_network(tmp_path / "net")
    sources = ["random", net, "process:python3 x.py", "a.b:make", str(tmp_path / "nowhere")]
    found = expand_runs(sources)
    assert (found.list_agents(sources), found.notes) == (tuple(sources), ())


def test_a_run_without_an_agent_is_refused(tmp_path):
    run = make_run(tmp_path / "a", latest=None)
    with pytest.raises(CheckpointError, match=r"is a run \(training\) that holds no agent yet"):
        expand_runs([run])
    with pytest.raises(CheckpointError, match=r"a/latest is no agent checkpoint"):
        load_agent(run)


def test_a_run_is_its_newest_agent_in_other_commands(tmp_path, capsys):
    run = make_run(tmp_path / "a", (1,), latest=2)
    own, newest = load_agent(run), load_agent(f"{run}/latest")
    assert find_fingerprint(own, GAME) == find_fingerprint(newest, GAME)
    assert checkpoint.read_description(run).seed == 2
    record = describe_agent("a", own, GAME, run)
    assert record == describe_agent("a", newest, GAME, f"{run}/latest")
    assert read_source(record) == f"{run}/latest"
    assert main(["match", run, "random", "--games=2", "--set=max_ticks=100"]) == 0
    assert f"A = {run}, B = random on deep_line_wars 11x11" in capsys.readouterr().out
    assert main(["evaluate", run, "--games", "2", "--set", "max_ticks=100"]) == 0


def test_a_learner_of_a_league_training_must_be_named(tmp_path, capsys):
    folder = tmp_path / "league"
    with claim_output_folder(folder, "league training", {}):
        for name in ("main", "exploiter"):
            save_network(folder / "shared" / "live" / name)
    message = (
        f"{folder} is a run of `league train`, which has several agents: name one of those in "
        f"{folder / 'shared' / 'live'} (exploiter, main), or their mixture {folder / 'mixture'}"
    )
    about = ["--game", GAME.name, "--scenario", "11x11"]
    for words in (["match", str(folder), "random"], ["evaluate", str(folder)]):
        assert_refused(capsys, message, *words, *about)
    out = ["--out", str(tmp_path / "out")]
    assert_refused(capsys, message, "league", "exploit", str(folder), *about, *out)
    assert not (tmp_path / "out").exists()


@pytest.fixture
def mixed(tmp_path):
    """The folder of a run of best responses to mixtures."""
    folder = tmp_path / "psro"
    with claim_output_folder(folder, "policy-space response oracles", {}):
        save_network(folder / "players" / "player_000", seed=1)
        net = save_network(folder / "players" / "player_001", seed=2)
        save_mixture(folder / "mixture", [net, str(folder / "players" / "player_000")], (1, 2))
    return folder


@pytest.fixture
def response(tmp_path):
    """The folder of best responses to one agent, of which the second is the best."""
    folder = tmp_path / "response"
    with claim_output_folder(folder, "exploit", {}):
        for stage in (1, 2):
            save_network(folder / "candidates" / f"seed_0_stage_00{stage}", seed=stage)
        (folder / "exploit.json").write_text('{"chosen": "seed_0_stage_002"}', "utf-8")
    return folder


@pytest.mark.slow
def test_best_responses_stand_for_their_mixture_or_for_the_best(tmp_path, capsys, mixed, response):
    for run, inside in ((mixed, "mixture"), (response, "candidates/seed_0_stage_002")):
        own, meant = load_agent(run), load_agent(run / inside)
        assert find_fingerprint(own, GAME) == find_fingerprint(meant, GAME)
        assert main(["match", str(run), "random", "--games=2", "--set=max_ticks=100"]) == 0
    capsys.readouterr()
    words = ["league", str(mixed), str(response), "random", "--games", "2", "--no-replays"]
    assert main([*words, "--out", str(tmp_path / "ladder")]) == 0
    assert {"psro", "response"} <= set(capsys.readouterr().out.split())


def test_a_mixture_does_not_overwrite_a_run_that_stands_for_one(mixed):
    with pytest.raises(FileExistsError, match="is there and is no mixture"):
        save_mixture(mixed, ["deep_line_wars/rusher"], (1,))
    assert read_mixture(mixed).weights == pytest.approx((1 / 3, 2 / 3))


def test_best_responses_without_a_result_are_refused(mixed, response):
    (response / "exploit.json").unlink()
    with pytest.raises(CheckpointError, match="`league exploit` without a result .* finish it"):
        load_agent(response)
    shutil.rmtree(mixed / "mixture")
    with pytest.raises(CheckpointError, match="psro/mixture is no agent checkpoint"):
        load_agent(mixed)


def test_a_mixture_copies_only_the_newest_agent_of_a_run(tmp_path):
    run = make_run(tmp_path / "a", (1,), latest=2)
    save_mixture(tmp_path / "mix", [run, "deep_line_wars/rusher"], (1, 1))
    kept, _ = read_mixture(tmp_path / "mix").sources
    assert checkpoint.read_description(kept).seed == 2
    assert not (tmp_path / "mix" / "members" / "00" / "run.json").exists()


@pytest.mark.slow
def test_new_agents_of_a_run_can_be_added(tmp_path, capsys):
    run = make_run(tmp_path / "a", (1, 2), latest=2)
    out = ["--out", str(tmp_path / "ladder"), "--games", "2", "--no-replays"]
    words = [f"{run}/snapshots/frames_0000000000", "random", "--scenario", "11x11"]
    assert main(["league", *words, *out]) == 0
    capsys.readouterr()
    assert main(["league", "add", run, *out]) == 0
    (text,) = (line for line in capsys.readouterr().err.splitlines() if " is a run" in line)
    assert text == (
        f"{run} is a run, of which the league takes latest, snapshots/frames_0000000000; 1 left "
        "out, as the same agents are there already"
    )
    before = count_games(tmp_path / "ladder")
    assert main(["league", "add", run, *out]) == 0  # as after an interrupt
    assert count_games(tmp_path / "ladder") == before
    assert main(["league", "add", run, *out[:3], "16", "--no-replays"]) == 0
    assert count_games(tmp_path / "ladder") > before
