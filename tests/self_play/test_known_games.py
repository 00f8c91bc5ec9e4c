"""Self-play in games with known equilibria: `latest` cycles, mixtures converge.

The learner is minimal: it tries each throw against the opponents of the mixture, and freezes the
throw with the highest reward. The engine, the pool, the records and the samplers are the real ones.
"""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from marl_cair.games.engine import BatchedEngine
from marl_cair.league.ratings.equilibrium import exploitability, maximum_entropy_nash
from marl_cair.self_play.pool import FOREIGN, Pool
from marl_cair.self_play.samplers import LATEST_ID, SamplerOptions, mix, read_standings
from marl_cair.self_play.win_rates import WinRecords
from marl_cair.training.settings.config import SELF_PLAY
from tests.games.rock_paper_scissors import GAME, PAPER, ROCK, SCISSORS, Thrower, payoff

WORLDS = 384
WITHOUT_BOTS = {name: weight for name, weight in SELF_PLAY.items() if name != "bots"}


def play(engine, own, theirs, seed):
    """Rewards [WORLDS] of seat 0, and its scores."""
    engine.reset(np.arange(WORLDS, dtype=np.uint64) + np.uint64(seed * WORLDS))
    engine.step(np.stack([own, theirs], 1).astype(np.int32))
    won = engine.rewards[:, 0].copy()
    return won, (1.0 + won) / 2.0


def run(tmp_path, scenario_name, mixture, generations):
    """Freeze the best response to the mixture in each generation."""
    scenario = GAME.scenario(scenario_name)
    engine = BatchedEngine(GAME, scenario, WORLDS)
    pool = Pool(tmp_path / "_".join(mixture), GAME, scenario, "vector", capacity=1)
    records = WinRecords(half_life_frames=4 * WORLDS)
    rng = np.random.default_rng(0)
    throws = [ROCK]
    for generation in range(generations):
        frames = generation * WORLDS
        standings = read_standings(pool, records, frames)
        shares = mix(mixture, standings, SamplerOptions())
        met = rng.choice(standings.numbers, WORLDS, p=shares)
        theirs = np.full(WORLDS, throws[-1])
        for number in set(met.tolist()) - {LATEST_ID}:
            theirs[met == number] = pool.agent(number).throw
        tried = rng.permutation(np.arange(WORLDS) % 3)
        rewards, _ = play(engine, tried, theirs, 2 * generation)
        throw = int(np.argmax([rewards[tried == action].mean() for action in range(3)]))
        _, scores = play(engine, np.full(WORLDS, throw), theirs, 2 * generation + 1)
        own = WinRecords(half_life_frames=WORLDS)  # of this throw alone
        for number, score in zip(met.tolist(), scores.tolist(), strict=True):
            if number != LATEST_ID:
                records.book(number, score, frames)
                own.book(number, score, frames)
        kept = {number: own.evidence(number, frames) for number in set(met.tolist()) - {LATEST_ID}}
        pool.add(FOREIGN, Thrower(f"generation_{generation}", throw), 0, kept)
        throws.append(throw)
    return SimpleNamespace(pool=pool, records=records, throws=throws[1:], scenario=scenario)


def shares_of(throws):
    return np.bincount(throws, minlength=3) / len(throws)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["fair", "biased"])
def test_latest_cycles(tmp_path, scenario):
    """Each generation throws what beats the one before."""
    throws = run(tmp_path, scenario, {"latest": 1.0}, 60).throws
    assert all(new == (old + 1) % 3 for old, new in itertools.pairwise(throws))


@pytest.mark.slow
def test_the_history_of_latest_is_no_equilibrium_where_throws_differ_in_worth(tmp_path):
    done = run(tmp_path, "biased", {"latest": 1.0}, 60)
    assert exploitability(payoff(done.scenario), shares_of(done.throws)) >= 0.2


@pytest.mark.parametrize(
    ("scenario", "sampler"),
    [
        ("biased", "pfsp"),
        pytest.param("fair", "pfsp", marks=pytest.mark.slow),
        pytest.param("biased", "uniform", marks=pytest.mark.slow),
        pytest.param("fair", "uniform", marks=pytest.mark.slow),
    ],
)
def test_the_history_of_a_sampler_converges_to_the_equilibrium(tmp_path, scenario, sampler):
    done = run(tmp_path, scenario, {sampler: 1.0}, 150)
    assert exploitability(payoff(done.scenario), shares_of(done.throws)) <= 0.12


@pytest.mark.slow
def test_half_latest_is_too_much_for_exact_best_responses(tmp_path):
    """The default converges in the fair game, and nearly cycles in the biased one."""
    fair = run(tmp_path / "fair", "fair", WITHOUT_BOTS, 150)
    assert exploitability(payoff(fair.scenario), shares_of(fair.throws)) <= 0.12
    biased = run(tmp_path / "biased", "biased", WITHOUT_BOTS, 150)
    assert 0.15 <= exploitability(payoff(biased.scenario), shares_of(biased.throws)) <= 0.25


@pytest.mark.parametrize("scenario", ["fair", "biased"])
def test_the_nash_mixture_of_the_pool_is_the_equilibrium(tmp_path, scenario):
    """Computed from the pool's own records, so that all members must be played now and then."""
    done = run(tmp_path, scenario, {"nash": 0.6, "uniform": 0.4}, 16)
    assert set(done.throws) == {ROCK, PAPER, SCISSORS}
    standings = read_standings(done.pool, done.records, 16 * WORLDS)
    shares = mix({"nash": 1.0}, standings, SamplerOptions())[1:]
    throws = np.zeros(3)
    np.add.at(throws, done.throws, shares)
    assert exploitability(payoff(done.scenario), throws) <= 0.15


def test_the_equilibrium_of_the_biased_game_follows_from_its_rules():
    """The probability of each throw is proportional to the reward of the other two's game."""
    found = maximum_entropy_nash(payoff(GAME.scenario("biased")))
    assert found == pytest.approx([4 / 9, 4 / 9, 1 / 9])
