"""The package stays small: lines of each part and files of each folder, against a table."""

from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "marl_cair"
SOURCES = sorted(PACKAGE.rglob("*.py"))
MAX_FILES_IN_A_FOLDER = 16
# Lines of Python in each part. A change that needs more raises its number here, knowingly.
MAX_LINES = {
    "games": 21_660,
    "policies": 2_465,
    "replay": 2_455,
    "generative": 3_507,
    "self_play": 1_035,
    "league": 8_091,
    "training": 8_037,
    "experiments": 1_864,
    "viewer": 725,
    "window": 2_680,
    "browser": 950,
    "dashboard": 320,
    "conf": 10,
    "cli": 4_481,
    "": 2_003,  # the modules that every part may import
}


def test_a_folder_holds_few_files():
    counts = Counter(path.parent for path in SOURCES)
    assert {folder: n for folder, n in counts.items() if n > MAX_FILES_IN_A_FOLDER} == {}


def test_parts_do_not_grow_unnoticed():
    lines = dict.fromkeys(MAX_LINES, 0)
    for path in SOURCES:
        part = path.relative_to(PACKAGE).parts[0]
        lines["" if part.endswith(".py") else part] += path.read_text("utf-8").count("\n")
    assert {part: (n, MAX_LINES[part]) for part, n in lines.items() if n > MAX_LINES[part]} == {}
