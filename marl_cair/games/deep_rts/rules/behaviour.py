"""How a unit carries out its order: it makes a wish, goes there, and works when it has arrived.

A wish is four columns of the clock (goal cell, half size of the box around it, reach, resource):
be within reach of the box, or beside the nearest tile of the resource. Search and step stand at one
place only, because all of this is inlined.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.rules.board import (
    box_distance,
    cuts_corner,
    owner_of,
    reach_of,
    walks_on,
)
from marl_cair.games.deep_rts.rules.combat import aim_at, find_enemy, has_target, is_soldier
from marl_cair.games.deep_rts.rules.motion import (
    LONGEST_WAIT_TICKS,
    begin_step,
    get_stuck,
    is_fellow_coming,
)
from marl_cair.games.deep_rts.rules.paths import (
    ANY_RESOURCE,
    NEXT_TO,
    NOT_FOR_RESOURCE,
    NOWHERE,
    ON_THE_SPOT,
    drop_step,
    forget_path,
    may_enter,
    next_direction,
    plan_straight,
    resource_beside,
    search,
)
from marl_cair.games.deep_rts.rules.roster import enter_state
from marl_cair.games.deep_rts.rules.rulebook import KIND_HALF_SIZE, SEAT_FRAME, TILE_RESOURCE
from marl_cair.games.deep_rts.rules.work import (
    REPAIR_TICKS,
    can_repair,
    deliver,
    is_used_up,
    nearest_hall,
    run_building,
)
from marl_cair.games.deep_rts.state import (
    ADVANCE,
    ATTACK,
    FIGHTING,
    GATHERING,
    HARVEST,
    IDLE,
    MAP_INDEX,
    MOVE,
    NEVER,
    NO_GOAL,
    NO_ORDER,
    NO_UNIT,
    OCCUPANT,
    REPAIR,
    REPAIRING,
    RETURN,
    TICK,
    TILE,
    UNIT_BLOCKED,
    UNIT_CARRY,
    UNIT_CARRY_KIND,
    UNIT_CELL,
    UNIT_GOAL,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_PATH_STEPS,
    UNIT_READY,
    UNIT_SERIAL,
    UNIT_TARGET,
    UNIT_TARGET_SERIAL,
    WISH,
)
from marl_cair.games.deep_rts.tables import (
    NO_KIND,
    NO_RESOURCE,
    NUM_MOBILE_KINDS,
    TOWN_HALL,
)

WATCH_TICKS = 5  # between two looks around of an idle soldier
PATIENCE = 3  # vain plans (14 ticks) after which a unit looks for something else to do
LONG_PATIENCE = 5  # the same (62 ticks) of one that has only a way to go
MAX_THOUGHTS = 6  # changes of mind within a tick
GOAL, HALF, REACH, RESOURCE = range(4)  # of a wish
NOTHING, SOMEWHERE, AGAIN = range(3)  # what a unit wishes
ARRIVED, ON_THE_WAY, STUCK, FOUND = range(4)  # how the way goes


@compiled_copy
def wish_for(world: Any, goal: int, half: int, reach: int) -> int:
    """Wish to be near a box."""
    world.clock[WISH + GOAL] = goal
    world.clock[WISH + HALF] = half
    world.clock[WISH + REACH] = reach
    world.clock[WISH + RESOURCE] = NOT_FOR_RESOURCE
    return SOMEWHERE


@compiled
def forget_order(world: Any, unit: int) -> None:
    """The order is done or given up."""
    world.units[unit, UNIT_ORDER] = NO_ORDER
    world.units[unit, UNIT_TARGET] = NO_UNIT
    forget_path(world, unit)


@compiled
def look_out(world: Any, rules: Any, unit: int) -> None:
    """Idle soldiers and those who advance turn to the enemy that they see."""
    order = world.units[unit, UNIT_ORDER]
    if order == ADVANCE:
        if has_target(world, rules, unit):
            return
    elif (
        order != NO_ORDER
        or rules.has_auto_attack == 0
        or not is_soldier(world.units[unit, UNIT_KIND])
    ):
        return
    enemy = find_enemy(world, rules, unit)
    if enemy == NO_UNIT:
        return
    aim_at(world, unit, enemy)
    forget_path(world, unit)
    if order == NO_ORDER:
        world.units[unit, UNIT_ORDER] = ATTACK


@compiled
def wish_to_fight(world: Any, rules: Any, unit: int) -> int:
    """Have the target in range; it may have moved, so the way is planned anew at each step."""
    target, kind = int(world.units[unit, UNIT_TARGET]), int(world.units[unit, UNIT_KIND])
    if world.units[unit, UNIT_BLOCKED] == 0:
        forget_path(world, unit)
    half = int(rules.kinds[world.units[target, UNIT_KIND], KIND_HALF_SIZE])
    return wish_for(world, int(world.units[target, UNIT_CELL]), half, reach_of(rules, kind))


@compiled
def wish_to_harvest(world: Any, rules: Any, unit: int) -> int:
    """Full hands go home; else to the tile, or to the nearest of its kind when it is used up."""
    goal, carries = int(world.units[unit, UNIT_GOAL]), int(world.units[unit, UNIT_CARRY])
    carried = int(world.units[unit, UNIT_CARRY_KIND])
    has_gone = is_used_up(world, rules, goal)
    is_other = not has_gone and carried != int(rules.tiles[world.board[TILE, goal], TILE_RESOURCE])
    if carries >= rules.carry_capacity or (carries > 0 and is_other):
        world.units[unit, UNIT_ORDER] = RETURN
        forget_path(world, unit)
        return AGAIN
    if not has_gone:
        return wish_for(world, goal, 0, NEXT_TO)
    wish_for(world, int(world.units[unit, UNIT_CELL]), 0, ON_THE_SPOT)
    world.clock[WISH + RESOURCE] = ANY_RESOURCE if carried == NO_RESOURCE else carried
    return SOMEWHERE


@compiled
def make_wish(world: Any, rules: Any, unit: int) -> int:
    """Where the unit's order leads it now: SOMEWHERE (see WISH), NOTHING, or think AGAIN."""
    order = world.units[unit, UNIT_ORDER]
    if order == NO_ORDER:
        return NOTHING
    if order == HARVEST:
        return wish_to_harvest(world, rules, unit)
    if order == RETURN:
        hall = nearest_hall(world, rules, unit)
        if hall != NO_UNIT:
            half = int(rules.kinds[TOWN_HALL, KIND_HALF_SIZE])
            return wish_for(world, int(world.units[hall, UNIT_CELL]), half, NEXT_TO)
    elif order == MOVE:
        return wish_for(world, int(world.units[unit, UNIT_GOAL]), 0, ON_THE_SPOT)
    elif order == REPAIR:
        building = int(world.units[unit, UNIT_TARGET])
        is_same = world.units[building, UNIT_SERIAL] == world.units[unit, UNIT_TARGET_SERIAL]
        if is_same and can_repair(world, rules, building):
            half = int(rules.kinds[world.units[building, UNIT_KIND], KIND_HALF_SIZE])
            return wish_for(world, int(world.units[building, UNIT_CELL]), half, NEXT_TO)
    elif has_target(world, rules, unit):
        return wish_to_fight(world, rules, unit)
    elif order == ADVANCE:
        if world.units[unit, UNIT_TARGET] != NO_UNIT:
            world.units[unit, UNIT_TARGET] = NO_UNIT
            forget_path(world, unit)
        return wish_for(world, int(world.units[unit, UNIT_GOAL]), 0, ON_THE_SPOT)
    forget_order(world, unit)
    return AGAIN


@compiled
def pursue(world: Any, rules: Any, unit: int) -> int:
    """One step towards the wish: ARRIVED, ON_THE_WAY, STUCK, or FOUND (a tile of the resource)."""
    goal, half = int(world.clock[WISH + GOAL]), int(world.clock[WISH + HALF])
    reach, resource = int(world.clock[WISH + REACH]), int(world.clock[WISH + RESOURCE])
    frame = rules.seats[world.clock[MAP_INDEX], owner_of(rules, unit), SEAT_FRAME]
    cell = int(world.units[unit, UNIT_CELL])
    needs_search = False
    if resource != NOT_FOR_RESOURCE:
        tile = resource_beside(world, rules, frame, cell, resource)
        if tile != NOWHERE:
            world.units[unit, UNIT_GOAL] = tile
            return FOUND
        needs_search = True
    else:
        if box_distance(rules, cell, goal, half) < reach:
            forget_path(world, unit)
            world.units[unit, UNIT_BLOCKED] = 0
            return ARRIVED
        check_path(world, rules, unit, goal, reach)
        if world.units[unit, UNIT_PATH_STEPS] == 0:
            needs_search = not plan_straight(world, rules, unit, goal, half, reach)
    if needs_search:
        end = search(world, rules, unit, goal, half, reach, resource)
        if end == NOWHERE:
            get_stuck(world, unit)
            return STUCK
        if resource != NOT_FOR_RESOURCE:
            world.units[unit, UNIT_GOAL] = resource_beside(world, rules, frame, end, resource)
            return FOUND
    direction = next_direction(world, unit)
    there = int(cell + rules.offset[direction])
    other = int(world.board[OCCUPANT, there])
    if (
        world.units[unit, UNIT_BLOCKED] > 0
        and other != NO_UNIT
        and not is_fellow_coming(world, rules, unit, there)
    ):
        if walks_on(world, rules, unit, other):
            world.units[unit, UNIT_BLOCKED] -= 1  # not in vain: it follows somebody who walks on
        get_stuck(world, unit)
        return STUCK
    drop_step(world, unit)
    begin_step(world, rules, unit, direction)
    return ON_THE_WAY


@compiled
def check_path(world: Any, rules: Any, unit: int, goal: int, reach: int) -> None:
    """Forget a path whose next step is not open any more."""
    if world.units[unit, UNIT_PATH_STEPS] > 0:
        cell, direction = int(world.units[unit, UNIT_CELL]), next_direction(world, unit)
        there = int(cell + rules.offset[direction])
        is_open = may_enter(world, rules, unit, there, goal, reach)
        if not is_open or cuts_corner(world, rules, cell, direction):
            forget_path(world, unit)


@compiled
def begin_work(world: Any, rules: Any, unit: int) -> bool:
    """Arrived: begin what the order is for. False where the unit must think again."""
    order = world.units[unit, UNIT_ORDER]
    tick = int(world.clock[TICK])
    if order == HARVEST:
        world.units[unit, UNIT_CARRY_KIND] = rules.tiles[
            world.board[TILE, world.units[unit, UNIT_GOAL]], TILE_RESOURCE
        ]
        enter_state(world, unit, GATHERING, tick + int(rules.harvest_ticks))
        return True
    if order == REPAIR:
        enter_state(world, unit, REPAIRING, tick + REPAIR_TICKS)
        return True
    if order == ATTACK or (order == ADVANCE and world.units[unit, UNIT_TARGET] != NO_UNIT):
        enter_state(world, unit, FIGHTING, max(tick + 1, int(world.units[unit, UNIT_READY])))
        return True
    if order == RETURN:
        deliver(world, rules, unit)
    else:
        forget_order(world, unit)
    return False


@compiled
def keeps_waiting(world: Any, unit: int) -> bool:
    """Stuck: wait on (True), or change the mind and think again."""
    order = world.units[unit, UNIT_ORDER]
    blocked = world.units[unit, UNIT_BLOCKED]
    if order == HARVEST and world.clock[WISH + RESOURCE] != NOT_FOR_RESOURCE:
        # There is no free place at any such tile.
        if world.units[unit, UNIT_CARRY] > 0:
            world.units[unit, UNIT_ORDER] = RETURN
            return False
        if world.units[unit, UNIT_CARRY_KIND] != NO_RESOURCE:
            world.units[unit, UNIT_CARRY_KIND] = NO_RESOURCE
            return False
        if blocked > 2 * PATIENCE:
            forget_order(world, unit)
            return False
        return True
    is_on_its_way = order in (MOVE, ADVANCE) and world.units[unit, UNIT_TARGET] == NO_UNIT
    if blocked <= (LONG_PATIENCE if is_on_its_way else PATIENCE) or order == RETURN:
        return True
    if order == HARVEST:
        world.units[unit, UNIT_GOAL] = NO_GOAL  # which is used up: the nearest free one is sought
        return False
    if order == ADVANCE and world.units[unit, UNIT_TARGET] != NO_UNIT:
        world.units[unit, UNIT_TARGET] = NO_UNIT
        forget_path(world, unit)
        return False
    was_fighting = order == ATTACK
    forget_order(world, unit)
    if was_fighting:
        enter_state(world, unit, IDLE, world.clock[TICK] + LONGEST_WAIT_TICKS)
    return bool(was_fighting)


@compiled
def decide(world: Any, rules: Any, unit: int) -> None:
    """Begin what comes next, where the unit lives and its time has come."""
    if world.units[unit, UNIT_KIND] == NO_KIND or world.due[unit] > world.clock[TICK]:
        return
    if world.units[unit, UNIT_KIND] >= NUM_MOBILE_KINDS:
        run_building(world, rules, unit)
        return
    is_watching = True
    for _ in range(MAX_THOUGHTS):
        if is_watching:
            look_out(world, rules, unit)
        wish = make_wish(world, rules, unit)
        if wish == NOTHING:
            break
        if wish == AGAIN:
            continue
        way = pursue(world, rules, unit)
        if way == ON_THE_WAY or (way == ARRIVED and begin_work(world, rules, unit)):
            return
        if way == STUCK:
            if keeps_waiting(world, unit):
                return
            is_watching = False
    if world.units[unit, UNIT_ORDER] != NO_ORDER:
        get_stuck(world, unit)
        return
    world.units[unit, UNIT_BLOCKED] = 0
    is_guard = rules.has_auto_attack != 0 and is_soldier(world.units[unit, UNIT_KIND])
    enter_state(world, unit, IDLE, world.clock[TICK] + WATCH_TICKS if is_guard else NEVER)
