"""What the pages promise: links lead somewhere, and commands of training are understood."""

import re
import shlex
from pathlib import Path

import pytest

from marl_cair.cli.compose import compose_config

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("examples/*.md"),
        *ROOT.glob("agents/*.md"),
        *ROOT.glob("marl_cair/games/*/README.md"),
    ]
)
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
]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    for link in LINK.findall(WITHOUT_CODE.sub("", page.read_text("utf-8"))):
        if "://" in link:
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors_of(target), link


@pytest.mark.parametrize("line", TRAIN_COMMANDS)
def test_commands_of_training_are_understood(line):
    words = shlex.split(line, comments=True)[2:]
    if words[0].startswith("resume="):  # of a run that is not here
        words = words[1:]
    compose_config(words)
