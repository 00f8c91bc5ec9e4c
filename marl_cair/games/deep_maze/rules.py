"""The rules of Deep Maze, written for one world; the last functions run slices of worlds.

Order of a move (the README lists the same words): walk, catch, judge, look around.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze import rulebook as rb
from marl_cair.games.deep_maze import state as s
from marl_cair.games.deep_maze.places import enter_maze, potential
from marl_cair.games.deep_maze.sight import open_eyes, update_sight
from marl_cair.games.deep_maze.tables import EXCESS_REWARD, GOAL_REWARD, NOOP, NUM_MOVES
from marl_cair.games.game import NO_WINNER
from marl_cair.games.loops import loop_over_resets, loop_over_seats
from marl_cair.games.randomness import mix

DRAW = -2  # of `clock[WINNER]`: decided, without a winner
UNDECIDED = NO_WINNER


@compiled
def walk(world: Any, rules: Any, player: int, action: int, is_caught: bool) -> None:
    """Go one cell. A move into a wall does nothing; it is counted where the mask forbids it.

    Computed without branches, which a processor cannot predict for random players; a 1 for a wall
    is a number here, because the compiler would make a branch of a condition.
    """
    cell = int(world.cell[player])
    target = int(rules.neighbours[cell, action])
    stays = int(world.walls[target]) | int(target == cell) | int(is_caught)
    is_against_mask = (action != NOOP) & (stays != 0)
    is_against_mask &= (rules.mask_walls != 0) | is_caught
    world.illegal[player] += int(is_against_mask)
    moves = 1 - stays
    world.came_from[player] += (cell - world.came_from[player]) * moves
    world.cell[player] += (target - cell) * moves


@compiled
def judge_chase(world: Any, rules: Any, num_fled: int, num_fallen: int) -> int:
    """The hunter has caught all, or one of the others is safe, or time has saved them.

    num_fled: seats that reached the goal in this move and were not caught on it.
    num_fallen: seats that were caught on the goal in this move.
    """
    if num_fled > 0:
        return rb.HUNTER + 1
    if num_fallen > 0:
        return DRAW
    num_free = 0
    for player in range(rb.HUNTER + 1, rules.num_players):
        num_free += int(world.is_caught[player] == 0)
    if num_free == 0:
        return rb.HUNTER
    return rb.HUNTER + 1 if world.clock[s.TICK] >= rules.max_ticks else UNDECIDED


@compiled
def pay(world: Any, rules: Any, player: int, is_next_maze: bool) -> float:
    """The reward of a move without the potential; a goal that is not the last pays as the last."""
    if rules.reward == rb.BEYOND_OPTIMAL:
        moves = int(world.clock[s.TICK] - world.clock[s.MAZE_START])
        return EXCESS_REWARD if moves > world.optimal[player] else 0.0
    if world.clock[s.PHASE] != s.TERMINATED:
        return GOAL_REWARD if is_next_maze else float(rules.step_reward[player])
    winner = int(world.clock[s.WINNER])
    if winner == NO_WINNER:
        return 0.0
    has_won = player == winner
    if rules.contest == rb.CHASE:  # the hunted seats are one team
        has_won = (player == rb.HUNTER) == (winner == rb.HUNTER)
    return GOAL_REWARD if has_won else -GOAL_REWARD


@compiled
def play_chase(world: Any, rules: Any, actions: Any) -> int:
    """All seats move at once, and the hunter catches those it meets; returns as `judge_chase`."""
    hunter_before = int(world.cell[rb.HUNTER])
    walk(world, rules, rb.HUNTER, actions[rb.HUNTER], False)
    num_fled, num_fallen = 0, 0
    for player in range(rb.HUNTER + 1, rules.num_players):
        cell_before = int(world.cell[player])
        was_caught = world.is_caught[player] != 0
        walk(world, rules, player, actions[player], was_caught)
        if was_caught:
            continue
        hunter, cell = int(world.cell[rb.HUNTER]), int(world.cell[player])
        # On one cell, or the two have changed places.
        is_caught = cell == hunter or (cell == hunter_before and cell_before == hunter)
        if is_caught:
            world.is_caught[player] = 1
        if world.cell[player] == world.clock[s.GOAL]:
            num_fallen += int(is_caught)
            num_fled += int(not is_caught)
    return judge_chase(world, rules, num_fled, num_fallen)


@compiled
def play_race(world: Any, rules: Any, actions: Any) -> int:
    """All move at once: the seat that is at the goal, DRAW for several at once, or UNDECIDED."""
    winner = UNDECIDED
    for player in range(rules.num_players):
        walk(world, rules, player, actions[player], False)
        if world.cell[player] == world.clock[s.GOAL]:
            winner = player if winner == UNDECIDED else DRAW
    return winner


@compiled
def renew_sight(world: Any, rules: Any, actions: Any) -> None:
    """Update the sight of all seats that have moved; nothing changes for the others."""
    for player in range(rules.num_players):
        if actions[player] != NOOP:
            update_sight(world, rules, player, int(world.came_from[player]))


@compiled
def gain_potential(world: Any, rules: Any, player: int) -> float:
    """Discount * potential(after) - potential(before), with potential 0 after the end.

    That leaves the optimal policy as it is (Ng, Harada, Russell 1999).
    """
    before = float(world.potential[player])
    after = 0.0
    if world.clock[s.PHASE] != s.TERMINATED:
        after = potential(world, rules, player)
    world.potential[player] = after
    return float(rules.shaping_discount * after - before)


@compiled
def settle(world: Any, rules: Any, winner: int, rewards: Any) -> None:
    """The end of a maze or of the game, and rewards that depend on more than the move."""
    is_next_maze = winner != UNDECIDED and world.clock[s.MAZE] + 1 < rules.num_mazes
    if winner != UNDECIDED and not is_next_maze:
        world.clock[s.PHASE] = s.TERMINATED
        world.clock[s.WINNER] = NO_WINNER if winner == DRAW else winner
    elif world.clock[s.TICK] >= rules.max_ticks:
        world.clock[s.PHASE] = s.TRUNCATED
    for player in range(rules.num_players):
        paid = pay(world, rules, player, is_next_maze)
        if rules.reward == rb.DISTANCE and not is_next_maze:
            paid += gain_potential(world, rules, player)
        rewards[player] = paid
    if is_next_maze:
        enter_next_maze(world, rules, rewards)


@compiled
def step_world(world: Any, rules: Any, actions: Any, rewards: Any) -> None:
    """One move of every seat; writes the rewards of all."""
    if world.clock[s.PHASE] != s.RUNNING:
        rewards[:] = 0.0
        return
    world.clock[s.TICK] += 1
    if rules.contest == rb.CHASE:
        winner = play_chase(world, rules, actions)
    else:
        winner = play_race(world, rules, actions)
    is_plain = rules.reward == rb.CLASSIC and world.clock[s.TICK] < rules.max_ticks
    if winner == UNDECIDED and is_plain:
        for player in range(rules.num_players):
            rewards[player] = rules.step_reward[player]
    else:
        settle(world, rules, winner, rewards)
    if rules.visibility != rb.FULL_SIGHT:
        renew_sight(world, rules, actions)


@compiled
def enter_next_maze(world: Any, rules: Any, rewards: Any) -> None:
    """Put the only player of a sequence into its next maze, and pay it for the way to come."""
    before = float(world.potential[0])
    world.clock[s.MAZE] += 1
    enter_maze(world, rules)
    open_eyes(world, rules)
    if rules.reward == rb.DISTANCE:
        rewards[0] = GOAL_REWARD + (rules.shaping_discount * float(world.potential[0]) - before)


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """Begin a new game in a zeroed world. Mazes and places are drawn from two different words."""
    world.random[s.MAZE_WORD] = mix(seed + np.uint64(1))
    world.random[s.PLACE_WORD] = mix(world.random[s.MAZE_WORD] + np.uint64(2))
    world.clock[s.PHASE] = s.RUNNING
    world.clock[s.WINNER] = NO_WINNER
    enter_maze(world, rules)
    open_eyes(world, rules)


@compiled
def list_legal_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """The moves that lead somewhere (all, if walls are not masked) and the no-op: out bool [A]."""
    can_move = world.clock[s.PHASE] == s.RUNNING and world.is_caught[player] == 0
    cell = int(world.cell[player])
    for move in range(NUM_MOVES):
        is_legal = can_move
        if can_move and rules.mask_walls != 0:
            target = int(rules.neighbours[cell, move])
            is_legal = target != cell and world.walls[target] == s.OPEN
        out[move] = is_legal
    out[NOOP] = True


reset = loop_over_resets(reset_world, s.world_at, s.World)
legal_actions = loop_over_seats(list_legal_actions, s.world_at)  # out bool [B, P, A]


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Advance and write what the engine reports; a finished world stays as it is."""
    for index in range(first, last):
        world = s.world_at(worlds, index)
        step_world(world, rules, actions[index], outcome.rewards[index])
        outcome.terminated[index] = world.clock[s.PHASE] == s.TERMINATED
        outcome.truncated[index] = world.clock[s.PHASE] == s.TRUNCATED
        outcome.winner[index] = world.clock[s.WINNER]
