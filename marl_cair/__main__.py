"""`python -m marl_cair` is `marl-cair`."""

import sys

from marl_cair.cli import main

if __name__ == "__main__":
    sys.exit(main())
