"""A world of Deep Maze as text, for tests: lay a board, move, read what is there."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games import make_engine
from marl_cair.games.deep_maze.mazes import measure_distances
from marl_cair.games.deep_maze.places import potential
from marl_cair.games.deep_maze.state import GOAL, OPEN, WALL, World
from marl_cair.games.deep_maze.tables import ACTION_NAMES


def plain(rule: Any) -> Any:
    """A rule as plain Python: not worth the wait for the compiler."""
    return getattr(rule, "py_func", rule)


class Table:
    """One world of an engine.

    `board` is the maze as text: # wall, . open, G the goal, 0..3 the seats.
    """

    def __init__(
        self, scenario: str = "9x9-stochastic", board: str = "", seed: int = 0, **options: Any
    ) -> None:
        lines = board.split()
        if lines:
            options |= {"rows": len(lines), "columns": len(lines[0])}
        self.engine = make_engine("deep_maze", scenario, **options)
        self.engine.reset(seed)
        if lines:
            self.lay("".join(lines))

    @property
    def world(self) -> World:
        return World(*(field[0] for field in self.engine._worlds))

    def lay(self, cells: str) -> None:
        world, rules = self.world, self.engine._rules
        world.walls[:] = [WALL if sign == "#" else OPEN for sign in cells]
        world.clock[GOAL] = cells.index("G")
        world.sight[:] = 0  # under fog, a seat looks around when it moves
        plain(measure_distances)(world, rules, cells.index("G"))
        for player in range(self.engine.num_players):
            world.cell[player] = world.came_from[player] = cells.index(str(player))
            world.optimal[player] = world.distance[world.cell[player]]
            world.potential[player] = plain(potential)(world, rules, player)

    def move(self, *names: str) -> list[float]:
        """One action of each seat by name; the rewards."""
        self.engine.step(np.array([[ACTION_NAMES.index(name) for name in names]]))
        return [float(reward) for reward in self.engine.rewards[0]]

    def walk(self, names: str) -> list[float]:
        """Moves of the only seat, as words; the rewards."""
        return [self.move(name)[0] for name in names.split()]

    def mask(self, player: int = 0) -> list[str]:
        """The legal actions by name."""
        legal = self.engine.action_mask()[0, player]
        return [name for name, is_legal in zip(ACTION_NAMES, legal, strict=True) if is_legal]

    def ending(self) -> tuple[bool, bool, int]:
        """Terminated, truncated, winner."""
        engine = self.engine
        return bool(engine.terminated[0]), bool(engine.truncated[0]), int(engine.winner[0])

    def place(self, player: int = 0) -> tuple[int, int]:
        """Row and column of a seat."""
        row, column = divmod(int(self.world.cell[player]), self.engine.scenario.columns)
        return row, column

    def see(self, representation: str, player: int = 0) -> np.ndarray:
        return self.engine.observe(representation)[0, player]

    def walls(self) -> np.ndarray:
        scenario = self.engine.scenario
        return self.world.walls.reshape(scenario.rows, scenario.columns)


def reached_from(is_open: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Moves from `start` to every open cell, -1 where there is no way; written again for tests."""
    moves = np.full(is_open.shape, -1)
    moves[start] = 0
    front = [start]
    while front:
        following = []
        for row, column in front:
            for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                place = row + down, column + right
                inside = 0 <= place[0] < is_open.shape[0] and 0 <= place[1] < is_open.shape[1]
                if inside and is_open[place] and moves[place] < 0:
                    moves[place] = moves[row, column] + 1
                    following.append(place)
        front = following
    return moves
