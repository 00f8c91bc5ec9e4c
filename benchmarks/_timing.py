"""How long a piece of work takes."""

import math
import time
from collections.abc import Callable, Hashable, Mapping
from typing import TypeVar

Name = TypeVar("Name", bound=Hashable)


def best_seconds(
    work: Callable[[], object], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Seconds, by `clock`, of the fastest of some runs."""
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def best_in_turns(
    works: Mapping[Name, Callable[[], object]], repeats: int, warm_up: int = 1
) -> dict[Name, float]:
    """Processor seconds of the fastest of some runs of each, which take turns; the first `warm_up`
    runs do not count.
    """
    best = dict.fromkeys(works, math.inf)
    for number in range(warm_up + repeats):
        for name, work in works.items():
            seconds = best_seconds(work, 1, time.process_time)
            if number >= warm_up:
                best[name] = min(best[name], seconds)
    return best
