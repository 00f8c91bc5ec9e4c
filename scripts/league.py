"""The same as `marl-cair league`: python scripts/league.py --help."""

import sys

from marl_cair.cli import main

if __name__ == "__main__":
    sys.exit(main(["league", *sys.argv[1:]]))
