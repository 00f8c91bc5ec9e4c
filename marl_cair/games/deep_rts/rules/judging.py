"""Who is out, who has won, and what that pays: goals, score, shaping."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_finished
from marl_cair.games.deep_rts.rules.roster import can_pay, has_food
from marl_cair.games.game import NO_WINNER

SCORE_UNIT = 100.0  # score points that pay a reward of 1 where the goal is the score
STORE_WEIGHT = 0.3  # of a stored resource in the potential; what is built counts whole
POTENTIAL = 0.8  # weight of the potential, below what a win pays


@compiled
def score_of(world: Any, player: int) -> float:
    """The original's score: gathered, created, alive, and fought (thesis-era formula)."""
    gathered = (
        2.0 * world.players[player, s.GATHERED + t.GOLD]
        + world.players[player, s.GATHERED + t.LUMBER]
    )
    gathered += 3.0 * world.players[player, s.GATHERED + t.STONE]
    created = 0.0
    for kind in range(t.NUM_KINDS):
        created += world.players[player, s.NUM_CREATED + kind]
    fought = (
        0.6 * world.players[player, s.DAMAGE_DONE] - 0.5 * world.players[player, s.DAMAGE_TAKEN]
    )
    alive = float(world.players[player, s.NUM_UNITS])
    return float(0.5 * gathered + 2.0 * created + alive + max(0.0, fought))


@compiled
def progress_of(world: Any, rules: Any, player: int) -> int:
    """How far the player is on its way to goal_amount."""
    if rules.goal == rb.GOLD_GOAL:
        return int(world.players[player, s.GATHERED + t.GOLD])
    if rules.goal == rb.LUMBER_GOAL:
        return int(world.players[player, s.GATHERED + t.LUMBER])
    if rules.goal == rb.ARMY_GOAL:
        soldiers = 0
        for kind in (t.FOOTMAN, t.ARCHER, t.CAVALRY):
            soldiers += int(world.players[player, s.NUM_CREATED + kind])
        return soldiers
    return 0


@compiled
def measure(world: Any, rules: Any, player: int) -> float:
    """What the reward pays the growth of: the share of the goal, or the score; 0 in conquest."""
    if rules.goal == rb.CONQUEST:
        return 0.0
    if rules.goal == rb.SCORE_GOAL:
        return score_of(world, player) / SCORE_UNIT
    return float(min(1.0, progress_of(world, rules, player) / rules.goal_amount))


@compiled
def worth_of(world: Any, rules: Any, player: int) -> float:
    """Gold and lumber in living units by their health, and a part of what is stored."""
    worth = 0.0
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        kind = world.units[unit, s.UNIT_KIND]
        price = float(
            rules.product[kind, rb.PRODUCT_COST + t.GOLD]
            + rules.product[kind, rb.PRODUCT_COST + t.LUMBER]
        )
        worth += price * world.units[unit, s.UNIT_HEALTH] / rules.kinds[kind, rb.KIND_HEALTH]
    for resource in range(t.NUM_RESOURCES):
        worth += STORE_WEIGHT * world.players[player, s.RESOURCES + resource]
    return float(worth)


@compiled
def potential(world: Any, rules: Any, player: int) -> float:
    """How well the player's team stands, in -0.8..0.8: its share of all that is worth something."""
    own, total = 0.0, 1.0
    for other in range(rules.num_players):
        worth = worth_of(world, rules, other)
        total += worth
        if rules.team[other] == rules.team[player]:
            own += worth
    return float(POTENTIAL * (2.0 * own / total - 1.0))


@compiled
def can_go_on(world: Any, rules: Any, player: int) -> bool:
    """True with anybody who walks, with one in training, or with the means to train one."""
    for kind in range(t.NUM_MOBILE_KINDS):
        if world.players[player, s.NUM_OWNED + kind] > 0:
            return True
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        if world.units[unit, s.UNIT_HEALTH] <= 0 or not is_finished(world, unit):
            continue
        if (
            world.units[unit, s.UNIT_QUEUE_LENGTH] > 0
            and world.units[unit, s.UNIT_QUEUE + 0] < t.FIRST_UPGRADE
        ):
            return True
        for product in range(t.NUM_MOBILE_KINDS):
            if (
                rules.can_make[world.units[unit, s.UNIT_KIND], product]
                and rules.product[product, rb.PRODUCT_IS_ENABLED]
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
        if world.players[player, s.IS_ALIVE] and not can_go_on(world, rules, player):
            world.players[player, s.IS_ALIVE] = False
            for place in range(world.players[player, s.NUM_UNITS]):
                world.units[world.roster[player, place], s.UNIT_HEALTH] = 0
            world.clock[s.NUM_FALLEN] += 1
    if rules.goal == rb.CONQUEST:
        judge_conquest(world, rules)
    else:
        judge_race(world, rules)
    if world.clock[s.PHASE] == s.RUNNING and world.clock[s.TICK] >= rules.max_ticks:
        world.clock[s.PHASE] = s.TRUNCATED
        if rules.goal == rb.SCORE_GOAL:
            world.clock[s.PHASE] = s.TERMINATED
            rank_by_score(world, rules)


@compiled
def judge_conquest(world: Any, rules: Any) -> None:
    """The last team standing wins; none left is a draw."""
    first = -1
    for player in range(rules.num_players):
        if not world.players[player, s.IS_ALIVE]:
            continue
        if first >= 0 and rules.team[player] != rules.team[first]:
            return
        if first < 0:
            first = player
    world.clock[s.PHASE] = s.TERMINATED
    world.clock[s.WINNER] = NO_WINNER
    for player in range(rules.num_players - 1, -1, -1):
        if first >= 0 and rules.team[player] == rules.team[first]:
            world.clock[s.WINNER] = player


@compiled
def first_of_team(rules: Any, player: int) -> int:
    """The first seat of the player's team, which stands for it as the winner."""
    for other in range(player):
        if rules.team[other] == rules.team[player]:
            return other
    return player


@compiled
def judge_race(world: Any, rules: Any) -> None:
    """The first to reach the goal wins; two teams in one tick draw; none left ends it too."""
    num_alive, num_there = 0, 0
    for player in range(rules.num_players):
        num_alive += int(world.players[player, s.IS_ALIVE])
        if rules.goal != rb.SCORE_GOAL and progress_of(world, rules, player) >= rules.goal_amount:
            team = first_of_team(rules, player)
            if num_there == 0 or world.clock[s.WINNER] != team:
                num_there += 1
            world.clock[s.WINNER] = team
    if num_there > 1:
        world.clock[s.WINNER] = NO_WINNER
    if num_there > 0 or num_alive == 0:
        world.clock[s.PHASE] = s.TERMINATED


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
            world.clock[s.WINNER] = player
        elif score == best:
            world.clock[s.WINNER] = NO_WINNER


@compiled
def team_is_alive(world: Any, rules: Any, player: int) -> bool:
    """True while anybody of the player's team is in the game."""
    for other in range(rules.num_players):
        if rules.team[other] == rules.team[player] and world.players[other, s.IS_ALIVE] != 0:
            return True
    return False


@compiled
def reward_end(world: Any, rules: Any, rewards: Any) -> None:
    """In conquest a team is paid -1 when it falls and +1 when it is the last; a draw pays nobody
    who falls in the last tick.
    """
    if rules.goal != rb.CONQUEST:
        return
    is_over = world.clock[s.PHASE] == s.TERMINATED
    is_draw = is_over and world.clock[s.WINNER] == NO_WINNER
    for player in range(rules.num_players):
        if world.players[player, s.IS_OUT] != 0:
            continue
        if team_is_alive(world, rules, player):
            rewards[player] += 1.0 if is_over else 0.0
            continue
        world.players[player, s.IS_OUT] = 1
        if not is_draw:
            rewards[player] -= 1.0
