"""`compiled`: numba's njit for rules, with short compile times and a cache that follows changes.

A rule that another rule calls is a *part*: typed and lowered, then linked into the rule that Python
calls, and optimised there once. (Numba alone optimises every function, makes machine code of it,
and inlines it into its callers to do both again: for a tick of Deep RTS a minute and a half instead
of half a minute.) A rule that Python calls is an *entry*: its parts are linked, optimised and kept
on disk.

Numba's disk cache depends only on the file of the compiled function, so it would serve stale code
after a change of a helper in another file, and it ignores the bounds-check setting. The cache
folder is therefore named by a digest of the sources that rules can use, numba's version and that
setting. These sources are the game's own, with its PNG sprites (constants in machine code), and
those directly under games/ that define or serve rules: no game imports another. The folder does not
depend on where the package is installed: two environments share it.
"""

import hashlib
import os
import re
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, cached_property
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from filelock import FileLock
from numba.core import sigutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering
from numba.core.typing.typeof import Purpose, typeof

Function = TypeVar("Function", bound=Callable[..., Any])

_LONGEST_WAIT = 600.0  # seconds that a process waits for what another one compiles
_GAMES = Path(__file__).parent
_IMPORT = re.compile(r"^from marl_cair\.games\.(\w+) import", re.MULTILINE)
_CONFIG: Any = numba.config  # fills in its settings when imported, unseen by type checkers


def cache_root() -> Path:
    """Folder that holds all compiled code: $MARL_CAIR_CACHE, else the user's cache folder."""
    if chosen := os.environ.get("MARL_CAIR_CACHE"):
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "marl_cair"


def source_digest(own: Path | None = None, folder: Path = _GAMES) -> str:
    """Hex digest of all that changes code: the shared sources in `folder`, and a game's own sources
    and sprites (a folder or a file; None: no game).
    """
    setting = f"numba {numba.__version__} boundscheck {_CONFIG.BOUNDSCHECK}"
    digest = hashlib.sha256(setting.encode())
    for path in _shared_sources(folder):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    if own is not None:
        files = [*own.rglob("*.py"), *own.rglob("*.png")] if own.is_dir() else [own]
        for path in sorted(files):
            digest.update(str(path.relative_to(own.parent)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _shared_sources(folder: Path) -> list[Path]:
    """The sources in `folder` that can change machine code: those that games are made with, those
    with rules, and all that these import from `folder`; not the environments and the engine.
    """
    texts = {path: path.read_text("utf-8") for path in folder.glob("*.py")}
    imports = {
        path: {folder / f"{name}.py" for name in _IMPORT.findall(text)}
        for path, text in texts.items()
    }
    reached = {path for path, text in texts.items() if "\n@compiled" in text}
    always = ("compiled.py", "game.py", "game_package.py", "loops.py")
    reached |= {folder / name for name in always} & imports.keys()
    while more := {used for path in reached for used in imports[path]} & imports.keys() - reached:
        reached |= more
    return sorted(reached)


@cache
def _cache_dir(own: Path | None) -> Path:
    return cache_root() / source_digest(own)


def _sources_of(function: Callable[..., Any]) -> Path | None:
    """The folder of the function's game, None for rules that games share; outside our package, the
    folder of the whole package, or the file.
    """
    file = Path(function.__code__.co_filename)
    top, *inner = function.__module__.split(".")
    if top != __name__.partition(".")[0]:
        depth = len(inner) + (file.stem == "__init__")
        return file.parents[depth - 1] if depth else file
    return _GAMES / inner[1] if inner[0] == _GAMES.name and len(inner) > 2 else None


# No allocation and no exceptions, so that a compiler for GPUs can take the rules too.
_OPTIONS: dict[str, Any] = {"nogil": True, "_nrt": False, "error_model": "numpy"}
_PART_OPTIONS = {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: Function) -> Function:
    """Compile a rule function; it releases the GIL, so that slices of worlds run on threads.

    It is inlined wherever it is called: passing all arrays of the world by value costs more than
    most rules do. With NUMBA_DISABLE_JIT=1 the plain Python function is returned: the reference
    that the compiled one must equal bit for bit.
    """
    return _compile(function, forceinline=True)


def compiled_copy(function: Function) -> Function:
    """`compiled` for a few lines that many rules call: copied into each of them before types are
    known, so that it is not compiled again for each combination of integer types.
    """
    return _compile(function, inline="always")


def compiled_compact(function: Function) -> Function:
    """`compiled` without inlining, for drawing: there the wait for the compiler matters more."""
    return _compile(function)


def is_compiling() -> bool:
    """False where NUMBA_DISABLE_JIT makes every rule plain Python."""
    return not _CONFIG.DISABLE_JIT


def settled(kernel: Callable[..., None], *arguments: Any) -> Callable[..., None]:
    """`kernel` compiled for arguments of these types, which it does not check again.

    Checking the types of all arrays of worlds and rules takes ten times as long as passing them.
    The caller must pass the same types and memory layouts: others would be misread.
    """
    if not isinstance(kernel, _Rule):
        return kernel
    types = tuple(typeof(argument, Purpose.argument) for argument in arguments)
    return cast("Callable[..., None]", kernel.entry.compile(types))


def _compile(function: Function, **options: Any) -> Function:
    if not is_compiling():
        return function
    return cast("Function", _Rule(function, targetoptions=_OPTIONS | options))


class _Rule(CPUDispatcher):
    """A rule: a part for the rules that call it, an entry for Python.

    Its overloads are the parts; it is pickled by its arguments, as numba's dispatchers are.
    """

    def __init__(
        self,
        py_func: Callable[..., Any],
        locals: dict[str, Any] | None = None,  # numba's name, by which it makes copies
        targetoptions: dict[str, Any] | None = None,
    ) -> None:
        options = targetoptions or {}
        super().__init__(py_func, locals or {}, options | _PART_OPTIONS, _PartCompiler)
        own = {name: options[name] for name in options.keys() - _PART_OPTIONS}
        self._entry_options = {"nopython": True, "boundscheck": None, **own}

    def __call__(self, *arguments: Any) -> Any:
        return self.entry(*arguments)

    @cached_property
    def entry(self) -> Any:
        """The dispatcher that Python calls, with code of its own on disk.

        A rule that is in no file (of a notebook or a prompt) is not kept: changes of the rules that
        it calls would go unnoticed.
        """
        try:
            kept = _KeptCode(self.py_func)  # type: ignore[no-untyped-call]
        except RuntimeError:  # no file, or no folder that can be written to
            return CPUDispatcher(self.py_func, targetoptions=self._entry_options)
        entry: Any = _Entry(self.py_func, targetoptions=self._entry_options)
        entry._cache = kept
        return entry

    def add_overload(self, cres: Any) -> None:
        """Keep a part for the rules that call it, which Python does not call."""
        self.overloads[tuple(cres.signature.args)] = cres


class _Place(_CacheLocator):
    """Where a rule's machine code is kept: by the digest of its sources and by its name."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._line = py_func.__code__.co_firstlineno
        self._folder = _cache_dir(_sources_of(py_func)) / py_func.__module__

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return ""  # the digest in the path says it

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Place | None":
        if not Path(py_file).is_file():
            return None
        place = cls(py_func)
        try:
            place.ensure_cache_path()  # type: ignore[no-untyped-call]
        except OSError:
            return None
        return place


class _KeptCodeFiles(CompileResultCacheImpl):
    _locator_classes: Any = (_Place,)


class _KeptCode(FunctionCache):
    _impl_class = _KeptCodeFiles


class _Entry(CPUDispatcher):
    """The dispatcher that Python calls. Of several processes that need its code at once, one
    compiles and the others wait to read it: with numba alone each would compile, and the last would
    drop from the cache what the others had added.
    """

    def compile(self, sig: Any) -> Any:
        known: Any = self.overloads.get(tuple(sigutils.normalize_signature(sig)[0]))
        if known is not None:
            return known.entry_point
        if self._is_kept(sig):  # many processes may read at one time
            return super().compile(sig)
        with compiling(), self._locked():
            return super().compile(sig)  # looks into the cache first

    def _is_kept(self, sig: Any) -> bool:
        kept: Any = self._cache  # type: ignore[attr-defined]
        context: Any = self.targetctx
        context.refresh()
        with kept._guard_against_spurious_io_errors():  # Windows: while another process writes it
            return kept._index_key(sig, context.codegen()) in kept._cache_file._load_index()
        return False

    @contextmanager
    def _locked(self) -> Iterator[None]:
        kept: Any = self._cache  # type: ignore[attr-defined]
        folder, code = Path(kept.cache_path), self.py_func.__code__
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{self.py_func.__module__}.{code.co_qualname}-{code.co_firstlineno}"
        lock = FileLock(folder / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.lock")
        try:
            lock.acquire(timeout=_LONGEST_WAIT)
        except (NotImplementedError, OSError):
            # No locks on this file system, or their holder hangs: a lock only saves work.
            yield
            return
        try:
            yield
        finally:
            lock.release()


class _PartCompiler(CompilerBase):
    """Numba's pipeline up to unoptimised code."""

    def define_pipelines(self) -> list[Any]:
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [
            (_PartLowering if step is NativeLowering else step, why)
            for step, why in pipeline.passes
        ]
        pipeline.finalize()
        return [pipeline]


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    _name = "marl_cair_part_lowering"

    def run_pass(self, state: Any) -> bool:
        codegen, name = state.targetctx.codegen(), state.func_id.func_qualname
        library: Any = _PartLibrary(codegen, name)  # type: ignore[no-untyped-call]
        state.library = library
        state.flags.no_compile = True
        super().run_pass(state)  # type: ignore[no-untyped-call]
        lowered = state["cr"]

        def part() -> None:
            """The key by which numba finds the part; it is never called."""

        state.targetctx.insert_user_function(part, lowered.fndesc, [library])
        state["cr"] = lowered._replace(cfunc=part)
        return True


class _PartLibrary(JITCodeLibrary):
    """Code that is optimised and made machine code only where it is linked.

    It holds the parts that it calls: a linker drops functions without callers, so linking them one
    by one would depend on their order.
    """

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


# --- a notice where the compiler takes more than a second ----------------------------------------

ANNOUNCE_AFTER_SECONDS = 1.0
_announced_games: set[str] = set()
_called: ContextVar[str] = ContextVar("the game whose rules are called", default="")


def announce_nothing(games: Iterable[str]) -> None:
    """Print no notices about these games in this process: another process reports its progress."""
    _announced_games.update(games)


@contextmanager
def calling(game: str) -> Iterator[None]:
    """Name the game whose rules are called, and compiled if they have never been."""
    token = _called.set(game)
    try:
        yield
    finally:
        _called.reset(token)


@contextmanager
def compiling() -> Iterator[None]:
    """Print which game is compiled when this takes more than a second."""
    if not (game := _called.get()):
        yield
        return
    timer = threading.Timer(ANNOUNCE_AFTER_SECONDS, _announce, (game,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _announce(game: str) -> None:
    if game not in _announced_games:
        _announced_games.add(game)
        sys.stderr.write(f"marl_cair: compiling the rules of {game} (once for each version) ...\n")
