"""The same as `python -m benchmarks.capsule_digits`: python scripts/capsule_digits.py --help."""

import runpy
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    runpy.run_module("benchmarks.capsule_digits", run_name="__main__")
