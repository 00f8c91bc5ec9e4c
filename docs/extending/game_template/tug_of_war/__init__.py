"""Tug of war: the names that marl_cair and users import. The rules are loaded when used."""

from tug_of_war.scenarios import GYMNASIUM_PREFIX, SCENARIOS

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "parallel_env"]


def __getattr__(name):
    if name == "GAME":
        from tug_of_war.definition import GAME

        return GAME
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def parallel_env(scenario="short", representation="vector", **options):
    """One game as a PettingZoo ParallelEnv."""
    from marl_cair.games.parallel_env import GameParallelEnv

    return GameParallelEnv("tug_of_war", scenario, representation=representation, **options)
