"""How a unit carries out its order: it finds its destination, walks there and starts its work.

A destination is four columns of the clock (goal cell, half size of the box around it, reach,
resource): within reach of the box, or beside the nearest tile of the resource. The search and the
step stand in one place only, because all of this is inlined.
"""

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board, combat, motion, paths, work
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.roster import enter_state

WATCH_TICKS = 5  # between two looks around of an idle soldier
PATIENCE = 3  # failed plans (14 ticks) after which a unit looks for something else to do
LONG_PATIENCE = 5  # the same (62 ticks) for a unit that only walks
MAX_THOUGHTS = 6  # changes of its order within a tick
GOAL, HALF, REACH, RESOURCE = range(4)  # columns of a destination
NO_DESTINATION, HAS_DESTINATION, THINK_AGAIN = range(3)
ARRIVED, WALKS, STUCK, FOUND = range(4)  # results of a step towards it; FOUND: a resource tile


@compiled_copy
def set_destination(world: Any, goal: int, half: int, reach: int) -> int:
    """Set a box as the destination."""
    world.clock[s.DESTINATION + GOAL] = goal
    world.clock[s.DESTINATION + HALF] = half
    world.clock[s.DESTINATION + REACH] = reach
    world.clock[s.DESTINATION + RESOURCE] = paths.NOT_FOR_RESOURCE
    return HAS_DESTINATION


@compiled
def go_to_unit(world: Any, rules: Any, target: int, reach: int) -> int:
    """Set the cells of a unit as the destination."""
    half = board.kind_value(world, rules, target, rb.KIND_HALF_SIZE)
    return set_destination(world, int(world.units[target, s.UNIT_CELL]), half, reach)


@compiled
def forget_order(world: Any, unit: int) -> None:
    """The order is done or given up."""
    world.units[unit, s.UNIT_ORDER] = s.NO_ORDER
    forget_target(world, unit)


@compiled
def forget_target(world: Any, unit: int) -> None:
    """The unit drops its target, and its path to it."""
    world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
    paths.forget_path(world, unit)


@compiled
def look_for_enemy(world: Any, rules: Any, unit: int) -> None:
    """Idle soldiers and units that advance attack an enemy that they see."""
    order = world.units[unit, s.UNIT_ORDER]
    if order == s.ADVANCE:
        if combat.has_target(world, rules, unit):
            return
    elif order != s.NO_ORDER or not is_guard(world, rules, unit):
        return
    sight = board.sight_of(rules, world.units[unit, s.UNIT_KIND])
    enemy = combat.find_enemy(world, rules, unit, sight * sight + sight + 1, False)
    if enemy == s.NO_UNIT:
        return
    combat.aim_at(world, unit, enemy)
    paths.forget_path(world, unit)
    if order == s.NO_ORDER:
        world.units[unit, s.UNIT_ORDER] = s.ATTACK


@compiled_copy
def is_guard(world: Any, rules: Any, unit: int) -> bool:
    """True for a unit that attacks without an order."""
    return bool(rules.has_auto_attack != 0 and combat.is_soldier(world.units[unit, s.UNIT_KIND]))


@compiled
def find_harvest(world: Any, rules: Any, unit: int) -> int:
    """Home with a full load; else to the tile, or to the nearest of its kind if it is used up."""
    goal, load = int(world.units[unit, s.UNIT_GOAL]), int(world.units[unit, s.UNIT_CARRY])
    carried = int(world.units[unit, s.UNIT_CARRY_KIND])
    has_tile = board.can_gather(world, rules, goal)
    is_other = has_tile and carried != board.tile_value(world, rules, goal, rb.TILE_RESOURCE)
    if load >= rules.carry_capacity or (load > 0 and is_other):
        world.units[unit, s.UNIT_ORDER] = s.RETURN
        paths.forget_path(world, unit)
        return THINK_AGAIN
    if has_tile:
        return set_destination(world, goal, 0, paths.NEXT_TO)
    set_destination(world, int(world.units[unit, s.UNIT_CELL]), 0, paths.ON_THE_SPOT)
    resource = paths.ANY_RESOURCE if carried == t.NO_RESOURCE else carried
    world.clock[s.DESTINATION + RESOURCE] = resource
    return HAS_DESTINATION


@compiled
def find_destination(world: Any, rules: Any, unit: int) -> int:
    """Set where the unit's order leads it now; drop an order that cannot be carried out."""
    order = world.units[unit, s.UNIT_ORDER]
    if order == s.NO_ORDER:
        return NO_DESTINATION
    if order == s.HARVEST:
        return find_harvest(world, rules, unit)
    if order == s.RETURN:
        hall = work.nearest_hall(world, rules, unit)
        if hall != s.NO_UNIT:
            return go_to_unit(world, rules, hall, paths.NEXT_TO)
    elif order == s.REPAIR:
        target = int(world.units[unit, s.UNIT_TARGET])
        is_same = world.units[target, s.UNIT_SERIAL] == world.units[unit, s.UNIT_TARGET_SERIAL]
        if is_same and work.can_repair(world, rules, target):
            return go_to_unit(world, rules, target, paths.NEXT_TO)
    elif order != s.MOVE and combat.has_target(world, rules, unit):
        if world.units[unit, s.UNIT_BLOCKED] == 0:
            paths.forget_path(world, unit)  # the target may have moved: plan again at each step
        reach = board.reach_of(world, rules, unit)
        return go_to_unit(world, rules, int(world.units[unit, s.UNIT_TARGET]), reach)
    elif order in (s.MOVE, s.ADVANCE):
        if order == s.ADVANCE and world.units[unit, s.UNIT_TARGET] != s.NO_UNIT:
            forget_target(world, unit)
        return set_destination(world, int(world.units[unit, s.UNIT_GOAL]), 0, paths.ON_THE_SPOT)
    forget_order(world, unit)
    return THINK_AGAIN


@compiled
def walk_on(world: Any, rules: Any, unit: int) -> int:
    """Begin one step towards the destination: ARRIVED, WALKS, STUCK, or FOUND (a resource tile)."""
    goal, half = int(world.clock[s.DESTINATION + GOAL]), int(world.clock[s.DESTINATION + HALF])
    reach = int(world.clock[s.DESTINATION + REACH])
    resource = int(world.clock[s.DESTINATION + RESOURCE])
    frame = board.frame_of(world, rules, board.owner_of(rules, unit))
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
            motion.wait_blocked(world, unit)
            return STUCK
        if resource != paths.NOT_FOR_RESOURCE:
            tile = paths.resource_beside(world, rules, frame, end, resource)
            world.units[unit, s.UNIT_GOAL] = tile
            return FOUND
    direction = paths.next_direction(world, unit)
    there = int(cell + rules.offset[direction])
    other = int(world.board[s.OCCUPANT, there])
    is_blocked = world.units[unit, s.UNIT_BLOCKED] > 0 and other != s.NO_UNIT
    if is_blocked and not motion.can_swap(world, rules, unit, there):
        if board.is_walking_for(world, rules, unit, other):
            world.units[unit, s.UNIT_BLOCKED] -= 1  # it follows a walker: not a failed plan
        motion.wait_blocked(world, unit)
        return STUCK
    motion.begin_step(world, rules, unit, direction)
    return WALKS


@compiled
def check_path(world: Any, rules: Any, unit: int, goal: int, reach: int) -> None:
    """Forget a path whose next step is no longer open."""
    if world.units[unit, s.UNIT_PATH_STEPS] > 0:
        cell, direction = int(world.units[unit, s.UNIT_CELL]), paths.next_direction(world, unit)
        there = int(cell + rules.offset[direction])
        is_open = paths.may_enter(world, rules, unit, there, goal, reach)
        if not is_open or board.cuts_corner(world, rules, cell, direction):
            paths.forget_path(world, unit)


@compiled
def begin_work(world: Any, rules: Any, unit: int) -> bool:
    """Begin the order's work at the destination. False if the unit must decide again."""
    order, tick = world.units[unit, s.UNIT_ORDER], int(world.clock[s.TICK])
    if order == s.HARVEST:
        resource = board.tile_value(world, rules, world.units[unit, s.UNIT_GOAL], rb.TILE_RESOURCE)
        world.units[unit, s.UNIT_CARRY_KIND] = resource
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
    """A stuck unit waits (True), or changes its order and decides again."""
    order, blocked = world.units[unit, s.UNIT_ORDER], world.units[unit, s.UNIT_BLOCKED]
    has_target = world.units[unit, s.UNIT_TARGET] != s.NO_UNIT
    if order == s.HARVEST and world.clock[s.DESTINATION + RESOURCE] != paths.NOT_FOR_RESOURCE:
        # No such tile has a free cell beside it.
        if world.units[unit, s.UNIT_CARRY] > 0:
            world.units[unit, s.UNIT_ORDER] = s.RETURN
        elif world.units[unit, s.UNIT_CARRY_KIND] != t.NO_RESOURCE:
            world.units[unit, s.UNIT_CARRY_KIND] = t.NO_RESOURCE
        elif blocked > 2 * PATIENCE:
            forget_order(world, unit)
        else:
            return True
        return False
    only_walks = order in (s.MOVE, s.ADVANCE) and not has_target
    if blocked <= (LONG_PATIENCE if only_walks else PATIENCE) or order == s.RETURN:
        return True
    if order == s.HARVEST:
        world.units[unit, s.UNIT_GOAL] = s.NO_GOAL  # where nothing is: look for another tile
    elif order == s.ADVANCE and has_target:
        forget_target(world, unit)
    else:
        forget_order(world, unit)
        if order == s.ATTACK:
            enter_state(world, unit, s.IDLE, world.clock[s.TICK] + motion.LONGEST_WAIT_TICKS)
            return True
    return False


@compiled
def decide(world: Any, rules: Any, unit: int) -> None:
    """Begin the unit's next action, if it is alive and due."""
    if world.units[unit, s.UNIT_KIND] == t.NO_KIND or world.due[unit] > world.clock[s.TICK]:
        return
    if board.is_building(world, unit):
        work.run_building(world, rules, unit)
        return
    is_watching = True
    for _ in range(MAX_THOUGHTS):
        if is_watching:
            look_for_enemy(world, rules, unit)
        found = find_destination(world, rules, unit)
        if found == NO_DESTINATION:
            break
        if found == THINK_AGAIN:
            continue
        step = walk_on(world, rules, unit)
        if step == WALKS or (step == ARRIVED and begin_work(world, rules, unit)):
            return
        if step == STUCK:
            if keeps_waiting(world, unit):
                return
            is_watching = False
    if world.units[unit, s.UNIT_ORDER] != s.NO_ORDER:
        motion.wait_blocked(world, unit)
        return
    world.units[unit, s.UNIT_BLOCKED] = 0
    due = world.clock[s.TICK] + WATCH_TICKS if is_guard(world, rules, unit) else s.NEVER
    enter_state(world, unit, s.IDLE, due)
