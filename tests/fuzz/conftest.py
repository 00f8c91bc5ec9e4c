"""Time and seeds of fuzzing: `make fuzz FUZZ_SECONDS=600 FUZZ_SEED=7`.

FUZZ_SECONDS (60) is shared by all fuzz tests that are run; each makes at least one round. FUZZ_SEED
(0) gives the same rounds again: `make fuzz` draws another each time and prints it.
"""

import os
import sys
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest

SECONDS = float(os.environ.get("FUZZ_SECONDS") or 60)
SEED = int(os.environ.get("FUZZ_SEED") or 0)


def pytest_report_header():
    return f"fuzzing for {SECONDS:g} seconds with FUZZ_SEED={SEED}"


@pytest.fixture
def fuzz_rounds(request) -> Iterator[np.random.Generator]:
    """Random generators, one for each round, until this test's share of the time is over."""
    here = Path(__file__).parent
    num_tests = sum(item.path.is_relative_to(here) for item in request.session.items)
    return draw_rounds(SECONDS / num_tests)


def draw_rounds(seconds: float) -> Iterator[np.random.Generator]:
    """The generator of round n is seeded by (SEED, n), which a failing test shows."""
    end = time.monotonic() + seconds
    for number in count():
        sys.stdout.write(f"FUZZ_SEED={SEED} round {number}\n")
        yield np.random.default_rng((SEED, number))
        if time.monotonic() >= end:
            return
