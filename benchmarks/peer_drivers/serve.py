"""Answers benchmarks/peers.py from inside a peer's own interpreter, Python 3.9 or newer."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable


def serve(play: Callable[[], int], description: str) -> None:
    """For each line on standard input, which is a number of seconds, play that long.

    Each is answered by one line of JSON: agent-steps per second and what was played. `play` does a
    round of work and returns its agent-steps: players times ticks of the game. The peer stays
    started in between, so that its compilation and its first maps are not in the time.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--processor-time", action="store_true")
    clock = time.process_time if parser.parse_args().processor_time else time.perf_counter
    play()
    for line in sys.stdin:
        seconds, steps, start = float(line), 0, clock()
        while clock() - start < seconds:
            steps += play()
        rate = steps / max(clock() - start, 1e-9)
        answer = {"agent_steps_per_second": rate, "description": description}
        print(json.dumps(answer), flush=True)
