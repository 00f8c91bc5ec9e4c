"""What the site is built from: pages in the navigation, the picture of the imports."""

import re
from pathlib import Path

from docs.architecture_picture import LAYERS, PICTURE, describe, read_rooms

ROOT = Path(__file__).parents[1]


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text("utf-8").partition("nav:\n")[2]
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in ROOT.glob("docs/**/*.md")}
    pages -= {page for page in pages if page.startswith("extending/")}
    assert pages <= set(re.findall(r"[\w/]+\.md", navigation))


def test_the_picture_shows_the_imports_of_today():
    """`python docs/architecture_picture.py` draws it again."""
    assert describe(read_rooms()) in PICTURE.read_text("utf-8")


def test_imports_point_down():
    layer_of = {room: layer for layer, rooms in enumerate(LAYERS) for room in rooms}
    for name, room in read_rooms().items():
        assert room.num_files > 0, name
        assert all(layer_of[target] > layer_of[name] for target in room.imports), name


def test_the_table_says_where_to_change_what_the_issue_asks():
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    for question in ("a unit's price", "the loss", "how a rating is fitted", "what a report says"):
        assert f"| {question}" in page


def test_the_site_loads_nothing_from_the_network():
    settings = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert "font: false" in settings
    assert not re.search(r"privacy|social|googleapis|extra_(javascript|css)", settings)
