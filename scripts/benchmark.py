"""The same as `python -m benchmarks`: python scripts/benchmark.py --help."""

import runpy
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    runpy.run_module("benchmarks", run_name="__main__")
