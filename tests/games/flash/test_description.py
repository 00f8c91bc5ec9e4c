"""Descriptions of SWF files: what they say, and what is refused."""

from dataclasses import replace

import pytest

from marl_cair.games.flash.description import (
    DescriptionError,
    Ending,
    Region,
    check_digest,
    find_description,
    find_value,
)

TEXT = """
title = "Balance"
swf = "game.swf"
sha256 = "ab"
size = [480, 360]
fps = 30
start = ["enter", 30, "240, 200"]
keys = [["left", "right"]]
callback = "getState"
score = "points.0"
done = "done"
numbers = [["ball.x", -100, 100]]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "game.swf").write_bytes(b"CWS")
    (tmp_path / "over.png").write_bytes(b"")
    return tmp_path


def read(folder, *changes):
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "game.toml"
    path.write_text(text)
    return find_description(str(path))


def test_a_description_says_all(folder):
    found = read(folder)
    assert (found.size, found.fps, found.keys) == ((480, 360), 30, (("left", "right"),))
    assert found.start == ("enter", 30, (240, 200))
    assert found.numbers == (("ball.x", -100.0, 100.0, ""),)
    assert not found.reads_pixels
    assert found.renderer == "canvas"
    assert read(folder, ("fps = 30", 'fps = 30\nrenderer = "webgl"')).renderer == "webgl"


def test_score_and_end_can_be_read_from_the_picture(folder):
    found = read(
        folder,
        ('score = "points.0"', "score = { region = [0, 0, 100, 8] }"),
        ('done = "done"', 'done = { region = [9, 9, 20, 20], picture = "over.png", within = 0.1 }'),
    )
    assert found.score == Region(0, 0, 100, 8)
    assert found.done == Ending(Region(9, 9, 20, 20), folder / "over.png", 0.1)
    assert found.reads_pixels


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("fps = 30", "fps = 300", ["fps", "300", "1..120"]),
        ("fps = 30", "fps = true", ["fps", "True"]),
        ("fps = 30", 'fps = 30\nrenderer = "wgpu"', ["renderer", "'wgpu'", "canvas or webgl"]),
        ('"left"', '"lefft"', ["'lefft'", "'left'"]),
        ("title", "titel", ["'titel'", "'title'"]),
        ("size = [480, 360]", "", ["size"]),
        ('swf = "game.swf"', 'swf = "other.swf"', ["other.swf"]),
        ('keys = [["left", "right"]]', "keys = []", ["keys", "1..8"]),
        ('[["left", "right"]]', '[["left"], ["a", "b"]]', ["keys", "as many"]),
        ('[["left", "right"]]', "[[]]", ["mouse_grid"]),
        ("-100, 100", "100, -100", ["numbers", "low"]),
        ("-100, 100", '-100, 100, "a", "b"', ["numbers", "mirrored"]),
        ('"240, 200"', "-1", ["start", "-1"]),
        ('callback = "getState"', "", ["callback"]),
        ('score = "points.0"', "score = { region = [0, 0, 900, 9] }", ["score.region", "900"]),
        ('done = "done"', 'done = { region = [0, 0, 9, 9], picture = "x.png" }', ["x.png"]),
        ('"done"', '{ region = [0, 0, 9, 9], picture = "over.png", within = 2 }', ["within", "2"]),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(folder, old, new, named):
    with pytest.raises(DescriptionError) as error:
        read(folder, (old, new))
    assert all(part in str(error.value) for part in ["game.toml", *named])


def test_unknown_games_and_files_are_refused():
    with pytest.raises(DescriptionError, match="multitask"):
        find_description("multitsk")
    with pytest.raises(DescriptionError, match=r"none\.toml"):
        find_description("none.toml")


def test_another_swf_than_the_described_one_is_refused(folder):
    found = read(folder)
    with pytest.raises(DescriptionError, match="SHA-256"):
        check_digest(found)
    digest = "20ee0f4c10e8a2a2db4f2b0b4b5d7d3b"
    assert digest not in str(found)
    check_digest(replace(find_description("multitask")))


def test_values_are_found_by_their_paths():
    state = {"balls": [{"x": 3.0}], "tick": 7}
    assert find_value(state, "tick") == 7
    assert find_value(state, "balls.0.x") == 3.0
    assert find_value(state, "balls.1.x", missing=lambda: -1.0) == -1.0
    with pytest.raises(DescriptionError, match="'ball'"):
        find_value(state, "ball")
