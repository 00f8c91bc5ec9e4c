"""Mixtures: the safest of a league, a folder that is an agent, and one member for each game."""

import json

import numpy as np
import pytest

from marl_cair.checkpoint import CheckpointError
from marl_cair.cli import main
from marl_cair.games import GAMES
from marl_cair.league import mixing
from marl_cair.league.agents.load import describe_agent, find_fingerprint, find_scenario, load_agent
from marl_cair.league.agents.mixtures import is_mixture, read_mixture, save_mixture
from marl_cair.league.mixing import mix_league
from marl_cair.league.play.match import play_chunks, play_match
from marl_cair.league.ratings.equilibrium import find_safest_mixture
from marl_cair.league.store.store import LeagueStoreError
from marl_cair.lookup import UnknownNameError
from tests.damage import forget_checksums
from tests.games import rock_paper_scissors
from tests.league.players import GAME, save_network

RPS = np.array([[0.5, 0.0, 1.0], [1.0, 0.5, 0.0], [0.0, 1.0, 0.5]])
THROWS = ("rock", "paper", "scissors")
FORMAT = {"format": "marl_cair mixture", "format_version": 1}
SCENARIO = GAME.scenario("11x11", reward=GAME.rated_reward)


@pytest.mark.parametrize(
    ("scores", "wanted"),
    [
        (RPS, [1 / 3, 1 / 3, 1 / 3]),
        # More rock than a third costs half as much against paper.
        (RPS[:2], [1 / 3 + 0.04, 2 / 3 - 0.04]),
        (np.array([[0.9, 0.8], [0.1, 0.2]]), None),
        (np.array([[0.6, 0.7], [0.6, 0.7], [0.6, 0.7]]), [1 / 3, 1 / 3, 1 / 3]),
    ],
)
def test_the_safest_mixture_of_known_games(scores, wanted):
    mixture = find_safest_mixture(scores, 0.02)
    assert mixture.sum() == pytest.approx(1.0)
    if wanted is None:  # one row is better everywhere: the other gets what the slack allows
        assert (mixture @ scores).min() == pytest.approx(0.78, abs=1e-4)
    else:
        assert mixture == pytest.approx(wanted, abs=1e-3)


def test_the_safest_mixture_is_within_its_slack_and_more_even_with_more_of_it():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        scores = np.round(rng.random((rng.integers(2, 12), rng.integers(2, 20))), 2)
        entropies = []
        best = (find_safest_mixture(scores, 1e-4) @ scores).min()
        for slack in (0.01, 0.05, 0.2):
            mixture = find_safest_mixture(scores, slack)
            assert (mixture >= 0).all()
            assert (mixture @ scores).min() >= best - slack - 1e-3
            entropies.append(-(mixture * np.log(mixture + 1e-300)).sum())
        assert entropies == sorted(entropies)


@pytest.mark.parametrize(
    ("scores", "slack"), [(np.zeros((0, 2)), 0.1), (np.full((2, 2), np.nan), 0.1), (RPS, 0.0)]
)
def test_invalid_scores_are_refused(scores, slack):
    with pytest.raises(ValueError, match="finite|above 0"):
        find_safest_mixture(scores, slack)


def test_one_member_is_drawn_for_each_game_whichever_chunks_are_played_together(
    tmp_path, monkeypatch
):
    monkeypatch.setitem(GAMES.modules, rock_paper_scissors.NAME, rock_paper_scissors)
    save_mixture(tmp_path / "mix", [f"rock_paper_scissors/{name}" for name in THROWS], (2, 1, 1))
    game = GAMES[rock_paper_scissors.NAME]
    scenario = game.scenario("fair")
    mixed, paper = load_agent(tmp_path / "mix"), load_agent("rock_paper_scissors/paper")
    match = play_match(paper, mixed, game, scenario, 800, 0)
    won, drawn = match.wins / 800, match.draws / 800
    assert (won, drawn) == pytest.approx((0.5, 0.25), abs=0.06)
    again = play_chunks(paper, mixed, game, scenario, 0, range(5, 9))
    assert again.results == match.results[5 * 8 : 9 * 8]
    turned = play_match(mixed, paper, game, scenario, 800, 0)
    assert turned.score == pytest.approx(1 - match.score)


@pytest.fixture(scope="module")
def nets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("nets")
    return [save_network(folder / name, name, seed) for seed, name in enumerate("abc")]


def test_a_mixture_holds_its_members(tmp_path, nets):
    folder = tmp_path / "mix"
    save_mixture(folder, [nets[0], nets[1], nets[2]], (1, 2, 1))
    mixture = read_mixture(folder)
    assert mixture.weights == (0.25, 0.5, 0.25)
    assert all(str(folder) in source for source in mixture.sources)
    moved = folder.rename(tmp_path / "moved")
    agent = load_agent(moved, GAME.name, SCENARIO)
    prints = [find_fingerprint(member, GAME) for member in agent.members]
    assert prints[0] == find_fingerprint(load_agent(nets[0], GAME.name, SCENARIO), GAME)
    record = describe_agent("moved", agent, GAME, str(moved))
    assert record.kind == "mixture"
    assert record.evaluation_policy == "one of 3, drawn before each game"
    assert json.loads(record.configuration)["members"] == dict(
        zip(prints, mixture.weights, strict=True)
    )
    assert find_scenario([str(moved)])[1] == "11x11"


def test_a_fingerprint_is_of_members_and_weights_in_any_order(tmp_path, nets):
    def fingerprint(sources, weights):
        save_mixture(tmp_path / "mix", sources, weights)
        return find_fingerprint(load_agent(tmp_path / "mix", GAME.name, SCENARIO), GAME)

    usual = fingerprint(nets[:2], (1, 2))
    assert fingerprint(nets[1::-1], (2, 1)) == usual
    assert fingerprint(nets[:2], (1, 1)) != usual
    assert fingerprint(nets[1:], (1, 2)) != usual


def test_members_of_an_inner_mixture_become_members(tmp_path, nets):
    save_mixture(tmp_path / "inner", nets[:2], (1, 3))
    save_mixture(tmp_path / "outer", [str(tmp_path / "inner"), nets[2]], (1, 1))
    mixture = read_mixture(tmp_path / "outer")
    assert mixture.weights == pytest.approx((0.125, 0.375, 0.5))
    assert find_scenario([str(tmp_path / "outer")])[1] == "11x11"


@pytest.mark.parametrize("source", ["users_module:make", "process:python3 bot.py", "turtle"])
def test_code_and_bots_of_no_game_are_no_members(tmp_path, source):
    with pytest.raises(
        ValueError, match=r"name checkpoints and bots alone|write a bot as game/bot"
    ):
        save_mixture(tmp_path / "mix", [source], (1,))
    assert not (tmp_path / "mix").exists()
    record = {**FORMAT, "members": [{"agent": source, "weight": 1}]}
    (tmp_path / "mixture.json").write_text(json.dumps(record), "utf-8")
    with pytest.raises(CheckpointError, match="cannot be read as a mixture"):
        load_agent(tmp_path, GAME.name, SCENARIO)


def test_a_long_command_is_no_mixture():
    assert not is_mixture("process:python3 -c " + "x" * 5_000)


def test_a_folder_of_something_else_is_not_replaced(tmp_path, nets):
    with pytest.raises(FileExistsError, match="is no mixture"):
        save_mixture(nets[0], nets[1:], (1, 1))
    assert load_agent(nets[0], GAME.name, SCENARIO).name == "a"


@pytest.mark.parametrize(
    "record",
    [
        "nothing",
        {"format": "another"},
        {**FORMAT, "format_version": 2, "members": [{"agent": "turtle", "weight": 1}]},
        {**FORMAT, "members": []},
        {**FORMAT, "members": [{"agent": "turtle", "weight": 0}]},
        {**FORMAT, "members": [{"weight": 1}]},
    ],
)
def test_a_damaged_mixture_is_refused(tmp_path, record):
    text = record if isinstance(record, str) else json.dumps(record)
    forget_checksums(tmp_path)
    (tmp_path / "mixture.json").write_text(text, "utf-8")
    with pytest.raises(CheckpointError, match="cannot be read as a mixture"):
        load_agent(tmp_path, GAME.name, SCENARIO)


@pytest.fixture(scope="module")
def league(tmp_path_factory, nets):
    folder = tmp_path_factory.mktemp("mixing") / "league"
    words = [*nets, "random", "turtle", "--games", "8", "--no-replays", "--out", str(folder)]
    assert main(["league", *words]) == 0
    return folder


@pytest.mark.slow
def test_a_league_is_mixed_by_one_command(league, nets, tmp_path, capsys):
    names = ["a", "b", "c"]
    assert main(["league", "mix", str(league), "--out", str(tmp_path / "best"), *names]) == 0
    assert "each of the 5 agents" in capsys.readouterr().out
    found = mix_league(league)
    assert set(found.sources) <= set(nets)
    assert read_mixture(tmp_path / "best").weights == pytest.approx(found.weights)
    agents = [str(tmp_path / "best"), "turtle", "--games", "8", "--no-replays"]
    assert main(["league", *agents, "--out", str(tmp_path / "league")]) == 0
    assert "best" in capsys.readouterr().out


def test_bots_can_be_mixed_by_their_names(league):
    found = mix_league(league, ("turtle", "random"), slack=0.5)
    assert set(found.sources) == {"deep_line_wars/turtle", "deep_line_wars/random"}
    assert sum(found.weights) == pytest.approx(1.0)


def test_only_the_given_agents_count(league, nets):
    agents = [load_agent(name, GAME.name, SCENARIO) for name in (nets[0], nets[1], "turtle")]
    found = mix_league(league, among={find_fingerprint(agent, GAME) for agent in agents})
    assert found.num_agents == 3
    assert set(found.sources) <= set(nets[:2])


def test_many_equals_are_all_members(league, monkeypatch):
    monkeypatch.setattr(mixing, "find_safest_mixture", lambda scores, slack: np.full(3, 1 / 300))
    assert mix_league(league).weights == pytest.approx((1 / 3,) * 3)


@pytest.mark.slow
def test_only_the_newest_agent_of_a_folder_may_be_a_member(tmp_path, nets):
    own, words = str(tmp_path / "net"), ["--games", "2", "--no-replays"]
    words += ["--out", str(tmp_path / "league")]
    for seed in (7, 8):
        save_network(tmp_path / "net", seed=seed)
        assert main(["league", own, nets[0], "turtle", *words]) == 0
    with pytest.raises(LeagueStoreError, match=r"net \(\d\) and net \(\d\) have not met"):
        mix_league(tmp_path / "league")
    now = [load_agent(name, GAME.name, SCENARIO) for name in (own, nets[0], "turtle")]
    found = mix_league(tmp_path / "league", among={find_fingerprint(a, GAME) for a in now})
    assert set(found.sources) <= {own, nets[0]}


def test_names_that_are_not_in_the_league_are_refused(league):
    with pytest.raises(UnknownNameError, match="turtl"):
        mix_league(league, ("turtl",))


@pytest.mark.slow
def test_agents_that_have_not_met_cannot_be_mixed(tmp_path, nets):
    out = str(tmp_path / "league")
    words = ["--games", "2", "--no-replays", "--out", out]
    assert main(["league", *nets[:2], "--ladder", "turtle", "random", *words]) == 0
    assert mix_league(tmp_path / "league").num_agents == 4
    with pytest.raises(LeagueStoreError, match="have not met"):
        mix_league(tmp_path / "league", ("turtle", "random"))


@pytest.mark.slow
def test_a_league_without_networks_is_refused(tmp_path):
    out = str(tmp_path / "league")
    words = ["random", "turtle", "--scenario", "11x11", "--games", "2", "--no-replays"]
    assert main(["league", *words, "--out", out]) == 0
    with pytest.raises(LeagueStoreError, match="no network has played"):
        mix_league(tmp_path / "league")
