"""`marl-cair verify`: compare the stored files of a run, an agent or a league with checksums."""

from __future__ import annotations

import sqlite3
import sys
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from marl_cair.cli import EXIT_DAMAGED, EXIT_DONE
from marl_cair.cli.parser import Parser
from marl_cair.files import is_leftover
from marl_cair.stored import (
    CHECKSUM,
    FILM,
    INDEX,
    MANIFEST_FILE,
    TENSORS,
    DamagedFileError,
    find_damage,
    open_stored,
    read_bytes,
    read_json,
    read_settings,
)

_STORE_FILE = "league.sqlite"


class Findings(NamedTuple):
    """Problems of files by path, and how many files are sound, or have no checksum."""

    problems: dict[Path, str]
    num_sound: int
    num_unknown: int  # reports, or files of an older version


def run(arguments: Sequence[str]) -> int:
    """Print each problem in a line; returns the exit code, EXIT_DAMAGED where there is one."""
    options = make_parser().parse_args(arguments)
    found = verify_folder(Path(options.folder))
    for path, problem in found.problems.items():
        sys.stdout.write(f"{path}: {problem}\n")
    if not any(Path(options.folder).rglob(MANIFEST_FILE)):
        sys.stdout.write(f"{options.folder}: no manifest, an older version wrote it\n")
    sys.stdout.write(
        f"{found.num_sound} files are sound, {len(found.problems)} are damaged, "
        f"{found.num_unknown} have no checksum\n"
    )
    return EXIT_DAMAGED if found.problems else EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair verify",
        description="Compare all stored files in a folder with their checksums, and validate "
        "league files. No code in them runs. The exit code is 0, or 1 if a file is damaged.",
    )
    parser.add_argument("folder", help="of a run, an agent, a mixture or a league")
    return parser


def verify_folder(folder: Path) -> Findings:
    """Check all files below `folder`. Raises NotADirectoryError where it is none."""
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is no folder: give that of a run, an agent or a league")
    problems: dict[Path, str] = {}
    listed: set[Path] = set()
    num_sound = num_unknown = 0
    for place in [folder, *sorted(path for path in folder.rglob("*") if path.is_dir())]:
        if not (place / MANIFEST_FILE).exists():
            continue
        try:
            found = find_damage(place)
        except DamagedFileError as error:
            found = {MANIFEST_FILE: _shorten(error, place / MANIFEST_FILE)}
        listed |= {place / name for name in found}
        problems |= {place / name: problem for name, problem in found.items() if problem}
        num_sound += sum(not problem for problem in found.values())
    for path in _list_others(folder, listed):
        problem = _check_alone(path)
        num_unknown += problem is None
        num_sound += problem == ""
        if problem:
            problems[path] = problem
    return Findings(problems, num_sound, num_unknown)


def _list_others(folder: Path, listed: set[Path]) -> Iterator[Path]:
    for path in sorted(folder.rglob("*")):
        is_listed = path in listed or path.name == MANIFEST_FILE
        if not is_listed and not path.is_dir() and not is_leftover(path.name):
            yield path


def _check_alone(path: Path) -> str | None:
    """The problem of a file that no manifest lists: "" if it is sound, None without a checksum."""
    check = _CHECKS.get(path.name) or _CHECKS.get(path.suffix)
    if not path.is_file():
        return "is no regular file"
    try:
        return None if check is None else check(path)
    except (ValueError, OSError, sqlite3.Error, zipfile.BadZipFile, EOFError) as error:
        return _shorten(error, path)


def _shorten(error: Exception, path: Path) -> str:
    return f"{error}".removeprefix(f"{path} ") or type(error).__name__


def _check_json(path: Path) -> str | None:
    read_json(path, INDEX)
    return "" if f'"{CHECKSUM}"'.encode() in read_bytes(path, INDEX) else None


def _check_settings(path: Path) -> str | None:
    return "" if f"# {CHECKSUM}: " in read_settings(path) else None


def _check_tensors(path: Path) -> str:
    with open_stored(path, TENSORS) as file, zipfile.ZipFile(file) as parts:
        wrong = parts.testzip()
    return f"is damaged: the checksum of its part {wrong} is of something else" if wrong else ""


def _check_film(path: Path) -> str:
    data = read_bytes(path, FILM)
    return "" if data[:4] == b"GIF8" and data[-1:] == b";" else "is no whole GIF"


def _check_league(path: Path) -> str:
    from marl_cair.league.store.store import LeagueStore  # for leagues alone

    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        (state,) = database.execute("PRAGMA integrity_check(1)").fetchone()
    if state != "ok":
        return f"is damaged: {state}"
    with closing(LeagueStore(path)) as store:
        store.read_agents()
        store.read_games()
    return ""


_CHECKS: dict[str, Callable[[Path], str | None]] = {
    _STORE_FILE: _check_league,
    ".json": _check_json,
    ".yaml": _check_settings,
    ".pt": _check_tensors,
    ".gif": _check_film,
}
