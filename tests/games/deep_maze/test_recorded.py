"""Recorded games that a person can read: replayed move by move, so that a change of rules shows.

`pytest tests/games --update-playthroughs` plays them again and rewrites the files; their diff then
shows what the change of rules does to a game, and belongs in the same commit.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from marl_cair.games.deep_maze.definition import VERSION
from marl_cair.games.deep_maze.state import GOAL, MAZE, TICK, WALL
from marl_cair.games.deep_maze.tables import ACTION_NAMES
from tests.games.bot_play import make_bot
from tests.games.deep_maze.table import Table

FOLDER = Path(__file__).parent / "recorded"
SEED = 7
LEGEND = """\
# After each move: the cells of all seats as row,column, then their rewards.
#   # wall, . open, G goal, 0 1 2 the seats; under fog a board of what seat 0 knows follows the
#   whole one, with ? for what it does not.
"""


class Record(NamedTuple):
    """A recorded game, the bots that once chose its actions, and its last word."""

    scenario: str
    bots: tuple[str, ...]
    ends: str

    @property
    def path(self) -> Path:
        return FOLDER / f"{self.scenario}.txt"


RECORDS = (
    Record("9x9-sequence", ("wall_follower",), "terminated, winner 0"),
    Record("15x15-line_of_sight", ("oracle",), "terminated, winner 0"),
    Record("15x15-chase-3p", ("oracle", "oracle", "wall_follower"), "terminated, winner 0"),
)


def draw_board(table: Table, is_known: np.ndarray | None = None) -> list[str]:
    world, columns = table.world, table.engine.scenario.columns
    signs = np.where(world.walls == WALL, "#", ".")
    signs[world.clock[GOAL]] = "G"
    for player in range(table.engine.num_players - 1, -1, -1):
        signs[world.cell[player]] = str(player)
    if is_known is not None:
        signs = np.where(is_known, signs, "?")
    return ["    " + "".join(row) for row in signs.reshape(-1, columns)]


def describe_maze(table: Table) -> list[str]:
    optimal = " ".join(map(str, table.world.optimal.tolist()))
    lines = [f"maze {table.world.clock[MAZE]}, optimal moves {optimal}", *draw_board(table)]
    if table.engine.scenario.visibility != "full":
        lines += ["known to 0", *draw_board(table, table.world.sight[0] != 0)]
    return lines


def describe_move(table: Table, actions: list[int]) -> str:
    names = " ".join(f"{ACTION_NAMES[action]:<5}" for action in actions)
    places = "  ".join("{},{}".format(*table.place(seat)) for seat in range(len(actions)))
    rewards = " ".join(f"{reward:g}" for reward in table.engine.rewards[0].tolist())
    return f"{table.world.clock[TICK]:>4}: {names} -> {places}  {rewards}"


def format_game(record: Record, choices: Iterator[list[int]], table: Table) -> str:
    """The text of a game with the actions that `choices` gives."""
    engine = table.engine
    lines = [f"# Deep Maze, rules version {VERSION}, {record.scenario}, seed {SEED}"]
    lines += [*LEGEND.splitlines(), *describe_maze(table)]
    maze = 0
    for actions in choices:
        engine.step(np.array([actions]))
        lines.append(describe_move(table, actions))
        if table.world.clock[MAZE] != maze:
            maze = int(table.world.clock[MAZE])
            lines += describe_maze(table)
        if engine.terminated[0] or engine.truncated[0]:
            break
    how = "terminated" if engine.terminated[0] else "truncated"
    return "\n".join([*lines, *describe_maze(table), f"{how}, winner {engine.winner[0]}", ""])


def choose_again(record: Record, table: Table) -> Iterator[list[int]]:
    bots = [make_bot(table.engine, name, seat) for seat, name in enumerate(record.bots)]
    while True:
        seen, mask = table.engine.observe("planes"), table.engine.action_mask()
        yield [int(bot.act(seen[:, s], mask[:, s])[0]) for s, bot in enumerate(bots)]


def read_actions(text: str) -> Iterator[list[int]]:
    for line in text.splitlines():
        move, arrow, _ = line.partition(" -> ")
        if arrow:
            yield [ACTION_NAMES.index(name) for name in move.partition(":")[2].split()]


@pytest.mark.plain_python
@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.scenario)
def test_a_recorded_game_goes_as_written(record, update_playthroughs):
    if update_playthroughs:
        record.path.parent.mkdir(exist_ok=True)
        table = Table(record.scenario, seed=SEED)
        record.path.write_text(format_game(record, choose_again(record, table), table), "utf-8")
    text = record.path.read_text("utf-8")
    found = format_game(record, read_actions(text), Table(record.scenario, seed=SEED))
    for number, (line, written) in enumerate(
        zip(found.splitlines(), text.splitlines(), strict=True), start=1
    ):
        assert line == written, f"{record.path}:{number}"
    assert text.rstrip().endswith(record.ends)


@pytest.mark.plain_python
def test_a_recorded_game_is_changed_by_any_other_move():
    """The replay can fail: one move left out changes what follows."""
    record = RECORDS[1]
    text = record.path.read_text("utf-8")
    actions = list(read_actions(text))
    others = [actions[0], [ACTION_NAMES.index("noop")], *actions[2:]]
    assert format_game(record, iter(others), Table(record.scenario, seed=SEED)) != text
