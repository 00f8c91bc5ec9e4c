"""The same as `marl-cair train`: python scripts/train.py --help."""

import sys

from marl_cair.cli import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]]))
