"""Terms of the field, and spelling, in the code and the documentation."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# Laboratory notes (docs/experiments) are kept as they were written.
CHECKED = (
    "*.md",
    "docs/*.md",
    "docs/*.py",
    "docs/extending/**/*.md",
    "docs/extending/**/*.py",
    "examples/*",
    "agents/*.md",
    "marl_cair/games/*/README.md",
    "marl_cair/**/*.py",
    "tests/**/*.py",
    "benchmarks/**/*.py",
    "scripts/*.py",
)
FILES = sorted({path for pattern in CHECKED for path in ROOT.glob(pattern) if path.is_file()})
FILES.remove(Path(__file__).resolve())  # it holds the terms
# What not to write -> what to write.
TERMS = {
    r"nobody": "no player, none, unknown",
    r"somebody": "a player, an agent",
    r"anew": "again",
    r"the mend|to mend|mends": "the fix, how to repair it",
    r"go(es)? on with|went on with": "resume",
    r"goes first": "overrides",
    r"(who|whom) is met|whom it meets|whom a learner": "opponent",
    r"what beats it": "best response",
    r"what it scores": "its score, its win rate",
    r"what plays": "policy, agent",
    r"rows that are (drawn|made)": "sampled, generated transitions",
    r"what has not been trained on": "held-out",
    r"how-manieth": "index, from 1",
    r"foreseen": "predicted",
    r"that which": "what",
    r"so that it be": "so that it is",
    r"tell_\w+": "a verb such as format_, describe_, find_",
    r"told|tells": "print, report, describe, show",
}


def name(path):
    return path.relative_to(ROOT).as_posix()


def test_terms_of_the_field_are_used():
    terms = re.compile(rf"(?i)\b(?:{'|'.join(TERMS)})\b")
    found = [
        f"{name(path)}:{number}: {match[0]!r}, write {right!r}"
        for path in FILES
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        for match in terms.finditer(line)
        for wrong, right in TERMS.items()
        if re.fullmatch(wrong, match[0], re.IGNORECASE)
    ]
    assert found == []


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("codespell_lib") is None, reason="extra dev")
def test_spelling():
    """Settings and allowed words are in pyproject.toml; tests misspell on purpose."""
    documents = [name(path) for path in FILES if not name(path).startswith("tests/")]
    done = subprocess.run(
        [sys.executable, "-m", "codespell_lib", *documents, "docs", "marl_cair"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
