"""Files are written whole or not at all; an output folder belongs to one run."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from marl_cair.files import (
    NotEnoughSpaceError,
    OutputFolderError,
    atomic_path,
    claim_output_folder,
    copy_folder,
    find_folder,
    recover_folder,
    replaced_folder,
    require_free_space,
    write_atomically,
)

CONV = {"net": "conv", "n": {"lr": 1.0}}


def claim(*arguments, **options) -> bool:
    with claim_output_folder(*arguments, **options) as was_here:
        return was_here


def names_in(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def run_killed_script(script: str, *arguments: object) -> None:
    """Run `script`, which must end by killing its own process without any cleaning up."""
    command = [sys.executable, "-c", script, *map(str, arguments)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, check=False)
    assert done.returncode == -signal.SIGKILL


def test_text_and_bytes_are_written_as_given_into_folders_that_are_made(tmp_path):
    for name, data in (("a.txt", "première\nligne\n"), ("b.bin", b"\x00\r\n\xff")):
        write_atomically(tmp_path / "x" / "y" / name, data)
        written = (tmp_path / "x" / "y" / name).read_bytes()
        assert written == (data.encode() if isinstance(data, str) else data)
    assert names_in(tmp_path / "x" / "y") == ["a.txt", "b.bin"]


def test_new_content_replaces_the_old_only_at_the_end(tmp_path):
    target = tmp_path / "curve.png"
    target.write_text("old")
    with atomic_path(target) as unfinished:
        assert (unfinished.parent, unfinished.suffix) == (tmp_path, ".png")
        assert unfinished.name.startswith(".")
        unfinished.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert names_in(tmp_path) == ["curve.png"]


def write_half_then_raise(path: Path, failure: type[BaseException]) -> None:
    with atomic_path(path) as unfinished:
        unfinished.write_text("half")
        raise failure


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, failure):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(failure):
        write_half_then_raise(target, failure)
    assert target.read_text() == "old"
    assert names_in(tmp_path) == ["a.txt"]


def note_syncs(monkeypatch, target):
    """What is synced from now on: its place on the disk, and whether `target` is there by then."""
    synced = []

    def note(descriptor):
        synced.append((os.fstat(descriptor).st_ino, target.exists()))

    monkeypatch.setattr(os, "fsync", note)
    return synced


@pytest.mark.skipif(os.name == "nt", reason="Windows syncs no folders")
def test_a_file_is_synced_before_it_gets_its_name_and_the_folder_after_that(tmp_path, monkeypatch):
    target = tmp_path / "a.txt"
    synced = note_syncs(monkeypatch, target)
    write_atomically(target, "1")
    assert synced == [(target.stat().st_ino, False), (tmp_path.stat().st_ino, True)]


@pytest.mark.skipif(os.name == "nt", reason="Windows syncs no folders")
def test_all_files_of_a_folder_are_synced_before_it_gets_its_name(tmp_path, monkeypatch):
    target = tmp_path / "agent"
    synced = note_syncs(monkeypatch, target)
    with replaced_folder(target) as unfinished:
        (unfinished / "deep").mkdir()
        (unfinished / "deep" / "a.txt").write_text("1")
        (unfinished / "b.txt").write_text("2")
    before = {place for place, has_its_name in synced if not has_its_name}
    assert before >= {(target / name).stat().st_ino for name in ("deep/a.txt", "b.txt")}
    assert (tmp_path.stat().st_ino, True) in synced


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_killed_write_leaves_the_old_file(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    script = (
        "import os, signal, sys; from marl_cair.files import atomic_path\n"
        "with atomic_path(sys.argv[1]) as unfinished:\n"
        "    unfinished.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    run_killed_script(script, target)
    assert target.read_text() == "old"
    assert len(names_in(tmp_path)) == 2  # the unfinished file stays: its process was killed
    write_atomically(target, "new")
    assert target.read_text() == "new"


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    target = tmp_path / "a.txt"
    with atomic_path(target) as first, atomic_path(target) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert target.read_text() == "first"  # the outer block ends last
    assert names_in(tmp_path) == ["a.txt"]


def test_a_block_that_writes_nothing_and_a_folder_as_target_are_errors(tmp_path):
    with (
        pytest.raises(FileNotFoundError, match="nothing was written for .*a.txt"),
        atomic_path(tmp_path / "a.txt"),
    ):
        pass
    with pytest.raises(IsADirectoryError, match="it is a folder; give the name of a file"):
        write_atomically(tmp_path, "1")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no umask")
def test_written_file_has_the_rights_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_text("1")
    write_atomically(tmp_path / "atomic", "1")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_free_space_is_required_of_a_path_that_need_not_exist(tmp_path):
    require_free_space(tmp_path / "x" / "y" / "a.bin", 1)
    assert names_in(tmp_path) == []
    message = r"runs needs 1,073,741,824\.0 MiB, but its disk has .*B free: free some space"
    with pytest.raises(NotEnoughSpaceError, match=message):
        require_free_space(tmp_path / "runs", 2**50)
    with pytest.raises(ValueError, match="^num_bytes is -1, expected 0 or more$"):
        require_free_space(tmp_path, -1)


@pytest.mark.parametrize("resume", [False, True])
def test_new_folder_is_claimed_and_marked_and_resumed_only_when_asked(tmp_path, resume):
    folder = tmp_path / "runs" / "demo"
    assert claim(folder, "training", CONV, resume=resume) is False
    record = json.loads((folder / "run.json").read_text())
    assert record.pop("checksum")
    assert record == {"kind": "training", "settings": CONV}
    assert claim(folder, "training", CONV, resume=True) is True
    with pytest.raises(OutputFolderError, match="already holds this training run: resume it"):
        claim(folder, "training", CONV)


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("league", CONV, "holds a training run, this is a league run: give another folder"),
        ("exploit", CONV, "holds a training run, this is an exploit run: give another folder"),
        ("training", {**CONV, "net": "capsule"}, r"\(net is 'conv' there, 'capsule' here\)"),
        ("training", {**CONV, "n": {"lr": 0.5}}, r"\(n.lr is 1.0 there, 0.5 here\)"),
        ("training", {"net": "conv"}, r"\(n is {'lr': 1.0} there, None here\): give another"),
        ("training", {**CONV, **dict(zip("abcd", "1234", strict=True))}, r"; c is .* and 1 more\)"),
    ],
)
def test_folder_of_another_run_is_refused(tmp_path, resume, kind, settings, message):
    claim(tmp_path, "training", CONV)
    before = (tmp_path / "run.json").read_bytes()
    with pytest.raises(OutputFolderError, match=message):
        claim(tmp_path, kind, settings, resume)
    assert (tmp_path / "run.json").read_bytes() == before


def test_folder_with_files_of_no_run_is_refused_and_left_alone(tmp_path):
    for name in ("a.py", "b.py", "c.py", "d.py"):
        (tmp_path / name).write_text("mine")
    with pytest.raises(OutputFolderError, match=r"of no run \(a.py, b.py, c.py, ...\) and no"):
        claim(tmp_path, "training", CONV, resume=True)
    assert names_in(tmp_path) == ["a.py", "b.py", "c.py", "d.py"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_folder_whose_claim_was_killed_half_way_is_claimed_again(tmp_path):
    script = (
        "import os, signal, sys; from marl_cair import files\n"
        "files._sync_file = lambda path: os.kill(os.getpid(), signal.SIGKILL)\n"
        "with files.claim_output_folder(sys.argv[1], 'training', {'net': 'conv'}): pass"
    )
    run_killed_script(script, tmp_path)
    assert len([name for name in names_in(tmp_path) if name != ".lock"]) == 1
    assert "run.json" not in names_in(tmp_path)
    assert claim(tmp_path, "training", CONV, resume=True) is False
    assert claim(tmp_path, "training", CONV, resume=True) is True


@pytest.fixture
def other_process(tmp_path):
    """A process that has claimed `tmp_path` as training with the settings CONV, and stays."""
    script = (
        "import sys, json; from marl_cair import files\n"
        "with files.claim_output_folder(sys.argv[1], 'training', json.loads(sys.argv[2])):\n"
        "    print('claimed', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", script, str(tmp_path), json.dumps(CONV)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "claimed\n"
        yield process
        process.kill()


@pytest.mark.parametrize("settings", [CONV, {"net": "capsule"}])
def test_folder_in_which_another_process_runs_is_refused(tmp_path, other_process, settings):
    before = names_in(tmp_path)
    with pytest.raises(OutputFolderError, match=r"another process is running in .*: wait until"):
        claim(tmp_path, "training", settings, resume=True)
    assert names_in(tmp_path) == before


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows locks files on any disk")
def test_on_a_file_system_without_locks_a_folder_belongs_to_one_process_all_the_same(tmp_path):
    script = (
        "import errno, fcntl, os, signal, sys, warnings; from marl_cair import files\n"
        "def refuse(*_): raise OSError(errno.ENOSYS, 'no flock')\n"
        "fcntl.flock = refuse; warnings.simplefilter('ignore')\n"
        "def claim(): return files.claim_output_folder(sys.argv[1], 'training', {}, resume=True)\n"
        "with claim():\n"
        "    if os.fork() == 0:\n"
        "        try:\n"
        "            with claim(): os._exit(0)\n"
        "        except files.OutputFolderError: os._exit(3)\n"
        "    if os.waitstatus_to_exitcode(os.wait()[1]) == 3:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)"
    )
    run_killed_script(script, tmp_path)
    run_killed_script(script, tmp_path)  # what the first has left locks no later process out


def test_folder_is_refused_where_filelock_can_keep_no_lock(tmp_path, monkeypatch):
    def acquire(*_: object, **__: object) -> None:  # as before its version 3.24
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr("filelock.FileLock.acquire", acquire)
    with pytest.raises(OutputFolderError, match=r"keeps no locks.*: give a folder on another disk"):
        claim(tmp_path, "training", CONV)


def test_folder_of_a_killed_process_is_free(tmp_path, other_process):
    other_process.kill()
    other_process.wait()
    assert claim(tmp_path, "training", CONV, resume=True) is True


def test_folder_is_free_after_the_block_and_within_the_process(tmp_path):
    with (
        claim_output_folder(tmp_path, "training", CONV) as was_here,
        claim_output_folder(tmp_path, "training", CONV, resume=True) as is_here,
    ):
        assert (was_here, is_here) == (False, True)
    script = (
        "import sys, json; from marl_cair import files\n"
        "with files.claim_output_folder(sys.argv[1], 'training', json.loads(sys.argv[2]), True):\n"
        "    pass"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path), json.dumps(CONV)], check=True)


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"kind": "training"}', "7"])
def test_marker_that_is_none_is_refused(tmp_path, content):
    (tmp_path / "run.json").write_text(content)
    with pytest.raises(OutputFolderError, match="run.json is no run marker.*: give another"):
        claim(tmp_path, "training", CONV, resume=True)
    with pytest.raises(OutputFolderError, match="run.json is a file: give another folder"):
        claim(tmp_path / "run.json", "training", CONV)


def test_folders_without_a_name_are_where_they_are():
    assert [find_folder(path) for path in (".", "/", "")] == [Path(), Path("/"), Path()]


def test_folders_of_ones_own_beside_a_replaced_one_stay(tmp_path):
    for name in ("best.old", "best.unfinished"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine").write_text("kept")
    for text in ("1", "2"):
        with replaced_folder(tmp_path / "best") as fresh:
            (fresh / "a").write_text(text)
    recover_folder(tmp_path / "best")
    assert names_in(tmp_path) == ["best", "best.old", "best.unfinished"]
    assert (tmp_path / "best.old" / "mine").read_text() == "kept"


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_folder_whose_replacement_was_killed_between_the_renames_comes_back(tmp_path):
    """By `recover_folder`, or by the next replacement."""
    script = (
        "import os, signal, sys, pathlib; from marl_cair import files\n"
        "target = pathlib.Path(sys.argv[1]) / 'kept'\n"
        "rename = pathlib.Path.rename\n"
        "def die(path, to):\n"
        "    rename(path, to)\n"
        "    if path.name == 'kept': os.kill(os.getpid(), signal.SIGKILL)\n"
        "for text in ('old', 'new'):\n"
        "    with files.replaced_folder(target) as fresh: (fresh / 'a').write_text(text)\n"
        "    pathlib.Path.rename = die\n"
    )
    run_killed_script(script, tmp_path)
    assert "kept" not in names_in(tmp_path)
    assert (find_folder(tmp_path / "kept") / "a").read_text() == "old"
    recover_folder(tmp_path / "kept")
    assert (tmp_path / "kept" / "a").read_text() == "old"
    run_killed_script(script.replace("for text", "pathlib.Path.rename = die\nfor text"), tmp_path)
    with pytest.raises(RuntimeError), replaced_folder(tmp_path / "kept"):
        raise RuntimeError
    assert find_folder(tmp_path / "kept") == tmp_path / "kept"
    assert (tmp_path / "kept" / "a").read_text() == "old"
    assert names_in(tmp_path) == ["kept"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has other rights")
def test_a_write_protected_folder_is_copied_as_new_files(tmp_path):
    source = tmp_path / "source" / "inner"
    source.mkdir(parents=True)
    (source / "a").write_text("a")
    for path in (source / "a", source, source.parent):
        path.chmod(path.stat().st_mode & ~0o222)
    try:
        copy_folder(source.parent, tmp_path / "copy")
        copies = [tmp_path / "copy" / "inner", tmp_path / "copy" / "inner" / "a"]
        assert all(path.stat().st_mode & 0o200 for path in copies)
    finally:
        for path in (source.parent, source):
            path.chmod(0o755)
