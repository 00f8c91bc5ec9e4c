"""Reads the numbers that the panels show: resources, scoreboard and score of each player."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts import state as rts
from marl_cair.games.deep_rts.tables import NUM_KINDS, NUM_MOBILE_KINDS
from marl_cair.games.engine import BatchedEngine
from marl_cair.viewer.measures import MEASURES, find_resources, read_columns

Counts = dict[str, NDArray[np.float64]]


class Numbers(NamedTuple):
    """Numbers of P players by name, float64 [P] each."""

    resources: Counts  # what they own
    scoreboard: Counts  # how well they do
    score: NDArray[np.float64]  # [P], what the graph shows
    score_name: str


def read_numbers(
    engine: BatchedEngine, returns: NDArray[np.float64], kills: NDArray[np.int64]
) -> Numbers:
    """The numbers of world 0; `returns` float64 [P] are the rewards so far, `kills` int64 [P]."""
    owned = {name: values.astype(np.float64) for name, values in read_columns(engine).items()}
    resources = find_resources(engine, owned)
    if engine.game.name == "deep_rts":
        return _read_deep_rts(engine, resources, owned, kills)
    scoreboard = {
        name.replace("_", " "): value[0] for name, value in engine.info(np.float64).items()
    }
    if engine.game.name == "deep_line_wars":
        measures = MEASURES["deep_line_wars"].items()
        scoreboard |= {name: count(engine, {}).astype(np.float64) for name, count in measures}
        return Numbers(resources, scoreboard, resources["health"], "health")
    scoreboard["return"] = returns.copy()
    name = next((name for name in ("score", "pipes passed") if name in scoreboard), "return")
    return Numbers(resources, scoreboard, scoreboard[name], name)


def _read_deep_rts(
    engine: BatchedEngine, resources: Counts, owned: Counts, kills: NDArray[np.int64]
) -> Numbers:
    """Kills, attack and defence as the thesis's scoreboard has them: hit points dealt and taken."""
    players = read_world(engine).players[0].astype(np.float64)
    alive = players[:, rts.NUM_OWNED : rts.NUM_OWNED + NUM_KINDS]
    gathered = players[:, rts.GATHERED : rts.UPGRADES].sum(1)
    resources = resources | {
        "food": owned["own food used"],
        "of": owned["own food limit"],
        "units": alive[:, :NUM_MOBILE_KINDS].sum(1),
    }
    scoreboard = {
        "kills": kills.astype(np.float64),
        "attack": players[:, rts.DAMAGE_DONE],
        "damage": players[:, rts.DAMAGE_TAKEN],
        "gathered": gathered,
        "score": owned["own score"],
    }
    return Numbers(resources, scoreboard, owned["own score"], "score")


def read_world(engine: BatchedEngine) -> Any:
    """A copy of the game's World [1, ...] of arrays."""
    kind: Any = type(engine.game.allocate(engine.scenario, 1))
    return kind(*engine.snapshot([0]).world)


def count_kills(old: rts.World, new: rts.World) -> NDArray[np.int64]:
    """Units of Deep RTS that fell between two ticks, int64 [P], each counted for the owner of a
    unit that fought it.
    """
    fallen = old.units[0, :, rts.UNIT_KIND] >= 0
    fallen &= old.units[0, :, rts.UNIT_SERIAL] != new.units[0, :, rts.UNIT_SERIAL]
    num_players, slots = old.roster.shape[1:]
    kills: NDArray[np.int64] = np.zeros(num_players, np.int64)
    fights = old.units[0, :, rts.UNIT_STATE] == rts.FIGHTING
    for unit in np.flatnonzero(fallen):
        fighters = np.flatnonzero(fights & (old.units[0, :, rts.UNIT_TARGET] == unit))
        if len(fighters):
            kills[fighters[0] // slots] += 1
    return kills
