"""Where units stand: distances, placing and taking away, sight and the fog of war."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb

LAST_STRAIGHT = 3  # directions above are diagonals


@compiled_copy
def owner_of(rules: Any, unit: int) -> int:
    """The player whose unit slot it is."""
    return int(unit // rules.slots)


@compiled_copy
def is_building(world: Any, unit: int) -> bool:
    """True where the unit cannot walk."""
    return bool(world.units[unit, s.UNIT_KIND] >= t.NUM_MOBILE_KINDS)


@compiled
def box_distance(rules: Any, cell: int, centre: int, half: int) -> int:
    """Squared distance in cells from `cell` to the nearest cell of a square around `centre`."""
    rows = abs(int(rules.cells[cell, rb.CELL_ROW]) - int(rules.cells[centre, rb.CELL_ROW])) - half
    columns = (
        abs(int(rules.cells[cell, rb.CELL_COLUMN]) - int(rules.cells[centre, rb.CELL_COLUMN]))
        - half
    )
    rows, columns = max(0, rows), max(0, columns)
    return rows * rows + columns * columns


@compiled_copy
def reach_of(rules: Any, kind: int) -> int:
    """Squared distances below this are in the range of a kind; a range of 1 takes in diagonals."""
    return int((rules.kinds[kind, rb.KIND_RANGE_TILES] + 1) ** 2)


@compiled
def unit_distance(world: Any, rules: Any, cell: int, unit: int) -> int:
    """Squared distance from `cell` to the nearest cell that `unit` covers."""
    half = rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_HALF_SIZE]
    return box_distance(rules, cell, int(world.units[unit, s.UNIT_CELL]), int(half))


@compiled_copy
def is_ground(world: Any, rules: Any, cell: int) -> bool:
    """True where a unit can walk if no unit stands there."""
    return bool(rules.tiles[world.board[s.TILE, cell], rb.WALK_PERCENT] > 0)


@compiled_copy
def is_free(world: Any, rules: Any, cell: int) -> bool:
    """True where a unit can stand now."""
    return bool(
        world.board[s.OCCUPANT, cell] == s.NO_UNIT
        and rules.tiles[world.board[s.TILE, cell], rb.WALK_PERCENT] > 0
    )


@compiled
def is_solid(world: Any, rules: Any, cell: int) -> bool:
    """Walls, resources and buildings: no unit squeezes past their corners."""
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

    Who sets out in this very tick walks for its fellows, even before it has decided, and stands
    for all others, even after it: so it does not matter which player's units decide first.
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
    return walks_on(world, rules, unit, occupant)


@compiled
def walks_on(world: Any, rules: Any, unit: int, other: int) -> bool:
    """True where `unit` takes `other` for a walker: a foreign one from the tick after its start."""
    is_own = owner_of(rules, other) == owner_of(rules, unit)
    has_gone = is_own or world.units[other, s.UNIT_SINCE] < world.clock[s.TICK]
    return bool(has_gone and world.units[other, s.UNIT_STATE] == s.WALKING)


@compiled
def direction_between(rules: Any, cell: int, other: int) -> int:
    """The direction of the first step of a straight walk, NO_DIRECTION on the spot."""
    rows = int(rules.cells[other, rb.CELL_ROW]) - int(rules.cells[cell, rb.CELL_ROW])
    columns = int(rules.cells[other, rb.CELL_COLUMN]) - int(rules.cells[cell, rb.CELL_COLUMN])
    if rows == 0:
        if columns == 0:
            return rb.NO_DIRECTION
        return 1 if columns > 0 else 3
    if columns == 0:
        return 0 if rows < 0 else 2
    if rows < 0:
        return 4 if columns > 0 else 7
    return 5 if columns > 0 else 6


# --- the fog of war --------------------------------------------------------------------------


@compiled
def change_sight(
    world: Any, rules: Any, player: int, centre: int, radius: int, change: int
) -> None:
    """Count a unit in (`change` 1) or out (-1) of those of `player` that see the cells around."""
    row, column = int(rules.cells[centre, rb.CELL_ROW]), int(rules.cells[centre, rb.CELL_COLUMN])
    for away in range(-radius, radius + 1):
        if row + away < 0 or row + away >= rules.rows:
            continue
        span = int(rules.sight_span[radius, abs(away)])
        left, right = max(0, column - span), min(rules.columns - 1, column + span)
        first = (row + away + 1) * rules.stride + 1
        for cell in range(first + left, first + right + 1):
            world.vision[player, cell] = int(world.vision[player, cell]) + change
            if change > 0:
                world.known[player, cell] = world.board[s.TILE, cell]


@compiled_copy
def sight_of(rules: Any, kind: int) -> int:
    """Cells that a kind sees from its centre."""
    return int(min(15, rules.kinds[kind, rb.KIND_SIGHT] + rules.kinds[kind, rb.KIND_HALF_SIZE]))


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
    centre, half = (
        int(world.units[unit, s.UNIT_CELL]),
        int(rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_HALF_SIZE]),
    )
    for row in range(-half, half + 1):
        for column in range(-half, half + 1):
            if sees(world, rules, player, centre + row * rules.stride + column):
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
    """What the player's team saw last of a cell that is out of its sight, or UNKNOWN."""
    for other in range(rules.num_players):
        if rules.team[other] == rules.team[player] and world.known[other, cell] != s.UNKNOWN:
            return int(world.known[other, cell])
    return s.UNKNOWN


# --- placing -----------------------------------------------------------------------------------


@compiled
def cover(world: Any, rules: Any, unit: int, occupant: int) -> None:
    """Mark the cells of a unit as held by `occupant`."""
    centre, half = (
        int(world.units[unit, s.UNIT_CELL]),
        int(rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_HALF_SIZE]),
    )
    for row in range(-half, half + 1):
        for column in range(-half, half + 1):
            world.board[s.OCCUPANT, centre + row * rules.stride + column] = occupant


@compiled
def put_on_board(world: Any, rules: Any, unit: int, cell: int) -> None:
    """Let a unit stand at `cell` (the centre of a building) and look around."""
    world.units[unit, s.UNIT_CELL] = cell
    cover(world, rules, unit, unit)
    kind = world.units[unit, s.UNIT_KIND]
    if rules.tiles[world.board[s.TILE, cell], rb.TILE_DAMAGE] > 0:
        world.clock[s.NUM_BURNING] += 1
    if rules.fog != 0:
        change_sight(world, rules, owner_of(rules, unit), cell, sight_of(rules, kind), 1)


@compiled
def take_off_board(world: Any, rules: Any, unit: int) -> None:
    """Free the cells of a unit and close its eyes."""
    cell = int(world.units[unit, s.UNIT_CELL])
    cover(world, rules, unit, s.NO_UNIT)
    if rules.tiles[world.board[s.TILE, cell], rb.TILE_DAMAGE] > 0:
        world.clock[s.NUM_BURNING] -= 1
    if rules.fog != 0:
        kind = world.units[unit, s.UNIT_KIND]
        change_sight(world, rules, owner_of(rules, unit), cell, sight_of(rules, kind), -1)


@compiled
def change_tile(world: Any, rules: Any, cell: int, tile: int) -> None:
    """A resource is used up; those who see it remember what is left."""
    world.board[s.TILE, cell] = tile
    world.board[s.AMOUNT, cell] = 0
    if rules.fog != 0:
        for player in range(rules.num_players):
            if world.vision[player, cell] > 0:
                world.known[player, cell] = tile


@compiled_copy
def is_finished(world: Any, unit: int) -> bool:
    """False for a building that still rises."""
    return bool(world.units[unit, s.UNIT_STATE] != s.RISING)
