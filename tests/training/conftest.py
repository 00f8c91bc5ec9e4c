"""Fixtures of the training tests: the test game, and a run with a generator that tests copy."""

import shutil

import pytest

from tests.games import last_standing
from tests.training.runs import tiny, train


@pytest.fixture
def test_game(monkeypatch):
    last_standing.register(monkeypatch)


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A finished run of 640 steps; read only."""
    return train(tiny(tmp_path_factory.mktemp("finished") / "first", 640)).folder


@pytest.fixture
def finished_copy(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "first")
