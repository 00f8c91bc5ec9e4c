"""Elimination, winners and rewards: goals, score, shaping."""

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_finished
from marl_cair.games.deep_rts.rules.roster import can_pay, has_food
from marl_cair.games.game import NO_WINNER

SCORE_UNIT = 100.0  # score points for a reward of 1 where the goal is the score
STORE_WEIGHT = 0.3  # of a stored resource in the potential; units count whole
POTENTIAL = 0.8  # weight of the potential, below the reward of a win


@compiled
def score_of(world: Any, player: int) -> float:
    """The original's score: gathered, created, alive, and fought (formula of the thesis)."""
    gold = 2.0 * world.players[player, s.GATHERED + t.GOLD]
    gathered = gold + world.players[player, s.GATHERED + t.LUMBER]
    gathered += 3.0 * world.players[player, s.GATHERED + t.STONE]
    created = 0.0
    for kind in range(t.NUM_KINDS):
        created += world.players[player, s.NUM_CREATED + kind]
    done = 0.6 * world.players[player, s.DAMAGE_DONE]
    fought = done - 0.5 * world.players[player, s.DAMAGE_TAKEN]
    alive = float(world.players[player, s.NUM_UNITS])
    return float(0.5 * gathered + 2.0 * created + alive + max(0.0, fought))


@compiled
def progress_of(world: Any, rules: Any, player: int) -> int:
    """The player's progress towards goal_amount: gold, lumber or soldiers."""
    if rules.goal == rb.ARMY_GOAL:
        soldiers = 0
        for kind in (t.FOOTMAN, t.ARCHER, t.CAVALRY):
            soldiers += int(world.players[player, s.NUM_CREATED + kind])
        return soldiers
    resource = t.GOLD if rules.goal == rb.GOLD_GOAL else t.LUMBER
    return int(world.players[player, s.GATHERED + resource])


@compiled
def measure(world: Any, rules: Any, player: int) -> float:
    """The quantity whose growth is paid: the share of the goal, or the score; 0 in conquest."""
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
        gold = rules.product[kind, rb.PRODUCT_COST + t.GOLD]
        price = float(gold + rules.product[kind, rb.PRODUCT_COST + t.LUMBER])
        worth += price * world.units[unit, s.UNIT_HEALTH] / rules.kinds[kind, rb.KIND_HEALTH]
    for resource in range(t.NUM_RESOURCES):
        worth += STORE_WEIGHT * world.players[player, s.RESOURCES + resource]
    return float(worth)


@compiled
def potential(world: Any, rules: Any, player: int) -> float:
    """The share of the player's team in the worth of all, scaled to -0.8..0.8."""
    own, total = 0.0, 1.0
    for other in range(rules.num_players):
        worth = worth_of(world, rules, other)
        total += worth
        if rules.team[other] == rules.team[player]:
            own += worth
    return float(POTENTIAL * (2.0 * own / total - 1.0))


@compiled
def can_go_on(world: Any, rules: Any, player: int) -> bool:
    """True with a unit that walks, with one in training, or with the means to train one."""
    for kind in range(t.NUM_MOBILE_KINDS):
        if world.players[player, s.NUM_OWNED + kind] > 0:
            return True
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        if world.units[unit, s.UNIT_HEALTH] <= 0 or not is_finished(world, unit):
            continue
        is_busy = world.units[unit, s.UNIT_QUEUE_LENGTH] > 0
        if is_busy and world.units[unit, s.UNIT_QUEUE + 0] < t.FIRST_UPGRADE:
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
    """Eliminate players without means; end the game at its goal, and at the time limit.

    At the time limit no player has won, unless the score is the goal.
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
def alive_teams(world: Any, rules: Any) -> int:
    """Bits of the teams with a player in the game."""
    alive = 0
    for player in range(rules.num_players):
        if world.players[player, s.IS_ALIVE] != 0:
            alive |= 1 << int(rules.team[player])
    return alive


@compiled
def judge_conquest(world: Any, rules: Any) -> None:
    """The last team alive wins; none left is a draw."""
    alive = alive_teams(world, rules)
    if alive & (alive - 1) != 0:
        return  # two teams or more
    world.clock[s.PHASE] = s.TERMINATED
    world.clock[s.WINNER] = NO_WINNER
    for team in range(rules.num_players):
        if alive >> team & 1 != 0:
            world.clock[s.WINNER] = team


@compiled
def judge_race(world: Any, rules: Any) -> None:
    """The first team at the goal wins; two in one tick draw; no player left ends the game too."""
    num_alive, num_done = 0, 0
    for player in range(rules.num_players):
        num_alive += int(world.players[player, s.IS_ALIVE])
        if rules.goal != rb.SCORE_GOAL and progress_of(world, rules, player) >= rules.goal_amount:
            if num_done == 0 or world.clock[s.WINNER] != rules.team[player]:
                num_done += 1
            world.clock[s.WINNER] = rules.team[player]
    if num_done > 1:
        world.clock[s.WINNER] = NO_WINNER
    if num_done > 0 or num_alive == 0:
        world.clock[s.PHASE] = s.TERMINATED


@compiled
def rank_by_score(world: Any, rules: Any) -> None:
    """The team with the highest sum of scores wins, eliminated players included; ties draw."""
    best = -1.0
    for team in range(rules.num_players):
        total, is_team = 0.0, False
        for player in range(rules.num_players):
            if rules.team[player] == team:
                total += score_of(world, player)
                is_team = True
        if is_team and total > best:
            best = total
            world.clock[s.WINNER] = team
        elif is_team and total == best:
            world.clock[s.WINNER] = NO_WINNER


@compiled
def reward_end(world: Any, rules: Any, rewards: Any) -> None:
    """In conquest, pay a team -1 when it falls and +1 when it is the last.

    After a draw, teams that fall in the last tick are paid 0.
    """
    if rules.goal != rb.CONQUEST:
        return
    is_over = world.clock[s.PHASE] == s.TERMINATED
    is_draw = is_over and world.clock[s.WINNER] == NO_WINNER
    alive = alive_teams(world, rules)
    for player in range(rules.num_players):
        if world.players[player, s.IS_OUT] != 0:
            continue
        if alive >> int(rules.team[player]) & 1 != 0:
            rewards[player] += 1.0 if is_over else 0.0
            continue
        world.players[player, s.IS_OUT] = 1
        if not is_draw:
            rewards[player] -= 1.0
