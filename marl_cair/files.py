"""Write files and folders atomically, and claim output folders for one run."""

import errno
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from marl_cair.stored import read_json, refuse_damage, with_checksum, write_manifest

MAX_SHOWN = 80  # characters of a value in an error
RUN_MARKER = "run.json"
_LOCK_FILE = ".lock"
_LEFTOVER_MARK = ".unfinished"
# Of the folders beside one that is replaced.
_FRESH_SUFFIX, _OLD_SUFFIX = ".marl_cair" + _LEFTOVER_MARK, ".marl_cair.old"


class NotEnoughSpaceError(OSError):
    """The disk holds less free space than a write needs."""


class OutputFolderError(ValueError):
    """An output folder that belongs to another run, or holds files of no run."""


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path beside `path` to write to; on success it is synced and renamed to `path`.

    A reader, or a run after a crash, sees the old file or the new one, never a part. The yielded
    path has the suffix of `path`, which savers choose a format by. Missing folders are made.
    Raises IsADirectoryError for a folder, FileNotFoundError where the block wrote nothing, and
    NotEnoughSpaceError for a full disk; on any exception the unfinished file is removed and `path`
    stays as it was.
    """
    target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(f"cannot write {target}: it is a folder; give the name of a file")
    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_name(
        f".{target.stem}.{secrets.token_hex(6)}{_LEFTOVER_MARK}{target.suffix}"
    )
    try:
        with _full_disk_explained(target):
            yield unfinished
        if not unfinished.is_file():
            raise FileNotFoundError(
                f"nothing was written for {target}: write to the path that atomic_path yields"
            )
        _sync_file(unfinished)
        unfinished.replace(target)
        _sync_folder(target.parent)
    finally:
        unfinished.unlink(missing_ok=True)


def write_atomically(path: str | os.PathLike[str], data: bytes | str) -> None:
    """Write `data` (text as UTF-8, line ends as given) to `path`, whole or not at all."""
    content = data.encode("utf-8") if isinstance(data, str) else data
    with atomic_path(path) as unfinished:
        unfinished.write_bytes(content)


def write_json(path: str | os.PathLike[str], values: Mapping[str, Any]) -> None:
    """Write plain values by name, and the checksum that `stored.read_json` compares."""
    write_atomically(path, json.dumps(with_checksum(values), indent=1) + "\n")


@contextmanager
def _full_disk_explained(target: Path) -> Iterator[None]:
    """Turn the errors of a full disk into a NotEnoughSpaceError that names `target`."""
    try:
        yield
    except NotEnoughSpaceError:
        raise
    except OSError as error:
        # NumPy reports a short write as an OSError without a number; what shutil could not copy
        # has none either.
        is_full = error.errno in (None, errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        if not is_full or isinstance(error, shutil.Error):
            raise
        raise NotEnoughSpaceError(
            f"{target} could not be written, the disk is full ({error}): free some space or choose "
            "a folder on another disk; the old content is kept"
        ) from error


def require_free_space(path: str | os.PathLike[str], num_bytes: int) -> None:
    """Raise NotEnoughSpaceError unless the disk that `path` lies on has `num_bytes` free.

    `path` may be a file or folder that does not exist yet.
    """
    if num_bytes < 0:
        raise ValueError(f"num_bytes is {num_bytes}, expected 0 or more")
    place = Path(path).absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    if free < num_bytes:
        raise NotEnoughSpaceError(
            f"{path} needs {num_bytes / 2**20:,.1f} MiB, but its disk has {free / 2**20:,.1f} MiB "
            "free: free some space or choose a folder on another disk"
        )


@contextmanager
def claim_output_folder(
    folder: str | os.PathLike[str],
    kind: str,
    settings: Mapping[str, Any],
    resume: bool = False,
    how_to_resume: str = "resume it",
    proof: str = RUN_MARKER,
) -> Iterator[bool]:
    """Make `folder` the output folder of one run, and keep other processes out of it for the block;
    yield True where that run was here before.

    kind: of the run ("training", "league", ...); settings: plain values by name that distinguish
    runs of a kind. A marker file `run.json` records both. New and empty folders are claimed, those
    of a run that died before its marker was written, and those of the same run that died before it
    had written `proof`, a file that resuming needs. The operating system's lock ends with its
    process; within a process a folder may be claimed more than once.
    Raises OutputFolderError for a folder of another run or of other settings, with files but no
    marker, in use by another process, and for the same run where `resume` is False.
    """
    place = Path(folder)
    if place.exists() and not place.is_dir():
        raise OutputFolderError(f"output folder {place} is a file: give another folder")
    place.mkdir(parents=True, exist_ok=True)
    marker = place / RUN_MARKER
    if not marker.exists():
        refuse_foreign_files(place, RUN_MARKER, "run")
    with locked_folder(place):
        yield _mark(place, kind, settings, resume or not (place / proof).is_file(), how_to_resume)


@contextmanager
def locked_folder(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Keep other processes out of an existing folder. Raises OutputFolderError if one uses it."""
    place = Path(folder)
    # One object for all claims of a folder in this process, which would else lock itself out.
    lock = FileLock(place.resolve() / _LOCK_FILE, thread_local=False, is_singleton=True)
    try:
        lock.acquire(timeout=0)
    except NotImplementedError as error:  # filelock before 3.24; later ones fall back to a marker
        raise OutputFolderError(
            f"the file system of {place} keeps no locks, so two processes could write into one "
            "folder: give a folder on another disk"
        ) from error
    except Timeout as error:
        raise OutputFolderError(
            f"another process is running in the output folder {place}: wait until it has ended "
            "(after Ctrl-C it saves first), or give another folder"
        ) from error
    try:
        yield
    finally:
        lock.release()


def _mark(
    place: Path, kind: str, settings: Mapping[str, Any], resume: bool, how_to_resume: str
) -> bool:
    marker = place / RUN_MARKER
    record = {"kind": kind, "settings": settings}
    if not marker.exists():
        write_json(marker, record)
        return False
    held_kind, held = read_run_marker(marker)
    if held_kind != kind:
        raise OutputFolderError(
            f"output folder {place} holds {_name_run(held_kind)}, this is {_name_run(kind)}: give "
            "another folder, or delete this one"
        )
    # As JSON gives them back: tuples as lists.
    if differences := _list_differences(held, json.loads(json.dumps(settings))):
        more = f" and {len(differences) - 3} more" if len(differences) > 3 else ""
        raise OutputFolderError(
            f"output folder {place} holds {_name_run(kind)} with other settings "
            f"({'; '.join(differences[:3])}{more}): give another folder, or delete this one"
        )
    if not resume:
        raise OutputFolderError(
            f"output folder {place} already holds this {kind} run: {how_to_resume}, give "
            "another folder, or delete this one"
        )
    return True


def _name_run(kind: str) -> str:
    return f"{'an' if kind[:1] in 'aeiou' else 'a'} {kind} run"


def _list_differences(held: Any, wanted: Any, name: str = "") -> list[str]:
    """Descriptions of the differences between two nested settings."""
    if isinstance(held, dict) and isinstance(wanted, dict):
        differences = []
        for key in dict.fromkeys([*held, *wanted]):
            inner = f"{name}.{key}" if name else key
            differences += _list_differences(held.get(key), wanted.get(key), inner)
        return differences
    shown = f"{name} is {shorten_value(held)} there, {shorten_value(wanted)} here"
    return [] if held == wanted else [shown]


def shorten_value(value: Any) -> str:
    """The beginning of a value's `repr`, for errors."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."


def refuse_foreign_files(place: Path, marker: str, kind: str) -> None:
    """Raise OutputFolderError for a folder that has files, but not `marker`, as those of a kind."""
    names = sorted(entry.name for entry in place.iterdir() if not is_leftover(entry.name))
    if names and marker not in names:  # one that is being written just now: the lock decides
        shown = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
        raise OutputFolderError(
            f"output folder {place} holds files of no {kind} ({shown}) and no {marker}: give a "
            "new or empty folder"
        )


def read_run_marker(marker: Path) -> tuple[str, dict[str, Any]]:
    """Kind and settings that `claim_output_folder` wrote. Raises OutputFolderError."""
    try:
        record = read_json(marker)
        return str(record["kind"]), dict(record["settings"])
    except (ValueError, KeyError, TypeError) as error:
        raise OutputFolderError(
            f"{marker} is no run marker, an object with 'kind' and 'settings' ({error!r}): give "
            "another folder, or delete this one"
        ) from error


def read_run_kind(folder: str | os.PathLike[str]) -> str:
    """The `kind` of `claim_output_folder` of the run in `folder`; "" where there is none."""
    marker = Path(folder) / RUN_MARKER
    try:
        return read_run_marker(marker)[0] if marker.is_file() else ""
    except OutputFolderError:
        return ""


def is_leftover(name: str) -> bool:
    """Whether `name` is a lock or an unfinished file of a killed process."""
    return name == _LOCK_FILE or (name.startswith(".") and _LEFTOVER_MARK in name)


def _sync_file(path: Path) -> None:
    # Opened for writing: Windows syncs no file that is open for reading only.
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Make a rename in `folder` outlast a power cut; not possible on Windows."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def replaced_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a folder to fill beside `path`, which then replaces `path`, with a `manifest.json` of
    the checksums of its files (`stored`).

    On an exception the new folder is removed and `path` stays as it was. A process that is killed
    between the two renames leaves the old folder under another name; `recover_folder` restores it.
    """
    target = Path(path).absolute()
    fresh, old = _beside(target, _FRESH_SUFFIX), _beside(target, _OLD_SUFFIX)
    recover_folder(target)
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    try:
        with _full_disk_explained(target):
            yield fresh
            write_manifest(fresh)
        for file in fresh.rglob("*"):
            if file.is_file():
                _sync_file(file)
        if target.exists():
            target.rename(old)
        fresh.rename(target)
        _sync_folder(target.parent)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _beside(target: Path, suffix: str) -> Path:
    return target.with_name(f".{target.name}{suffix}")


def find_folder(path: str | os.PathLike[str]) -> Path:
    """The folder with the content of `path`: beside it, if a `replaced_folder` was killed."""
    target = Path(path)
    if not target.name:  # "." and "/" are there
        return target
    old = _beside(target, _OLD_SUFFIX)
    return old if old.is_dir() and not target.exists() else target


def copy_folder(source: str | os.PathLike[str], target: str | os.PathLike[str]) -> None:
    """Make `target` a copy of the folder `source`, whole or not at all. Raises ValueError for a
    symbolic link in it, whose target may be any file of this machine.
    """
    found = find_folder(source)
    for entry in found.rglob("*"):
        if entry.is_symlink():
            raise ValueError(f"{entry} is a symbolic link: replace it by the file it points to")
    with replaced_folder(target) as fresh:
        copy_content(found, fresh)
        refuse_damage(fresh, str(source))


def copy_content(source: Path, target: Path) -> None:
    """Copy all files of a folder, but not who may read and write them."""
    for file in source.rglob("*"):
        if file.is_file():
            place = target / file.relative_to(source)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)


def recover_folder(path: str | os.PathLike[str]) -> None:
    """Clean up after a killed `replaced_folder`: restores the old folder if there is no new one.
    For the folder's writer; readers beside a living writer use `find_folder`.
    """
    target = Path(path).absolute()
    old = _beside(target, _OLD_SUFFIX)
    if old.is_dir() and not target.exists():
        old.rename(target)
    shutil.rmtree(old, ignore_errors=True)
