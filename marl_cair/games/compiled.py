"""`compiled`: numba's njit with a disk cache that a change in any game file makes anew.

Numba looks only at the file of the compiled function itself, so a helper changed in another file
would be served stale, and it leaves the bounds-check setting out of its key. The cache folder is
therefore named by a digest of every source under games/, numba's version and that setting.
"""

import hashlib
import os
from collections.abc import Callable
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


def source_digest(folder: Path = _GAMES) -> str:
    """Hex digest of all Python sources below `folder` and of what else changes machine code."""
    setting = f"numba {numba.__version__} boundscheck {_CONFIG.BOUNDSCHECK}"
    digest = hashlib.sha256(setting.encode())
    for path in sorted(folder.rglob("*.py")):
        digest.update(str(path.relative_to(folder)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


_CACHE_DIR = str(cache_root() / source_digest())


def compiled(function: Function) -> Function:
    """Compile a rule function; it releases the GIL, so that slices of worlds run on threads.

    With NUMBA_DISABLE_JIT=1 the plain Python function is returned: the reference that the
    compiled one must equal bit for bit.
    """
    users_folder = _CONFIG.CACHE_DIR
    # Numba reads the folder when it decorates. The user's own setting is put back at once.
    _CONFIG.CACHE_DIR = _CACHE_DIR
    try:
        return cast("Function", _NJIT(cache=True, nogil=True, _nrt=False)(function))
    finally:
        _CONFIG.CACHE_DIR = users_folder


def is_compiling() -> bool:
    """False where NUMBA_DISABLE_JIT makes every rule plain Python."""
    return not _CONFIG.DISABLE_JIT
