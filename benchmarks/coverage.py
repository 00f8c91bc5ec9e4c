"""Measure how often 95 % intervals of ratings, and of scores, hold the truth.

python -m benchmarks.coverage [--leagues 500] [--seed 0] [--effects 0 80 150] [--players 2 3 4]
    [--blocks 8 20 40] [--seeds own shared] [--scores | --runs]
Games are simulated, their schedule, seating, fit and resampling are the package's. An agent's
rating on a map is its own plus a normal number of each agent and map seed, with the standard
deviation `--effects` in Elo. Each line-up has map seeds of its own, as leagues have since these
intervals, or shares them with all others, as before. The truth is the fit to a league of endless
games: what more games of these agents would give. Prints a table in Markdown.

--scores: intervals of the score of one agent against another in `--leagues` matches, of blocks of
two games in which the map decides both games with some probability.
--runs: intervals of interquartile means over `--leagues` tables of runs with normal scores.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from marl_cair.experiments.summary import find_iqm
from marl_cair.league.play.blocks import make_design
from marl_cair.league.play.schedule import schedule_meetings
from marl_cair.league.ratings import rate as ratings_module
from marl_cair.league.ratings.bootstrap import block_interval
from marl_cair.league.ratings.fit import check_fit
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.groups import ELO_PER_LOGIT
from marl_cair.league.ratings.intervals import LEVEL
from marl_cair.league.ratings.likelihood import Likelihood, Rankings
from marl_cair.league.ratings.rate import rate

STRENGTHS = (-180.0, -60.0, 0.0, 60.0, 180.0)  # Elo
NUM_RESAMPLES = 500  # fewer than reports have: on the mean over leagues their noise is nothing
TRUE_BLOCKS = 200_000  # of the league that gives the truth
SEEDS = ("own", "shared")
# Chances of loss, draw and win, and how often the map decides both games of a block.
SCORES = (
    *(((0.5, 0.0, 0.5), 0.0), ((0.2, 0.0, 0.8), 0.0), ((0.05, 0.0, 0.95), 0.0)),
    *(((0.25, 0.5, 0.25), 0.0), ((0.0, 0.7, 0.3), 0.0)),
    *(((0.5, 0.0, 0.5), 0.5), ((0.2, 0.0, 0.8), 0.5), ((0.2, 0.0, 0.8), 1.0)),
)
FIT_EVERY = 4  # leagues: one of so many is tested for fit


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    seeds: str  # of SEEDS
    effect: float  # Elo, standard deviation of an agent's rating between maps
    players: int  # of a game
    blocks: int  # in which each pair meets


@dataclass(frozen=True)
class Coverage:
    """Shares of intervals that hold the truth, and of leagues whose test of fit says no."""

    ratings: float
    differences: float
    error: float  # root mean square of ratings, Elo
    half_width: float  # mean, Elo, of ratings
    misfits: float


def simulate(case: Case, seed: int) -> Games:
    """A league in which all pairs meet in `case.blocks` blocks."""
    line_ups, numbers = schedule(case.players, case.blocks)
    return play(case, line_ups, numbers, np.random.default_rng(seed))


def schedule(players: int, blocks: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Line-ups [K, players] of blocks, and the number [K] of each within its line-up's."""
    jobs = schedule_meetings(len(STRENGTHS), players, blocks, 1)
    return np.array([job.line_up for job in jobs]), np.array([job.chunk for job in jobs])


def play(
    case: Case,
    line_ups: NDArray[np.int64],
    numbers: NDArray[np.int64],
    rng: np.random.Generator,
) -> Games:
    """All seatings of each block: Plackett-Luce orders by the agents' ratings on its map."""
    shape = len(line_ups), len(STRENGTHS)
    effects = rng.normal(0.0, case.effect, shape)
    maps = np.arange(len(line_ups))
    if case.seeds == "shared":
        effects, maps = effects[numbers], numbers
    design = make_design(case.players, "all" if case.players < 4 else "ring", 0)
    seatings = np.stack([design(number) for number in range(int(numbers.max()) + 1)])[numbers]
    agents = np.take_along_axis(line_ups[:, None], seatings, axis=2)  # [K, games, players]
    strength = np.array(STRENGTHS)[agents] + np.take_along_axis(effects[:, None], agents, axis=2)
    luck = rng.gumbel(size=agents.shape)
    places = np.argsort(np.argsort(-strength / ELO_PER_LOGIT - luck, axis=2), axis=2)
    ranks = 1.0 + places.astype(np.float64)
    blocks = np.repeat(maps, agents.shape[1])
    flat = agents.reshape(-1, case.players), ranks.reshape(-1, case.players)
    return Games(flat[0], 1.0 * (flat[1] == 1), flat[1], blocks, np.zeros(len(blocks), np.bool_))


def find_truth(effect: float, players: int) -> NDArray[np.float64]:
    """Elo [agents], mean 0, of the fit to TRUE_BLOCKS blocks."""
    line_ups, numbers = schedule(players, 40)
    repeats = -(-TRUE_BLOCKS // len(line_ups))
    case = Case("own", effect, players, 40)
    line_ups, numbers = np.tile(line_ups, (repeats, 1)), np.tile(numbers, repeats)
    games = play(case, line_ups, numbers, np.random.default_rng(1))
    blocks = np.zeros(len(games.blocks), np.int64)
    model = Likelihood(len(STRENGTHS), [Rankings(games.agents, games.ranks, blocks)])
    found = ELO_PER_LOGIT * model.fit(np.ones(1))[: len(STRENGTHS)]
    return np.asarray(found - found.mean(), np.float64)


def measure(
    case: Case, truth: NDArray[np.float64], num_leagues: int, seed: int, bar: "tqdm[None]"
) -> Coverage:
    """Rate `num_leagues` simulated leagues."""
    names = [str(number) for number in range(len(STRENGTHS))]
    held: list[bool] = []
    gaps_held: list[bool] = []
    errors, widths, misfits = [], [], []
    for league in range(num_leagues):
        games = simulate(case, hash_seed(seed, league))
        ladder = rate(names, games, league)
        if league % FIT_EVERY == 0:  # it takes as long as all the rest
            fit = check_fit(len(names), games, league)
            misfits.append(fit is not None and fit.p_value <= LEVEL)
        for rating in ladder.ratings:
            true = truth[int(rating.name)]
            if rating.is_bound:
                continue
            held.append(rating.low <= true <= rating.high)
            errors.append(rating.elo - true)
            widths.append((rating.high - rating.low) / 2.0)
        for one, two in itertools.combinations(range(len(names)), 2):
            gap = ladder.differences[one][two]
            if gap is not None:
                own, other = (int(ladder.ratings[place].name) for place in (one, two))
                gaps_held.append(gap.low <= truth[own] - truth[other] <= gap.high)
        bar.update()
    return Coverage(
        float(np.mean(held)),
        float(np.mean(gaps_held)),
        float(np.sqrt(np.mean(np.square(errors)))),
        float(np.mean(widths)),
        float(np.mean(misfits)),
    )


def measure_scores(num_matches: int, blocks: list[int], seed: int) -> None:
    """Print how often intervals of scores hold the true score, and their mean width."""
    print(
        "| blocks | win | draw | map decides both games | coverage | width |\n" + "|---" * 6 + "|"
    )
    for num_blocks, (chances, pairing) in itertools.product(blocks, SCORES):
        rng = np.random.default_rng(seed)
        truth, numbers = np.dot(chances, [0.0, 0.5, 1.0]), np.repeat(np.arange(num_blocks), 2)
        ends = np.empty((num_matches, 2))
        for match in range(num_matches):
            games = rng.choice([0.0, 0.5, 1.0], size=(num_blocks, 2), p=chances)
            same = rng.random(num_blocks) < pairing
            games[same, 1] = games[same, 0]
            ends[match] = block_interval(games.ravel(), numbers)
        held = (ends[:, 0] <= truth + 1e-9) & (truth - 1e-9 <= ends[:, 1])
        print(
            f"| {num_blocks} | {chances[2]:g} | {chances[1]:g} | {pairing:g} | {held.mean():.3f} | "
            f"{np.diff(ends).mean():.2f} |",
            flush=True,
        )


def measure_runs(num_tables: int, seed: int) -> None:
    """Print how often intervals of `experiments.summary` hold the truth, by runs of a cell."""
    print("| runs | coverage |\n|---|---|")
    for num_runs in (2, 3, 4, 5, 10, 15):
        tables = np.random.default_rng(seed).normal(size=(num_tables, num_runs))
        found = [find_iqm([table]) for table in tables]
        print(f"| {num_runs} | {np.mean([one.low <= 0 <= one.high for one in found]):.3f} |")


def hash_seed(seed: int, league: int) -> int:
    """Another number for each league and seed."""
    return int(np.random.SeedSequence([seed, league]).generate_state(1)[0])


def list_cases(options: argparse.Namespace) -> Iterator[Case]:
    """The rows of the table, in order."""
    every = options.seeds, options.players, options.effects, options.blocks
    for seeds, players, effect, blocks in itertools.product(*every):
        yield Case(seeds, effect, players, blocks)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.coverage", description=__doc__)
    parser.add_argument("--leagues", type=int, default=500, help="of each row (%(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--effects", type=float, nargs="+", default=[0.0, 80.0, 150.0])
    parser.add_argument("--players", type=int, nargs="+", default=[2, 3, 4])
    parser.add_argument("--blocks", type=int, nargs="+", default=[8, 20, 40])
    parser.add_argument("--seeds", nargs="+", choices=SEEDS, default=["own"])
    parser.add_argument("--scores", action="store_true", help="of matches in place of leagues")
    parser.add_argument("--runs", action="store_true", help="of experiments in place of leagues")
    options = parser.parse_args()
    if options.runs:
        measure_runs(options.leagues, options.seed)
        return
    if options.scores:
        measure_scores(options.leagues, options.blocks, options.seed)
        return
    ratings_module.LEAST_RESAMPLES = ratings_module.MOST_RESAMPLES = NUM_RESAMPLES
    cases = list(list_cases(options))
    start = time.process_time()
    print(
        "| map seeds | players | agent x map, Elo | blocks of a pair | ratings | differences | "
        "error, Elo | half-width, Elo | test of fit says no |\n" + "|---" * 9 + "|"
    )
    truths = {}
    with tqdm(total=len(cases) * options.leagues, unit=" leagues") as bar:
        for case in cases:
            key = case.effect, case.players
            if key not in truths:
                truths[key] = find_truth(*key)
            found = measure(case, truths[key], options.leagues, options.seed, bar)
            print(
                f"| {case.seeds} | {case.players} | {case.effect:.0f} | {case.blocks} | "
                f"{found.ratings:.3f} | {found.differences:.3f} | {found.error:.0f} | "
                f"{found.half_width:.0f} | {found.misfits:.2f} |",
                flush=True,
            )
    seconds = time.process_time() - start
    print(f"\n{options.leagues} leagues of {len(STRENGTHS)} agents a row, {seconds:.0f} s of CPU")


if __name__ == "__main__":
    main()
