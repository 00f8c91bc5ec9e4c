"""A recorded game that a person can read: the same flaps give the same flight in later versions.

`pytest tests/games --update-playthroughs` writes it again. That is a change of rules: it raises the
game's version and stands in the change log.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from marl_cair.games.flappy_bird.definition import VERSION
from tests.games.flappy_bird.flight import Flight

FILE = Path(__file__).parent / "recorded" / "storm.txt"
HEAD = f"# Flappy Bird, rules version {VERSION}, storm: action -> y, velocity, wind, pipes, passed"
NAMES = ("noop", "flap")

pytestmark = pytest.mark.plain_python


def describe(flight: Flight, action: int) -> str:
    pipes = " ".join(
        f"{x:7.2f}@{gap}" for x, gap in zip(flight.pipes(), flight.world.gap_top, strict=True)
    )
    wind = int(flight.world.wind[0]) / 100
    line = f"{NAMES[action]} -> {flight.y():7.2f} {flight.velocity():6.2f} {wind:5.2f} | {pipes}"
    return f"{line} | {flight.world.pipes_passed[0]}"


def play_again() -> list[str]:
    """Flaps below a line in the next gap, until the wind wins."""
    flight, lines = Flight("storm", seed=11), [HEAD]
    while not flight.is_over() and len(lines) < 400:
        action = int(flight.can_flap() and flight.y() > flight.next_gap() + 70)
        flight.play(action)
        lines.append(describe(flight, action))
    return [*lines, f"pays {flight.engine.rewards[0, 0]}"]


def replay(lines: list[str]) -> list[str]:
    flight, lines_found = Flight("storm", seed=11), [HEAD]
    for line in lines[1:-1]:
        action = NAMES.index(line.split()[0])
        flight.play(action)
        lines_found.append(describe(flight, action))
    return [*lines_found, f"pays {flight.engine.rewards[0, 0]}"]


def test_a_recorded_game_goes_as_written(update_playthroughs):
    if update_playthroughs:
        FILE.parent.mkdir(exist_ok=True)
        FILE.write_text("\n".join(play_again()) + "\n")
    written = FILE.read_text().splitlines()
    for number, (found, expected) in enumerate(zip(replay(written), written, strict=True), start=1):
        assert found == expected, f"{FILE}:{number}"


def test_another_flap_changes_the_recorded_game():
    written = FILE.read_text().splitlines()
    place = next(at for at in range(5, len(written)) if written[at].startswith("noop"))
    changed = [*written[:place], written[place].replace("noop", "flap"), *written[place + 1 :]]
    assert replay(changed)[place + 1 :] != written[place + 1 :]
