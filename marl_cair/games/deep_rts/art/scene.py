"""Collects the drawn facts of a world of Deep RTS for one seat: a `Scene`, and `Piece`s.

Numba passes every array of a tuple to every call, so a `Scene` holds only arrays that are drawn.
The drawn facts of a unit are read once into a `Piece` of plain numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import direction_between, sees_unit
from marl_cair.games.deep_rts.tables import NO_RESOURCE, NUM_MOBILE_KINDS

SPECTATOR = -1  # sees all, from the side of the board itself
FLASH_TICKS = 4  # for which a blow, or an arrow in flight, is drawn
NO_BLOW = -1
_SOUTH = 2


class Scene(NamedTuple):
    """One world and its rules, by their names there, with the viewer and its place on an image."""

    viewer: int  # seat, or SPECTATOR
    tile_side: int  # pixels
    top: int  # pixels over the board
    left: int
    tick: int
    rows: int
    columns: int
    stride: int
    num_players: int
    slots: int
    fog: int
    own_cell: Any  # of the viewer's frame, as the next two
    world_cell: Any
    own_direction: Any
    cells: Any
    team: Any
    kinds: Any
    tiles: Any
    board: Any
    vision: Any
    known: Any
    players: Any
    units: Any
    due: Any


class Piece(NamedTuple):
    """The drawn facts of a unit or building; pixels are those of the image."""

    kind: int
    owner: int
    colour: int  # row of PALETTES
    state: int
    top: int
    left: int
    size: int
    direction: int  # as the view shows it
    done_percent: int  # of what it does
    health_percent: int
    ticks: int  # since its state began
    blow_ticks: int  # since it struck, or NO_BLOW
    carry_kind: int  # resource on its back, or NO_RESOURCE


@compiled_compact
def scene_of(
    worlds: Any, rules: Any, index: int, viewer: int, tile_side: int, top: int, left: int
) -> Any:
    """The scene of one world among many, for a seat or the SPECTATOR."""
    world = s.world_at(worlds, index)
    frame = 0
    if viewer != SPECTATOR:
        frame = int(rules.seats[world.clock[s.MAP_INDEX], viewer, rb.SEAT_FRAME])
    return Scene(
        viewer,
        tile_side,
        top,
        left,
        int(world.clock[s.TICK]),
        rules.rows,
        rules.columns,
        rules.stride,
        rules.num_players,
        rules.slots,
        rules.fog,
        rules.own_cell[frame],
        rules.world_cell[frame],
        rules.own_direction[frame],
        rules.cells,
        rules.team,
        rules.kinds,
        rules.tiles,
        world.board,
        world.vision,
        world.known,
        world.players,
        world.units,
        world.due,
    )


@compiled_compact
def colour_of(team: Any, viewer: int, owner: int) -> int:
    """Row of PALETTES: the seat's number for a spectator; for a seat itself first, then its team,
    then the others, each in the order of seats after its own. `team` int8 [P].
    """
    if viewer in (SPECTATOR, owner):
        return owner if viewer == SPECTATOR else 0
    players = len(team)
    is_ally = team[owner] == team[viewer]
    behind = (owner - viewer) % players
    rank = 1
    for step in range(1, players):
        other_is_ally = team[(viewer + step) % players] == team[viewer]
        if (other_is_ally and not is_ally) or (other_is_ally == is_ally and step < behind):
            rank += 1
    return rank


@compiled_compact
def stands_at(scene: Any, cell: int) -> int:
    """The unit with this middle cell, NO_UNIT if there is none or the viewer does not see it."""
    unit = int(scene.board[s.OCCUPANT, cell])
    if unit == s.NO_UNIT or scene.units[unit, s.UNIT_CELL] != cell:
        return s.NO_UNIT
    if scene.viewer != SPECTATOR and not sees_unit(scene, scene, scene.viewer, unit):
        return s.NO_UNIT
    return unit


@compiled_compact
def target_in_sight(scene: Any, unit: int) -> int:
    """The unit that a unit attacks or repairs, NO_UNIT if the viewer does not see it."""
    target = int(scene.units[unit, s.UNIT_TARGET])
    if target == s.NO_UNIT or scene.units[target, s.UNIT_KIND] < 0:
        return s.NO_UNIT
    if scene.units[target, s.UNIT_SERIAL] != scene.units[unit, s.UNIT_TARGET_SERIAL]:
        return s.NO_UNIT
    return stands_at(scene, int(scene.units[target, s.UNIT_CELL]))


@compiled_compact
def facing_of(scene: Any, unit: int) -> int:
    """Direction that a unit faces in the view: to its target or its work, else ahead."""
    cell, state = int(scene.units[unit, s.UNIT_CELL]), int(scene.units[unit, s.UNIT_STATE])
    direction, faced = int(scene.units[unit, s.UNIT_FACING]), rb.NO_DIRECTION
    if state == s.GATHERING:
        faced = direction_between(scene, cell, int(scene.units[unit, s.UNIT_GOAL]))
    elif state in (s.FIGHTING, s.REPAIRING):
        target = target_in_sight(scene, unit)
        if target != s.NO_UNIT:
            faced = direction_between(scene, cell, int(scene.units[target, s.UNIT_CELL]))
    if faced != rb.NO_DIRECTION:
        direction = faced
    for own in range(rb.NUM_DIRECTIONS):
        if scene.own_direction[own] == direction:
            return own
    return _SOUTH


@compiled_compact
def forward_pixels(side: int, state: int, ticks: int, done_percent: int, strikes: bool) -> int:
    """Pixels by which a unit is drawn ahead of its cell: it walks, gathers or strikes."""
    if state == s.WALKING:
        return side * done_percent // 100
    if state == s.GATHERING and ticks // 2 % 2 == 1:
        return side // 12
    return side // 6 if strikes else 0


@compiled_compact
def piece_of(scene: Any, unit: int) -> Any:
    """The `Piece` of a unit on the board.

    Only the owner and the spectator see a unit's movement, direction and progress. Others see it
    face south, in the middle of its cell.
    """
    kind, owner = int(scene.units[unit, s.UNIT_KIND]), int(unit // scene.slots)
    state, side = int(scene.units[unit, s.UNIT_STATE]), scene.tile_side
    is_open = scene.viewer in (SPECTATOR, owner)
    ticks = 0
    if is_open or state == s.RISING:
        ticks = scene.tick - int(scene.units[unit, s.UNIT_SINCE])
    lasts = max(1, int(scene.due[unit]) - int(scene.units[unit, s.UNIT_SINCE]))
    done_percent = max(0, min(100, 100 * ticks // lasts))
    blow_ticks = NO_BLOW
    if state == s.FIGHTING:
        age = scene.tick - int(scene.units[unit, s.UNIT_READY])
        age += int(scene.kinds[kind, rb.KIND_ATTACK_TICKS])
        if 0 <= age < FLASH_TICKS:
            blow_ticks = age
    own = int(scene.own_cell[scene.units[unit, s.UNIT_CELL]])
    half = int(scene.kinds[kind, rb.KIND_HALF_SIZE])
    top = scene.top + (own // scene.columns - half) * side
    left = scene.left + (own % scene.columns - half) * side
    direction = _SOUTH
    if kind < NUM_MOBILE_KINDS and is_open:
        direction = facing_of(scene, unit)
        strikes = blow_ticks != NO_BLOW and scene.kinds[kind, rb.KIND_RANGE_TILES] <= 1
        ahead = forward_pixels(side, state, ticks, done_percent, strikes)
        top += ahead * rb.ROW_STEP[direction]
        left += ahead * rb.COLUMN_STEP[direction]
    health, carry_kind = max(0, int(scene.units[unit, s.UNIT_HEALTH])), NO_RESOURCE
    if scene.units[unit, s.UNIT_CARRY] > 0:
        carry_kind = int(scene.units[unit, s.UNIT_CARRY_KIND])
    return Piece(
        kind=kind,
        owner=owner,
        colour=colour_of(scene.team, scene.viewer, owner),
        state=state,
        top=top,
        left=left,
        size=(2 * half + 1) * side,
        direction=direction,
        done_percent=done_percent,
        health_percent=100 * health // int(scene.kinds[kind, rb.KIND_HEALTH]),
        ticks=ticks,
        blow_ticks=blow_ticks,
        carry_kind=carry_kind,
    )
