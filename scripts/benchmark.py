"""The same as `marl-cair benchmark`: python scripts/benchmark.py --help."""

import sys

from marl_cair.cli import main

if __name__ == "__main__":
    sys.exit(main(["benchmark", *sys.argv[1:]]))
