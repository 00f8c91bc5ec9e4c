"""Where the time of training goes: network, rules, replay, and the loop around them.

    pip install py-spy
    py-spy record --rate 100 --duration 60 --format raw --output profile.txt -- marl-cair train recipe=quick opponent=random generator=none
    python -m benchmarks.time_shares PROFILE   # profile.txt

py-spy looks at the running program a hundred times a second. Each look within the training loop
counts for the innermost function of marl_cair in it: in `policies` and `training/losses.py`, and
gradients, optimiser and averages in `Learner`, for the network; in `games` for the rules (with
their observations and TensorDicts); in `replay`; all else is the loop. Prints Markdown.
"""  # noqa: E501

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

LOOP = "iterate (marl_cair/training/trainer.py"
FRAME = re.compile(r"(?P<function>[^;]+) \([^;]*marl_cair/(?P<file>[\w/]+)\.py")
NETWORK = ("update", "_follow")  # of Learner
PARTS = {"policies": "network", "games": "rules", "replay": "replay"}


def find_part(stack: str) -> str:
    """What the innermost function of marl_cair in a stack of py-spy belongs to."""
    frame = [*FRAME.finditer(stack)][-1].groupdict()
    file, function = frame["file"], frame["function"].split(".")[-1]
    if file == "training/losses" or (file == "training/learner" and function in NETWORK):
        return "network"
    return PARTS.get(file.partition("/")[0], "loop")


def main() -> None:
    """Print the shares."""
    if len(sys.argv) != 2:
        sys.exit("usage: python -m benchmarks.time_shares PROFILE")
    shares: Counter[str] = Counter()
    for line in Path(sys.argv[1]).read_text().splitlines():
        stack, count = line.rsplit(" ", 1)
        if LOOP in stack:
            shares[find_part(stack)] += int(count)
    if not shares:
        sys.exit(f"{sys.argv[1]} has no look within training: profile `marl-cair train` for longer")
    total = sum(shares.values())
    print("| part | % of the time |")
    print("|---|---|")
    for part, number in shares.most_common():
        print(f"| {part} | {100 * number / total:.1f} |")


if __name__ == "__main__":
    main()
