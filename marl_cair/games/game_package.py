"""`parallel_env` and `env` of a game's package: one world as a PettingZoo environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from marl_cair.games.parallel_env import GameParallelEnv


def make_environments(
    package: str, default_scenario: str
) -> tuple[Callable[..., GameParallelEnv], Callable[..., AECEnv[str, Any, Any]]]:
    """The functions `parallel_env` and `env` of the game whose package has this name."""
    game = package.rpartition(".")[2]

    def parallel_env(scenario: str = default_scenario, **options: Any) -> GameParallelEnv:
        """One game as a PettingZoo ParallelEnv; options as `games.parallel_env.GameParallelEnv`."""
        from marl_cair.games.parallel_env import GameParallelEnv  # loads the rules

        return GameParallelEnv(game, scenario, **options)

    def env(scenario: str = default_scenario, **options: Any) -> AECEnv[str, Any, Any]:
        """The same game turn by turn (AEC), through PettingZoo's own conversion."""
        from marl_cair.games.parallel_env import make_aec_env

        return make_aec_env(game, scenario, **options)

    for function in (parallel_env, env):  # as if the package defined them: pickle finds them there
        function.__module__, function.__qualname__ = package, function.__name__
    return parallel_env, env
