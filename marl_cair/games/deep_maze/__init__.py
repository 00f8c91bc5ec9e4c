"""Deep Maze: find the shortest way to the goal of a maze. One to four players."""

from __future__ import annotations

from marl_cair.games.deep_maze.scenarios import GYMNASIUM_PREFIX, SCENARIOS
from marl_cair.games.game import Game
from marl_cair.games.game_package import make_environments
from marl_cair.lookup import import_when_used

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]

GAME: Game
__getattr__ = import_when_used(__name__, {"GAME": f"{__name__}.definition:GAME"})
parallel_env, env = make_environments(__name__, "9x9-stochastic")
