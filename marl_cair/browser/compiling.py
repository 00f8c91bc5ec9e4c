"""Compiles a scenario's rules to WebAssembly in a process of its own, and keeps the result."""

from __future__ import annotations

import hashlib
import inspect
import pickle
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.browser import kernels, lowering, wasm_file
from marl_cair.files import write_atomically
from marl_cair.games.compiled import cache_root, calling, compiling, is_compiling, source_digest
from marl_cair.games.game import Game
from marl_cair.games.registry import GAMES


class ShownTo:
    """In the place of an agent that is not compiled: the representation that it is shown."""

    def __init__(self, representation: str) -> None:
        self.representation = representation


def load_rules(game: Game, scenario: Any, bot: str, representation: str) -> bytes:
    """The WebAssembly module of `kernels.compile_rules`, compiled unless the cache holds it.

    bot: of the game, compiled too; "" for an opponent that is not: it is shown `representation`.

    Raises:
        ValueError: the compiler is off (NUMBA_DISABLE_JIT) or cannot write WebAssembly, or the
            rules call functions that WebAssembly does not have.
        OSError: the process that compiles has died.
    """
    require_compiler()
    representation = "" if bot else representation  # a bot has its own
    kept = cache_root() / "browser" / f"{_digest(game, scenario, bot, representation)}.wasm"
    if kept.is_file():
        return kept.read_bytes()
    with ProcessPoolExecutor(1, get_context("spawn"), lowering.keep_plain_code) as pool:
        try:
            with calling(game.name), compiling():
                task = pool.submit(_compile, game.name, scenario, bot, representation)
                code = task.result()
        except BrokenProcessPool as error:
            raise OSError(
                f"the process that compiles {game.name} to WebAssembly has died ({error}): see "
                "whether memory is short"
            ) from error
    write_atomically(kept, code)
    return code


def require_compiler() -> None:
    """Raise ValueError unless rules are compiled, and this llvmlite can write WebAssembly."""
    import llvmlite
    from llvmlite import binding

    if not is_compiling():
        raise ValueError("NUMBA_DISABLE_JIT is set, and WebAssembly is compiled code: unset it")
    binding.initialize_all_targets()
    try:
        binding.Target.from_triple(lowering.TRIPLE)
    except RuntimeError as error:
        raise ValueError(
            f"llvmlite {llvmlite.__version__} cannot write WebAssembly ({error}): "
            "pip install --upgrade numba llvmlite"
        ) from error


def _compile(name: str, scenario: Any, bot: str, representation: str) -> bytes:
    game = GAMES[name]
    opponent: Any = ShownTo(representation)
    with np.errstate(over="ignore"):  # plain Python wraps counters, but warns about it
        if bot:
            opponent = game.bot(bot, scenario)
        return kernels.compile_rules(game, scenario, opponent)


def _digest(game: Game, scenario: Any, *choices: object) -> str:
    """Of all that the module depends on."""
    import llvmlite

    package = Path(inspect.getfile(GAMES.modules[game.name])).parent
    digest = hashlib.sha256(source_digest(package).encode())
    for module in (kernels, lowering, wasm_file):
        digest.update(Path(inspect.getfile(module)).read_bytes())
    digest.update(repr((llvmlite.__version__, game.name, scenario, choices)).encode())
    digest.update(pickle.dumps(game.make_rules(scenario)))  # with the content of map files
    return digest.hexdigest()[:32]
