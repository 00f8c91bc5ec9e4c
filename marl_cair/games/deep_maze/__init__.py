"""Deep Maze: find the shortest way to the goal of a maze. One to four players."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from marl_cair.games.deep_maze.scenarios import GYMNASIUM_PREFIX, SCENARIOS

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from marl_cair.games.game import Game
    from marl_cair.games.parallel_env import GameParallelEnv

    GAME: Game

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]


def __getattr__(name: str) -> Game:
    if name == "GAME":
        from marl_cair.games.deep_maze.definition import GAME

        return GAME
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def parallel_env(scenario: str = "9x9-stochastic", **options: Any) -> GameParallelEnv:
    """One game as a PettingZoo ParallelEnv; options as `games.parallel_env.GameParallelEnv`."""
    from marl_cair.games.parallel_env import make_parallel_env

    return make_parallel_env("deep_maze", scenario, **options)


def env(scenario: str = "9x9-stochastic", **options: Any) -> AECEnv[str, Any, Any]:
    """The same game turn by turn (AEC), through PettingZoo's own conversion."""
    from marl_cair.games.parallel_env import make_aec_env

    return make_aec_env("deep_maze", scenario, **options)
