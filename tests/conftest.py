"""Settings of every test run: no window, no threads of its own, the same examples every time, and
no waiting for the disk.
"""

import os
from pathlib import Path

# Read when the libraries are first imported, so set before any test module is.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pytest
from hypothesis import HealthCheck, settings

# A first example may compile for seconds, so neither a deadline nor "too slow" says anything.
settings.register_profile(
    "repeatable",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")


@pytest.fixture(scope="session", autouse=True)
def _no_waiting_for_the_disk():
    """What is written only has to outlast a power cut where users run it; a league of seconds syncs
    thousands of times, for a minute. That files are synced, and when, is a test of test_files.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


def pytest_collection_modifyitems(items):
    """Modules that train, a minute each, come before the many quick ones of the games: else one of
    them comes last, and all workers but one have nothing to do (with --no-loadscope-reorder).
    """
    games = Path(__file__).parent / "games"

    def find_turn(item):
        return 0 if not item.path.is_relative_to(games) else 1 + (item.path.parent != games)

    items.sort(key=find_turn)
