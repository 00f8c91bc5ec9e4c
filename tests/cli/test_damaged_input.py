"""Damaged settings and maps end a command in one line that names the file or the value."""

import json

import pytest

from tests.fuzz.test_files import make_tiled
from tests.refusals import assert_refused

DEEP = 100_000  # levels: Python's own parsers recurse


@pytest.mark.parametrize(
    ("text", "fact"),
    [
        (json.dumps(make_tiled()).replace('"firstgid": 1', '"firstgid": 1e400'), "infinity"),
        ("[" * DEEP + "]" * DEEP, "recursion"),
        ('{"layers": ' * DEEP + "1" + "}" * DEEP, "recursion"),
    ],
    ids=["infinite", "deep-array", "deep-object"],
)
def test_a_map(tmp_path, capsys, text, fact):
    path = tmp_path / "map.json"
    path.write_text(text)
    words = ["match", "random", "rusher", "--game", "deep_rts", "--set", f"map={path}"]
    assert str(path) in assert_refused(capsys, fact, *words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "fact"),
    [
        ("1: 2", "option 1"),
        ("game:\n  options: {3: 4}", "option 3"),
        ("opponent:\n  mixture: {3: 4}", "opponent 3"),
        ("[" * 60_000, "config.yaml"),
    ],
)
def test_settings_of_a_run(tmp_path, capsys, settings, fact):
    (tmp_path / "run.json").write_text('{"kind": "train"}')
    (tmp_path / "config.yaml").write_text(settings)
    assert_refused(capsys, fact, "train", f"resume={tmp_path}")


def test_a_run_whose_settings_are_deep_json(tmp_path, capsys):
    (tmp_path / "run.json").write_text("[" * DEEP)
    (tmp_path / "config.yaml").write_text("seed: 0\n")
    assert_refused(capsys, "run.json", "train", f"resume={tmp_path}")
