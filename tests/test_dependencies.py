"""Libraries are declared with bounds that are tested."""

import ast
import re
import sys
import tomllib

import pytest

from tests import test_architecture
from tests.test_architecture import PACKAGE, ROOT, SOURCES, list_imports, read_tree


@pytest.mark.slow
def test_every_imported_library_is_declared():
    known = {*sys.stdlib_module_names, "marl_cair", *declared_modules()}

    def find(path):
        for line, name in list_imports(path, ast.walk(read_tree(path))):
            if name.split(".")[0] not in known:
                yield line, name

    assert test_architecture.find_violations(SOURCES, find) == []


def declared_modules() -> set[str]:
    """Import names of what pyproject.toml names as needed, or as needed for an extra of users."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    for_users = ("dashboard", "parquet", "openspiel", "export", "play", "ray", "video", "vnc")
    requirements = project["dependencies"] + [need for name in for_users for need in extras[name]]
    names = {re.match(r"[\w.-]+", requirement).group() for requirement in requirements}
    renamed = {
        "hydra-core": "hydra",
        "open-spiel": "open_spiel",
        "pillow": "PIL",
        "pygame-ce": "pygame",
        "pyyaml": "yaml",
    }
    return {renamed.get(name, name) for name in names}


def test_citation_names_the_version_of_the_package():
    source = (PACKAGE / "__init__.py").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    version = re.findall(r'^__version__ = "(.+)"$', source, re.MULTILINE)
    assert len(version) == 1, "pyproject.toml takes the version from __version__ in __init__.py"
    assert re.findall(r"^version: (.+)$", citation, re.MULTILINE) == version


def test_the_oldest_versions_that_are_tested_are_those_that_are_allowed():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    bounds = [re.match(r"([\w-]+)>=([\d.]+)", line) for line in project["dependencies"]]
    assert all(bounds)
    lines = (ROOT / "constraints-oldest.txt").read_text("utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert pins == [f"{bound[1]}=={bound[2]}" for bound in bounds]
