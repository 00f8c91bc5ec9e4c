"""Tables of the bots of Deep RTS: each against each on several maps, and in free-for-alls.

`python -m benchmarks.balance --game deep_rts` prints them, as Markdown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

import marl_cair
from benchmarks._matches import MatchResult, play_round_robin, win_interval, write_results
from marl_cair.games.deep_rts.scenarios import SCENARIOS
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent
from marl_cair.games.randomness import episode_seeds

BOARDS = ("1v1-15x15", "21x21-2p-fords", "1v1-31x31")
FREE_FOR_ALL = "FFA-4-15x15"
RANDOM = "random"


def make_duel(board: str, games: int, preset: str) -> BatchedEngine:
    """Games of two on a scenario, or on a map of any name with the longer time limit."""
    if board in SCENARIOS:
        return marl_cair.make_engine("deep_rts", board, games, preset=preset)
    return marl_cair.make_engine("deep_rts", "1v1-31x31", games, preset=preset, map=board)


def describe_share(wins: int, games: int) -> str:
    """Percent won, with Wilson's interval."""
    low, high = win_interval(wins, games)
    return f"{100 * wins / games:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def describe_pair(result: MatchResult) -> str:
    """Percent won, drawn (the time limit too) and lost; Wilson's interval of those won."""
    drawn = result.draws + result.truncations
    shares = [f"{100 * count / result.games:.0f}" for count in (result.wins, drawn, result.losses)]
    interval = describe_share(result.wins, result.games).split(" ", 1)[1]
    return f"{'-'.join(shares)} {interval}"


def print_table(
    board: str, names: Sequence[str], results: Mapping[tuple[int, int], MatchResult]
) -> None:
    """One row per bot: its games against each other bot, and against all scripted ones."""
    print(f"\n| {board} | " + " | ".join(names) + " | all but random |")
    print("|---" * (len(names) + 2) + "|")
    for i, name in enumerate(names):
        cells = ["-" if i == j else describe_pair(results[i, j]) for j in range(len(names))]
        others = [j for j, other in enumerate(names) if j != i and other != RANDOM]
        wins = sum(results[i, j].wins for j in others)
        cells.append(describe_share(wins, sum(results[i, j].games for j in others)))
        print(f"| {name} | " + " | ".join(cells) + " |")


def play_together(
    engine: BatchedEngine, players: Sequence[Agent], seats: NDArray[np.int64], seed: int
) -> NDArray[np.int64]:
    """Wins of each player: one game in each world, `seats` [B, P] names each seat's player."""
    num_worlds = engine.num_worlds
    worlds = np.arange(num_worlds)
    engine.reset(episode_seeds(seed, worlds, np.zeros(num_worlds, np.int64)))
    for number, player in enumerate(players):
        player.seed(seed + number)
    actions = np.zeros(seats.shape, np.int64)
    while not (engine.terminated | engine.truncated).all():
        planes, mask = engine.observe("planes"), engine.action_mask()
        for number, player in enumerate(players):
            world, seat = np.nonzero(seats == number)
            if len(world):
                actions[world, seat] = player.act(planes[world, seat], mask[world, seat])
        engine.step(actions)
    won = np.flatnonzero(engine.terminated & (engine.winner >= 0))
    wins = np.bincount(seats[won, engine.winner[won]], minlength=len(players))
    return wins.astype(np.int64)


def seat_one(player: int, rivals: NDArray[np.int64]) -> NDArray[np.int64]:
    """Seats [B, P] in which one player has a place, each place as often, and rivals the others."""
    seats = rivals.copy()
    worlds = np.arange(len(seats))
    seats[worlds, worlds % seats.shape[1]] = player
    return seats


def report_free_for_all(games: int, preset: str, seed: int) -> None:
    """Each bot alone against random ones, and against players drawn from the other bots."""
    engine = marl_cair.make_engine("deep_rts", FREE_FOR_ALL, games, preset=preset)
    names = list(engine.game.bots)
    players = [engine.game.bot(name, engine.scenario) for name in names]
    luck = np.random.default_rng(seed)
    shape = (games, engine.num_players)
    print(f"\n| {FREE_FOR_ALL}, % won | against {RANDOM} | against the others |")
    print("|---|---|---|")
    for number, name in enumerate(names):
        if name == RANDOM:
            continue
        others = [k for k, other in enumerate(names) if other not in (name, RANDOM)]
        cells = []
        for rivals in (np.full(shape, names.index(RANDOM)), luck.choice(others, shape)):
            seats = seat_one(number, rivals)
            wins = play_together(engine, players, seats, seed)
            cells.append(describe_share(int(wins[number]), games))
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def report_tables(
    boards: Sequence[str], games: int, preset: str, seed: int, file: TextIO | None
) -> None:
    """All tables; `games` of each pair, in one half of which the first has the first seat."""
    print(f"won-drawn-lost in % of {games} games, [Wilson's 95 % interval of won]")
    for board in boards:
        engine = make_duel(board, games, preset)
        names = list(engine.game.bots)
        players = [engine.game.bot(name, engine.scenario) for name in names]
        results = play_round_robin(engine, players, seed)
        print_table(board, names, results)
        if file:
            write_results(file, board, names, results)
    report_free_for_all(games, preset, seed)
