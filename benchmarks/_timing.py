"""How long a piece of work takes."""

import time
from collections.abc import Callable


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


class Clock:
    """Processor seconds between `start` and `stop`, and whether `every` seconds are over."""

    def __init__(self, every: float) -> None:
        self.every, self.seconds, self._looked, self._begun = every, 0.0, 0, 0.0

    def start(self) -> None:
        self._begun = time.process_time()

    def stop(self) -> None:
        self.seconds += time.process_time() - self._begun

    def is_due(self) -> bool:
        """Whether another `every` seconds are over since this last said so."""
        looks = int(self.seconds // self.every)
        is_due, self._looked = looks > self._looked, looks
        return is_due
