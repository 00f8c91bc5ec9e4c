"""What the package says of its games before any is loaded."""

import subprocess
import sys

import marl_cair
from marl_cair.games import GAMES
from tests.games.test_engine import refuses


def test_games_can_be_listed_and_have_titles():
    assert list(GAMES)
    assert len(GAMES) == len(list(GAMES))
    for name, game in GAMES.items():
        assert game.name == name
        assert game.title
        assert game.summary
        assert game.default_scenario in game.scenarios


LIST_MODULES = """
import sys
import gymnasium
print(*(name for name in gymnasium.registry if name.startswith("marl_cair/")))
import marl_cair
print(*sys.modules)
print(*(name for name in gymnasium.registry if name.startswith("marl_cair/")))
"""


def test_importing_the_package_registers_ids_and_loads_no_rules():
    command = [sys.executable, "-c", LIST_MODULES]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    before, modules, ids = (line.split() for line in done.stdout.split("\n")[:3])
    assert before == []
    assert len(ids) == len(set(ids)) == sum(len(game.scenarios) for game in GAMES.values())
    ours = {name for name in modules if name.startswith("marl_cair")}
    assert {f"marl_cair.games.{game}" for game in GAMES} < ours
    for part in ("definition", "rules", "state", "observation"):
        assert not ours & {f"marl_cair.games.{game}.{part}" for game in GAMES}
    assert not {"numba", "torch"} & set(modules)


def test_unknown_attributes_are_named():
    with refuses(AttributeError, "has no attribute 'nothing'"):
        marl_cair.nothing  # noqa: B018
    with refuses(AttributeError, "has no attribute 'nothing'"):
        marl_cair.games.deep_line_wars.nothing  # noqa: B018
