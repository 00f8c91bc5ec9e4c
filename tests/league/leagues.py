"""Leagues for tests: made-up tables, and short games of bots."""

import functools
from contextlib import closing

import numpy as np

from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.ratings.games import Games
from marl_cair.league.report.table import make_table
from marl_cair.league.store.store import STORE_FILE, LeagueStore

NAMES = ["turtle", "economist", "rusher", "random"]
EDGES = {(0, 1): 25, (0, 2): 40, (0, 3): 40, (1, 2): 40, (1, 3): 40, (2, 3): 30}


def make_games(results=EDGES, repeats=0, draws=0):
    """40 games of each pair, half of them in each seat; the last `repeats` are not counted."""
    rows = []
    for number, ((first, second), wins) in enumerate(results.items()):
        scores = [1.0] * wins + [0.5] * draws + [0.0] * (40 - wins - draws)
        for game, score in enumerate(scores):
            agents, ranks = (first, second), (2.0 - score, 1.0 + score)
            turn = -1 if game % 2 else 1
            rows.append(
                (agents[::turn], ranks[::turn], 20 * number + game // 2, game >= 40 - repeats)
            )
    agents, ranks, blocks, is_repeat = (np.array(column) for column in zip(*rows, strict=True))
    return Games(agents, 2.0 - ranks, ranks, blocks, is_repeat)


def make(results=EDGES, names=NAMES, repeats=0, draws=0, forfeits=()):
    """The table of `make_games`, made once for equal arguments: it takes seconds."""
    return _make(tuple(results.items()), tuple(names), repeats, draws, tuple(forfeits))


@functools.cache
def _make(results, names, repeats, draws, forfeits):
    return make_table(names, make_games(dict(results), repeats, draws), forfeits)


def play_bots(folder, *bots):
    """Play 4 short games of each pair into `folder`."""
    config = LeagueConfig(
        bots,
        scenario="11x11",
        scenario_options={"max_ticks": 300},
        games_per_pair=4,
        out=str(folder),
        replays=False,
    )
    run_league(config, show_progress=False)


def count_games(folder):
    """Number of games in the league file of a folder."""
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        return len(store.read_games().agents)


def no_games(num_teams=2):
    """An empty league."""
    shape = 0, num_teams
    empty = np.zeros(0, np.int64)
    return Games(
        np.zeros(shape, np.int64), np.zeros(shape), np.zeros(shape), empty, empty.astype(np.bool_)
    )
