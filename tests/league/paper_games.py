"""Simulated games of agents of known strength."""

import itertools

import numpy as np

from marl_cair.league.ratings.games import Games


def make_games(agents, ranks, blocks, is_repeat=None):
    agents, ranks = np.array(agents), np.array(ranks, float)
    level = (ranks[:, None] == ranks[:, :, None]).sum(1)
    points = np.where(ranks == ranks.min(1, keepdims=True), 1.0 / level, 0.0)
    repeats = np.zeros(len(agents), bool) if is_repeat is None else np.array(is_repeat)
    return Games(agents, points, ranks, np.array(blocks), repeats)


def from_rows(rows):
    """Games of two from (first, second, block, score of the first): the first in the first seat."""
    agents, keys, ranks = [], {}, []
    for first, second, block, score in rows:
        agents.append((int(first), int(second)))
        keys.setdefault((min(first, second), max(first, second), block), len(keys))
        ranks.append((2.0 - score, 1.0 + score))
    blocks = [keys[(min(r[0], r[1]), max(r[0], r[1]), r[2])] for r in rows]
    return make_games(agents, ranks, blocks)


def simulate(strengths, blocks_per_pair, seed, seat=0.0, map_spread=0.0, draws=0.0, surplus=None):
    """Bradley-Terry games in logits; each block is a map seed in both seatings.

    seat: advantage of the first seat. map_spread: standard deviation of each map's advantage for
    one of the two. draws: share of games that are drawn. surplus: [n, n] advantage of the row
    against the column beyond strengths.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for first, second in itertools.combinations(range(len(strengths)), 2):
        for block in range(blocks_per_pair):
            gap = strengths[first] - strengths[second] + map_spread * rng.normal()
            gap += 0.0 if surplus is None else surplus[first][second]
            won = rng.random(2) < 1 / (1 + np.exp([-(gap + seat), gap - seat]))
            won = won.astype(float)
            if draws:
                won[rng.random(2) < draws] = 0.5
            rows += [(first, second, block, won[0]), (second, first, block, won[1])]
    return from_rows(rows)


def count_results(games):
    """Numbers of blocks of two agents by their pair of results, on which ratings depend."""
    points = games.points[:, 0].reshape(-1, 2)  # in the first seat, first of one, then of the other
    return tuple(np.bincount((2 * points[:, 0] + points[:, 1]).astype(int), minlength=4).tolist())


def simulate_orders(strengths, num_blocks, num_teams, seed):
    """Plackett-Luce orders of random groups, each played in all rotations."""
    rng = np.random.default_rng(seed)
    agents, ranks, blocks = [], [], []
    for block in range(num_blocks):
        group = rng.permutation(len(strengths))[:num_teams]
        for turn in range(num_teams):
            seated = np.roll(group, turn)
            keys = np.array(strengths)[seated] + rng.gumbel(size=num_teams)
            agents.append(seated)
            ranks.append(1 + np.argsort(np.argsort(-keys)))
            blocks.append(block)
    return make_games(agents, ranks, blocks)


def sweep(winner, loser, num_games=40):
    return [(winner, loser, game // 2, 1.0) for game in range(num_games)]


def share(first, second, wins, num_games=40):
    """`wins` of the games go to the first, in mixed blocks."""
    return [(first, second, game // 2, float(game < wins)) for game in range(num_games)]
