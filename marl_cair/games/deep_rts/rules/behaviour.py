"""How a unit carries out its order: it makes a wish, goes there, and works when it has arrived.

A wish is four columns of the clock (goal cell, half size of the box around it, reach, resource):
be within reach of the box, or beside the nearest tile of the resource. Search and step stand at one
place only, because all of this is inlined.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board, paths, work
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.combat import aim_at, find_enemy, has_target, is_soldier
from marl_cair.games.deep_rts.rules.motion import (
    LONGEST_WAIT_TICKS,
    begin_step,
    get_stuck,
    is_fellow_coming,
)
from marl_cair.games.deep_rts.rules.roster import enter_state

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
    world.clock[s.WISH + GOAL] = goal
    world.clock[s.WISH + HALF] = half
    world.clock[s.WISH + REACH] = reach
    world.clock[s.WISH + RESOURCE] = paths.NOT_FOR_RESOURCE
    return SOMEWHERE


@compiled
def forget_order(world: Any, unit: int) -> None:
    """The order is done or given up."""
    world.units[unit, s.UNIT_ORDER] = s.NO_ORDER
    world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
    paths.forget_path(world, unit)


@compiled
def look_for_enemy(world: Any, rules: Any, unit: int) -> None:
    """Idle soldiers and those who advance turn to the enemy that they see."""
    order = world.units[unit, s.UNIT_ORDER]
    if order == s.ADVANCE:
        if has_target(world, rules, unit):
            return
    elif (
        order != s.NO_ORDER
        or rules.has_auto_attack == 0
        or not is_soldier(world.units[unit, s.UNIT_KIND])
    ):
        return
    enemy = find_enemy(world, rules, unit)
    if enemy == s.NO_UNIT:
        return
    aim_at(world, unit, enemy)
    paths.forget_path(world, unit)
    if order == s.NO_ORDER:
        world.units[unit, s.UNIT_ORDER] = s.ATTACK


@compiled
def wish_to_fight(world: Any, rules: Any, unit: int) -> int:
    """Have the target in range; it may have moved, so the way is planned again at each step."""
    target, kind = int(world.units[unit, s.UNIT_TARGET]), int(world.units[unit, s.UNIT_KIND])
    if world.units[unit, s.UNIT_BLOCKED] == 0:
        paths.forget_path(world, unit)
    half = int(rules.kinds[world.units[target, s.UNIT_KIND], rb.KIND_HALF_SIZE])
    return wish_for(world, int(world.units[target, s.UNIT_CELL]), half, board.reach_of(rules, kind))


@compiled
def wish_to_harvest(world: Any, rules: Any, unit: int) -> int:
    """Full hands go home; else to the tile, or to the nearest of its kind when it is used up."""
    goal, carries = int(world.units[unit, s.UNIT_GOAL]), int(world.units[unit, s.UNIT_CARRY])
    carried = int(world.units[unit, s.UNIT_CARRY_KIND])
    has_gone = work.is_used_up(world, rules, goal)
    is_other = not has_gone and carried != int(
        rules.tiles[world.board[s.TILE, goal], rb.TILE_RESOURCE]
    )
    if carries >= rules.carry_capacity or (carries > 0 and is_other):
        world.units[unit, s.UNIT_ORDER] = s.RETURN
        paths.forget_path(world, unit)
        return AGAIN
    if not has_gone:
        return wish_for(world, goal, 0, paths.NEXT_TO)
    wish_for(world, int(world.units[unit, s.UNIT_CELL]), 0, paths.ON_THE_SPOT)
    world.clock[s.WISH + RESOURCE] = paths.ANY_RESOURCE if carried == t.NO_RESOURCE else carried
    return SOMEWHERE


@compiled
def make_wish(world: Any, rules: Any, unit: int) -> int:
    """Where the unit's order leads it now: SOMEWHERE (see WISH), NOTHING, or think AGAIN."""
    order = world.units[unit, s.UNIT_ORDER]
    if order == s.NO_ORDER:
        return NOTHING
    if order == s.HARVEST:
        return wish_to_harvest(world, rules, unit)
    if order == s.RETURN:
        hall = work.nearest_hall(world, rules, unit)
        if hall != s.NO_UNIT:
            half = int(rules.kinds[t.TOWN_HALL, rb.KIND_HALF_SIZE])
            return wish_for(world, int(world.units[hall, s.UNIT_CELL]), half, paths.NEXT_TO)
    elif order == s.MOVE:
        return wish_for(world, int(world.units[unit, s.UNIT_GOAL]), 0, paths.ON_THE_SPOT)
    elif order == s.REPAIR:
        building = int(world.units[unit, s.UNIT_TARGET])
        is_same = world.units[building, s.UNIT_SERIAL] == world.units[unit, s.UNIT_TARGET_SERIAL]
        if is_same and work.can_repair(world, rules, building):
            half = int(rules.kinds[world.units[building, s.UNIT_KIND], rb.KIND_HALF_SIZE])
            return wish_for(world, int(world.units[building, s.UNIT_CELL]), half, paths.NEXT_TO)
    elif has_target(world, rules, unit):
        return wish_to_fight(world, rules, unit)
    elif order == s.ADVANCE:
        if world.units[unit, s.UNIT_TARGET] != s.NO_UNIT:
            world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
            paths.forget_path(world, unit)
        return wish_for(world, int(world.units[unit, s.UNIT_GOAL]), 0, paths.ON_THE_SPOT)
    forget_order(world, unit)
    return AGAIN


@compiled
def pursue(world: Any, rules: Any, unit: int) -> int:
    """One step towards the wish: ARRIVED, ON_THE_WAY, STUCK, or FOUND (a tile of the resource)."""
    goal, half = int(world.clock[s.WISH + GOAL]), int(world.clock[s.WISH + HALF])
    reach, resource = int(world.clock[s.WISH + REACH]), int(world.clock[s.WISH + RESOURCE])
    frame = rules.seats[world.clock[s.MAP_INDEX], board.owner_of(rules, unit), rb.SEAT_FRAME]
    cell = int(world.units[unit, s.UNIT_CELL])
    needs_search = False
    if resource != paths.NOT_FOR_RESOURCE:
        tile = paths.resource_beside(world, rules, frame, cell, resource)
        if tile != paths.NOWHERE:
            world.units[unit, s.UNIT_GOAL] = tile
            return FOUND
        needs_search = True
    else:
        if board.box_distance(rules, cell, goal, half) < reach:
            paths.forget_path(world, unit)
            world.units[unit, s.UNIT_BLOCKED] = 0
            return ARRIVED
        check_path(world, rules, unit, goal, reach)
        if world.units[unit, s.UNIT_PATH_STEPS] == 0:
            needs_search = not paths.plan_straight(world, rules, unit, goal, half, reach)
    if needs_search:
        end = paths.search(world, rules, unit, goal, half, reach, resource)
        if end == paths.NOWHERE:
            get_stuck(world, unit)
            return STUCK
        if resource != paths.NOT_FOR_RESOURCE:
            world.units[unit, s.UNIT_GOAL] = paths.resource_beside(
                world, rules, frame, end, resource
            )
            return FOUND
    direction = paths.next_direction(world, unit)
    there = int(cell + rules.offset[direction])
    other = int(world.board[s.OCCUPANT, there])
    if (
        world.units[unit, s.UNIT_BLOCKED] > 0
        and other != s.NO_UNIT
        and not is_fellow_coming(world, rules, unit, there)
    ):
        if board.walks_on(world, rules, unit, other):
            world.units[unit, s.UNIT_BLOCKED] -= 1  # not in vain: it follows a unit that walks on
        get_stuck(world, unit)
        return STUCK
    paths.drop_step(world, unit)
    begin_step(world, rules, unit, direction)
    return ON_THE_WAY


@compiled
def check_path(world: Any, rules: Any, unit: int, goal: int, reach: int) -> None:
    """Forget a path whose next step is not open any more."""
    if world.units[unit, s.UNIT_PATH_STEPS] > 0:
        cell, direction = int(world.units[unit, s.UNIT_CELL]), paths.next_direction(world, unit)
        there = int(cell + rules.offset[direction])
        is_open = paths.may_enter(world, rules, unit, there, goal, reach)
        if not is_open or board.cuts_corner(world, rules, cell, direction):
            paths.forget_path(world, unit)


@compiled
def begin_work(world: Any, rules: Any, unit: int) -> bool:
    """Arrived: begin what the order is for. False where the unit must think again."""
    order = world.units[unit, s.UNIT_ORDER]
    tick = int(world.clock[s.TICK])
    if order == s.HARVEST:
        world.units[unit, s.UNIT_CARRY_KIND] = rules.tiles[
            world.board[s.TILE, world.units[unit, s.UNIT_GOAL]], rb.TILE_RESOURCE
        ]
        enter_state(world, unit, s.GATHERING, tick + int(rules.harvest_ticks))
        return True
    if order == s.REPAIR:
        enter_state(world, unit, s.REPAIRING, tick + work.REPAIR_TICKS)
        return True
    if order == s.ATTACK or (order == s.ADVANCE and world.units[unit, s.UNIT_TARGET] != s.NO_UNIT):
        enter_state(world, unit, s.FIGHTING, max(tick + 1, int(world.units[unit, s.UNIT_READY])))
        return True
    if order == s.RETURN:
        work.deliver(world, rules, unit)
    else:
        forget_order(world, unit)
    return False


@compiled
def keeps_waiting(world: Any, unit: int) -> bool:
    """Stuck: wait on (True), or change the mind and think again."""
    order = world.units[unit, s.UNIT_ORDER]
    blocked = world.units[unit, s.UNIT_BLOCKED]
    if order == s.HARVEST and world.clock[s.WISH + RESOURCE] != paths.NOT_FOR_RESOURCE:
        # There is no free place at any such tile.
        if world.units[unit, s.UNIT_CARRY] > 0:
            world.units[unit, s.UNIT_ORDER] = s.RETURN
            return False
        if world.units[unit, s.UNIT_CARRY_KIND] != t.NO_RESOURCE:
            world.units[unit, s.UNIT_CARRY_KIND] = t.NO_RESOURCE
            return False
        if blocked > 2 * PATIENCE:
            forget_order(world, unit)
            return False
        return True
    is_on_its_way = order in (s.MOVE, s.ADVANCE) and world.units[unit, s.UNIT_TARGET] == s.NO_UNIT
    if blocked <= (LONG_PATIENCE if is_on_its_way else PATIENCE) or order == s.RETURN:
        return True
    if order == s.HARVEST:
        world.units[unit, s.UNIT_GOAL] = (
            s.NO_GOAL
        )  # which is used up: the nearest free one is sought
        return False
    if order == s.ADVANCE and world.units[unit, s.UNIT_TARGET] != s.NO_UNIT:
        world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
        paths.forget_path(world, unit)
        return False
    was_fighting = order == s.ATTACK
    forget_order(world, unit)
    if was_fighting:
        enter_state(world, unit, s.IDLE, world.clock[s.TICK] + LONGEST_WAIT_TICKS)
    return bool(was_fighting)


@compiled
def decide(world: Any, rules: Any, unit: int) -> None:
    """Begin what comes next, where the unit lives and its time has come."""
    if world.units[unit, s.UNIT_KIND] == t.NO_KIND or world.due[unit] > world.clock[s.TICK]:
        return
    if world.units[unit, s.UNIT_KIND] >= t.NUM_MOBILE_KINDS:
        work.run_building(world, rules, unit)
        return
    is_watching = True
    for _ in range(MAX_THOUGHTS):
        if is_watching:
            look_for_enemy(world, rules, unit)
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
    if world.units[unit, s.UNIT_ORDER] != s.NO_ORDER:
        get_stuck(world, unit)
        return
    world.units[unit, s.UNIT_BLOCKED] = 0
    is_guard = rules.has_auto_attack != 0 and is_soldier(world.units[unit, s.UNIT_KIND])
    enter_state(world, unit, s.IDLE, world.clock[s.TICK] + WATCH_TICKS if is_guard else s.NEVER)
