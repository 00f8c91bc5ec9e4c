"""Best responses approach the known equilibria; a stop changes nothing; bad files are refused."""

import json
import re
import shutil

import numpy as np
import pytest

from marl_cair import games
from marl_cair.checkpoint import CheckpointError
from marl_cair.files import OutputFolderError, write_json
from marl_cair.games import GAMES
from marl_cair.league.agents.load import find_fingerprint, load_agent
from marl_cair.league.agents.mixtures import read_mixture, save_mixture
from marl_cair.training import trainer
from marl_cair.training.population import psro
from marl_cair.training.population.psro import train_psro, weigh_opponents
from marl_cair.training.population.psro_settings import build_psro
from marl_cair.training.settings.config import GameSettings
from tests.damage import forget_checksums
from tests.games import rock_paper_scissors
from tests.training.runs import make_agent, tiny

NAME = rock_paper_scissors.NAME
LEARNER = {"batch_size": 64, "frames_per_update": 8, "n_steps": 1, "average_decay": 0.0}
TRAINING = {
    "torch_threads": 1,
    "synthetic_fraction": 0.0,
    "game": {"name": NAME, "scenario": "fair", "representation": "vector"},
    "policy": {"body": "mlp", "hidden_width": 8},
    "opponent": {"warmup_frames": 0},
    "collector": {"num_worlds": 32, "steps_per_batch": 4},
    "exploration": {"epsilon_end": 0.2, "anneal_frames": 256},
    "replay": {"capacity_transitions": 2_000, "min_transitions": 64},
    "learner": {**LEARNER, "learning_rate": 0.05},
    "generator": {"name": "none"},
    "evaluation": {"bots": []},
}


@pytest.fixture(autouse=True)
def _know_the_game(monkeypatch):
    monkeypatch.setitem(games.GAMES.modules, NAME, rock_paper_scissors)


def make(out, **changes):
    values = {
        "out": str(out),
        "rounds": 2,
        "round_frames": 256,
        "first_round_frames": 256,
        "bots": ["rock"],
        "games_per_pair": 4,
        "even_share": 0.1,
        "training": TRAINING,
        **changes,
    }
    return build_psro(values)


def run(out, **changes):
    return train_psro(make(out, **changes), show_progress=False)


def run_stopped(monkeypatch, out, until, **changes):
    """Stop the first response that is trained after `until` steps."""
    with monkeypatch.context() as patched:
        patched.setattr(psro, "train", lambda *words: trainer.train(*words, until_frames=until))
        return run(out, **changes)


def find_throws(folder):
    """Shares of the throws of a mixture, float64 [3]."""
    mixture = read_mixture(folder)
    scenario = GAMES[NAME].scenario("fair")
    shares = np.zeros(3)
    for source, weight in zip(mixture.sources, mixture.weights, strict=True):
        agent = load_agent(source, NAME, scenario)
        shares[agent.act(np.ones((1, 1), np.float32), np.ones((1, 3), bool))[0]] += weight
    return shares


@pytest.mark.slow
def test_rounds_find_every_throw_and_mix_them_as_the_equilibrium_does(tmp_path):
    settings = {"rounds": 4, "round_frames": 2_048, "first_round_frames": 512, "games_per_pair": 20}
    result = run(tmp_path / "out", **settings)
    assert (result.rounds, result.is_done, result.was_interrupted) == (4, True, False)
    assert find_throws(tmp_path / "out" / "mixture") == pytest.approx([1 / 3] * 3, abs=0.05)
    assert "player_000 100.0%; it begins with a new network, against all bots alike" in result.text
    # Mostly against paper, sometimes against the bot's rock.
    answer = r"player_001 9\d\.\d% \(5\d\.\d%\); it begins as player_000, against player_000 9\d%"
    assert re.search(answer, result.text)
    assert (tmp_path / "out" / "report.txt").read_text("utf-8") == result.text
    assert not list((tmp_path / "out").glob("rounds/*/run/resume"))
    assert run(tmp_path / "out", **settings) == result


def test_half_the_games_are_against_the_own_mixture_half_against_the_hardest_one():
    # Networks throw paper and scissors, the third agent, a bot, rock.
    scores = np.array([[0.5, 0.0, 1.0], [1.0, 0.5, 0.0], [0.0, 1.0, 0.5]])
    weights = weigh_opponents(scores[:2], [0, 1], slack=0.001, even_share=0.0)
    safest, hardest = np.array([1, 2, 0]) / 3, np.array([0, 2, 1]) / 3
    assert weights == pytest.approx((safest + hardest) / 2, abs=0.01)
    even = weigh_opponents(scores[:2], [0, 1], slack=0.001, even_share=0.6)
    assert even == pytest.approx(0.4 * weights + 0.2)
    assert weigh_opponents(scores, [0, 1, 2], 0.001, 0.0) == pytest.approx([1 / 3] * 3, abs=1e-3)


@pytest.mark.slow
def test_a_run_that_was_stopped_resumes_to_the_same_bits(tmp_path, monkeypatch):
    whole = run(tmp_path / "whole")
    assert run(tmp_path / "parts", rounds=1).is_done  # and then one round more
    stopped = run_stopped(monkeypatch, tmp_path / "parts", 128)
    assert (stopped.rounds, stopped.is_done) == (1, False)
    assert (tmp_path / "parts" / "rounds" / "001" / "run" / "resume").is_dir()
    stopped = run(tmp_path / "parts", max_minutes=1e-6)
    assert (stopped.rounds, stopped.is_done) == (1, False)
    parts = run(tmp_path / "parts")
    scenario = GAMES[NAME].scenario("fair")
    for name in ("player_000", "player_001"):
        agents = [
            load_agent(tmp_path / part / "players" / name, NAME, scenario)
            for part in ("whole", "parts")
        ]
        assert len({find_fingerprint(agent, GAMES[NAME]) for agent in agents}) == 1
    texts = [one.text.replace(str(one.folder), "") for one in (whole, parts)]
    assert texts[0] == texts[1]


@pytest.mark.slow
def test_each_response_begins_with_what_the_generator_before_it_has_learned(tmp_path, monkeypatch):
    generator = {"name": "ccdn", "frames_per_update": 256, "batch_size": 8}
    training = {**TRAINING, "synthetic_fraction": 0.2, "generator": generator}
    begun_with = []

    def note(config, *words):
        begun_with.append(config.initial_generator)
        return trainer.train(config, *words)

    monkeypatch.setattr(psro, "train", note)
    run(tmp_path / "out", training=training)
    assert begun_with == [None, str(tmp_path / "out" / "rounds" / "000" / "run")]
    run(tmp_path / "real")
    assert begun_with[2:] == [None, None]


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A folder of an agent to begin with."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(games.GAMES.modules, NAME, rock_paper_scissors)
        run(folder, rounds=1)
    return folder / "players" / "player_000"


@pytest.mark.slow
def test_begin_with_is_an_opponent_and_a_first_network_even_if_deleted_later(
    tmp_path, monkeypatch, begun
):
    player = str(shutil.copytree(begun, tmp_path / "first" / "player_000"))
    again = {"rounds": 1, "begin_with": [player]}
    assert not run_stopped(monkeypatch, tmp_path / "next", 128, **again).is_done
    plan = json.loads((tmp_path / "next" / "rounds" / "000" / "plan.json").read_text("utf-8"))
    assert plan["start"] == "begin_0"
    assert set(plan["met"]) == {"begin_0", "rock"}
    assert sum(plan["met"].values()) == pytest.approx(1.0)
    shutil.rmtree(tmp_path / "first")
    monkeypatch.chdir(tmp_path)
    assert run("next", **again).is_done  # the same folder, spelled otherwise


@pytest.mark.slow
def test_a_state_left_by_a_kill_is_deleted_and_other_settings_are_refused(tmp_path):
    run(tmp_path / "out", rounds=1)
    left = tmp_path / "out" / "rounds" / "000" / "run" / "resume"
    left.mkdir()
    run(tmp_path / "out", rounds=1)
    assert not left.exists()
    with pytest.raises(OutputFolderError, match="even_share"):
        run(tmp_path / "out", rounds=1, even_share=0.2)


def test_damaged_plans_are_refused(tmp_path):
    run(tmp_path / "out", max_minutes=1e-9)
    path = tmp_path / "out" / "rounds" / "000" / "plan.json"
    path.write_text("{", "utf-8")
    with pytest.raises(ValueError, match=r"plan.json cannot be read .* delete it"):
        run(tmp_path / "out")
    write_json(path, {"met": {"rock": 0.5, "well": 0.5}, "start": None})
    with pytest.raises(ValueError, match=r"plan.json .*unknown agents well; known are .*rock"):
        run(tmp_path / "out")


def test_agents_that_no_response_can_begin_as_are_refused_before_anything_is_written(
    tmp_path, begun
):
    out, player = tmp_path / "out", str(begun)
    save_mixture(tmp_path / "mix", [player], [1.0])
    for given in ("nowhere", "mix"):
        with pytest.raises(CheckpointError, match=f"begin_with has .*{given}, which is no folder"):
            run(out, begin_with=[str(tmp_path / given)])
    with pytest.raises(CheckpointError, match="begin_with has rock, which is no folder"):
        run(out, begin_with=["rock"])
    other = tmp_path / "other"
    shutil.copytree(player, other)
    about = json.loads((other / "agent.json").read_text("utf-8"))
    forget_checksums(other)
    (other / "agent.json").write_text(json.dumps({**about, "representation": "planes"}), "utf-8")
    with pytest.raises(ValueError, match=r"representation"):
        run(out, begin_with=[player, str(other)])
    game = GameSettings(scenario="11x11", representation="heatmap")
    picture = make_agent(tiny(tmp_path / "picture", game=game, synthetic_fraction=0.0))
    with pytest.raises(ValueError, match=r"generator 'ccdn' works on `planes`.*not on 'heatmap'"):
        run(
            out,
            begin_with=[picture],
            bots=["random"],
            training={"game": {"name": "deep_line_wars", "scenario": "11x11"}},
            round_frames=20_000,
            first_round_frames=20_000,
        )
    assert not out.exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rounds": 0}, "rounds is 0, it must be 1 or more"),
        ({"round_frames": 100}, "round_frames is 100, it must be 128 or more, twice training.rep"),
        ({"training": {**TRAINING, "nfsp": {"enabled": True}}}, "training.nfsp.enabled is True"),
        ({"games_per_pair": 3}, "games_per_pair is 3, it must be even and 2 or more"),
        ({"even_share": 1.5}, "even_share is 1.5, it must be in 0..1"),
        ({"slack": 0}, "slack is 0.0, it must be above 0, below 1"),
        ({"bots": []}, r"bots is \[\], it must be one or more"),
        ({"bots": ["rock", "rock"]}, "bots has 'rock' twice"),
        ({"bots": ["rok"]}, f"unknown {NAME} bot 'rok': nearest are 'rock'"),
        ({"begin_with": ["a", "a"]}, "begin_with has 'a' twice"),
        ({"round": 3}, "unknown option 'round': nearest are 'rounds'"),
        ({"training": {**TRAINING, "seed": 3}}, "training.seed is given: each response has its"),
        (
            {"training": {**TRAINING, "opponent": {"mixture": {"rock": 1}}}},
            "training.opponent.mixture is given: opponents are bots",
        ),
        ({"training": {**TRAINING, "learner": {"gama": 1}}}, "unknown option 'gama'"),
        (
            {
                "bots": ["random"],
                "training": {
                    "game": {"name": "flappy_bird", "scenario": "race-4"},
                    "evaluation": {"bots": []},
                },
            },
            "training.game.scenario is 'race-4', it must be a scenario of two teams",
        ),
    ],
)
def test_bad_settings_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        make("unused", **changes)
