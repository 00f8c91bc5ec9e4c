"""Who is out, who has won, and what that pays: goals, score, shaping."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.rules.board import is_finished
from marl_cair.games.deep_rts.rules.roster import can_pay, has_food
from marl_cair.games.deep_rts.rules.rulebook import (
    ARMY_GOAL,
    CONQUEST,
    GOLD_GOAL,
    KIND_HEALTH,
    LUMBER_GOAL,
    PRODUCT_COST,
    PRODUCT_IS_ENABLED,
    SCORE_GOAL,
)
from marl_cair.games.deep_rts.state import (
    DAMAGE_DONE,
    DAMAGE_TAKEN,
    GATHERED,
    IS_ALIVE,
    IS_OUT,
    NUM_CREATED,
    NUM_FALLEN,
    NUM_OWNED,
    NUM_UNITS,
    PHASE,
    RESOURCES,
    RUNNING,
    TERMINATED,
    TICK,
    TRUNCATED,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_QUEUE,
    UNIT_QUEUE_LENGTH,
    WINNER,
)
from marl_cair.games.deep_rts.tables import (
    ARCHER,
    CAVALRY,
    FIRST_UPGRADE,
    FOOTMAN,
    GOLD,
    LUMBER,
    NUM_KINDS,
    NUM_MOBILE_KINDS,
    NUM_RESOURCES,
    STONE,
)
from marl_cair.games.game import NO_WINNER

SCORE_UNIT = 100.0  # score points that pay a reward of 1 where the goal is the score
STORE_WEIGHT = 0.3  # of a stored resource in the potential; what is built counts whole
POTENTIAL = 0.8  # weight of the potential, below what a win pays


@compiled
def score_of(world: Any, player: int) -> float:
    """The original's score: gathered, created, alive, and fought (thesis-era formula)."""
    gathered = (
        2.0 * world.players[player, GATHERED + GOLD] + world.players[player, GATHERED + LUMBER]
    )
    gathered += 3.0 * world.players[player, GATHERED + STONE]
    created = 0.0
    for kind in range(NUM_KINDS):
        created += world.players[player, NUM_CREATED + kind]
    fought = 0.6 * world.players[player, DAMAGE_DONE] - 0.5 * world.players[player, DAMAGE_TAKEN]
    alive = float(world.players[player, NUM_UNITS])
    return float(0.5 * gathered + 2.0 * created + alive + max(0.0, fought))


@compiled
def progress_of(world: Any, rules: Any, player: int) -> int:
    """How far the player is on its way to goal_amount."""
    if rules.goal == GOLD_GOAL:
        return int(world.players[player, GATHERED + GOLD])
    if rules.goal == LUMBER_GOAL:
        return int(world.players[player, GATHERED + LUMBER])
    if rules.goal == ARMY_GOAL:
        soldiers = 0
        for kind in (FOOTMAN, ARCHER, CAVALRY):
            soldiers += int(world.players[player, NUM_CREATED + kind])
        return soldiers
    return 0


@compiled
def measure(world: Any, rules: Any, player: int) -> float:
    """What the reward pays the growth of: the share of the goal, or the score; 0 in conquest."""
    if rules.goal == CONQUEST:
        return 0.0
    if rules.goal == SCORE_GOAL:
        return score_of(world, player) / SCORE_UNIT
    return float(min(1.0, progress_of(world, rules, player) / rules.goal_amount))


@compiled
def worth_of(world: Any, rules: Any, player: int) -> float:
    """Gold and lumber in living units by their health, and a part of what is stored."""
    worth = 0.0
    for place in range(world.players[player, NUM_UNITS]):
        unit = world.roster[player, place]
        kind = world.units[unit, UNIT_KIND]
        price = float(
            rules.product[kind, PRODUCT_COST + GOLD] + rules.product[kind, PRODUCT_COST + LUMBER]
        )
        worth += price * world.units[unit, UNIT_HEALTH] / rules.kinds[kind, KIND_HEALTH]
    for resource in range(NUM_RESOURCES):
        worth += STORE_WEIGHT * world.players[player, RESOURCES + resource]
    return float(worth)


@compiled
def potential(world: Any, rules: Any, player: int) -> float:
    """How well the player's team stands, in -0.8..0.8: its share of all that is worth something."""
    own, everybody = 0.0, 1.0
    for other in range(rules.num_players):
        worth = worth_of(world, rules, other)
        everybody += worth
        if rules.team[other] == rules.team[player]:
            own += worth
    return float(POTENTIAL * (2.0 * own / everybody - 1.0))


@compiled
def can_go_on(world: Any, rules: Any, player: int) -> bool:
    """True with anybody who walks, with one in training, or with the means to train one."""
    for kind in range(NUM_MOBILE_KINDS):
        if world.players[player, NUM_OWNED + kind] > 0:
            return True
    for place in range(world.players[player, NUM_UNITS]):
        unit = world.roster[player, place]
        if world.units[unit, UNIT_HEALTH] <= 0 or not is_finished(world, unit):
            continue
        if (
            world.units[unit, UNIT_QUEUE_LENGTH] > 0
            and world.units[unit, UNIT_QUEUE + 0] < FIRST_UPGRADE
        ):
            return True
        for product in range(NUM_MOBILE_KINDS):
            if (
                rules.can_make[world.units[unit, UNIT_KIND], product]
                and rules.product[product, PRODUCT_IS_ENABLED]
                and can_pay(world, rules, player, product)
                and has_food(world, rules, player, product)
            ):
                return True
    return False


@compiled
def judge(world: Any, rules: Any) -> None:
    """Players without means are out; the goal ends the game, and the clock, without a winner unless
    the score is the goal.
    """
    for player in range(rules.num_players):
        if world.players[player, IS_ALIVE] and not can_go_on(world, rules, player):
            world.players[player, IS_ALIVE] = False
            for place in range(world.players[player, NUM_UNITS]):
                world.units[world.roster[player, place], UNIT_HEALTH] = 0
            world.clock[NUM_FALLEN] += 1
    if rules.goal == CONQUEST:
        judge_conquest(world, rules)
    else:
        judge_race(world, rules)
    if world.clock[PHASE] == RUNNING and world.clock[TICK] >= rules.max_ticks:
        world.clock[PHASE] = TRUNCATED
        if rules.goal == SCORE_GOAL:
            world.clock[PHASE] = TERMINATED
            rank_by_score(world, rules)


@compiled
def judge_conquest(world: Any, rules: Any) -> None:
    """The last team standing wins; nobody left is a draw."""
    first = -1
    for player in range(rules.num_players):
        if not world.players[player, IS_ALIVE]:
            continue
        if first >= 0 and rules.team[player] != rules.team[first]:
            return
        if first < 0:
            first = player
    world.clock[PHASE] = TERMINATED
    world.clock[WINNER] = NO_WINNER
    for player in range(rules.num_players - 1, -1, -1):
        if first >= 0 and rules.team[player] == rules.team[first]:
            world.clock[WINNER] = player


@compiled
def first_of_team(rules: Any, player: int) -> int:
    """The first seat of the player's team, which stands for it as the winner."""
    for other in range(player):
        if rules.team[other] == rules.team[player]:
            return other
    return player


@compiled
def judge_race(world: Any, rules: Any) -> None:
    """The first to reach the goal wins; two teams in one tick draw; nobody left ends it too."""
    num_alive, num_there = 0, 0
    for player in range(rules.num_players):
        num_alive += int(world.players[player, IS_ALIVE])
        if rules.goal != SCORE_GOAL and progress_of(world, rules, player) >= rules.goal_amount:
            team = first_of_team(rules, player)
            if num_there == 0 or world.clock[WINNER] != team:
                num_there += 1
            world.clock[WINNER] = team
    if num_there > 1:
        world.clock[WINNER] = NO_WINNER
    if num_there > 0 or num_alive == 0:
        world.clock[PHASE] = TERMINATED


@compiled
def team_score(world: Any, rules: Any, player: int) -> float:
    """The sum over the player's team, of those who are out too."""
    total = 0.0
    for other in range(rules.num_players):
        if rules.team[other] == rules.team[player]:
            total += score_of(world, other)
    return total


@compiled
def rank_by_score(world: Any, rules: Any) -> None:
    """The team with the best score wins, named by its first seat; equal ones draw."""
    best = -1.0
    for player in range(rules.num_players):
        if first_of_team(rules, player) != player:
            continue
        score = team_score(world, rules, player)
        if score > best:
            best = score
            world.clock[WINNER] = player
        elif score == best:
            world.clock[WINNER] = NO_WINNER


@compiled
def team_is_alive(world: Any, rules: Any, player: int) -> bool:
    """True while anybody of the player's team is in the game."""
    for other in range(rules.num_players):
        if rules.team[other] == rules.team[player] and world.players[other, IS_ALIVE] != 0:
            return True
    return False


@compiled
def reward_end(world: Any, rules: Any, rewards: Any) -> None:
    """In conquest a team is paid -1 when it falls and +1 when it is the last; a draw pays nobody
    who falls in the last tick.
    """
    if rules.goal != CONQUEST:
        return
    is_over = world.clock[PHASE] == TERMINATED
    is_draw = is_over and world.clock[WINNER] == NO_WINNER
    for player in range(rules.num_players):
        if world.players[player, IS_OUT] != 0:
            continue
        if team_is_alive(world, rules, player):
            rewards[player] += 1.0 if is_over else 0.0
            continue
        world.players[player, IS_OUT] = 1
        if not is_draw:
            rewards[player] -= 1.0
