"""A league of learners: opponents and resets of each role; a kill changes nothing."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from marl_cair.checkpoint import CheckpointError, load_network
from marl_cair.files import OutputFolderError
from marl_cair.league.agents.mixtures import read_mixture
from marl_cair.self_play.shared_folder import read_players, read_records
from marl_cair.training.population.league_run import train_league
from marl_cair.training.population.league_slice import Budget, SliceResult, read_member, run_slice
from marl_cair.training.settings.config_file import load_config
from tests.games import last_standing
from tests.training.leagues import TRAINING, make_league

ROOT = Path(__file__).resolve().parents[2]
DONE = SliceResult(256, 0, is_done=True, was_interrupted=False, last_row={})


@pytest.fixture(scope="module", autouse=True)
def _known():
    with pytest.MonkeyPatch.context() as patch:
        last_standing.register(patch)
        yield


@pytest.fixture(scope="module")
def league(tmp_path_factory):
    """One that was never stopped."""
    folder = tmp_path_factory.mktemp("whole") / "league"
    result = train_league(make_league(folder), show_progress=False)
    assert result.is_done
    return folder


def read_all(folder):
    """The state of a league: weights of players and newest policies, records, learners."""
    shared = folder / "shared"
    found = {player.name: player for player in read_players(shared)}
    for path in sorted([*(shared / "players").iterdir(), *(shared / "live").iterdir()]):
        network, about = load_network(path)
        weights = [value.flatten() for value in network.state_dict().values()]
        found[f"weights of {path.name}"] = (torch.cat(weights).tolist(), about)
    for path in sorted((folder / "members").iterdir()):
        found[path.name] = read_member(path)
    return {**found, **read_records(shared)}


# --- roles -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_all_learners_train_to_the_end_each_with_its_own_replay(league):
    names = ["league_exploiter_0", "main_0", "main_1", "main_exploiter_0"]
    assert sorted(path.name for path in (league / "members").iterdir()) == names
    for name in names:
        member = league / "members" / name
        record = read_member(member)
        run = member / f"{record.generation:03d}"
        state = torch.load(run / "resume" / "state.pt", weights_only=True) if run.is_dir() else {}
        assert record.frames_before + state.get("frames", 0) >= 768
        assert (run / "resume" / "replay").is_dir() == run.is_dir()


@pytest.mark.slow
def test_a_main_exploiter_is_reset_with_each_player_and_a_main_agent_never(league):
    exploiter = league / "members" / "main_exploiter_0"
    generation = read_member(exploiter).generation
    mine = [p for p in read_players(league / "shared") if p.owner == "main_exploiter_0"]
    assert [player.generation for player in mine] == list(range(generation)) == [0, 1]
    assert not (exploiter / "000" / "resume").exists()
    weights = [torch.load(exploiter / n / "latest" / "weights.pt") for n in ("000", "001")]
    assert any(not torch.equal(weights[0][key], weights[1][key]) for key in weights[0])
    assert read_member(league / "members" / "main_0").generation == 0
    mains = [p for p in read_players(league / "shared") if p.role == "main"]
    assert len(mains) >= 2 * (768 // 192)


@pytest.mark.slow
def test_a_main_exploiter_begins_as_the_main_agents_in_turn(league):
    for name, wanted in (
        ("main_0", [None]),
        ("league_exploiter_0", [None]),
        ("main_exploiter_0", ["main_0", "main_1"]),
    ):
        for generation, main in enumerate(wanted):
            config = load_config(league / "members" / name / f"{generation:03d}")
            assert config.initial_agent == (main and str(league / "shared" / "live" / main))
            assert config.exploration.epsilon_start == (1.0 if main is None else 0.05)


@pytest.mark.slow
def test_a_new_generation_begins_with_the_weights_of_the_main_agent(tmp_path):
    settings = make_league(tmp_path, total_frames=384, slice_frames=384)

    def run(name, **changes):
        exploiter = dataclasses.replace(settings.main_exploiter, **changes)
        own = dataclasses.replace(settings, out=str(tmp_path / name), main_exploiter=exploiter)
        return train_league(own, show_progress=False)

    fresh = run("fresh", begins_as_main=False)
    # Nothing is learned, so the first player still is the agent that it began as.
    begun = run("begun", training={"learner": {"learning_rate": 1e-12}})
    for result, is_main in ((begun, True), (fresh, False)):
        shared = result.folder / "shared"
        first = next(p for p in read_players(shared) if p.owner == "main_exploiter_0")
        nets = [load_network(shared / part)[0] for part in (f"players/{first.name}", "live/main_0")]
        pairs = zip(*(net.parameters() for net in nets), strict=True)
        same = all(torch.allclose(a, b, atol=1e-6) for a, b in pairs)
        assert same == is_main


@pytest.mark.slow
def test_a_league_of_learners_that_begin_with_an_agent_is_resumed(tmp_path):
    """Whether a learner began as a main agent is decided once, not at each turn."""
    settings = make_league(tmp_path / "first", total_frames=64, slice_frames=64)
    agent = train_league(settings, show_progress=False).folder / "shared" / "live" / "main_0"
    training = {**TRAINING, "initial_agent": str(agent)}
    frames = {"total_frames": 128, "slice_frames": 64}
    settings = make_league(tmp_path / "second", training=training, **frames)
    train_league(settings, show_progress=False)
    for name, start in (("main_0", 1.0), ("main_exploiter_0", 0.05), ("league_exploiter_0", 1.0)):
        config = load_config(tmp_path / "second" / "members" / name / "000")
        assert config.exploration.epsilon_start == start


@pytest.mark.slow
def test_opponents_of_each_role(league):
    met = {
        owner: {name for name, (_, _, count) in record["against"].items() if count}
        for owner, record in read_records(league / "shared").items()
    }
    past = {player.name for player in read_players(league / "shared")}
    assert met["main_exploiter_0"] <= {"main_0", "main_1"} | {p for p in past if "main_" in p}
    assert met["main_exploiter_0"] & {"main_0", "main_1"}
    assert met["league_exploiter_0"] <= past
    assert "main_1" in met["main_0"]
    assert {name.partition("-")[0] for name in met["main_0"] & past} >= {"main_0", "main_1"}
    exploiters = {name for name in met["main_0"] & past if "exploiter" in name}
    assert exploiters, "main agents play the players of exploiters"


@pytest.mark.slow
def test_a_player_holds_the_records_of_its_learner(league):
    players = read_players(league / "shared")
    later = [player for player in players if player.owner == "main_0"][-1]
    assert later.met
    assert all(0 <= kept.points <= kept.games for kept in later.met.values())


# --- interrupts and kills --------------------------------------------------------------------


class KilledError(BaseException):
    """Stands for a kill: nothing catches it."""


def kill_at(patch, number):
    """Let the `number`th rename of a file or folder not happen; returns the count so far."""
    count = [0]
    for name in ("rename", "replace"):
        real = getattr(Path, name)

        def counted(path, target, real=real):
            count[0] += 1
            if count[0] == number:
                raise KilledError
            return real(path, target)

        patch.setattr(Path, name, counted)
    return count


@pytest.mark.slow
def test_a_league_that_was_stopped_and_killed_at_any_write_comes_to_the_same(league, tmp_path):
    """First with fewer frames, then with no time, then each attempt is cut at a later rename than
    the one before, and the next one resumes it.
    """
    settings = make_league(tmp_path / "league")
    assert train_league(make_league(settings.out, total_frames=384), show_progress=False).is_done
    hurried = dataclasses.replace(settings, max_minutes=1e-3)
    assert not train_league(hurried, show_progress=False).is_done
    kills = 0
    for number in range(3, 400, 37):
        with pytest.MonkeyPatch.context() as patch:
            kill_at(patch, number)
            try:
                train_league(settings, show_progress=False)
            except KilledError:
                kills += 1
                continue
        break
    assert train_league(settings, show_progress=False).slices == 8
    assert kills >= 4
    assert read_all(tmp_path / "league") == read_all(league)


@pytest.mark.slow
def test_kill_minus_nine_at_twenty_moments_changes_nothing(league, tmp_path):
    code = (
        "import pytest, sys; from tests.games import last_standing;"
        "last_standing.register(pytest.MonkeyPatch());"
        "from marl_cair.training.population.league_run import train_league;"
        "from tests.training.leagues import make_league;"
        "train_league(make_league(sys.argv[1]), show_progress=False)"
    )
    words = [sys.executable, "-W", "ignore", "-c", code, str(tmp_path / "league")]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    begun = time.monotonic()
    subprocess.run([*words[:-1], str(tmp_path / "other")], check=True, env=env)
    whole = time.monotonic() - begun
    for number in range(20):
        child = subprocess.Popen(words, env=env)
        try:
            child.wait(whole * (0.2 + 0.01 * number))
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGKILL)
            child.wait()
    subprocess.run(words, check=True, env=env)
    assert read_all(tmp_path / "league") == read_all(league)


@pytest.mark.slow
def test_a_slice_that_is_done_does_nothing_when_it_is_run_again(league):
    before = read_all(league)
    name, _ = make_league(league).learners[-1]
    assert run_slice(
        league / "members" / name, league / "shared", Budget(768, 1_024), False
    ).is_done
    assert read_all(league) == before


def test_slices_need_only_their_folders(tmp_path):
    """A slice needs two folders and a budget, so it can run in any process."""
    seen = []

    def play(member, shared, budget, show_progress):
        seen.append((member.name, shared.name, json.loads(json.dumps(dataclasses.asdict(budget)))))
        return DONE

    settings = make_league(tmp_path / "league", total_frames=256)
    train_league(settings, show_progress=False, play_slice=play)
    assert [name for name, *_ in seen] == [name for name, _ in settings.learners]
    assert seen[0][1:] == ("shared", {"frames": 256, "total_frames": 256, "max_minutes": None})


def test_more_frames_take_up_a_turn_that_the_end_had_cut(tmp_path):
    goals = []

    def play(member, shared, budget, show_progress):
        goals.append((member.name, budget.frames))
        return DONE

    def train_to(frames):
        goals.clear()
        settings = make_league(tmp_path / "league", total_frames=frames, slice_frames=100)
        assert train_league(settings, show_progress=False, play_slice=play).is_done
        return [goal for name, goal in goals if name == "main_0"]

    assert train_to(240) == [100, 200, 240]
    assert train_to(240) == []
    assert train_to(280) == [280]
    assert train_to(400) == [300, 400]
    assert train_to(500) == [500]


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["ffa-3", "teams"])
def test_leagues_of_many_seats_and_of_average_policies_train_too(tmp_path, scenario):
    training = {
        **TRAINING,
        "game": {**TRAINING["game"], "scenario": scenario},
        "nfsp": {"enabled": True, "min_rows": 10, "batch_size": 8},
    }
    main = {"learners": 1, "snapshot_every_frames": 64}
    values = {"training": training, "main": main, "total_frames": 128, "slice_frames": 128}
    result = train_league(make_league(tmp_path / "league", **values), show_progress=False)
    assert result.is_done
    folder = tmp_path / "league" / "shared" / "live" / "main_0"
    assert load_network(folder)[1].plays == "sampled"
    assert read_players(tmp_path / "league" / "shared")
    # An average policy's outputs are no values of actions.
    exploiter = tmp_path / "league" / "members" / "main_exploiter_0" / "000"
    assert load_config(exploiter).initial_agent is None


# --- the end, and what is refused ------------------------------------------------------------


@pytest.mark.slow
def test_the_report_rates_the_learners_and_shows_their_payoffs(tmp_path):
    values = {"total_frames": 64, "final_games": 2, "final_bots": ["idle"]}
    result = train_league(make_league(tmp_path / "league", **values), show_progress=False)
    for words in ("league_exploiter_0", "Ladder", "idle", "Won in training", "frozen players"):
        assert words in result.text
    assert (tmp_path / "league" / "report.txt").read_text("utf-8") == result.text
    ladder = tmp_path / "league" / "evaluation" / "00004" / "ladder.csv"
    rated = {line.partition(",")[0] for line in ladder.read_text("utf-8").splitlines()[1:]}
    # The main exploiter has learned nothing yet, and is the main agent that it began as.
    assert rated == {"main_0", "main_1", "league_exploiter_0", "idle"}
    assert "The league as one agent" in result.text
    mixture = read_mixture(tmp_path / "league" / "mixture")
    assert {Path(source).parent.name for source in mixture.sources} == {"members"}


@pytest.mark.slow
@pytest.mark.parametrize("final_past", [0, 2])
def test_the_report_rates_what_learners_froze_last_too(tmp_path, final_past):
    values = {"total_frames": 384, "final_games": 2, "final_past": final_past}
    values["main"] = {"learners": 2, "snapshot_every_frames": 96}
    alone = {"main_exploiter": {"learners": 0}, "league_exploiter": {"learners": 0}}
    settings = make_league(tmp_path / "league", **values, **alone, final_bots=["idle"])
    train_league(settings, show_progress=False)
    ladder = next((tmp_path / "league" / "evaluation").glob("*/ladder.csv"))
    rated = {line.partition(",")[0] for line in ladder.read_text("utf-8").splitlines()[1:]}
    players = [player.name for player in read_players(tmp_path / "league" / "shared")]
    owned = [[n for n in players if n.startswith(owner)] for owner in ("main_0", "main_1")]
    newest = {name for names in owned for name in names[-final_past:]}
    live = {name for name in rated if name in ("main_0", "main_1")}
    # A player frozen at the end equals the learner as it is now, and takes part once.
    assert rated - live - {"idle"} <= (newest if final_past else set())
    assert len(rated) == 1 + 2 + 2 * max(0, final_past - 1)


@pytest.mark.slow
def test_a_folder_of_other_settings_is_refused(league):
    with pytest.raises(OutputFolderError, match="seed is 5 there, 6 here"):
        train_league(make_league(league, seed=6), show_progress=False)


def test_a_damaged_learner_is_refused(tmp_path):
    settings = make_league(tmp_path / "league", total_frames=256)
    train_league(settings, show_progress=False, play_slice=lambda *_: DONE)
    (tmp_path / "league" / "members" / "main_0" / "member.json").write_text("{", "utf-8")
    again = make_league(tmp_path / "league", total_frames=512)
    with pytest.raises(CheckpointError, match="cannot be read as a learner of a league"):
        train_league(again, show_progress=False)
