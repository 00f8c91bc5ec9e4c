"""The rules that keep the code readable: imports point one way, files are short, nothing is hidden.

Every test reads the files that exist, so that a new module is held to the rules by being there.
"""

import ast
import copy
import functools
import graphlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "marl_cair"
SOURCES = sorted(PACKAGE.rglob("*.py"))
OTHER_SOURCES = sorted(
    path for folder in ("tests", "scripts", "benchmarks") for path in (ROOT / folder).rglob("*.py")
)

MAX_FILE_LINES = 400
MAX_SCRIPT_LINES = 40

LEAVES = {"lookup", "files", "stored", "ranges", "memory", "interrupts", "text"}
_SELF_PLAY = {"league.agents", "league.play", "league.ratings", "self_play"}
_LEARNING = {"policies", "replay", "generative", "checkpoint", "games"}
# What each room of the package may import of it, beside the leaves and itself.
MAY_IMPORT: dict[str, set[str]] = {
    **{leaf: set() for leaf in LEAVES},
    "games": set(),
    "policies": set(),
    "replay": set(),
    "generative": {"replay", "policies"},
    "checkpoint": {"policies"},
    "league.ratings": set(),
    "league.store": {"games"},
    "league.agents": {"games", "policies", "checkpoint", "league.store"},
    "league.play": {"games", "league.agents", "league.ratings", "league.store"},
    "league.report": {
        *("games", "league.agents", "league.play", "league.ratings", "league.store"),
    },
    "league": {
        *("games", "checkpoint", "league.agents", "league.play", "league.ratings"),
        *("league.store", "league.report"),
    },
    "self_play": {"games", "policies", "checkpoint", "league.agents", "league.ratings"},
    "training.settings": {*_LEARNING, "league.agents", "self_play"},
    "training.collecting": {*_LEARNING, *_SELF_PLAY, "training.settings"},
    "training": {*_LEARNING, *_SELF_PLAY, "league", "training.settings", "training.collecting"},
    "training.population": {
        *_LEARNING,
        *_SELF_PLAY,
        *("league", "training", "training.settings"),
    },
    # "" is what `import marl_cair` gives every user; the registries tell --help the choices.
    "cli": {
        *("", "games", "policies", "generative", "checkpoint", "self_play"),
        *("league", "league.agents", "league.play", "league.ratings", "league.store"),
        *("league.report", "training", "training.settings", "training.population"),
    },
    "conf": set(),
    "__main__": {"cli"},
}
TORCH = {"torch", "torchrl", "tensordict"}
# The only files of games/ that may import a library which the rules must not know.
GAMES_DOORS: dict[str, set[str]] = {
    **{library: {"torchrl_env.py"} for library in TORCH},
    "pettingzoo": {"parallel_env.py"},
    "gymnasium": {"gymnasium_env.py", "parallel_env.py"},
}
OPTIONAL = {"pyarrow", "open_spiel"}
# Imported when used: each alone takes longer than `import marl_cair` may (0.3 s).
NOT_AT_IMPORT = [*sorted(TORCH), "numba", "matplotlib.pyplot", "scipy.stats", "pygame", "hydra"]


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@functools.cache
def read_tree(path: Path) -> ast.Module:
    """Every rule reads the same one: whoever changes it copies it first."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def name_is_module(name: str) -> bool:
    location = ROOT.joinpath(*name.split("."))
    return location.is_dir() or location.with_suffix(".py").is_file()


def imported_modules(path: Path, tree: ast.AST) -> Iterator[str]:
    """Full names of all that `tree` imports: all three spellings, at any depth, and by string."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            source = absolute_source(path, node)
            for alias in node.names:
                full_name = f"{source}.{alias.name}"
                yield full_name if name_is_module(full_name) else source
        elif isinstance(node, ast.Call) and node.args:
            called = ast.unparse(node.func).rpartition(".")[2]
            first = node.args[0]
            if called in {"import_module", "__import__"} and isinstance(first, ast.Constant):
                yield str(first.value)


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


def forbidden_imports(path: Path, tree: ast.AST) -> list[str]:
    """What `path` imports of the package although the table does not allow it."""
    own = module_name(path)
    if own == "marl_cair":
        return [name for name in imported_modules(path, tree) if room_of(name) == "cli"]
    allowed = LEAVES | MAY_IMPORT[room_of(own)] | {room_of(own)}
    return [
        name
        for name in imported_modules(path, tree)
        if name.split(".")[0] == "marl_cair" and room_of(name) not in allowed
    ]


class RuntimeOnly(ast.NodeTransformer):
    """Drops what only a type checker reads: an annotation may name a class of any library."""

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        return node.orelse if "TYPE_CHECKING" in ast.unparse(node.test) else node


class AtImport(ast.NodeTransformer):
    """Drops what is not run when a module is imported."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Dropped."""

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        """Dropped."""


def imports_at_import(path: Path) -> set[str]:
    """Full names of what is imported with the module, not inside its functions."""
    tree = AtImport().visit(RuntimeOnly().visit(copy.deepcopy(read_tree(path))))
    return set(imported_modules(path, tree))


every_source = pytest.mark.parametrize("path", SOURCES, ids=relative)
every_file = pytest.mark.parametrize("path", SOURCES + OTHER_SOURCES, ids=relative)
every_games_source = pytest.mark.parametrize(
    "path", [path for path in SOURCES if path.is_relative_to(PACKAGE / "games")], ids=relative
)


@every_source
def test_imports_point_one_way(path):
    room = room_of(module_name(path))
    assert room == "" or room in MAY_IMPORT, f"give {room} a row in MAY_IMPORT"
    assert forbidden_imports(path, read_tree(path)) == []


@pytest.mark.parametrize(
    "statement",
    [
        "import marl_cair.training.trainer",
        "from marl_cair.training import trainer",
        "from marl_cair import training",
        "from ..training import trainer",
        "from .. import training",
        "def act():\n    from marl_cair.training import trainer",
        "importlib.import_module('marl_cair.training')",
        "from marl_cair import make_engine",
    ],
)
def test_import_rule_sees_every_spelling(statement, monkeypatch):
    monkeypatch.setattr(
        sys.modules[__name__], "name_is_module", lambda name: not name.endswith("make_engine")
    )
    assert forbidden_imports(PACKAGE / "policies" / "conv.py", ast.parse(statement)) != []


@every_games_source
def test_game_never_imports_another_game(path):
    own_game = game_of(module_name(path))
    games = {game_of(name) for name in imported_modules(path, read_tree(path))} - {None}
    if path != PACKAGE / "games" / "__init__.py":  # the list of all games
        assert games <= {own_game}


@every_games_source
def test_libraries_enter_games_by_their_door_only(path):
    tree = RuntimeOnly().visit(copy.deepcopy(read_tree(path)))
    imported = {name.split(".")[0] for name in imported_modules(path, tree)}
    at_the_door = path.parent == PACKAGE / "games"
    wrong = {
        library
        for library in imported & set(GAMES_DOORS)
        if not (at_the_door and path.name in GAMES_DOORS[library])
    }
    assert wrong == set()


# Of its game a bot may know scenarios, numbers of the rules, and constants, such as where a plane
# or an action stands; functions and classes of other files could read the state of the world.
KNOWN_TO_BOTS = {"scenarios", "rulebook", "tables"}
OPEN_TO_BOTS = {
    module
    for module in map(module_name, SOURCES)
    if game_of(module) and module.rpartition(".")[2] in KNOWN_TO_BOTS | {"planes"}
}
BOTS = sorted({*PACKAGE.glob("games/*/bot*.py"), *PACKAGE.glob("games/*/bots/*.py")})


def peeks(path: Path) -> list[str]:
    """What a file of a bot imports of the games that could show it more than its observation."""
    peeked = []
    for node in ast.walk(read_tree(path)):
        if isinstance(node, ast.Import):
            peeked += [alias.name for alias in node.names if "marl_cair" in alias.name]
        if not isinstance(node, ast.ImportFrom):
            continue
        source = absolute_source(path, node)
        file = source.rpartition(".")[2]
        is_shared = source in {
            f"marl_cair.games.{name}" for name in ("compiled", "game", "scripted")
        }
        if source.split(".")[0] != "marl_cair" or is_shared or ".bot" in source:
            continue
        names = [alias.name for alias in node.names]
        is_closed = file in {"rules", "state"} or game_of(source) is None
        peeked += [
            f"{source}.{name}"
            for name in names
            if f"{source}.{name}" not in OPEN_TO_BOTS
            and (is_closed or not (name.isupper() or file in KNOWN_TO_BOTS))
        ]
    return peeked


@pytest.mark.parametrize("path", BOTS, ids=relative)
def test_bots_do_not_peek_at_the_state(path):
    assert peeks(path) == []


def test_the_rule_for_bots_covers_their_plans():
    assert {"bots.py", "bot_sight.py"} <= {path.name for path in BOTS}
    games = {path.parent.name for path in PACKAGE.glob("games/*/scenarios.py")}
    assert {game_of(module_name(path)) for path in BOTS} == games


@pytest.mark.parametrize(
    "line",
    [
        "from marl_cair.games.deep_rts.state import World",
        "from marl_cair.games.deep_rts import state",
        "from marl_cair.games.deep_rts.rules.step import combat",
        "from marl_cair.games.deep_rts.world_view import world_at",
        "from marl_cair.games.engine import BatchedEngine",
        "from marl_cair.games import make_engine",
        "from .state import NUM_SLOTS",
        "from ..engine import BatchedEngine",
        "import marl_cair.games.deep_rts.state",
    ],
)
def test_a_bot_that_peeks_is_found(line, tmp_path, monkeypatch):
    package = tmp_path / "marl_cair" / "games" / "deep_rts"
    package.mkdir(parents=True)
    (package / "bot_spy.py").write_text(f'"""A bot that peeks."""\n\n{line}\n')
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    assert peeks(package / "bot_spy.py") != []


@every_source
def test_optional_libraries_are_imported_when_used(path):
    imported = {name.split(".")[0] for name in imports_at_import(path)}
    assert OPTIONAL & imported == set()


@every_file
def test_file_is_short(path):
    limit = MAX_SCRIPT_LINES if path.is_relative_to(ROOT / "scripts") else MAX_FILE_LINES
    assert len(path.read_text(encoding="utf-8").splitlines()) <= limit


@every_file
def test_file_says_in_its_first_line_what_it_is_for(path):
    text = path.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)), "the file has no docstring"
    first = next(line for line in text.splitlines() if not line.startswith("#!"))
    assert re.match(r'r?"""\S', first)


@every_file
def test_nothing_is_left_for_later(path):
    marks = "|".join(["TO" + "DO", "FIX" + "ME", "X" * 3, "HA" + "CK"])
    text = path.read_text(encoding="utf-8")
    assert re.findall(rf"\b(?:{marks})\b", text) == []


@every_source
def test_only_the_command_line_prints(path):
    if room_of(module_name(path)) == "cli":
        return
    calls = [node for node in ast.walk(read_tree(path)) if isinstance(node, ast.Call)]
    prints = [node.lineno for node in calls if ast.unparse(node.func) == "print"]
    assert prints == []


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


@pytest.mark.parametrize("alone", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_module_imports_without_side_effects(tmp_path, alone):
    modules = [module_name(path) for path in SOURCES if path.name != "__main__.py"]
    imported = {name for path in SOURCES for name in imported_modules(path, read_tree(path))}
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
