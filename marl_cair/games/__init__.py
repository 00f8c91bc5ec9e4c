"""The games. One line each; a game's rules are imported (and numba with them) when first used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine
    from marl_cair.games.game import Game

_MODULES = {
    "deep_line_wars": "marl_cair.games.deep_line_wars",
    "deep_rts": "marl_cair.games.deep_rts",
    "flappy_bird": "marl_cair.games.flappy_bird",
}


class _Games(Mapping[str, "Game"]):
    """The games by name, each loaded when it is asked for."""

    def __getitem__(self, name: str) -> Game:
        module = import_module(find_by_name("game", name, _MODULES))
        game: Game = module.GAME
        return game

    def __contains__(self, name: object) -> bool:
        return name in _MODULES

    def __iter__(self) -> Iterator[str]:
        return iter(_MODULES)

    def __len__(self) -> int:
        return len(_MODULES)


GAMES: Mapping[str, Game] = _Games()


def game_modules() -> Iterator[ModuleType]:
    """The games' packages, which know their scenarios without loading their rules."""
    for path in _MODULES.values():
        yield import_module(path)


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
    from marl_cair.games.engine import BatchedEngine  # noqa: PLC0415  # numba only from here on

    chosen = GAMES[game]
    return BatchedEngine(chosen, chosen.scenario(scenario, **options), num_worlds, num_threads)
