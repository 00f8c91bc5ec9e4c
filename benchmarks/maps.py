"""Measure how long maps of Deep RTS take to make, against reading the same map from its text.

python -m benchmarks.maps [--repeats 5]
Times are the best of the repeats; both sides check the map.
"""

import argparse
import tempfile
from functools import partial
from pathlib import Path

from benchmarks._timing import best_seconds
from marl_cair.games.deep_rts.maps.generator import generate_map
from marl_cair.games.deep_rts.maps.maps import read_map, write_text_map

SIDES = (15, 31, 64, 128)
NUM_PLAYERS = 4


def main() -> None:
    """Print a line for each size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    print(f"maps for {NUM_PLAYERS} players, best of {repeats}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.txt"
        for side in SIDES:
            make = partial(generate_map, side, side, NUM_PLAYERS, 0)
            write_text_map(make(), path)
            making = best_seconds(make, repeats)
            reading = best_seconds(partial(read_map, path), repeats)
            ratio = making / reading
            print(f"{side:>3} x {side:<3} {making * 1e3:8.1f} ms  {ratio:6.1f} x reading it")


if __name__ == "__main__":
    main()
