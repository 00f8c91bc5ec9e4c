"""Read stored files after checks of kind, size and checksum; write manifests and checksums.

A folder that is written whole (`files.replaced_folder`) holds a `manifest.json` with the size and
the digest of each of its files; an inner folder with its own manifest counts as that one file.
Single files carry their digest: JSON objects under `checksum`, YAML in a comment in its last line.
A checksum shows damage; it is no signature.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MANIFEST_FILE = "manifest.json"
CHECKSUM = "checksum"
_SETTINGS_CHECKSUM = f"# {CHECKSUM}: "
_LEVELS_UP = 3  # folders between a file and its manifest: <mixture>/members/00, <replay>/storage

_KIB, _MIB, _GIB = 1 << 10, 1 << 20, 1 << 30
SETTINGS, RECORD, INDEX, LOG, MAP = "settings", "record", "index", "log", "map"
FILM, VIEWER, REPLAY, TENSORS, ARRAY = "film", "viewer", "replay", "tensors", "array"
# Most bytes of a file by its kind: larger ones are refused before they are read.
MAX_BYTES = {
    SETTINGS: 128 * _KIB,  # a configuration has 5 KiB; YAML is read at some 100 KiB in a second
    RECORD: 4 * _MIB,  # agent.json has 2 KiB, a mixture 0.1 KiB for each member
    INDEX: 32 * _MIB,  # of a folder of thousands of files
    LOG: 256 * _MIB,  # log.csv has 1 KiB for each 10,000 frames
    MAP: 2 * _MIB,  # 128 x 128 cells, the most there are, have 17 KiB as text, 0.1 MiB as JSON
    FILM: 16 * _MIB,  # a film has some MiB at most
    VIEWER: 16 * _MIB,  # a game to watch has 2 MB at most, if not asked for more
    REPLAY: 128 * _MIB,  # a game has some KiB; with the values of an agent some MiB
    TENSORS: 64 * _GIB,  # readers check the memory
    ARRAY: 4096 * _GIB,  # arrays are mapped, not read
}


class DamagedFileError(ValueError):
    """A stored file that was changed, or that this program would not write."""


@contextmanager
def open_stored(path: str | os.PathLike[str], kind: str) -> Iterator[io.BufferedReader]:
    """Open a file to read after checks of its kind (of MAX_BYTES), size and digest. Files without a
    manifest, of older versions, have no digest.

    Raises:
        DamagedFileError: no regular file (a pipe would block), a file that is larger than its kind
            may be, or not the one that its manifest lists.
        OSError: it cannot be opened.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    place = Path(path)
    with os.fdopen(os.open(place, flags), "rb") as file:
        about = os.fstat(file.fileno())
        if not stat.S_ISREG(about.st_mode):
            raise DamagedFileError(
                f"{place} is no regular file, but a folder, pipe or device: restore the file"
            )
        if about.st_size > MAX_BYTES[kind]:
            raise DamagedFileError(
                f"{place} has {about.st_size:,} bytes, a {kind} file has at most "
                f"{MAX_BYTES[kind]:,}: restore the right file"
            )
        if listed := _find_listed(place):
            if problem := _compare(file, *listed):
                raise DamagedFileError(f"{place} {problem}: restore it from a copy")
            file.seek(0)
        yield file


def read_bytes(path: str | os.PathLike[str], kind: str) -> bytes:
    """The content of a file. Raises as `open_stored`."""
    with open_stored(path, kind) as file:
        return file.read()


def read_text(path: str | os.PathLike[str], kind: str) -> str:
    """The text of a UTF-8 file. Raises as `open_stored`; DamagedFileError for another encoding."""
    try:
        return read_bytes(path, kind).decode("utf-8")
    except UnicodeDecodeError as error:
        raise DamagedFileError(f"{path} is no UTF-8 text ({error}): restore it") from error


def read_json(path: str | os.PathLike[str], kind: str = RECORD) -> Any:
    """The plain value in a JSON file, without its `checksum`, if any. Raises as `open_stored`;
    DamagedFileError for a file that is no JSON, is nested too deeply, or has another checksum.
    """
    text = read_text(path, kind)
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{path} is no JSON ({error}): restore it") from error
    if isinstance(value, dict) and CHECKSUM in value and value.pop(CHECKSUM) != _digest_of(value):
        raise DamagedFileError(
            f"{path} is not as it was written (its checksum differs): restore it"
        )
    return value


def check_plain_name(name: Any, what: str) -> str:
    """`name` as text. Raises ValueError, which calls it `what`, unless it is the plain name of an
    entry of a folder.
    """
    plain = str(name)
    if plain in ("", ".", "..") or any(mark in plain for mark in "/\\\0"):
        raise ValueError(f"{what} {plain!r:.80} must be the plain name of a folder")
    return plain


def with_checksum(values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` as JSON returns them, and their `checksum` for `read_json`."""
    plain = json.loads(json.dumps(dict(values)))
    return {**plain, CHECKSUM: _digest_of(plain)}


def _digest_of(plain: Mapping[str, Any]) -> str:
    return digest_text(json.dumps(plain, sort_keys=True, separators=(",", ":")))


def digest_text(text: str) -> str:
    """Hexadecimal digest of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def sign_settings(text: str) -> str:
    """A text of YAML with its checksum in a last line, a comment."""
    return f"{text}{_SETTINGS_CHECKSUM}{digest_text(text)}\n"


def read_settings(path: str | os.PathLike[str]) -> str:
    """The text of a YAML file. Raises as `open_stored`; DamagedFileError where the checksum in its
    last line, if any, differs.
    """
    text = read_text(path, SETTINGS)
    body, mark, digest = text.rpartition(_SETTINGS_CHECKSUM)
    if mark and digest.strip() != digest_text(body):
        raise DamagedFileError(
            f"{path} is not as it was written: restore it; if you changed it on purpose, delete "
            f"its last line, {_SETTINGS_CHECKSUM}..."
        )
    return text


# --- manifests ---------------------------------------------------------------------------------


def write_manifest(folder: Path) -> None:
    """Write `manifest.json` of all files in `folder`, in place of one that is there."""
    files = {}
    for path in _list_own(folder):
        with path.open("rb") as file:
            files[path.relative_to(folder).as_posix()] = [path.stat().st_size, _digest(file)]
    text = json.dumps({"format_version": 1, "files": files}, indent=1) + "\n"
    (folder / MANIFEST_FILE).write_text(text, "utf-8")


def read_manifest(folder: Path) -> dict[str, tuple[int, str]]:
    """Size and digest of each file by its path in `folder`.

    Raises DamagedFileError for a manifest that cannot be read, OSError where there is none.
    """
    path = folder / MANIFEST_FILE
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES[INDEX]) if stat.S_ISREG(path.stat().st_mode) else b""
        files = json.loads(text)["files"]
        return {str(name): (int(size), str(digest)) for name, (size, digest) in files.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DamagedFileError(
            f"{path} cannot be read as the list of the folder's checksums ({error!r}): restore it, "
            "or delete it to use the files unchecked"
        ) from error


def find_damage(folder: Path) -> dict[str, str]:
    """The problem of each file in the manifest of `folder` by name, "" for a sound one. Raises as
    `read_manifest`.
    """
    found: dict[str, str] = {}
    for name, (size, digest) in read_manifest(folder).items():
        path = folder / name
        if path.is_file():
            with path.open("rb") as file:
                found[name] = _compare(file, size, digest)
        else:
            found[name] = "is no regular file" if path.exists() else "is missing"
    return found


def refuse_damage(folder: Path, name: str) -> None:
    """Raise DamagedFileError, which calls the folder `name`, where a file differs from its
    manifest, if there is one.
    """
    found = find_damage(folder) if (folder / MANIFEST_FILE).is_file() else {}
    for file, problem in found.items():
        if problem:
            raise DamagedFileError(f"{name}/{file} {problem}: restore it from a copy")


def _find_listed(path: Path) -> tuple[int, str] | None:
    """Size and digest of a file in the nearest manifest, if one lists it."""
    if path.name == MANIFEST_FILE:
        return None
    name = path.name
    for folder in list(path.parents)[:_LEVELS_UP]:
        if (folder / MANIFEST_FILE).is_file():
            return read_manifest(folder).get(name)
        name = f"{folder.name}/{name}"
    return None


def _list_own(folder: Path) -> Iterator[Path]:
    """All files below `folder` by name; of an inner folder with a manifest only that."""
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            own = path / MANIFEST_FILE
            yield from (own,) if own.is_file() else _list_own(path)
        elif path.name != MANIFEST_FILE:
            yield path


def _compare(file: io.BufferedReader, size: int, digest: str) -> str:
    found = os.fstat(file.fileno()).st_size
    if found != size:
        return f"is damaged: it has {found:,} bytes, its manifest says {size:,}"
    return "" if _digest(file) == digest else "is damaged: its digest differs from its manifest"


def _digest(file: io.BufferedReader) -> str:
    return hashlib.file_digest(file, "sha256").hexdigest()  # where CPUs help, twice blake2b's speed
