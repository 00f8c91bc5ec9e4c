"""The rules of Tug of war, compiled. Each function works on the worlds first..last-1 only."""

from typing import NamedTuple

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import draw_below, mix

REST, PULL = range(2)
LEAST_STAMINA, NUM_STAMINAS = 3, 3  # at the start: 3, 4 or 5
MOST_STAMINA = 5


class Rules(NamedTuple):
    """The numbers of a scenario that the compiled rules read."""

    rope_end: int
    max_ticks: int


def make_rules(scenario):
    """The numbers of `scenario`."""
    return Rules(scenario.rope_end, scenario.max_ticks)


@compiled
def reset(worlds, rules, seeds, mask, first, last):
    """New games in the worlds of `mask` bool [B], from `seeds` uint64 [B]."""
    for b in range(first, last):
        if mask[b]:
            worlds.random[b, 0] = mix(seeds[b] + np.uint64(1))
            worlds.tick[b] = 0
            worlds.rope[b] = 0
            worlds.is_over[b] = False
            stamina = LEAST_STAMINA + draw_below(worlds.random[b], 0, NUM_STAMINAS)
            for player in range(2):
                worlds.stamina[b, player] = stamina
                worlds.illegal[b, player] = 0


@compiled
def pull(worlds, b, player, action):
    """One player's action; returns by how much it pulls. An illegal pull is a counted rest."""
    if action == PULL and worlds.stamina[b, player] >= 1:
        worlds.stamina[b, player] -= 1
        return 1
    worlds.illegal[b, player] += int(action == PULL)
    worlds.stamina[b, player] = min(MOST_STAMINA, worlds.stamina[b, player] + 1)
    return 0


@compiled
def step(worlds, rules, actions, outcome, first, last):
    """One step of every world; a finished world stays as it is."""
    for b in range(first, last):
        outcome.rewards[b, 0] = outcome.rewards[b, 1] = 0.0
        if worlds.is_over[b]:
            continue
        worlds.tick[b] += 1
        worlds.rope[b] += pull(worlds, b, 0, actions[b, 0]) - pull(worlds, b, 1, actions[b, 1])
        outcome.winner[b] = NO_WINNER
        has_winner = abs(worlds.rope[b]) >= rules.rope_end
        if has_winner:
            winner = 0 if worlds.rope[b] > 0 else 1
            outcome.winner[b] = winner
            outcome.rewards[b, winner], outcome.rewards[b, 1 - winner] = 1.0, -1.0
        outcome.terminated[b] = has_winner
        outcome.truncated[b] = not has_winner and worlds.tick[b] >= rules.max_ticks
        worlds.is_over[b] = outcome.terminated[b] or outcome.truncated[b]


@compiled
def legal_actions(worlds, rules, out, first, last):
    """Write the mask: out bool [B, 2, 2]."""
    for b in range(first, last):
        for player in range(2):
            out[b, player, REST] = True
            out[b, player, PULL] = worlds.stamina[b, player] >= 1 and not worlds.is_over[b]


@compiled
def observe(worlds, rules, out, first, last):
    """Write `vector`: out float32 [B, 2, 3], each player from its own side."""
    for b in range(first, last):
        for player in range(2):
            sign = 1 if player == 0 else -1
            out[b, player, 0] = sign * worlds.rope[b]
            out[b, player, 1] = worlds.stamina[b, player]
            out[b, player, 2] = worlds.stamina[b, 1 - player]
