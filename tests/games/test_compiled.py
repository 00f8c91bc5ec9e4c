"""The compiler's cache: made again when it must be, and the user's own settings left alone."""

import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import marl_cair
from marl_cair.games import compiled as compiled_module
from marl_cair.games import deep_line_wars
from marl_cair.games.compiled import (
    cache_root,
    compiled,
    compiled_compact,
    is_compiling,
    settled,
    source_digest,
)
from marl_cair.games.deep_line_wars.rules import step
from marl_cair.games.deep_line_wars.state import world_at
from marl_cair.games.randomness import mix

DEEP_LINE_WARS = Path(deep_line_wars.__file__).parent


@pytest.fixture
def sources(tmp_path) -> Path:
    for game in ("game", "other"):
        (tmp_path / game).mkdir()
        (tmp_path / game / "rules.py").write_text("b = 2\n")
    (tmp_path / "compiled.py").write_text("a = 0\n")
    (tmp_path / "tables.py").write_text("a = 1\n")
    (tmp_path / "dice.py").write_text(
        "from marl_cair.games.compiled import compiled\nfrom marl_cair.games.tables import a\n"
        "@compiled\ndef roll(): return a\n"
    )
    (tmp_path / "engine.py").write_text("from marl_cair.games.dice import a\n")
    return tmp_path


def test_the_digest_changes_with_any_source_or_sprite_of_the_game_and_with_its_name(sources):
    game = sources / "game"
    digests = [source_digest(game, sources)]
    for change in (
        lambda: (game / "rules.py").write_text("b = 3\n"),
        lambda: (game / "rules.py").rename(game / "combat.py"),
        lambda: (game / "more.py").write_text(""),
        lambda: (sources / "tables.py").write_text("a = 2\n"),
        lambda: (game / "sprites.png").write_bytes(b"pixels"),
    ):
        assert source_digest(game, sources) == digests[-1]
        change()
        digests.append(source_digest(game, sources))
    assert len(set(digests)) == 6


def test_the_digest_ignores_other_games_environments_and_readmes(sources):
    before = source_digest(sources / "game", sources), source_digest(None, sources)
    (sources / "engine.py").write_text("a = 2\n")
    (sources / "game" / "README.md").write_text("words")
    (sources / "other" / "rules.py").write_text("b = 3\n")
    assert (source_digest(sources / "game", sources), source_digest(None, sources)) == before


def test_the_digest_changes_with_the_bounds_check_and_the_version(sources, monkeypatch):
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", None)
    digests = {source_digest(sources / "game", sources)}
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    digests.add(source_digest(sources / "game", sources))
    monkeypatch.setattr(numba, "__version__", "0.0.0")
    digests.add(source_digest(sources / "game", sources))
    assert len(digests) == 3


def test_a_rule_is_kept_under_the_digest_of_its_game_and_a_helper_under_the_shared_one():
    for function, own in ((step, DEEP_LINE_WARS), (world_at, DEEP_LINE_WARS), (mix, None)):
        folder = str(cache_root() / source_digest(own))
        assert function.entry._cache.cache_path.startswith(folder)
    assert source_digest(DEEP_LINE_WARS) != source_digest()


def test_the_digest_covers_all_that_rules_are_made_of():
    """Every file with compiled functions, and what such a file imports of the shared modules."""
    folder = DEEP_LINE_WARS.parent
    games = {path.parent for path in folder.glob("*/scenarios.py")}
    shared = {path.stem for path in compiled_module._shared_sources(folder)}
    rules = [path for path in folder.rglob("*.py") if "\n@compiled" in path.read_text("utf-8")]
    for path in rules:
        assert path.parent == folder or games & set(path.parents)
        imported = set(compiled_module._IMPORT.findall(path.read_text("utf-8")))
        assert imported - {game.name for game in games} <= shared
    assert len(rules) > 30


@pytest.mark.slow
def test_the_rules_of_another_package_are_kept_under_the_digest_of_that_package(
    tmp_path, monkeypatch
):
    """Numba alone would look at the file of the function and miss a helper beside it."""
    package = tmp_path / "packages" / "strangers"
    (package / "chess").mkdir(parents=True)
    (package / "chess" / "rules.py").write_text(
        "from marl_cair.games.compiled import compiled\n"
        "@compiled\ndef add(a: int, b: int) -> int:\n    return a + b\n"
    )
    monkeypatch.syspath_prepend(tmp_path / "packages")
    code = "from strangers.chess.rules import add; print(add(1, 2), add.entry._cache.cache_path)"
    total, folder = run_python(code, tmp_path, NUMBA_DISABLE_JIT="0")
    assert total == "3"
    assert folder.startswith(str(tmp_path / "ours" / source_digest(package)))
    (package / "tables.py").write_text("COST = 50\n")
    assert not folder.startswith(str(tmp_path / "ours" / source_digest(package)))


def test_the_cache_lies_where_the_user_says(monkeypatch):
    monkeypatch.setenv("MARL_CAIR_CACHE", "/somewhere")
    assert cache_root() == Path("/somewhere")
    monkeypatch.delenv("MARL_CAIR_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert cache_root() == Path("/cache/marl_cair")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_root() == Path.home() / ".cache" / "marl_cair"


@pytest.mark.skipif(not is_compiling(), reason="NUMBA_DISABLE_JIT=1")
def test_where_the_cache_folder_cannot_be_made_rules_are_compiled_all_the_same(
    monkeypatch, tmp_path
):
    (tmp_path / "file").touch()
    monkeypatch.setenv("MARL_CAIR_CACHE", str(tmp_path / "file"))
    compiled_module._cache_dir.cache_clear()
    try:
        assert compiled(read_entry)(np.array([3, 4]), 1) == 4
    finally:
        compiled_module._cache_dir.cache_clear()


SHARE_CODE = """
from marl_cair.games.randomness import mix
import numpy
mix(numpy.uint64(3))
print(mix.__module__, len(mix.entry.stats.cache_hits))
"""


@pytest.mark.slow
def test_two_installations_with_one_cache_compile_once(tmp_path):
    for number in (0, 1):
        shutil.copytree(
            Path(marl_cair.__file__).parent,
            tmp_path / str(number) / "marl_cair",
            ignore=lambda _, names: [n for n in names if n in {"__pycache__", "league"}],
        )
    hits = [
        run_python(
            SHARE_CODE, tmp_path, PYTHONPATH=str(tmp_path / str(number)), NUMBA_DISABLE_JIT="0"
        )[1]
        for number in (0, 1)
    ]
    assert hits == ["0", "1"]


IN_NO_FILE = """
from marl_cair.games.compiled import compiled
@compiled
def double(number):
    return 2 * number
@compiled
def quadruple(number):
    return double(double(number))
"""


@pytest.mark.parametrize("name", ["<ipython-input-1>", "<stdin>", "/cells/ipykernel_1/2.py"])
def test_rules_of_a_notebook_or_a_prompt_are_compiled_and_not_kept(name):
    cell = {"__name__": "__main__"}
    exec(compile(IN_NO_FILE, name, "exec"), cell)  # noqa: S102  # as a notebook does
    assert cell["quadruple"](3) == 12
    assert settled(cell["quadruple"], 3)(4) == 16


@compiled
def half(number):
    return number / 2


@compiled
def halve_all(numbers):
    for index in range(len(numbers)):
        numbers[index] = half(numbers[index]) + half(index)


def test_a_rule_is_called_by_python_and_by_other_rules_whichever_comes_first():
    numbers = np.array([2.0, 4.0, 6.0])
    halve_all(numbers)
    assert numbers.tolist() == [1.0, 2.5, 4.0]
    assert (half(3), half(3.0)) == (1.5, 1.5)
    halve_all(numbers)
    assert numbers.tolist() == [0.5, 1.75, 3.0]


@pytest.mark.skipif(not is_compiling(), reason="NUMBA_DISABLE_JIT=1")
def test_a_rule_called_by_rules_only_gets_no_machine_code():
    @compiled
    def double(number):
        return 2 * number

    @compiled
    def quadruple(number):
        return double(double(number))

    assert quadruple(3) == 12
    assert len(double.overloads) == 1
    assert "entry" not in vars(double)
    assert quadruple.entry.overloads
    assert not quadruple.overloads


@compiled_compact
def third(number):
    return number / 3


@compiled_compact
def thirds_below(number, limit):
    return third(number) if number < limit else third(float(number))


@compiled_compact
def count_thirds(numbers):
    """Calls variants of a rule that are left out again when their branch proves dead."""
    total = thirds_below(3, 10)
    for number in numbers:
        total += thirds_below(number, 10) + thirds_below(int(number), 4) + third(9)
    return total


def test_rules_that_are_not_inlined_are_linked_whatever_their_order():
    assert count_thirds(np.array([6.0, 12.0])) == 1 + (2 + 2 + 3) + (4 + 4 + 3)


def test_a_rule_survives_pickling():
    assert pickle.loads(pickle.dumps(half))(5) == 2.5  # noqa: S301  # its own


RUN_ENGINE = """
import numba, numpy, marl_cair
numba.config.CACHE_DIR = "{users}"
engine = marl_cair.make_engine("deep_line_wars")
engine.reset(0)
from marl_cair.games.compiled import is_compiling
print(is_compiling(), numba.config.CACHE_DIR)
"""


def run_python(code: str, tmp_path: Path, **setting: str) -> list[str]:
    """What a fresh process prints, with a compiler cache of its own."""
    environment = {
        **os.environ,
        "MARL_CAIR_CACHE": str(tmp_path / "ours"),
        "PYTHONPATH": os.pathsep.join(sys.path),
        **setting,
    }
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


def run_engine(tmp_path: Path, **setting: str) -> list[str]:
    return run_python(RUN_ENGINE.format(users=tmp_path / "users"), tmp_path, **setting)


@pytest.mark.slow
def test_compiled_code_is_kept_in_our_folder_and_not_in_the_users(tmp_path):
    printed = run_engine(tmp_path, NUMBA_DISABLE_JIT="0")
    assert printed == ["True", str(tmp_path / "users")]
    assert not (tmp_path / "users").exists()
    rules = tmp_path / "ours" / source_digest(DEEP_LINE_WARS)
    assert any("reset" in path.name for path in rules.rglob("*.nbi"))


@pytest.mark.slow
def test_without_the_compiler_rules_are_plain_functions(tmp_path):
    assert run_engine(tmp_path, NUMBA_DISABLE_JIT="1")[0] == "False"
    assert not (tmp_path / "ours").exists()


def read_entry(numbers, index):
    return numbers[index]


COMPILE_TOGETHER = """
import sys
import time
from pathlib import Path
import marl_cair
engine = marl_cair.make_engine("flappy_bird")
Path(sys.argv[1]).touch()
while not Path(sys.argv[2]).exists():
    time.sleep(0.001)
engine.reset(0)
print(sum(engine.game.reset.entry.stats.cache_misses.values()))
"""


@pytest.mark.slow
def test_of_processes_that_want_the_same_code_at_one_time_one_compiles(tmp_path):
    environment = {**os.environ, "MARL_CAIR_CACHE": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    ready, start = [tmp_path / "first", tmp_path / "second"], tmp_path / "start"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", COMPILE_TOGETHER, str(path), str(start)],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for path in ready
    ]
    try:
        while not all(path.exists() for path in ready):
            assert all(process.poll() is None for process in processes)
            time.sleep(0.01)
        start.touch()
        compiled_by = [int(process.communicate(timeout=300)[0]) for process in processes]
    finally:
        for process in processes:
            process.kill()
    assert sorted(compiled_by) == [0, 1]


@pytest.mark.skipif(not is_compiling(), reason="NUMBA_DISABLE_JIT=1")
@pytest.mark.parametrize("error", [NotImplementedError("no flock"), OSError("no locks available")])
def test_where_no_lock_can_be_kept_rules_are_compiled_all_the_same(monkeypatch, error):
    def acquire(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("filelock.FileLock.acquire", acquire)
    monkeypatch.setattr("marl_cair.games.compiled._Entry._is_kept", lambda *_: False)
    assert compiled(read_entry)(np.array([3, 4]), 1) == 4


@pytest.mark.skipif(not is_compiling(), reason="NUMBA_DISABLE_JIT=1")
def test_code_in_the_process_or_on_disk_waits_for_no_other_process(monkeypatch):
    rule, numbers = compiled(read_entry), np.array([3, 4])
    rule(numbers, 1)

    def acquire(*_: object, **__: object) -> None:
        pytest.fail("a lock is asked for")

    monkeypatch.setattr("filelock.FileLock.acquire", acquire)
    assert settled(rule, numbers, 1)(numbers, 0) == 3
    begun_later: Any = compiled(read_entry)
    assert begun_later(numbers, 1) == 4
    assert sum(begun_later.entry.stats.cache_hits.values()) == 1


READ_BEYOND = """
import numpy
from marl_cair.games.compiled import compiled
from tests.games.test_compiled import read_entry
read = compiled(read_entry)
try:
    read(numpy.zeros(4), 10)
    print("unnoticed")
except IndexError:
    print("raised")
"""


@pytest.mark.slow
def test_bounds_are_checked_when_asked_for_whatever_was_cached_before(tmp_path):
    """Numba itself would load the unchecked code that the first run left behind."""
    printed = [
        run_python(READ_BEYOND, tmp_path, NUMBA_DISABLE_JIT="0", NUMBA_BOUNDSCHECK=setting)
        for setting in ("0", "1", "0")
    ]
    assert printed == [["unnoticed"], ["raised"], ["unnoticed"]]


def test_a_settled_rule_does_the_same():
    numbers = np.array([2.0, 4.0, 6.0])
    settled(halve_all, numbers)(numbers)
    assert numbers.tolist() == [1.0, 2.5, 4.0]


def test_what_is_no_rule_is_settled_as_it_is():
    assert settled(len, np.ones(2)) is len
