"""The rules of Deep Maze, written for one world; the last functions run slices of worlds.

Order of a move (the README lists the same words): walk, catch, judge, look around.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze.places import enter_maze, potential
from marl_cair.games.deep_maze.rulebook import (
    BEYOND_OPTIMAL,
    CHASE,
    CLASSIC,
    DISTANCE,
    FULL_SIGHT,
    HUNTER,
)
from marl_cair.games.deep_maze.sight import open_eyes, update_sight
from marl_cair.games.deep_maze.state import (
    GOAL,
    MAZE,
    MAZE_START,
    MAZE_WORD,
    OPEN,
    PHASE,
    PLACE_WORD,
    RUNNING,
    TERMINATED,
    TICK,
    TRUNCATED,
    WINNER,
    world_at,
)
from marl_cair.games.deep_maze.tables import EXCESS_REWARD, GOAL_REWARD, NOOP, NUM_MOVES
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import mix

DRAW = -2  # of `clock[WINNER]`: decided, without a winner
UNDECIDED = NO_WINNER


# --- the phases of a move ------------------------------------------------------------------------


@compiled
def walk(world: Any, rules: Any, player: int, action: int, is_caught: bool) -> None:
    """Go one cell; who goes into a wall stays, which is counted where it is against the mask.

    Reckoned without branches: which way a random player goes cannot be foreseen. 1 for a wall is a
    number here, not an answer, of which the compiler would make a branch.
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
def is_met(world: Any, hunter_before: int, player: int, cell_before: int) -> bool:
    """Whether the seat is on the hunter's cell, or has changed places with the hunter."""
    if world.cell[player] == world.cell[HUNTER]:
        return True
    return bool(world.cell[player] == hunter_before and cell_before == world.cell[HUNTER])


@compiled
def judge_chase(world: Any, rules: Any, num_fled: int, num_fallen: int) -> int:
    """The hunter has caught all, or one of the others is safe, or time has saved them.

    num_fled: seats that reached the goal in this move and were not caught on it.
    num_fallen: seats that were caught on the goal in this move.
    """
    if num_fled > 0:
        return HUNTER + 1
    if num_fallen > 0:
        return DRAW
    num_free = 0
    for player in range(HUNTER + 1, rules.num_players):
        num_free += int(world.is_caught[player] == 0)
    if num_free == 0:
        return HUNTER
    return HUNTER + 1 if world.clock[TICK] >= rules.max_ticks else UNDECIDED


# --- one world -----------------------------------------------------------------------------------


@compiled
def is_winner(rules: Any, player: int, winner: int) -> bool:
    """Whether a seat is the winner, or of the winning team: those who are hunted are one."""
    if rules.contest == CHASE:
        return (player == HUNTER) == (winner == HUNTER)
    return player == winner


@compiled
def pay(world: Any, rules: Any, player: int, is_next_maze: bool) -> float:
    """The reward of a move without the potential; a goal that is not the last pays as the last."""
    if rules.reward == BEYOND_OPTIMAL:
        moves = int(world.clock[TICK] - world.clock[MAZE_START])
        return EXCESS_REWARD if moves > world.optimal[player] else 0.0
    if world.clock[PHASE] != TERMINATED:
        return GOAL_REWARD if is_next_maze else float(rules.step_reward[player])
    winner = int(world.clock[WINNER])
    if winner == NO_WINNER:
        return 0.0
    return GOAL_REWARD if is_winner(rules, player, winner) else -GOAL_REWARD


@compiled
def play_chase(world: Any, rules: Any, actions: Any) -> int:
    """Hunter and hunted move at once, and who was met is caught; the result as `judge_chase`."""
    hunter_before = int(world.cell[HUNTER])
    walk(world, rules, HUNTER, actions[HUNTER], False)
    num_fled, num_fallen = 0, 0
    for player in range(HUNTER + 1, rules.num_players):
        cell_before = int(world.cell[player])
        was_caught = world.is_caught[player] != 0
        walk(world, rules, player, actions[player], was_caught)
        if was_caught:
            continue
        is_caught = is_met(world, hunter_before, player, cell_before)
        if is_caught:
            world.is_caught[player] = 1
        if world.cell[player] == world.clock[GOAL]:
            num_fallen += int(is_caught)
            num_fled += int(not is_caught)
    return judge_chase(world, rules, num_fled, num_fallen)


@compiled
def play_race(world: Any, rules: Any, actions: Any) -> int:
    """All move at once: the seat that is at the goal, DRAW for several at once, or UNDECIDED."""
    winner = UNDECIDED
    for player in range(rules.num_players):
        walk(world, rules, player, actions[player], False)
        if world.cell[player] == world.clock[GOAL]:
            winner = player if winner == UNDECIDED else DRAW
    return winner


@compiled
def renew_sight(world: Any, rules: Any, actions: Any) -> None:
    """All who have moved look around.

    Who goes nowhere has the same in sight as before: the maze does not change.
    """
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
    if world.clock[PHASE] != TERMINATED:
        after = potential(world, rules, player)
    world.potential[player] = after
    return float(rules.discount * after - before)


@compiled
def settle(world: Any, rules: Any, winner: int, rewards: Any) -> None:
    """The end of a maze or of the game, and rewards that depend on more than the move."""
    is_next_maze = winner != UNDECIDED and world.clock[MAZE] + 1 < rules.num_mazes
    if winner != UNDECIDED and not is_next_maze:
        world.clock[PHASE] = TERMINATED
        world.clock[WINNER] = NO_WINNER if winner == DRAW else winner
    elif world.clock[TICK] >= rules.max_ticks:
        world.clock[PHASE] = TRUNCATED
    for player in range(rules.num_players):
        paid = pay(world, rules, player, is_next_maze)
        if rules.reward == DISTANCE and not is_next_maze:
            paid += gain_potential(world, rules, player)
        rewards[player] = paid
    if is_next_maze:
        enter_next_maze(world, rules, rewards)


@compiled
def step_world(world: Any, rules: Any, actions: Any, rewards: Any) -> None:
    """One move of every seat; writes the rewards of all."""
    if world.clock[PHASE] != RUNNING:
        rewards[:] = 0.0
        return
    world.clock[TICK] += 1
    if rules.contest == CHASE:
        winner = play_chase(world, rules, actions)
    else:
        winner = play_race(world, rules, actions)
    is_plain = rules.reward == CLASSIC and world.clock[TICK] < rules.max_ticks
    if winner == UNDECIDED and is_plain:
        for player in range(rules.num_players):
            rewards[player] = rules.step_reward[player]
    else:
        settle(world, rules, winner, rewards)
    if rules.visibility != FULL_SIGHT:
        renew_sight(world, rules, actions)


@compiled
def enter_next_maze(world: Any, rules: Any, rewards: Any) -> None:
    """The one player of a sequence goes on; the potential before is that of the last maze."""
    before = float(world.potential[0])
    world.clock[MAZE] += 1
    enter_maze(world, rules)
    open_eyes(world, rules)
    if rules.reward == DISTANCE:
        rewards[0] = GOAL_REWARD + (rules.discount * float(world.potential[0]) - before)


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """A new game. Mazes and places are drawn from two different words."""
    world.random[MAZE_WORD] = mix(seed + np.uint64(1))
    world.random[PLACE_WORD] = mix(world.random[MAZE_WORD] + np.uint64(2))
    world.clock[:] = 0
    world.clock[PHASE] = RUNNING
    world.clock[WINNER] = NO_WINNER
    world.is_caught[:] = 0
    world.illegal[:] = 0
    enter_maze(world, rules)
    open_eyes(world, rules)


@compiled
def list_legal_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """The moves that lead somewhere (all, if walls are not masked) and the no-op: out bool [A]."""
    can_move = world.clock[PHASE] == RUNNING and world.is_caught[player] == 0
    cell = int(world.cell[player])
    for move in range(NUM_MOVES):
        is_legal = can_move
        if can_move and rules.mask_walls != 0:
            target = int(rules.neighbours[cell, move])
            is_legal = target != cell and world.walls[target] == OPEN
        out[move] = is_legal
    out[NOOP] = True


# --- slices of worlds ----------------------------------------------------------------------------


@compiled
def reset(worlds: Any, rules: Any, seeds: Any, mask: Any, first: int, last: int) -> None:
    """New games in the worlds of `mask` bool [B] from `seeds` uint64 [B]."""
    for index in range(first, last):
        if mask[index]:
            reset_world(world_at(worlds, index), rules, seeds[index])


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Advance and write what the engine reports; a finished world stays as it is."""
    for index in range(first, last):
        world = world_at(worlds, index)
        step_world(world, rules, actions[index], outcome.rewards[index])
        outcome.terminated[index] = world.clock[PHASE] == TERMINATED
        outcome.truncated[index] = world.clock[PHASE] == TRUNCATED
        outcome.winner[index] = world.clock[WINNER]


@compiled
def legal_actions(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the legal actions of every seat: out bool [B, P, A]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            list_legal_actions(world, rules, player, out[index, player])
