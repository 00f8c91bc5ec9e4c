"""Players of board games whose truth is known: exact solvers, and others that are weaker.

A value is what who is on turn gets if both play on without a mistake: 1 win, 0 draw, -1 loss.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.league.pettingzoo_games import NOBODY, Table, find_moves, find_seat, look

Choose = Callable[[NDArray[np.bool_], list[int]], list[int]]  # (cells [2 N], moves) -> the best

ROWS, COLUMNS = 6, 7
HEIGHT = ROWS + 1  # bits of a column of Connect Four: the one above the board is never set
LINES = (1, HEIGHT - 1, HEIGHT, HEIGHT + 1)  # from a cell to the next in each direction
OUTWARDS = (3, 2, 4, 1, 5, 0, 6)  # columns, the best first for a search that may stop early


class Player:
    """Draws from what `choose` leaves; waits where it is not on turn."""

    representation = "vector"

    def __init__(self, name: str, choose: Choose) -> None:
        self.name, self.choose = name, choose
        self.luck = np.random.default_rng(0)

    def seed(self, seed):
        self.luck = np.random.default_rng(seed)

    def act(self, observation, action_mask):
        return np.array([self._act(*row) for row in zip(observation, action_mask, strict=True)])

    def _act(self, cells, legal):
        moves = np.flatnonzero(legal).tolist()
        is_waiting = moves == [len(legal) - 1]
        return moves[0] if is_waiting else self.luck.choice(self.choose(cells > 0, moves))

    def state_dict(self):
        return {"state": json.dumps(self.luck.bit_generator.state)}

    def load_state_dict(self, state):
        self.luck.bit_generator.state = json.loads(state["state"])


def make_bots(choices: Mapping[str, Choose]) -> dict[str, Callable[..., Any]]:
    """Bots of a game by name."""
    return {
        name: lambda scenario, spec, name=name, choose=choose: Player(name, choose)
        for name, choose in choices.items()
    }


def choose_any(cells, moves):
    """Whatever is legal."""
    return moves


# --- tic-tac-toe: all of it, through PettingZoo's own environment -------------------------------


def solve_all(make_env: Callable[[], Any]) -> dict[bytes, dict[int, int]]:
    """The value of each move on each board that can be, for who is on turn."""
    table, values = Table(make_env), {}

    def find_value(moves: tuple[int, ...]) -> int:
        env = table.stand_at(moves)
        seat = len(moves) % 2
        if find_seat(env) == NOBODY:
            return int(env.rewards[env.possible_agents[seat]])
        board = look(env, seat).astype(np.bool_).tobytes()
        if board not in values:
            legal = find_moves(env)
            values[board] = {move: -find_value((*moves, move)) for move in legal}
        return max(values[board].values())

    find_value(())
    return values


def choose_by(values: Mapping[bytes, Mapping[int, int]], pick: Callable[..., int]) -> Choose:
    """The moves of the value that `pick` (max, or min) takes."""

    def choose(cells, moves):
        of = values[cells.tobytes()]
        return [move for move in moves if of[move] == pick(of.values())]

    return choose


# --- Connect Four: exact where few cells are empty ----------------------------------------------


def pack(cells: NDArray[np.bool_]) -> tuple[int, int]:
    """Own and the other's stones as bits: column after column, each from below."""
    boards = cells.reshape(2, ROWS, COLUMNS)[:, ::-1]
    own, other = (
        sum(1 << int(column * HEIGHT + row) for row, column in np.argwhere(board))
        for board in boards
    )
    return own, other


def has_four(stones: int) -> bool:
    for line in LINES:
        pairs = stones & (stones >> line)
        if pairs & (pairs >> 2 * line):
            return True
    return False


def drop(own: int, other: int, column: int) -> int:
    """Own stones after one more in the column; the same where it is full."""
    cells = ((1 << ROWS) - 1) << column * HEIGHT
    free = cells & ~(own | other)
    return own | (free & -free)


@cache
def solve(own: int, other: int) -> int:
    """The value for who is on turn and has the stones `own`; nobody has four."""
    tried = [stones for column in OUTWARDS if (stones := drop(own, other, column)) != own]
    if any(has_four(stones) for stones in tried):
        return 1
    best = -1 if tried else 0
    for stones in tried:
        best = max(best, -solve(other, stones))
        if best == 1:
            break
    return best


def value_moves(cells: NDArray[np.bool_], moves: list[int]) -> dict[int, int]:
    """The value of each column for who is on turn."""
    own, other = pack(cells)
    after = {move: drop(own, other, move) for move in moves}
    return {
        move: 1 if has_four(stones) else -solve(other, stones) for move, stones in after.items()
    }


def choose_worst(cells, moves):
    """A solver with its sign turned."""
    values = value_moves(cells, moves)
    return [move for move in moves if values[move] == min(values.values())]


def choose_near(cells, moves):
    """A win in one, else a block of one, else anything."""
    own, other = pack(cells)
    wins = [move for move in moves if has_four(drop(own, other, move))]
    blocks = [move for move in moves if has_four(drop(other, own, move))]
    return wins or blocks or moves


def choose_best(cells, moves):
    """Of the moves of the highest value those that ask most of one who errs."""
    values = value_moves(cells, moves)
    best = max(values.values())
    return choose_near(cells, [move for move in moves if values[move] == best])
