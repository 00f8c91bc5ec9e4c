"""Compile the rules of games ahead of their first use, in several processes at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import NamedTuple

from marl_cair.games.compiled import announce_nothing
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Game
from marl_cair.games.registry import GAMES

_MOST_WORKERS = 61  # that Windows can wait for


class Part(NamedTuple):
    """The work of one process: one use of a game, in all of its scenarios."""

    game: str
    use: str  # of `_USES`, or the name of a representation


def list_parts(games: Sequence[str]) -> list[Part]:
    """All parts of these games, first those that others need, then the longest, so that processes
    seldom wait for one another.

    Raises:
        UnknownNameError: no such game; names the nearest.
        GameLoadError: a game of an installed package that fails.
    """
    games = [name for name in games if GAMES[name].has_snapshots]  # others have no rules here
    uses: dict[str, list[str]] = {use: list(games) for use in _USES}
    for name in games:
        for use in GAMES.apply(name, list_representations):
            uses.setdefault(use, []).append(name)
    return [Part(name, use) for use, names in uses.items() for name in names]


def list_representations(game: Game) -> list[str]:
    """The representations of all scenarios of a game, each once."""
    specs = map(game.make_spec, game.scenarios.values())
    return list(dict.fromkeys(name for spec in specs for name in spec.representations))


def compile_parts(parts: Sequence[Part], num_workers: int) -> Iterator[Part]:
    """Compile all parts on `num_workers` processes; yields each part when it is done. Compiled code
    stays in the cache (`cache_root()`) however this ends.

    Raises:
        ValueError: num_workers below 1.
        OSError: a worker process has died.
    """
    if num_workers < 1:
        raise ValueError(f"num_workers is {num_workers}, it must be at least 1")
    games = tuple(dict.fromkeys(part.game for part in parts))
    spawn = get_context("spawn")
    num_workers = min(num_workers, len(parts), _MOST_WORKERS)
    with ProcessPoolExecutor(num_workers, spawn, announce_nothing, (games,)) as pool:
        tasks = {pool.submit(compile_part, part): part for part in parts}
        try:
            for task in as_completed(tasks):
                task.result()
                yield tasks[task]
        except BrokenProcessPool as error:
            raise OSError(
                f"a worker process has died ({error}): see whether memory is short, or give "
                "--workers 1; what is compiled is kept"
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


def compile_part(part: Part) -> None:
    """Use the game in that way once in each of its scenarios: the first use compiles."""
    game = GAMES[part.game]
    scenarios = list(game.scenarios.values())
    if part.use == "step":  # observations and pictures do not depend on the shape of actions
        scenarios += [game.scenario(**options) for options in game.other_shapes]
    for scenario in scenarios:
        engine = BatchedEngine(game, scenario)
        engine.reset(0)
        if part.use in _USES:
            _USES[part.use](engine)
        elif part.use in engine.spec.representations:
            engine.observe(part.use)


def _step(engine: BatchedEngine) -> None:
    engine.step(engine.action_mask().argmax(-1))


def _decide(engine: BatchedEngine) -> None:
    mask = engine.action_mask()
    for name in engine.game.bots:
        bot = engine.game.bot(name, engine.scenario)
        bot.seed(0)
        bot.act(engine.observe(bot.representation)[:, 0], mask[:, 0])


_USES: dict[str, Callable[[BatchedEngine], object]] = {
    "reset": lambda engine: None,
    "step": _step,
    "bots": _decide,
    "picture": lambda engine: engine.render(),
}
