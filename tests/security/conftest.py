"""A current folder with the module `pwn`."""

import sys

import pytest

from marl_cair import outside
from tests.security.foreign_code import MODULE


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A current folder in which code that runs leaves a file `pwned`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))  # loading a function adds the current folder
    monkeypatch.delitem(sys.modules, "pwn", raising=False)
    monkeypatch.setenv(outside.ALLOWED, "")
    (tmp_path / "pwn.py").write_text(MODULE, "utf-8")
    yield tmp_path
    sys.modules.pop("pwn", None)
