"""marl_cair: multi-agent self-play research on real-time-strategy games.

Importing it registers the Gymnasium ids (`marl_cair/DeepLineWars-10x15-v0`, ...) and loads neither
torch nor numba.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium

from marl_cair.games import GAMES, game_modules, make_engine

if TYPE_CHECKING:
    from marl_cair.games.torchrl_env import BatchedGameEnv
    from marl_cair.league.agents import load_agent

__version__ = "0.1.0"

__all__ = ["GAMES", "__version__", "load_agent", "make_engine", "make_torchrl_env"]


def make_torchrl_env(
    game: str, scenario: str | None = None, num_worlds: int = 1, **options: Any
) -> BatchedGameEnv:
    """B worlds as one TorchRL environment; options as `games.torchrl_env.BatchedGameEnv`.

    Raises:
        UnknownNameError: no such game, scenario, representation or option; names the nearest.
    """
    from marl_cair.games.torchrl_env import BatchedGameEnv  # torch is loaded only from here on

    return BatchedGameEnv(game, scenario, num_worlds, **options)


def __getattr__(name: str) -> Any:
    if name == "load_agent":
        from marl_cair.league.agents import load_agent  # torch is loaded only from here on

        return load_agent
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _register_gymnasium_ids() -> None:
    for module in game_modules():
        game = module.__name__.rpartition(".")[2]
        for scenario in module.SCENARIOS:
            gymnasium.register(
                f"marl_cair/{module.GYMNASIUM_PREFIX}-{scenario}-v0",
                entry_point="marl_cair.games.gymnasium_env:GameEnv",
                vector_entry_point="marl_cair.games.gymnasium_env:GameVectorEnv",
                kwargs={"game": game, "scenario": scenario},
            )


_register_gymnasium_ids()
