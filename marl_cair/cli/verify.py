"""`marl-cair verify`: compare the stored files of a run, an agent or a league with checksums."""

from __future__ import annotations

import sqlite3
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

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


def run(arguments: Sequence[str]) -> int:
    """Print each problem in a line; returns the exit code, EXIT_DAMAGED where there is one."""
    folder = Path(make_parser().parse_args(arguments).folder)
    found = verify_folder(folder)
    problems = {path: problem for path, problem in found.items() if problem}
    for path, problem in problems.items():
        sys.stdout.write(f"{path}: {problem}\n")
    counts = Counter(found.values())
    if {path.suffix for path in found} != {".replay"} and not any(folder.rglob(MANIFEST_FILE)):
        sys.stdout.write(f"{folder}: no manifest, an older version wrote it\n")
    sys.stdout.write(
        f"{counts['']} files are sound, {len(problems)} are damaged, "
        f"{counts[None]} have no checksum\n"
    )
    return EXIT_DAMAGED if problems else EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair verify",
        description="Compare all stored files in a folder with their checksums, and validate "
        "league files. No code in them runs. The exit code is 0, or 1 if a file is damaged.",
    )
    parser.add_argument("folder", help="of a run, an agent, a mixture or a league")
    return parser


def verify_folder(folder: Path) -> dict[Path, str | None]:
    """The problem of each file below `folder`: "" if it is sound, None if it has no checksum (a
    report, or a file of an older version). Raises NotADirectoryError for a file.
    """
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is no folder: give that of a run, an agent or a league")
    found: dict[Path, str | None] = {}
    for manifest in sorted(path for path in folder.rglob(MANIFEST_FILE) if path.exists()):
        try:
            listed = find_damage(manifest.parent)
        except DamagedFileError as error:
            listed = {MANIFEST_FILE: _shorten(error, manifest)}
        found |= {manifest.parent / name: problem for name, problem in listed.items()}
    for path in sorted(folder.rglob("*")):
        is_listed = path in found or path.name == MANIFEST_FILE
        if not is_listed and not path.is_dir() and not is_leftover(path.name):
            found[path] = _check_alone(path)
    return found


def _check_alone(path: Path) -> str | None:
    """The problem of a file that no manifest lists, as in `verify_folder`."""
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


def _check_replay(path: Path) -> str:
    from marl_cair.games.replays.reader import is_whole

    return "" if is_whole(path) else "was cut off before its end"


_CHECKS: dict[str, Callable[[Path], str | None]] = {
    "league.sqlite": _check_league,
    ".json": _check_json,
    ".yaml": _check_settings,
    ".pt": _check_tensors,
    ".gif": _check_film,
    ".replay": _check_replay,
}
