"""Named configurations of Deep Maze: size, generator, mode, sight, players, reward and time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from marl_cair.games.checks.scenario import (
    MAX_TICKS,
    check_shaping_discount,
    check_switch,
    check_whole_number,
    read_number,
)
from marl_cair.games.deep_maze.tables import (
    MAX_PLAYERS,
    MAX_TICKS_OF_SIZE,
    ORIGINAL_MAZE_SEED,
    ORIGINAL_PREVIEW_MOVES,
    ORIGINAL_VISION_CELLS,
)
from marl_cair.lookup import find_by_name

GYMNASIUM_PREFIX = "DeepMaze"  # of the ids marl_cair/DeepMaze-<scenario>-v0

GENERATORS = {
    "prim": "a perfect maze: one way between any two cells (randomised Prim)",
    "growth": "walls that grow from random seeds: ways with loops",
}
MODES = {
    "deterministic": "one maze; start and goal are drawn for each game",
    "full_deterministic": "one maze, one start, one goal",
    "stochastic": "maze, start and goal are drawn for each game",
    "sequence": "the same num_mazes mazes one after another in each game",
}
PLACES = {
    "random": "start and goal are open cells, drawn uniformly",
    "corners": "start and goal are the open cells nearest to the first and the last corner",
}
VISIBILITIES = {
    "full": "everything",
    "square": "all cells at most `vision` rows and columns away",
    "line_of_sight": "straight ways of up to `vision` cells, and the walls beside them",
}
CONTESTS = {
    "race": "the first at the goal wins",
    "chase": "the first seat hunts the others, who are safe at the goal",
}
REWARDS = {
    "classic": "+1 at the goal, -0.01 for every other move; against others +1 win, -1 loss, 0 draw",
    "beyond_optimal": "-1 for each move beyond the optimal count (the thesis's)",
    "distance": "classic plus a potential difference: the walking distance to the goal",
}

MIN_SIDE, MAX_SIDE = 5, 127
MAX_MAZES = 100  # of a sequence
MAX_CELL_PIXELS = 32
BY_SIZE = 0  # of max_ticks
OPEN_WAYS: dict[str, Any] = {"generator": "growth", "density": 0.8, "complexity": 0.05}


@dataclass(frozen=True)
class Scenario:
    """Settings of one kind of game.

    Raises:
        ValueError: a value is outside what is allowed, or two do not go together; the message
            names fields, values and what is allowed.
    """

    rows: int = 9
    columns: int = 9
    generator: str = "prim"  # see GENERATORS
    density: float = 1.0  # of `growth`: seeds of walls, as a share of one for each 2 x 2 cells
    complexity: float = 1.0  # of `growth`: how long a wall may grow, 1 = 5 (rows + columns) steps
    mode: str = "stochastic"  # see MODES
    num_mazes: int = 1  # of the mode sequence
    maze_seed: int = ORIGINAL_MAZE_SEED  # of all modes but stochastic
    places: str = "random"  # see PLACES
    visibility: str = "full"  # see VISIBILITIES
    vision: int = ORIGINAL_VISION_CELLS  # cells, where the visibility is not full
    preview_moves: int = 0  # for so many moves all is seen, whatever the visibility
    remembers: bool = True  # cells that were in sight stay known
    num_players: int = 1
    contest: str = "race"  # of 2 to 4 players: see CONTESTS
    reward: str = "classic"  # see REWARDS
    shaping_discount: float = 0.99  # gamma of the potential difference, per move
    mask_walls: bool = True  # a move into a wall is illegal; else it is legal and does nothing
    cell_pixels: int = 0  # pixels along a cell of `image`; 0 = the picture of 640 x 480
    max_ticks: int = BY_SIZE  # time limit in moves; 0 becomes that of `limit_by_size`

    def __post_init__(self) -> None:
        for field in ("rows", "columns"):
            check_whole_number("deep_maze", self, field, MIN_SIDE, MAX_SIDE)
        check_whole_number("deep_maze", self, "num_players", 1, MAX_PLAYERS)
        check_whole_number("deep_maze", self, "num_mazes", 1, MAX_MAZES)
        check_whole_number("deep_maze", self, "maze_seed", 0, 2**63 - 1)
        check_whole_number("deep_maze", self, "vision", 1, MAX_SIDE)
        check_whole_number("deep_maze", self, "max_ticks", BY_SIZE, MAX_TICKS)
        check_whole_number("deep_maze", self, "preview_moves", 0, MAX_TICKS)
        check_whole_number("deep_maze", self, "cell_pixels", 0, MAX_CELL_PIXELS)
        for field in ("density", "complexity"):
            _check_share(self, field)
        for field in ("remembers", "mask_walls"):
            check_switch("deep_maze", self, field)
        find_by_name("deep_maze generator", self.generator, GENERATORS)
        find_by_name("deep_maze mode", self.mode, MODES)
        find_by_name("deep_maze places", self.places, PLACES)
        find_by_name("deep_maze visibility", self.visibility, VISIBILITIES)
        find_by_name("deep_maze contest", self.contest, CONTESTS)
        find_by_name("deep_maze reward", self.reward, REWARDS)
        check_shaping_discount("deep_maze", self)
        self._check_maze()
        self._check_players()
        if self.max_ticks == BY_SIZE:
            object.__setattr__(self, "max_ticks", self.limit_by_size)

    def _check_maze(self) -> None:
        for field in ("density", "complexity"):
            if self.generator == "prim" and getattr(self, field) != 1.0:
                raise ValueError(
                    f"deep_maze: {field} is {getattr(self, field)}, but the generator prim has no "
                    f"{field}; leave it at 1.0 or choose generator='growth'"
                )
        if self.mode == "sequence" and self.num_mazes < 2:
            raise ValueError(
                "deep_maze: the mode sequence needs num_mazes of at least 2, it is "
                f"{self.num_mazes}"
            )
        if self.mode != "sequence" and self.num_mazes > 1:
            raise ValueError(
                f"deep_maze: num_mazes is {self.num_mazes}, but the mode {self.mode} plays one "
                "maze; choose mode='sequence'"
            )
        if self.mode == "stochastic" and self.maze_seed != Scenario.maze_seed:
            raise ValueError(
                f"deep_maze: maze_seed is {self.maze_seed}, but the mode stochastic draws a maze "
                f"for each game; leave it at {Scenario.maze_seed} or choose mode='deterministic'"
            )
        for field in ("preview_moves", "vision", "remembers"):
            value, default = getattr(self, field), getattr(Scenario, field)
            if self.visibility == "full" and value != default:
                raise ValueError(
                    f"deep_maze: {field} is {value}, but the visibility is full all the time; "
                    f"leave it at {default} or choose visibility='square' or 'line_of_sight'"
                )

    def _check_players(self) -> None:
        if self.contest == "chase" and self.num_players < 2:
            raise ValueError(
                "deep_maze: the contest chase needs 2 to 4 players, num_players is "
                f"{self.num_players}"
            )
        if self.num_players > 1 and self.mode == "sequence":
            raise ValueError(
                f"deep_maze: the mode sequence is for 1 player, num_players is {self.num_players}"
            )
        if self.is_chase and self.places == "corners":
            raise ValueError(
                "deep_maze: a chase cannot start in the corners, where all would stand on one "
                "cell; choose places='random'"
            )
        if self.num_players > 1 and self.reward == "beyond_optimal":
            raise ValueError(
                "deep_maze: the reward beyond_optimal is for 1 player, num_players is "
                f"{self.num_players}; choose 'classic'"
                + ("" if self.is_chase else " or 'distance'")
            )
        if self.is_chase and self.reward == "distance":
            raise ValueError(
                "deep_maze: the reward distance leads everybody to the goal, which a chase does "
                "not ask of the hunter; choose 'classic'"
            )

    def follow(self, options: dict[str, Any]) -> dict[str, Any]:
        """`options`, with the time limit of another board where it was the one of this board."""
        is_by_size = self.max_ticks == self.limit_by_size
        if is_by_size and options.keys() & {"rows", "columns", "num_mazes"}:
            return {"max_ticks": BY_SIZE, **options}
        return options

    @property
    def limit_by_size(self) -> int:
        """The time limit in moves that goes with the board: between the thesis's sizes linear in
        the number of cells, beyond the largest in proportion to it; so much for each maze.
        """
        cells = [side * side for side in MAX_TICKS_OF_SIZE]
        limits = list(MAX_TICKS_OF_SIZE.values())
        beyond = max(1.0, self.num_cells / cells[-1])
        limit = round(beyond * float(np.interp(self.num_cells, cells, limits)))
        return min(self.num_mazes * limit, MAX_TICKS)

    @property
    def is_chase(self) -> bool:
        """Whether the first seat hunts the others."""
        return self.num_players > 1 and self.contest == "chase"

    @property
    def has_open_ways(self) -> bool:
        """Whether its walls are those of the named chases."""
        return all(getattr(self, field) == value for field, value in OPEN_WAYS.items())

    @property
    def num_cells(self) -> int:
        """Cells of the board, walls included."""
        return self.rows * self.columns

    @property
    def num_views(self) -> int:
        """Cells of which a seat's sight is kept: all under fog, else one that nobody reads."""
        return 1 if self.visibility == "full" else self.num_cells


def _check_share(scenario: Scenario, field: str) -> None:
    value, share = getattr(scenario, field), read_number(scenario, field)
    if share is None or not 0.0 <= share <= 1.0:
        raise ValueError(f"deep_maze: {field} is {value!r}, it must be a number in 0..1")


_FOGGY_SIZES = (9, 15, 25)
_SEVERAL_SIZES = (15, 25)


def _name(size: int, *parts: str) -> str:
    return "-".join([f"{size}x{size}", *parts])


def _list_scenarios() -> dict[str, Scenario]:
    """The modes in all sizes; sights, sequences and loops in three; several players in two."""
    listed: dict[str, Scenario] = {}
    boards = {size: Scenario(rows=size, columns=size) for size in MAX_TICKS_OF_SIZE}
    for size, board in boards.items():
        for mode in ("deterministic", "full_deterministic", "stochastic"):
            listed[_name(size, mode)] = replace(board, mode=mode)
    for size in _FOGGY_SIZES:
        board = boards[size]
        listed[_name(size, "loops")] = replace(board, generator="growth")
        listed[_name(size, "sequence")] = replace(
            board, mode="sequence", num_mazes=3, max_ticks=BY_SIZE
        )
        for sight in ("square", "line_of_sight"):
            foggy = replace(board, visibility=sight)
            listed[_name(size, sight)] = foggy
            listed[_name(size, f"timed_{sight}")] = replace(
                foggy, preview_moves=ORIGINAL_PREVIEW_MOVES
            )
    for size in _SEVERAL_SIZES:
        listed |= _list_contests(size, boards[size])
    return listed


def _list_contests(size: int, board: Scenario) -> dict[str, Scenario]:
    listed = {}
    for players in (2, 3, 4):
        race = replace(board, num_players=players)
        chase = replace(race, contest="chase", **OPEN_WAYS)
        listed[_name(size, f"race-{players}p")] = race
        listed[_name(size, f"race-{players}p", "square")] = replace(race, visibility="square")
        listed[_name(size, f"chase-{players}p")] = chase
        listed[_name(size, f"chase-{players}p", "line_of_sight")] = replace(
            chase, visibility="line_of_sight"
        )
    return listed


DEFAULT_SCENARIO = "9x9-stochastic"
_LISTED = _list_scenarios()
SCENARIOS = {DEFAULT_SCENARIO: _LISTED[DEFAULT_SCENARIO], **_LISTED}
