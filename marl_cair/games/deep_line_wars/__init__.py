"""Deep Line Wars: send units across a line, build towers against the other's. Two players."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from marl_cair.games.deep_line_wars.scenarios import GYMNASIUM_PREFIX, SCENARIOS

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from marl_cair.games.game import Game
    from marl_cair.games.parallel_env import GameParallelEnv

    GAME: Game

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]


def __getattr__(name: str) -> Game:
    if name == "GAME":
        from marl_cair.games.deep_line_wars.definition import GAME

        return GAME
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def parallel_env(scenario: str = "10x15", **options: Any) -> GameParallelEnv:
    """One game as a PettingZoo ParallelEnv; options as `games.parallel_env.GameParallelEnv`."""
    from marl_cair.games.parallel_env import make_parallel_env

    return make_parallel_env("deep_line_wars", scenario, **options)


def env(scenario: str = "10x15", **options: Any) -> AECEnv[str, Any, Any]:
    """The same game turn by turn (AEC), through PettingZoo's own conversion."""
    from marl_cair.games.parallel_env import make_aec_env

    return make_aec_env("deep_line_wars", scenario, **options)
