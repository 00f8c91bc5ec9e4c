"""The constants of a scenario, as the numbers and arrays that the compiled rules read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_maze import scenarios as sc
from marl_cair.games.deep_maze import tables as t
from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.game_package import fill_record

PRIM, GROWTH = range(len(sc.GENERATORS))
DETERMINISTIC, FULL_DETERMINISTIC, STOCHASTIC, SEQUENCE = range(len(sc.MODES))
FULL_SIGHT, SQUARE, LINE_OF_SIGHT = range(len(sc.VISIBILITIES))
RACE, CHASE = range(len(sc.CONTESTS))
CLASSIC, BEYOND_OPTIMAL, DISTANCE = range(len(sc.REWARDS))

HUNTER = 0  # the seat that hunts in a chase


class Rules(NamedTuple):
    """The constants of a scenario, handed to the kernels so that none is compiled in."""

    neighbours: NDArray[np.int16]  # [cells, actions] where an action leads; off the board: nowhere
    step_reward: NDArray[np.float64]  # [P] of each move that does not end the game
    fixed_seed: NDArray[np.uint64]  # [1] of the mazes that are the same in each game
    rows: int
    columns: int
    generator: int
    growth_seeds: int  # walls that are begun
    growth_steps: int  # tries to grow each of them by two cells
    mode: int
    num_mazes: int
    in_corners: int  # 1: start and goal lie in opposite corners
    visibility: int
    vision: int  # cells
    preview_moves: int
    remembers: int
    num_players: int
    contest: int
    starts_apart: int  # 1: no player of a chase starts beside the goal
    reward: int
    shaping_discount: float
    mask_walls: int
    cell_pixels: int
    max_ticks: int


def make_rules(scenario: Scenario) -> Rules:
    """The numbers of `scenario`."""
    rows, columns = scenario.rows, scenario.columns
    growth_steps = scenario.complexity * t.GROWTH_STEPS_PER_SIDE_CELL * (rows + columns)
    return fill_record(
        Rules,
        scenario,
        neighbours=_neighbour_table(rows, columns),
        step_reward=_step_rewards(scenario),
        fixed_seed=[scenario.maze_seed],
        generator=list(sc.GENERATORS).index(scenario.generator),
        growth_seeds=scenario.density * (rows // 2) * (columns // 2),
        growth_steps=growth_steps,
        mode=list(sc.MODES).index(scenario.mode),
        in_corners=scenario.places == "corners",
        visibility=list(sc.VISIBILITIES).index(scenario.visibility),
        contest=CHASE if scenario.is_chase else RACE,
        # Five of 100,000 games of 15x15-chase-4p would start elsewhere than in version 1.
        starts_apart=scenario.is_chase and not scenario.has_open_ways,
        reward=list(sc.REWARDS).index(scenario.reward),
    )


def _neighbour_table(rows: int, columns: int) -> NDArray[np.int16]:
    """Where each action leads from each cell: nowhere for the no-op and moves off the board."""
    cells = np.arange(rows * columns)
    row, column = np.divmod(cells, columns)
    table = np.repeat(cells.astype(np.int16)[:, None], len(t.ACTION_NAMES), axis=1)
    for move in range(t.NUM_MOVES):
        to_row, to_column = row + t.ROW_STEP[move], column + t.COLUMN_STEP[move]
        inside = (to_row >= 0) & (to_row < rows) & (to_column >= 0) & (to_column < columns)
        table[inside, move] = (to_row * columns + to_column)[inside]
    return table


def _step_rewards(scenario: Scenario) -> NDArray[np.float64]:
    """Every move costs, except those of hunted players."""
    paid = np.full(scenario.num_players, t.STEP_REWARD)
    if scenario.reward == "beyond_optimal":
        paid[:] = 0.0
    if scenario.is_chase:
        paid[HUNTER + 1 :] = 0.0
    return paid
