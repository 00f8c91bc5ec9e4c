"""marl_cair: multi-agent self-play research on real-time-strategy games.

Importing it registers the Gymnasium ids (`marl_cair/DeepLineWars-10x15-v0`, ...) and loads neither
torch nor numba.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium

from marl_cair.games import GAMES, make_engine
from marl_cair.games.registry import add_scenario, describe_scenario, gymnasium_id
from marl_cair.lookup import UnknownOptionError, import_when_used

if TYPE_CHECKING:
    from marl_cair.games.torchrl_env import BatchedGameEnv
    from marl_cair.league.agents.load import load_agent

__version__ = "0.1.0"

__all__ = [
    "GAMES",
    "__version__",
    "load_agent",
    "make_engine",
    "make_torchrl_env",
    "register_scenario",
]


def make_torchrl_env(
    game: str, scenario: str | None = None, num_worlds: int = 1, **options: Any
) -> BatchedGameEnv:
    """B worlds as one TorchRL environment; options as `games.torchrl_env.BatchedGameEnv`.

    Raises UnknownNameError, which names the nearest game, scenario, representation or option.
    """
    from marl_cair.games.torchrl_env import BatchedGameEnv  # imports torch

    try:
        return BatchedGameEnv(game, scenario, num_worlds, **options)
    except UnknownOptionError as error:
        others = "num_worlds, num_threads, representation, extra_representations, seed"
        error.add_note(f"others: {others}; how agents take seats: docs/clients.md")
        raise


__getattr__ = import_when_used(__name__, {"load_agent": "marl_cair.league.agents.load:load_agent"})


def register_scenario(game: str, name: str, base: str | None = None, **options: Any) -> str:
    """Add a scenario to a game, for this process; returns its Gymnasium id.

    This process can then name it everywhere: `parallel_env`, `make_engine`, training. Environments
    of its Gymnasium id also work in other processes.

    Args:
        game: a name in GAMES.
        name: letters, digits, `_`, `-` and `.`.
        base: the scenario that `options` change (default: the game's first).
        options: fields of the scenario, for example `map="maps/lake.txt"`.

    Raises:
        UnknownNameError: no such game, base or option; names the nearest.
        ValueError: the name is taken or not valid, an option's value is not allowed, or the game
            takes no scenarios.
    """
    environment_id = add_scenario(game, name, base, **options)
    _register_with_gymnasium(environment_id, game, name)
    return environment_id


def _register_with_gymnasium(environment_id: str, game: str, scenario: str) -> None:
    gymnasium.register(
        environment_id,
        entry_point="marl_cair.games.gymnasium_env:GameEnv",
        vector_entry_point="marl_cair.games.gymnasium_env:GameVectorEnv",
        kwargs=describe_scenario(game, scenario),  # works in spawned processes too
    )


def _register_gymnasium_ids(game: str, module: Any) -> None:
    for scenario in module.SCENARIOS:
        _register_with_gymnasium(gymnasium_id(module.GYMNASIUM_PREFIX, scenario), game, scenario)


GAMES.on_add(_register_gymnasium_ids)
