"""The benchmark plays what it says."""

import pytest

from benchmarks.flappy_bird import ACTION_SETS, REPRESENTATIONS, SELDOM, make_round
from marl_cair.games import GAMES


@pytest.mark.plain_python
def test_a_round_returns_its_ticks():
    assert make_round(3, SELDOM)() == 3 * ACTION_SETS
    assert make_round(1, SELDOM, "features", "race-2")() == ACTION_SETS


def test_every_representation_is_measured():
    game = GAMES["flappy_bird"]
    assert set(REPRESENTATIONS) == set(game.make_spec(game.scenario()).representations)
