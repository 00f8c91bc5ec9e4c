"""Units on the board: distances, placing and removing, sight and the fog of war."""

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb

LAST_STRAIGHT = 3  # directions above are diagonals
MAX_SIGHT = 15


@compiled_copy
def owner_of(rules: Any, unit: int) -> int:
    """The player whose unit slot it is."""
    return int(unit // rules.slots)


@compiled_copy
def kind_value(world: Any, rules: Any, unit: int, column: int) -> int:
    """A number of the unit's kind: a column of `rules.kinds`."""
    return int(rules.kinds[world.units[unit, s.UNIT_KIND], column])


@compiled_copy
def tile_value(world: Any, rules: Any, cell: int, column: int) -> int:
    """A number of the tile at a cell: a column of `rules.tiles`."""
    return int(rules.tiles[world.board[s.TILE, cell], column])


@compiled_copy
def frame_of(world: Any, rules: Any, player: int) -> int:
    """The frame of the player's own view: the first index of the `own_...` tables."""
    return int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME])


@compiled_copy
def is_building(world: Any, unit: int) -> bool:
    """True for units that cannot walk."""
    return bool(world.units[unit, s.UNIT_KIND] >= t.NUM_MOBILE_KINDS)


@compiled_copy
def is_finished(world: Any, unit: int) -> bool:
    """False for a construction site."""
    return bool(world.units[unit, s.UNIT_STATE] != s.RISING)


@compiled_copy
def can_gather(world: Any, rules: Any, cell: int) -> bool:
    """True where a peasant can gather by hand (oil needs a well)."""
    resource = rules.tiles[world.board[s.TILE, cell], rb.TILE_RESOURCE]
    return bool(resource not in (t.NO_RESOURCE, t.OIL) and world.board[s.AMOUNT, cell] > 0)


# --- distances ---------------------------------------------------------------------------------


@compiled
def steps_between(rules: Any, cell: int, other: int) -> tuple[int, int]:
    """Rows and columns from one cell to another."""
    rows = int(rules.cells[other, rb.CELL_ROW]) - int(rules.cells[cell, rb.CELL_ROW])
    columns = int(rules.cells[other, rb.CELL_COLUMN]) - int(rules.cells[cell, rb.CELL_COLUMN])
    return rows, columns


@compiled
def box_distance(rules: Any, cell: int, centre: int, half: int) -> int:
    """Squared distance in cells from `cell` to the nearest cell of a square around `centre`."""
    rows, columns = steps_between(rules, cell, centre)
    rows, columns = max(0, abs(rows) - half), max(0, abs(columns) - half)
    return rows * rows + columns * columns


@compiled
def unit_distance(world: Any, rules: Any, cell: int, unit: int) -> int:
    """Squared distance from `cell` to the nearest cell that `unit` covers."""
    half = kind_value(world, rules, unit, rb.KIND_HALF_SIZE)
    return box_distance(rules, cell, int(world.units[unit, s.UNIT_CELL]), half)


@compiled_copy
def reach_of(world: Any, rules: Any, unit: int) -> int:
    """Squared distances below this are in the unit's range; a range of 1 includes diagonals."""
    return int((rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_RANGE_TILES] + 1) ** 2)


@compiled
def direction_between(rules: Any, cell: int, other: int) -> int:
    """The direction of the first step of a straight walk, NO_DIRECTION on the spot."""
    rows, columns = steps_between(rules, cell, other)
    if rows == 0:
        if columns == 0:
            return rb.NO_DIRECTION
        return 1 if columns > 0 else 3
    if columns == 0:
        return 0 if rows < 0 else 2
    if rows < 0:
        return 4 if columns > 0 else 7
    return 5 if columns > 0 else 6


# --- passing -----------------------------------------------------------------------------------


@compiled_copy
def is_free(world: Any, rules: Any, cell: int) -> bool:
    """True where a unit can stand now."""
    is_ground = rules.tiles[world.board[s.TILE, cell], rb.WALK_PERCENT] > 0
    return bool(is_ground and world.board[s.OCCUPANT, cell] == s.NO_UNIT)


@compiled
def is_solid(world: Any, rules: Any, cell: int) -> bool:
    """True for walls, resources and buildings: no unit passes their corners diagonally."""
    if rules.tiles[world.board[s.TILE, cell], rb.WALK_PERCENT] == 0:
        return True
    occupant = world.board[s.OCCUPANT, cell]
    return bool(occupant != s.NO_UNIT and is_building(world, occupant))


@compiled
def cuts_corner(world: Any, rules: Any, cell: int, direction: int) -> bool:
    """True for a diagonal step from `cell` past something solid."""
    if direction <= LAST_STRAIGHT:
        return False
    # Diagonal 4 + i lies between the straight directions i and i + 1.
    beside = cell + rules.offset[direction - 4]
    other = cell + rules.offset[(direction - 3) % 4]
    return is_solid(world, rules, beside) or is_solid(world, rules, other)


@compiled
def is_passable(world: Any, rules: Any, unit: int, cell: int) -> bool:
    """True where a path of `unit` may lead: ground that is not lava, free or held by a walker.

    A unit that starts to walk in this tick counts as a walker for units of its owner, even before
    it has decided, and as standing for all others, even after. So the result does not depend on
    which player's units decide first.
    """
    tile = world.board[s.TILE, cell]
    if tile == t.LAVA or rules.tiles[tile, rb.WALK_PERCENT] == 0:
        return False
    occupant = world.board[s.OCCUPANT, cell]
    if occupant == s.NO_UNIT:
        return True
    is_own = owner_of(rules, occupant) == owner_of(rules, unit)
    if is_own and world.units[occupant, s.UNIT_STATE] in (s.IDLE, s.WAITING):
        will_decide = world.due[occupant] <= world.clock[s.TICK]
        return bool(will_decide and world.units[occupant, s.UNIT_ORDER] != s.NO_ORDER)
    return is_walking_for(world, rules, unit, occupant)


@compiled
def is_walking_for(world: Any, rules: Any, unit: int, other: int) -> bool:
    """True where `other` counts as a walker for `unit`; see `is_passable`."""
    is_own = owner_of(rules, other) == owner_of(rules, unit)
    has_started = is_own or world.units[other, s.UNIT_SINCE] < world.clock[s.TICK]
    return bool(has_started and world.units[other, s.UNIT_STATE] == s.WALKING)


# --- the fog of war --------------------------------------------------------------------------


@compiled_copy
def sight_of(rules: Any, kind: int) -> int:
    """Cells that a kind sees from its centre."""
    sight = rules.kinds[kind, rb.KIND_SIGHT] + rules.kinds[kind, rb.KIND_HALF_SIZE]
    return int(min(MAX_SIGHT, sight))


@compiled
def sees(world: Any, rules: Any, player: int, cell: int) -> bool:
    """True where the player or its team has a unit in sight of the cell."""
    if rules.fog == 0:
        return True
    for other in range(rules.num_players):
        if rules.team[other] == rules.team[player] and world.vision[other, cell] > 0:
            return True
    return False


@compiled
def sees_unit(world: Any, rules: Any, player: int, unit: int) -> bool:
    """True where any cell that the unit covers is in sight."""
    if rules.fog == 0:
        return True
    half = kind_value(world, rules, unit, rb.KIND_HALF_SIZE)
    for row in range(-half, half + 1):
        for column in range(-half, half + 1):
            cell = int(world.units[unit, s.UNIT_CELL]) + row * rules.stride + column
            if sees(world, rules, player, cell):
                return True
    return False


@compiled
def known_tile(world: Any, rules: Any, player: int, cell: int) -> int:
    """The tile that the player believes to be there, UNKNOWN where it has never looked."""
    if sees(world, rules, player, cell):
        return int(world.board[s.TILE, cell])
    return remembered_tile(world, rules, player, cell)


@compiled
def remembered_tile(world: Any, rules: Any, player: int, cell: int) -> int:
    """The tile that the player's team saw last at a cell out of its sight, or UNKNOWN."""
    return int(world.known[rules.team[player], cell])


# --- placing -----------------------------------------------------------------------------------


@compiled
def count_unit(world: Any, rules: Any, unit: int, change: int) -> None:
    """Count a unit in (1) or out (-1) at its cell: among units on lava, and in its sight."""
    cell = int(world.units[unit, s.UNIT_CELL])
    if tile_value(world, rules, cell, rb.TILE_DAMAGE) > 0:
        world.clock[s.NUM_BURNING] += change
    if rules.fog == 0:
        return
    player, radius = owner_of(rules, unit), sight_of(rules, world.units[unit, s.UNIT_KIND])
    row, column = int(rules.cells[cell, rb.CELL_ROW]), int(rules.cells[cell, rb.CELL_COLUMN])
    for away in range(-radius, radius + 1):
        if row + away < 0 or row + away >= rules.rows:
            continue
        span = int(rules.sight_span[radius, abs(away)])
        left, right = max(0, column - span), min(rules.columns - 1, column + span)
        first = (row + away + 1) * rules.stride + 1
        for seen in range(first + left, first + right + 1):
            world.vision[player, seen] = int(world.vision[player, seen]) + change
            if change > 0:
                world.known[rules.team[player], seen] = world.board[s.TILE, seen]


@compiled
def cover(world: Any, rules: Any, unit: int, occupant: int) -> None:
    """Mark the cells of a unit as held by `occupant`."""
    half = kind_value(world, rules, unit, rb.KIND_HALF_SIZE)
    for row in range(-half, half + 1):
        for column in range(-half, half + 1):
            cell = int(world.units[unit, s.UNIT_CELL]) + row * rules.stride + column
            world.board[s.OCCUPANT, cell] = occupant


@compiled
def put_on_board(world: Any, rules: Any, unit: int, cell: int) -> None:
    """Place a unit at `cell` (the centre of a building)."""
    world.units[unit, s.UNIT_CELL] = cell
    cover(world, rules, unit, unit)
    count_unit(world, rules, unit, 1)


@compiled
def take_off_board(world: Any, rules: Any, unit: int) -> None:
    """Free the cells of a unit, which sees nothing any more."""
    cover(world, rules, unit, s.NO_UNIT)
    count_unit(world, rules, unit, -1)
