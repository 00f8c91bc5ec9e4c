"""Deep RTS: gather, build, train and fight on a board of tiles. One to eight players."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from marl_cair.games.deep_rts.scenarios import GYMNASIUM_PREFIX, SCENARIOS

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from marl_cair.games.game import Game
    from marl_cair.games.parallel_env import GameParallelEnv

    GAME: Game

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]


def __getattr__(name: str) -> Game:
    if name == "GAME":
        from marl_cair.games.deep_rts.definition import GAME

        return GAME
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def parallel_env(scenario: str = "1v1-15x15", **options: Any) -> GameParallelEnv:
    """One game as a PettingZoo ParallelEnv; options as `games.parallel_env.GameParallelEnv`."""
    from marl_cair.games.parallel_env import make_parallel_env

    return make_parallel_env("deep_rts", scenario, **options)


def env(scenario: str = "1v1-15x15", **options: Any) -> AECEnv[str, Any, Any]:
    """The same game turn by turn (AEC), through PettingZoo's own conversion."""
    from marl_cair.games.parallel_env import make_aec_env

    return make_aec_env("deep_rts", scenario, **options)
