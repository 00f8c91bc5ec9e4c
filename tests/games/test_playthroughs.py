"""Golden games that a person can read: replayed line by line, so that a change of rules shows.

`pytest tests/games --update-playthroughs` plays them again and rewrites the files; their diff then
shows what the change of rules does to a game, and belongs in the same commit.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.deep_line_wars.state import RUNNING, World
from marl_cair.games.engine import BatchedEngine
from tests.games.cases import Case, Luck, choose_action

FOLDER = Path(__file__).parent / "playthroughs"
DECISIONS_BETWEEN_BOARDS = 10

Policy = Callable[[BatchedEngine, int, np.ndarray, np.ndarray], int]


def play_by_luck(engine: BatchedEngine, player: int, mask: np.ndarray, numbers: np.ndarray) -> int:
    return choose_action(engine.spec, mask, *numbers)


def rush_or_build(engine: BatchedEngine, player: int, mask: np.ndarray, numbers: np.ndarray) -> int:
    """Player 0 buys the cheapest unit whenever it can; player 1 rarely does anything."""
    militia = engine.spec.action_names.index("buy_militia")
    if player == 0:
        return militia if mask[militia] else engine.spec.noop_action
    if numbers[1] > 0.3:
        return engine.spec.noop_action
    return play_by_luck(engine, player, mask, np.array([numbers[0], numbers[1] / 0.3]))


class Playthrough(NamedTuple):
    """A golden game: where it is played, and how its actions were first chosen."""

    file: str
    case: Case
    policy: Policy
    ends: str  # the last word of the file

    def open(self) -> BatchedEngine:
        engine = self.case.engine()
        engine.reset(7)
        return engine


PLAYTHROUGHS = [
    Playthrough(
        "deep_line_wars-10x15.txt",
        Case("deep_line_wars", "10x15", (("preset", "2018"), ("max_ticks", 1_200))),
        play_by_luck,
        ends="truncated",
    ),
    Playthrough(
        "deep_line_wars-11x11-classic.txt",
        Case(
            "deep_line_wars",
            "11x11",
            (("preset", "2018"), ("actions", "classic"), ("max_ticks", 1_200)),
        ),
        rush_or_build,
        ends="terminated",
    ),
]

every_playthrough = pytest.mark.parametrize("golden", PLAYTHROUGHS, ids=lambda one: one.file)


# --- Deep Line Wars as text ------------------------------------------------------------------

LEGEND = """\
# Boards are seen by player_0, whose base is on the left. In each cell: units, then towers.
#   player_0: units m f g a (militia, footman, grunt, armoured grunt), towers 1 2 3
#   player_1: units M F G A, towers ! @ # (basic, fast, faster)
# of several in a cell the newest unit shows; | is the centre, : are the spawn columns.
"""
UNIT_SIGNS = ("mfga", "MFGA")
TOWER_SIGNS = ("123", "!@#")


def draw_board(engine: BatchedEngine) -> list[str]:
    world = World(*(field[0] for field in engine._worlds))
    rows, columns = engine.scenario.rows, engine.scenario.columns
    build_columns = engine.scenario.build_columns
    ground = [":", *"." * build_columns]
    ground = [*ground, *"|" * (columns - 2 * len(ground)), *reversed(ground)]
    cells = [ground.copy() for _ in range(rows)]

    def put(player: int, row: int, column: int, sign: str) -> None:
        cells[row][column if player == 0 else columns - 1 - column] = sign

    for player in range(2):
        for row, column in np.argwhere(world.tower_at[player] >= 0).tolist():
            sign = TOWER_SIGNS[player][world.tower_at[player, row, column]]
            put(player, row, column + 1, sign)
    for player in range(2):
        for age in range(world.num_units[player]):
            slot = (int(world.first_unit[player]) + age) % world.unit_kind.shape[1]
            if world.unit_health[player, slot] > 0:
                place = world.unit_row[player, slot], int(world.unit_column[player, slot])
                put(player, *place, UNIT_SIGNS[player][world.unit_kind[player, slot]])
    return ["          " + "".join(row) for row in cells]


def describe_economy(engine: BatchedEngine) -> str:
    world = World(*(field[0] for field in engine._worlds))
    parts = [
        f"{name} {first:>3} {second:>3}"
        for name, (first, second) in {
            "health": world.health,
            "gold": world.gold,
            "income": world.income,
            "illegal": world.illegal,
        }.items()
    ]
    return "  ".join(parts)


# --- playing and replaying -------------------------------------------------------------------


def describe_head(golden: Playthrough, engine: BatchedEngine) -> list[str]:
    title = f"# {engine.game.title}, rules version {engine.game.version}, {engine.scenario}"
    return [title, *LEGEND.splitlines(), "# decision: player_0, player_1 -> what both then have"]


def describe_step(engine: BatchedEngine, decision: int, actions: list[int]) -> list[str]:
    first, second = (engine.spec.action_names[action] for action in actions)
    lines = [f"{decision:>4}: {first:<19} {second:<19} -> {describe_economy(engine)}"]
    is_over = engine._worlds.phase[0, 0] != RUNNING
    if is_over or (decision + 1) % DECISIONS_BETWEEN_BOARDS == 0:
        lines += [f"tick {engine._worlds.tick[0, 0]}", *draw_board(engine)]
    if is_over:
        how = "terminated" if engine.terminated[0] else "truncated"
        lines.append(f"winner {engine.winner[0]}, rewards {engine.rewards[0].tolist()}, {how}")
    return lines


def play_again(golden: Playthrough) -> str:
    """The text of a game whose actions are chosen now."""
    engine = golden.open()
    lines = describe_head(golden, engine)
    luck = Luck.draw(engine.spec.max_ticks // engine.spec.ticks_per_step, 1, 2, seed=3)
    for decision, numbers in enumerate(luck.numbers[:, 0]):
        masks = engine.action_mask()[0]
        actions = [golden.policy(engine, seat, masks[seat], numbers[seat]) for seat in (0, 1)]
        engine.step(np.array([actions]))
        lines += describe_step(engine, decision, actions)
        if engine.terminated[0] or engine.truncated[0]:
            break
    return "\n".join(lines) + "\n"


def read_actions(engine: BatchedEngine, text: str) -> list[list[int]]:
    """The actions of both players, decision by decision."""
    names = engine.spec.action_names
    shown = [line.partition(": ")[2].split()[:2] for line in text.splitlines() if " -> " in line]
    return [[names.index(name) for name in pair] for pair in shown if pair[0] in names]


def replay(golden: Playthrough, text: str) -> str:
    """The text of a game with the actions in `text`."""
    engine = golden.open()
    lines = describe_head(golden, engine)
    for decision, actions in enumerate(read_actions(engine, text)):
        engine.step(np.array([actions]))
        lines += describe_step(engine, decision, actions)
    return "\n".join(lines) + "\n"


@pytest.mark.plain_python
@every_playthrough
def test_a_golden_game_goes_as_written(golden, update_playthroughs):
    path = FOLDER / golden.file
    if update_playthroughs:
        path.write_text(play_again(golden))
    written = path.read_text().splitlines()
    replayed = replay(golden, path.read_text()).splitlines()
    for number, (found, expected) in enumerate(zip(replayed, written, strict=False), start=1):
        assert found == expected, f"{path}:{number}"
    assert len(replayed) == len(written)
    assert written[-1].endswith(golden.ends)


@every_playthrough
def test_a_golden_game_is_of_the_rules_as_they_are(golden):
    head = (FOLDER / golden.file).read_text().splitlines()[0]
    game = GAMES[golden.case.game]
    assert head.startswith(f"# {game.title}, rules version {game.version}, ")


@every_playthrough
def test_a_golden_game_is_changed_by_any_other_action(golden):
    """The replay can fail: leaving out one purchase changes what follows."""
    text = (FOLDER / golden.file).read_text()
    changed = text.replace("buy_militia", "noop       ", 1)
    assert replay(golden, changed) != replay(golden, text)
