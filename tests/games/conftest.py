"""The option that rewrites the golden playthroughs, and engines that several tests share."""

import pytest

from marl_cair.games import GAMES
from tests.games.cases import CASES, Case


def pytest_addoption(parser):
    parser.addoption(
        "--update-playthroughs",
        action="store_true",
        help="rewrite tests/games/playthroughs instead of comparing (read the diff afterwards)",
    )


def _is_duel(name: str) -> bool:
    game = GAMES[name]
    return game.make_spec(game.scenario()).num_players == 2


@pytest.fixture(scope="module", params=filter(_is_duel, GAMES), ids=str)
def game_name(request):
    """Each game whose default scenario is for two: tests of doors name both seats."""
    return request.param


@pytest.fixture(scope="module", params=CASES)
def case(request) -> Case:
    """Each scenario of each game with each of its action spaces."""
    return request.param


@pytest.fixture
def update_playthroughs(request) -> bool:
    return request.config.getoption("--update-playthroughs", default=False)
