"""`compiled`: numba's njit with a disk cache that a change in a game's sources makes anew.

Numba looks only at the file of the compiled function itself, so a helper changed in another file
would be served stale, and it leaves the bounds-check setting out of its key. The cache folder is
therefore named by a digest of the sources that a game can use (its own, and those directly under
games/: no game imports another), numba's version and that setting.
"""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_GAMES = Path(__file__).parent
_CONFIG: Any = numba.config  # fills in its settings when imported, unseen by type checkers
_NJIT: Any = numba.njit  # takes target options, such as _nrt, that its types leave out


def cache_root() -> Path:
    """Folder that holds all compiled code: $MARL_CAIR_CACHE, else the user's cache folder."""
    if chosen := os.environ.get("MARL_CAIR_CACHE"):
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "marl_cair"


def source_digest(game: str | None = None, folder: Path = _GAMES) -> str:
    """Hex digest of the sources that `game` (None: no game) uses and of what else changes code."""
    setting = f"numba {numba.__version__} boundscheck {_CONFIG.BOUNDSCHECK}"
    digest = hashlib.sha256(setting.encode())
    sources = sorted(folder.glob("*.py"))
    if game is not None:
        sources += sorted((folder / game).rglob("*.py"))
    for path in sources:
        digest.update(str(path.relative_to(folder)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _cache_dir(game: str | None) -> str:
    return str(cache_root() / source_digest(game))


def _game_of(function: Callable[..., Any]) -> str | None:
    """The game whose folder holds the function, None for what the games share."""
    package, _, path = function.__module__.partition("marl_cair.games.")
    game, _, file = path.partition(".")
    return game if not package and file else None


# No allocation and no exceptions: what a compiler for GPUs can take too.
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False, "error_model": "numpy"}


def compiled(function: Function) -> Function:
    """Compile a rule function; it releases the GIL, so that slices of worlds run on threads.

    It is inlined wherever it is called: each call would else pass all arrays of the world by value,
    which costs more than most rules do. With NUMBA_DISABLE_JIT=1 the plain Python function is
    returned: the reference that the compiled one must equal bit for bit.
    """
    return _compile(function, forceinline=True)


def compiled_copy(function: Function) -> Function:
    """`compiled` for a few straight lines that many rules call: copied into each of them before
    types are known, so that it is not compiled anew for each combination of integer types.
    """
    return _compile(function, inline="always")


def compiled_compact(function: Function) -> Function:
    """`compiled` without inlining, for drawing: there the wait for the compiler matters more."""
    return _compile(function)


def _compile(function: Function, **options: Any) -> Function:
    users_folder = _CONFIG.CACHE_DIR
    # Numba reads the folder when it decorates. The user's own setting is put back at once.
    _CONFIG.CACHE_DIR = _cache_dir(_game_of(function))
    try:
        return cast("Function", _NJIT(**_OPTIONS, **options)(function))
    finally:
        _CONFIG.CACHE_DIR = users_folder


def is_compiling() -> bool:
    """False where NUMBA_DISABLE_JIT makes every rule plain Python."""
    return not _CONFIG.DISABLE_JIT
