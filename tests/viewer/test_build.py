"""The scripts that ship are what their source builds, and their types are right."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "viewer"
SCRIPTS = "viewer/viewer.js", "browser/page/play.js"


def test_source_builds_the_same_bytes(tmp_path):
    if shutil.which("npm") is None and "MARL_CAIR_NEEDS_BROWSER" not in os.environ:
        pytest.skip("npm is missing: apt install npm")
    source = shutil.copytree(
        SOURCE, tmp_path / "viewer", ignore=shutil.ignore_patterns("node_modules")
    )
    for words in (
        ["ci", "--no-audit", "--no-fund"],
        ["run", "check"],
        ["run", "bundle", "--", f"--outdir={tmp_path}"],
    ):
        subprocess.run(["npm", *words], cwd=source, check=True)
    for script in SCRIPTS:
        assert (tmp_path / script).read_bytes() == (ROOT / "marl_cair" / script).read_bytes()
