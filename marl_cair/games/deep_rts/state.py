"""The state of Deep RTS: a few tables with named columns, first axis B worlds.

One table per kind of thing, not one array per field: the compiler handles every array that a rule
takes as seven values, and with sixty of them compiling took minutes and each call 200 ns.

A cell is an index into the board with a border of walls around it: (row + 1) * (columns + 2) +
column + 1, so that no rule asks for the edge. Unit slots 0..U-1 belong to the players in blocks of
`slots_per_player`; a player's `roster` lists its slots from the oldest unit to the newest.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game_package import allocate_world
from marl_cair.games.loops import make_world_at

NO_UNIT = -1
NO_GOAL = 0  # the corner of the border, where nothing is
STRUCK, TOOK = -1, -2  # marks in UNIT_EXIT of units that did so in this tick
UNKNOWN = 255  # a tile that a player has never seen
NEVER = 2**31 - 1
QUEUE_LENGTH = 5
PATH_STEPS = 21  # steps of 3 bits in a word

RUNNING, TERMINATED, TRUNCATED = range(3)
# The states of a unit, each until it is due.
IDLE, WALKING, GATHERING, FIGHTING, REPAIRING, WAITING, INSIDE, RISING, TRAINING, PUMPING = range(
    10
)
# The orders of a unit.
NO_ORDER, MOVE, HARVEST, RETURN, ATTACK, ADVANCE, REPAIR = range(7)

# --- columns -----------------------------------------------------------------------------------

NUM_CLOCK = 13
(
    TICK,  # ticks played
    PHASE,  # RUNNING, TERMINATED or TRUNCATED
    WINNER,  # seat (the first of a team), or NO_WINNER
    MAP_INDEX,  # which of the scenario's maps
    WAKE,  # the tick before which no unit has anything to do
    NUM_BURNING,  # units on lava
    NUM_SEARCHES,  # path searches, which mark the cells that they reach
    NUM_ACTING,  # units that are due in this tick
    NUM_FALLEN,  # units without health that are still on the board
    DESTINATION,  # scratch, four columns: where a unit goes, see behaviour.py
) = range(10)

NUM_LAYERS = 7
(
    TILE,  # kind
    AMOUNT,  # resource units left; below 0 where several took the last
    OCCUPANT,  # unit slot, or NO_UNIT
    CLAIM,  # scratch of a tick: the unit or the players that want the cell
    REACHED,  # scratch of a search: the number of the last that came here
    CAME,  # scratch of a search: direction in which it came
    FRONTIER,  # scratch of a search: cells in the order of reaching; of `grid`: orders taken
) = range(NUM_LAYERS)

(
    IS_ALIVE,  # 1 until the player is out
    FOOD_USED,  # eaten by units, those in training included
    FOOD_MADE,
    CURSOR,  # selected slot, or NO_UNIT
    DAMAGE_DONE,  # hit points taken from others
    DAMAGE_TAKEN,
    NEXT_SERIAL,
    NUM_UNITS,
    IS_OUT,  # 1 once no player of its team is alive and that has been paid
    RESOURCES,  # a column per resource: in store
) = range(10)
GATHERED = RESOURCES + t.NUM_RESOURCES  # taken from tiles since reset, yield included
UPGRADES = GATHERED + t.NUM_RESOURCES  # levels
NUM_CREATED = UPGRADES + t.NUM_UPGRADES  # a column per kind: finished since reset
NUM_OWNED = NUM_CREATED + t.NUM_KINDS  # alive, unfinished ones included
NUM_PLAYER_COLUMNS = NUM_OWNED + t.NUM_KINDS

(
    UNIT_KIND,  # or NO_KIND: the slot is free
    UNIT_STATE,
    UNIT_CELL,  # where it stands; the centre of a building
    UNIT_HEALTH,  # hit points
    UNIT_ORDER,
    UNIT_FACING,  # direction
    UNIT_GOAL,  # cell that the order is about
    UNIT_TARGET,  # slot that the order is about, or NO_UNIT
    UNIT_TARGET_SERIAL,  # separates a slot's new unit from its old one
    UNIT_PATH_STEPS,  # steps in `path`
    UNIT_BLOCKED,  # failed steps and plans in a row
    UNIT_EXIT,  # cell that it claims in this tick, NO_GOAL, STRUCK or TOOK
    UNIT_SERIAL,  # creation index within its owner, from 1
    UNIT_SINCE,  # tick at which the state began
    UNIT_READY,  # tick from which it may strike again
    UNIT_CARRY,  # resource units that it carries
    UNIT_CARRY_KIND,  # their resource, or NO_RESOURCE
    UNIT_PARTNER,  # the builder of a site, the site of a builder
    UNIT_RALLY,  # cell to which new units go, or NO_GOAL
    UNIT_HURT,  # hit points to lose in this tick
    UNIT_HURT_BY,  # the nearest unit that strikes it in this tick
    UNIT_QUEUE_LENGTH,
    UNIT_QUEUE,  # QUEUE_LENGTH columns of products
) = range(23)
NUM_UNIT_COLUMNS = UNIT_QUEUE + QUEUE_LENGTH


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P players, C unit slots of a player, U = P * C, N cells with the border, S cells of fog.
    """

    clock: Annotated[NDArray[np.int32], "NUM_CLOCK"]
    seed: Annotated[NDArray[np.uint64], "1"]  # word from which all dice of the game are hashed
    board: Annotated[NDArray[np.int16], "NUM_LAYERS N"]
    players: Annotated[NDArray[np.int32], "P NUM_PLAYER_COLUMNS"]
    illegal: Annotated[NDArray[np.int32], "P"]  # illegal actions since reset
    roster: Annotated[NDArray[np.int16], "P C"]  # slots
    vision: Annotated[NDArray[np.uint8], "P S"]  # own units that see the cell
    known: Annotated[NDArray[np.uint8], "P S"]  # seen last, or UNKNOWN; in a team's first seat
    units: Annotated[NDArray[np.int32], "U NUM_UNIT_COLUMNS"]
    due: Annotated[NDArray[np.int32], "U"]  # tick at which a unit's state ends, or NEVER
    path: Annotated[NDArray[np.uint64], "U"]  # directions ahead, 3 bits each, the next one lowest
    acting: Annotated[NDArray[np.int16], "U"]  # scratch of a tick: slots that are due


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    players, slots = scenario.num_players, scenario.slots_per_player
    return allocate_world(
        World,
        num_worlds,
        P=players,
        C=slots,
        U=players * slots,
        N=scenario.num_cells,
        S=scenario.num_cells if scenario.fog else 1,
        NUM_CLOCK=NUM_CLOCK,
        NUM_LAYERS=NUM_LAYERS,
        NUM_PLAYER_COLUMNS=NUM_PLAYER_COLUMNS,
        NUM_UNIT_COLUMNS=NUM_UNIT_COLUMNS,
    )


world_at = make_world_at(World)
