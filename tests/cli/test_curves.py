"""`marl-cair curves`: one picture of runs, and what it refuses."""

import pytest

from marl_cair.cli import main
from marl_cair.cli.curves import name_runs
from tests.refusals import assert_refused


@pytest.fixture
def runs(tmp_path):
    """Three runs as far as curves know them, two of one name."""
    folders = [tmp_path / "conv", tmp_path / "a" / "capsule", tmp_path / "b" / "capsule"]
    for folder in folders:
        folder.mkdir(parents=True)
        log = "frames,win_rate/random,loss/all\n1024,0.25,\n2048,0.5,0.1\n"
        (folder / "log.csv").write_text(log, "utf-8")
    return folders


def test_runs_are_drawn_as_one_picture(runs, tmp_path, capsys):
    out = tmp_path / "pictures" / "curves.png"
    assert main(["curves", *map(str, runs), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out == f"{out}: conv, a/capsule, b/capsule\n"


def test_runs_go_by_their_folders_names(runs, monkeypatch):
    assert list(name_runs([str(runs[0]), str(runs[1])])) == ["conv", "capsule"]
    monkeypatch.chdir(runs[0])
    assert list(name_runs(["."])) == ["conv"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{run}", "{run}"], "is given twice: name each run once"),
        (["{run}", "{nowhere}"], "has no log.csv with rows: give the folder of a run"),
        (["{run}", "--out", "{nowhere}.pdf"], "it must end in .png"),
        (["{run}", "--out", "{run}"], "is a folder: give the name of a PNG file"),
    ],
)
def test_what_cannot_be_drawn_is_refused(runs, tmp_path, words, message, capsys):
    places = {"run": runs[0], "nowhere": tmp_path / "nowhere"}
    assert_refused(capsys, message, "curves", *(word.format(**places) for word in words))
    assert not list(tmp_path.glob("*.p*"))
