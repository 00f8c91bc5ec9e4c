"""The option that rewrites the golden playthroughs, and engines that several tests share."""

import pytest

from tests.games.cases import CASES, IN_PROCESS, Case


def pytest_addoption(parser):
    parser.addoption(
        "--update-playthroughs",
        action="store_true",
        help="rewrite tests/games/playthroughs instead of comparing (read the diff afterwards)",
    )


@pytest.fixture(scope="module", params=IN_PROCESS, ids=str)
def game_name(request):
    """Each game's name, but those of games in browsers."""
    return request.param


@pytest.fixture(scope="module", params=CASES)
def case(request) -> Case:
    """Each scenario of each game with each of its action spaces."""
    return request.param


@pytest.fixture
def update_playthroughs(request) -> bool:
    return request.config.getoption("--update-playthroughs", default=False)
