"""Rules of the code: imports point one way, files are short, importing has no side effects.

Each test checks all files and lists every violation as "file:line: what".
"""

import ast
import functools
import graphlib
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "marl_cair"
SOURCES = sorted(PACKAGE.rglob("*.py"))
OTHER_SOURCES = sorted(
    path for folder in ("tests", "scripts", "benchmarks") for path in (ROOT / folder).rglob("*.py")
)

MAX_FILE_LINES, MAX_SCRIPT_LINES = 400, 40
LEAVES = {"lookup", "outside", "files", "stored", "ranges", "memory", "interrupts", "text", "npm",
          "cluster"}  # fmt: skip
_SELF_PLAY = {"league.agents", "league.play", "league.ratings", "self_play"}
_ROOMS = "settings", "population", "collecting", "offline"  # of training, for commands
_TRAINING = {"training", "training.settings", "training.collecting"}
_LEARNING = {"policies", "replay", "generative", "checkpoint", "games"}
# What each room of the package may import of it, beside the leaves and itself.
MAY_IMPORT: dict[str, set[str]] = {
    **{room: set() for room in (*LEAVES, "games", "policies", "replay", "conf")},
    **{room: set() for room in ("league.ratings", "league.store")},
    "browser": {"games", "viewer"},
    "generative": {"replay", "policies"},
    "checkpoint": {"policies"},
    "league.agents": {"games", "policies", "checkpoint", "league.store"},
    "league.play": {"games", "league.agents", "league.ratings", "league.store"},
    "league.report": {
        *("games", "viewer", "league.agents", "league.play", "league.ratings", "league.store"),
    },
    "league": {
        *("games", "checkpoint", "league.agents", "league.play", "league.ratings"),
        *("league.store", "league.report"),
    },
    "self_play": {"games", "policies", "checkpoint", "league.agents", "league.ratings"},
    "training.settings": {*_LEARNING, "league.agents", "self_play"},
    "training.collecting": {*_LEARNING, *_SELF_PLAY, "training.settings"},
    "training": {*_LEARNING, *_SELF_PLAY, "league", "training.settings", "training.collecting"},
    "training.population": {*_LEARNING, *_SELF_PLAY, "league", "training", "training.settings"},
    "training.offline": {*_LEARNING, *_SELF_PLAY, *_TRAINING},
    "experiments": {*("", "games", "league"), *_SELF_PLAY, "training", "training.settings"},
    "viewer": {"games"},
    "window": {"games", "viewer", "league.agents", "league.play"},
    "dashboard": {"games", "training", "training.settings", "viewer"},
    "cli": {
        *("", "games", "policies", "generative", "checkpoint", "replay", *_SELF_PLAY, "league"),
        *("league.store", "league.report", "training", "window", "browser", "dashboard", "viewer"),
        *("experiments", *(f"training.{room}" for room in _ROOMS)),
    },
    "__main__": {"cli"},
}
TORCH = {"torch", "torchrl", "tensordict"}
# The only files of games/ that may import a library which the rules must not know.
GAMES_DOORS: dict[str, set[str]] = {
    **{library: {"torchrl_env.py"} for library in TORCH},
    "pettingzoo": {"parallel_env.py"},
    "gymnasium": {"gymnasium_env.py", "parallel_env.py"},
}
OPTIONAL = {"av", "cryptography", "plotly", "pyarrow", "open_spiel", "onnx", "onnxruntime", "ray"}
# Imported when used: each alone takes longer than `import marl_cair` may (0.3 s).
NOT_AT_IMPORT = [*sorted(TORCH), "numba", "matplotlib.pyplot", "scipy.stats", "pygame", "hydra"]


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@functools.cache
def read_tree(path: Path) -> ast.Module:
    """All rules read the same tree."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def find_violations(paths: list[Path], find: Callable[[Path], Iterator]) -> list[str]:
    """All violations, `file:line: what`, that `find` yields for the files."""
    return [f"{relative(path)}:{line}: {what}" for path in paths for line, what in find(path)]


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def name_is_module(name: str) -> bool:
    location = ROOT.joinpath(*name.split("."))
    return location.is_dir() or location.with_suffix(".py").is_file()


@functools.cache
def list_nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(read_tree(path)))


def called_name(node: ast.Call) -> str:
    """The last part of the name of what is called; "" for what has none."""
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def list_imports(path: Path, nodes: Iterable[ast.AST]) -> Iterator[tuple[int, str]]:
    """Lines and full names of all imports among `nodes`: all three spellings, and by string."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            source = absolute_source(path, node)
            for alias in node.names:
                full_name = f"{source}.{alias.name}"
                yield node.lineno, full_name if name_is_module(full_name) else source
        elif isinstance(node, ast.Call) and node.args:
            first = node.args[0]
            is_import = called_name(node) in {"import_module", "__import__"}
            if is_import and isinstance(first, ast.Constant):
                yield node.lineno, str(first.value)


def imported_modules(path: Path, nodes: Iterable[ast.AST]) -> set[str]:
    return {name for _, name in list_imports(path, nodes)}


def absolute_source(path: Path, node: ast.ImportFrom) -> str:
    if node.level == 0:
        return str(node.module)
    package = path.relative_to(ROOT).parent.parts
    kept = package[: len(package) - (node.level - 1)]
    return ".".join([*kept, *([node.module] if node.module else [])])


def room_of(module: str) -> str:
    """The room of the package that `module` belongs to; "" is the package's own __init__."""
    parts = module.split(".")[1:3]
    room = ".".join(parts)
    return room if room in MAY_IMPORT else "".join(parts[:1])


def game_of(module: str) -> str | None:
    """The folder under games/ that `module` belongs to, if it does."""
    parts = module.split(".")
    if parts[:2] != ["marl_cair", "games"] or len(parts) < 3:
        return None
    return parts[2] if (PACKAGE / "games" / parts[2] / "scenarios.py").is_file() else None


def forbidden_imports(path: Path, nodes: Iterable[ast.AST]) -> Iterator[tuple[int, str]]:
    """Imports of the package in `path` that the table does not allow."""
    own = module_name(path)
    room = room_of(own)
    if own != "marl_cair" and room not in MAY_IMPORT:
        yield 1, f"give {room} a row in MAY_IMPORT"
        return
    allowed = LEAVES | MAY_IMPORT.get(room, set()) | {room}
    for line, name in list_imports(path, nodes):
        target = room_of(name)
        is_wrong = target == "cli" if own == "marl_cair" else target not in allowed
        if is_wrong and name.split(".")[0] == "marl_cair":
            yield line, name


def runtime_nodes(path: Path, leave_out: tuple[type[ast.AST], ...] = ()) -> Iterator[ast.AST]:
    """Nodes of the file without those of the kinds `leave_out`, and without what only a type
    checker reads: an annotation may name a class of any library.
    """
    left: list[ast.AST] = [read_tree(path)]
    while left:
        node = left.pop()
        yield node
        is_for_types = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        below = node.orelse if is_for_types else ast.iter_child_nodes(node)
        left += [child for child in below if not isinstance(child, leave_out)]


@functools.cache
def imports_at_import(path: Path) -> set[str]:
    """Full names of what is imported with the module, not inside its functions."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return imported_modules(path, runtime_nodes(path, leave_out=functions))


GAMES_SOURCES = [path for path in SOURCES if path.is_relative_to(PACKAGE / "games")]


def test_imports_point_one_way():
    assert find_violations(SOURCES, lambda path: forbidden_imports(path, list_nodes(path))) == []


def test_import_rule_sees_every_spelling():
    for statement in (
        "import marl_cair.training.trainer",
        "from marl_cair.training import trainer",
        "from marl_cair import training",
        "from ..training import trainer",
        "from .. import training",
        "def act():\n    from marl_cair.training import trainer",
        "importlib.import_module('marl_cair.training')",
        "from marl_cair import make_engine",
    ):
        nodes = ast.walk(ast.parse(statement))
        assert list(forbidden_imports(PACKAGE / "policies" / "conv.py", nodes)), statement


def test_game_never_imports_another_game():
    def find(path):
        for line, name in list_imports(path, list_nodes(path)):
            if game_of(name) not in (None, game_of(module_name(path))):
                yield line, name

    assert find_violations(GAMES_SOURCES, find) == []


@pytest.mark.slow
def test_libraries_enter_games_by_their_door_only():
    def find(path):
        for line, name in list_imports(path, runtime_nodes(path)):
            doors = GAMES_DOORS.get(name.split(".")[0])
            if doors and path not in {PACKAGE / "games" / door for door in doors}:
                yield line, name

    assert find_violations(GAMES_SOURCES, find) == []


# A bot may import scenarios, numbers of the rules, and constants of its game, such as the index of
# a plane or an action; functions and classes of other files could read the state of the world.
KNOWN_TO_BOTS = {"scenarios", "rulebook", "tables", "description"}
OPEN_TO_BOTS = {
    module
    for module in map(module_name, SOURCES)
    if game_of(module) and module.rpartition(".")[2] in KNOWN_TO_BOTS | {"planes"}
}
SHARED_WITH_BOTS = {f"marl_cair.games.{name}" for name in ("compiled", "game", "scripted")}
BOTS = sorted({*PACKAGE.glob("games/*/bot*.py"), *PACKAGE.glob("games/*/bots/*.py")})


def find_peeks(path: Path) -> Iterator[tuple[int, str]]:
    """Imports of a bot's file that could show it more than its observation."""
    for node in ast.walk(read_tree(path)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, a.name) for a in node.names if "marl_cair" in a.name)
        if not isinstance(node, ast.ImportFrom):
            continue
        source = absolute_source(path, node)
        file = source.rpartition(".")[2]
        if source.split(".")[0] != "marl_cair" or source in SHARED_WITH_BOTS or ".bot" in source:
            continue
        is_closed = file in {"rules", "state"} or game_of(source) is None
        for name in (alias.name for alias in node.names):
            is_constant = name.isupper() or file in KNOWN_TO_BOTS
            if f"{source}.{name}" not in OPEN_TO_BOTS and (is_closed or not is_constant):
                yield node.lineno, f"{source}.{name}"


def test_bots_do_not_peek_at_the_state():
    assert find_violations(BOTS, find_peeks) == []


def test_the_rule_for_bots_covers_their_plans():
    assert {"bots.py", "bot_sight.py"} <= {path.name for path in BOTS}
    games = {path.parent.name for path in PACKAGE.glob("games/*/scenarios.py")}
    assert {game_of(module_name(path)) for path in BOTS} == games


def test_a_bot_that_peeks_is_found(tmp_path, monkeypatch):
    package = tmp_path / "marl_cair" / "games" / "deep_rts"
    package.mkdir(parents=True)
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    for number, line in enumerate(
        (
            "from marl_cair.games.deep_rts.state import World",
            "from marl_cair.games.deep_rts import state",
            "from marl_cair.games.deep_rts.rules.step import combat",
            "from marl_cair.games.deep_rts.world_view import world_at",
            "from marl_cair.games.engine import BatchedEngine",
            "from marl_cair.games import make_engine",
            "from .state import NUM_SLOTS",
            "from ..engine import BatchedEngine",
            "import marl_cair.games.deep_rts.state",
        )
    ):
        spy = package / f"bot_spy_{number}.py"
        spy.write_text(line)
        assert list(find_peeks(spy)), line


def test_optional_libraries_are_imported_when_used():
    imported = {(relative(p), name.split(".")[0]) for p in SOURCES for name in imports_at_import(p)}
    assert [place for place in imported if place[1] in OPTIONAL] == []


def test_files_are_short():
    def find(path):
        limit = MAX_SCRIPT_LINES if path.is_relative_to(ROOT / "scripts") else MAX_FILE_LINES
        num_lines = len(path.read_text(encoding="utf-8").splitlines())
        if num_lines > limit:
            yield limit + 1, f"{num_lines} lines, at most {limit}"

    assert find_violations(SOURCES + OTHER_SOURCES, find) == []


def test_the_first_line_of_a_file_is_its_docstring():
    def find(path):
        text = path.read_text(encoding="utf-8")
        first = next((line for line in text.splitlines() if not line.startswith("#!")), "")
        if not ast.get_docstring(read_tree(path)) or not re.match(r'r?"""\S', first):
            yield 1, first

    assert find_violations(SOURCES + OTHER_SOURCES, find) == []


def test_nothing_is_left_for_later():
    marks = re.compile(rf"\b(?:{'|'.join(['TO' + 'DO', 'FIX' + 'ME', 'X' * 3, 'HA' + 'CK'])})\b")

    def find(path):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if marks.search(line):
                yield number, line

    assert find_violations(SOURCES + OTHER_SOURCES, find) == []


def test_only_the_command_line_prints():
    def find(path):
        for node in list_nodes(path):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print":
                yield node.lineno, ast.unparse(node)

    others = [path for path in SOURCES if room_of(module_name(path)) != "cli"]
    assert find_violations(others, find) == []


def run_in(folder: Path, script: str) -> str:
    """Standard output of `script` in a fresh interpreter that stands in `folder`."""
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{script}"
    command = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(
        command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_the_package_is_light_and_silent(tmp_path):
    loaded = f"[name for name in {NOT_AT_IMPORT} if name in sys.modules]"
    assert run_in(tmp_path, f"import marl_cair; print({loaded})") == "[]\n"
    assert list(tmp_path.iterdir()) == []


IMPORT_EACH = """
import contextlib, importlib, os, random, threading, numpy

def forget_package():
    for name in [name for name in sys.modules if name.partition(".")[0] == "marl_cair"]:
        del sys.modules[name]

def outside_state():
    return (random.getstate(), numpy.random.get_state()[1].tolist(), dict(os.environ),
            threading.active_count(), os.getcwd(), sys.getrecursionlimit())

for name in LIBRARIES:  # first: what a library does when imported is not judged here
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
changing = []
for name in MODULES:
    if ALONE:
        forget_package()
    before = outside_state()
    importlib.import_module(name)
    if outside_state() != before:
        changing.append(name)
print(changing)
"""


@pytest.mark.slow
@pytest.mark.parametrize("alone", [False, True])
def test_every_module_imports_without_side_effects(tmp_path, alone):
    modules = [module_name(path) for path in SOURCES if path.name != "__main__.py"]
    imported = {name for path in SOURCES for name in imported_modules(path, list_nodes(path))}
    libraries = sorted(name for name in imported if not name.startswith("marl_cair"))
    names = f"MODULES = {modules}\nLIBRARIES = {libraries}\nALONE = {alone}\n"
    output = run_in(tmp_path, names + IMPORT_EACH)
    assert output == "[]\n", "a module wrote to stdout, or changed what lies outside it"
    assert list(tmp_path.iterdir()) == []


def test_modules_import_one_another_in_one_direction():
    """Where there is no circle, each can be imported first."""
    sources = {module_name(path): path for path in SOURCES}
    graph = {name: sources.keys() & imports_at_import(path) for name, path in sources.items()}
    assert sum(map(len, graph.values())) > len(sources)
    graphlib.TopologicalSorter(graph).prepare()  # CycleError names the circle
