"""The script that ships is what its source builds, and its types are right."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from marl_cair.viewer.page import SCRIPT_FILE

SOURCE = Path(__file__).resolve().parents[2] / "viewer"


def test_source_builds_the_same_bytes(tmp_path):
    if shutil.which("npm") is None and "MARL_CAIR_NEEDS_BROWSER" not in os.environ:
        pytest.skip("npm is missing: apt install npm")
    source = shutil.copytree(
        SOURCE, tmp_path / "viewer", ignore=shutil.ignore_patterns("node_modules")
    )
    built = tmp_path / "viewer.js"
    for words in (
        ["ci", "--no-audit", "--no-fund"],
        ["run", "check"],
        ["run", "bundle", "--", f"--outfile={built}"],
    ):
        subprocess.run(["npm", *words], cwd=source, check=True)
    assert built.read_bytes() == SCRIPT_FILE.read_bytes()
