"""Ratings are those of OpenSpiel's batch Elo, on simulated games and on a published matrix."""

import numpy as np
import pytest

from marl_cair.league.ratings.likelihood import Likelihood, Rankings
from marl_cair.league.ratings.rate import ELO_PER_LOGIT
from tests.league.paper_games import from_rows, simulate

pyspiel = pytest.importorskip("pyspiel")

# American League East, 1987: how often the row has won against the column.
BASEBALL = (
    (0, 7, 9, 7, 7, 9, 11),  # Milwaukee
    (6, 0, 7, 5, 11, 9, 9),  # Detroit
    (4, 6, 0, 7, 7, 8, 12),  # Toronto
    (6, 8, 6, 0, 6, 7, 10),  # New York
    (6, 2, 6, 7, 0, 7, 12),  # Boston
    (4, 4, 5, 6, 6, 0, 6),  # Cleveland
    (2, 4, 1, 3, 1, 7, 0),  # Baltimore
)


def rate_here(num_agents, games):
    """The maximum of the likelihood, in Elo [n] with a mean of 0.

    OpenSpiel knows no seats: each game once more with the seats exchanged leaves nothing to them.
    """
    both = [np.concatenate((array, array[:, ::-1])) for array in (games.agents, games.ranks)]
    model = Likelihood(num_agents, [Rankings(*both, np.tile(games.blocks, 2))])
    fitted = ELO_PER_LOGIT * model.fit(np.ones(model.num_blocks))[:num_agents]
    return fitted - fitted.mean()


def rate_there(num_agents, games):
    """OpenSpiel's, without the games that it would add to each pair, centred as ours: its zero is
    the lowest agent.
    """
    wins, draws = np.zeros((2, num_agents, num_agents), int)
    for agents, ranks in zip(games.agents, games.ranks, strict=True):
        best, worst = agents[np.argsort(ranks)]
        if ranks[0] != ranks[1]:
            wins[best, worst] += 1
        else:
            draws[best, worst] += 1
            draws[worst, best] += 1
    options = pyspiel.elo.default_elo_options()
    options.smoothing_factor = 0.0
    given = wins.tolist(), draws.tolist()
    rated = np.array(pyspiel.elo.compute_ratings_from_matrices(*given, options=options))
    return rated - rated.mean()


@pytest.mark.parametrize("draws", [0.0, 0.3])
def test_simulated_games_have_the_same_ratings(draws):
    """But for the weak prior, a normal about 0 of 2,000 Elo, which OpenSpiel does not have."""
    games = simulate([0.0, 1.0, 2.0, 3.0], 40, 2, draws=draws)
    here, there = rate_here(4, games), rate_there(4, games)
    assert np.ptp(there) > 200.0
    assert here == pytest.approx(there, abs=1.0)


def test_baseball_is_rated_as_published():
    """Agresti, Categorical Data Analysis: logits above Baltimore, without an advantage at home."""
    rows = [
        (first, second, f"{first} {second} {game}", 1.0)
        for first, row in enumerate(BASEBALL)
        for second, wins in enumerate(row)
        for game in range(wins)
    ]
    games = from_rows(rows)
    here, there = rate_here(7, games), rate_there(7, games)
    assert here == pytest.approx(there, abs=1.0)
    published = [1.58, 1.44, 1.29, 1.25, 1.11, 0.68, 0.0]
    assert (here - here[-1]) / ELO_PER_LOGIT == pytest.approx(published, abs=0.01)
