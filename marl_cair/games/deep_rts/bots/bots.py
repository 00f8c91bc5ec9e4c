"""Scripted opponents of Deep RTS. They see what an agent sees: planes and action mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.bots.doctrines import DOCTRINES, NO_DOCTRINE, Doctrine
from marl_cair.games.deep_rts.bots.plans import plan_by_doctrine
from marl_cair.games.deep_rts.bots.sight import make_sight
from marl_cair.games.deep_rts.orders.grid import GRID_NOOP
from marl_cair.games.deep_rts.orders.orders import NOOP
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.scripted import ScriptedPlayer, choose_by_kind

RANDOM = "random"


@compiled
def decide_all(
    is_random: bool, groups: Any, seen: Any, planes: Any, mask: Any, random: Any, out: Any
) -> None:
    """Decide for each of N rows: planes [N, C, H, W], mask [N, A], out [N]."""
    for index in range(planes.shape[0]):
        if is_random:
            action = choose_by_kind(mask[index], groups, random)
        else:
            action = plan_by_doctrine(planes[index], mask[index], seen)
        out[index] = action if mask[index, action] else NOOP


@compiled
def decide_for_all_units(groups: Any, planes: Any, mask: Any, random: Any, out: Any) -> None:
    """A random order for each unit that can take one: mask [N, H, W, A], out [N, H, W]."""
    for index in range(mask.shape[0]):
        for row in range(mask.shape[1]):
            for column in range(mask.shape[2]):
                out[index, row, column] = GRID_NOOP
                if mask[index, row, column, GRID_NOOP + 1 :].any():
                    action = choose_by_kind(mask[index, row, column], groups, random)
                    out[index, row, column] = action


def make_bot(
    name: str, scenario: Scenario, spec: GameSpec, doctrine: Doctrine | None = None
) -> ScriptedPlayer:
    """The bot that plays by a doctrine, None plays at random.

    Raises:
        ValueError: a doctrine with an action space other than `unit`.
    """
    if doctrine is not None and scenario.actions != "unit":
        raise ValueError(
            f"deep_rts: the bot {name} cannot play the action space {scenario.actions!r}; "
            f"make the game with actions='unit', or play the bot {RANDOM!r}"
        )
    if spec.action_shape:
        return ScriptedPlayer(name, partial(decide_for_all_units, spec.action_groups))
    seen = make_sight(scenario, doctrine or NO_DOCTRINE)
    return ScriptedPlayer(name, partial(decide_all, doctrine is None, spec.action_groups, seen))


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    RANDOM: partial(make_bot, RANDOM),
    **{name: partial(make_bot, name, doctrine=plan) for name, plan in DOCTRINES.items()},
}
