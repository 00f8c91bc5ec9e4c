"""Pages of the documentation: links and pictures exist, and commands of training compose."""

import re
import shlex
from pathlib import Path

import pytest

from docs.architecture_picture import LAYERS, PICTURE, describe, read_rooms
from marl_cair.cli.compose import compose_config

ROOT = Path(__file__).parents[1]
PATTERNS = "*.md", "docs/**/*.md", "examples/*.md", "agents/*.md", "marl_cair/games/*/README.md"
PAGES = sorted(page for pattern in PATTERNS for page in ROOT.glob(pattern))
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
BLOCK = re.compile(r"```sh\n(.*?)```", re.DOTALL)
WITHOUT_CODE = re.compile(r"```.*?```", re.DOTALL)


def name(path):
    return path.relative_to(ROOT).as_posix()


def anchors_of(page):
    """Headings as GitHub names them."""
    headings = HEADING.findall(WITHOUT_CODE.sub("", page.read_text("utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


TRAIN_COMMANDS = [
    pytest.param(line, id=f"{name(page)}: {line[16:70]}")
    for page in PAGES
    for block in BLOCK.findall(page.read_text("utf-8"))
    for line in block.splitlines()
    if line.startswith("marl-cair train ") and "--help" not in line
    if "tug_of_war" not in line  # its package is not installed: test_extending.py
]


def test_links_lead_somewhere():
    broken = []
    for page in PAGES:
        for link in LINK.findall(WITHOUT_CODE.sub("", page.read_text("utf-8"))):
            file, _, anchor = link.partition("#")
            target = (page.parent / file).resolve() if file else page
            is_found = target.exists() and (not anchor or anchor in anchors_of(target))
            if "://" not in link and not is_found:
                broken.append(f"{name(page)}: {link}")
    assert broken == []


def test_scripts_that_pages_name_exist():
    missing = [
        f"{name(page)}: {script}"
        for page in PAGES
        if page.name != "CHANGELOG.md"  # of any version
        for script in re.findall(r"python -m (benchmarks\.\w+)", page.read_text("utf-8"))
        if not (ROOT / (script.replace(".", "/") + ".py")).is_file()
    ]
    assert missing == []


@pytest.mark.parametrize("line", TRAIN_COMMANDS)
def test_commands_of_training_are_understood(line):
    words = shlex.split(line, comments=True)[2:]
    if words[0].startswith("resume="):  # of a run that is not here
        words = words[1:]
    compose_config(words)


# --- the site ----------------------------------------------------------------------------------


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text("utf-8").partition("nav:\n")[2]
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in ROOT.glob("docs/**/*.md")}
    pages -= {page for page in pages if page.startswith("extending/")}
    assert pages <= set(re.findall(r"[\w/]+\.md", navigation))


@pytest.fixture(scope="module")
def rooms():
    return read_rooms()


def test_the_picture_shows_the_imports_of_today(rooms):
    """`python docs/architecture_picture.py` draws it again."""
    assert describe(rooms) in PICTURE.read_text("utf-8")


def test_imports_point_down(rooms):
    layer_of = {room: layer for layer, names in enumerate(LAYERS) for room in names}
    for name, room in rooms.items():
        assert room.num_files > 0, name
        assert all(layer_of[target] > layer_of[name] for target in room.imports), name


def test_the_table_says_where_to_change_what_the_issue_asks():
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    for question in ("a unit's price", "the loss", "how a rating is fitted", "what a report says"):
        assert f"| {question}" in page
