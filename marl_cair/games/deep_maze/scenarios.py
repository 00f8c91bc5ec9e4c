"""Named configurations of Deep Maze: size, generator, mode, sight, players, reward and time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from marl_cair.games.checks import scenario as checks
from marl_cair.games.checks.scenario import MAX_TICKS
from marl_cair.games.deep_maze import tables as t
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
    "chase": "the first seat hunts the others, which are safe at the goal",
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

CHOICES = {
    "generator": GENERATORS,
    "mode": MODES,
    "places": PLACES,
    "visibility": VISIBILITIES,
    "contest": CONTESTS,
    "reward": REWARDS,
}
# Options that do nothing where another one has a value, and what would use them.
UNUSED = (
    ("generator", "prim", ("density", "complexity"), "generator='growth'"),
    ("mode", "stochastic", ("maze_seed",), "mode='deterministic'"),
    ("visibility", "full", ("preview_moves", "vision", "remembers"), "visibility='square'"),
)
WHOLE_NUMBERS = {  # lowest and highest value of each option
    "rows": (MIN_SIDE, MAX_SIDE),
    "columns": (MIN_SIDE, MAX_SIDE),
    "num_players": (1, t.MAX_PLAYERS),
    "num_mazes": (1, MAX_MAZES),
    "maze_seed": (0, 2**63 - 1),
    "vision": (1, MAX_SIDE),
    "max_ticks": (BY_SIZE, MAX_TICKS),
    "preview_moves": (0, MAX_TICKS),
    "cell_pixels": (0, MAX_CELL_PIXELS),
}


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
    maze_seed: int = t.ORIGINAL_MAZE_SEED  # of all modes but stochastic
    places: str = "random"  # see PLACES
    visibility: str = "full"  # see VISIBILITIES
    vision: int = t.ORIGINAL_VISION_CELLS  # cells, where the visibility is not full
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
        for field, (low, high) in WHOLE_NUMBERS.items():
            checks.check_whole_number("deep_maze", self, field, low, high)
        for field in ("density", "complexity"):
            value, share = getattr(self, field), checks.read_number(self, field)
            if share is None or not 0.0 <= share <= 1.0:
                raise ValueError(f"deep_maze: {field} is {value!r}, it must be a number in 0..1")
        for field in ("remembers", "mask_walls"):
            checks.check_switch("deep_maze", self, field)
        for field, choices in CHOICES.items():
            find_by_name(f"deep_maze {field}", getattr(self, field), choices)
        checks.check_shaping_discount("deep_maze", self)
        for problem in (*self._list_unused_options(), *self._list_contradictions()):
            raise ValueError(f"deep_maze: {problem}")
        if self.max_ticks == BY_SIZE:
            object.__setattr__(self, "max_ticks", self.limit_by_size)

    def _list_unused_options(self) -> Iterator[str]:
        for option, value, unused, other in UNUSED:
            for field in unused if getattr(self, option) == value else ():
                found, default = getattr(self, field), getattr(Scenario, field)
                if found != default:
                    yield (
                        f"{field} is {found}, but {option}={value!r} does not use it; leave it at "
                        f"{default} or choose {other}"
                    )

    def _list_contradictions(self) -> Iterator[str]:
        players = f"num_players is {self.num_players}"
        if self.mode == "sequence" and self.num_mazes < 2:
            yield f"the mode sequence needs num_mazes of at least 2, it is {self.num_mazes}"
        if self.mode != "sequence" and self.num_mazes > 1:
            yield (
                f"num_mazes is {self.num_mazes}, but the mode {self.mode} plays one maze; choose "
                "mode='sequence'"
            )
        if self.contest == "chase" and self.num_players < 2:
            yield f"the contest chase needs 2 to 4 players, {players}"
        if self.num_players > 1 and self.mode == "sequence":
            yield f"the mode sequence is for 1 player, {players}"
        if self.num_players > 1 and self.reward == "beyond_optimal":
            yield f"the reward beyond_optimal is for 1 player, {players}; choose 'classic'"
        if self.is_chase and self.places == "corners":
            yield "all players of a chase would start in one corner; choose places='random'"
        if self.is_chase and self.reward == "distance":
            yield "the reward distance does not fit the hunter of a chase; choose 'classic'"

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
        cells = [side * side for side in t.MAX_TICKS_OF_SIZE]
        limits = list(t.MAX_TICKS_OF_SIZE.values())
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
        """Cells of which a seat's sight is kept: all under fog, else one that is not read."""
        return 1 if self.visibility == "full" else self.num_cells


def _list_scenarios() -> dict[str, Scenario]:
    """The modes in all sizes; sights, sequences and loops in three; several players in two."""
    listed: dict[str, Scenario] = {}
    boards = {size: Scenario(rows=size, columns=size) for size in t.MAX_TICKS_OF_SIZE}
    for size, board in boards.items():
        for mode in ("deterministic", "full_deterministic", "stochastic"):
            listed[f"{size}x{size}-{mode}"] = replace(board, mode=mode)
    for size in (9, 15, 25):
        name, board = f"{size}x{size}", boards[size]
        listed[f"{name}-loops"] = replace(board, generator="growth")
        sequence: dict[str, Any] = {"mode": "sequence", "num_mazes": 3, "max_ticks": BY_SIZE}
        listed[f"{name}-sequence"] = replace(board, **sequence)
        for sight in ("square", "line_of_sight"):
            foggy = replace(board, visibility=sight)
            listed[f"{name}-{sight}"] = foggy
            timed = replace(foggy, preview_moves=t.ORIGINAL_PREVIEW_MOVES)
            listed[f"{name}-timed_{sight}"] = timed
    for size, players in product((15, 25), (2, 3, 4)):
        name, race = f"{size}x{size}", replace(boards[size], num_players=players)
        chase = replace(race, contest="chase", **OPEN_WAYS)
        hidden = replace(chase, visibility="line_of_sight")
        listed[f"{name}-race-{players}p"] = race
        listed[f"{name}-race-{players}p-square"] = replace(race, visibility="square")
        listed[f"{name}-chase-{players}p"] = chase
        listed[f"{name}-chase-{players}p-line_of_sight"] = hidden
    return listed


DEFAULT_SCENARIO = "9x9-stochastic"
_LISTED = _list_scenarios()
SCENARIOS = {DEFAULT_SCENARIO: _LISTED[DEFAULT_SCENARIO], **_LISTED}
