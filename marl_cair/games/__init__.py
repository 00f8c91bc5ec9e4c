"""The games; their rules, and numba, are imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from marl_cair.games.registry import GAMES, BrokenGameWarning, GameLoadError

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

__all__ = ["GAMES", "BrokenGameWarning", "GameLoadError", "make_engine"]


def make_engine(
    game: str,
    scenario: str | None = None,
    num_worlds: int = 1,
    num_threads: int = 1,
    **options: Any,
) -> BatchedEngine:
    """B worlds of a scenario as one engine.

    Args:
        game: a name in GAMES.
        scenario: a name in the game's scenarios (default: the game's default scenario).
        num_worlds: B.
        num_threads: slices that run in parallel; results do not depend on it.
        options: fields of the scenario to change, for example `preset="2017"`.

    Raises:
        UnknownNameError: no such game, scenario or option; names the nearest.
        ValueError: a value is not allowed.
    """
    from marl_cair.games.engine import BatchedEngine  # numba only from here on

    chosen = GAMES[game]
    return BatchedEngine(chosen, chosen.scenario(scenario, **options), num_worlds, num_threads)
