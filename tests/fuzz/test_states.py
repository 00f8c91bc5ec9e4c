"""Damaged states: each is refused by name, or plays on without a read outside of any array.

Runs where an index out of range raises: with bounds checks (`make fuzz`) or in plain Python.
"""

from __future__ import annotations

import faulthandler
import sys
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.checks.state import Range
from marl_cair.games.compiled import is_compiling
from marl_cair.games.engine import BatchedEngine, Snapshot
from tests.games.cases import IN_PROCESS, QUICK_CASES, Case, choose_actions

if is_compiling() and not numba.config.BOUNDSCHECK:
    pytest.skip("needs NUMBA_BOUNDSCHECK=1 or NUMBA_DISABLE_JIT=1", allow_module_level=True)

pytestmark = pytest.mark.plain_python
LONGEST_ROUND_SECONDS = 600  # a state that makes the rules loop for ever ends the run
PICTURES = ("image", "gray", "gray_80", "gray_stack")  # take plain Python seconds each
NUM_SNAPSHOTS, DECISIONS_BETWEEN, DECISIONS_AFTER = 6, 12, 5


@pytest.fixture(params=QUICK_CASES, ids=str)
def case(request) -> Case:
    """A scenario of a game with one of its action spaces."""
    return request.param


@cache
def play_snapshots(case: Case) -> tuple[BatchedEngine, tuple[Snapshot, ...]]:
    """An engine of one world, and its states in the course of a game or two."""
    engine, luck = case.engine(), np.random.default_rng(1)
    engine.reset(1)
    snapshots = []
    for number in range(NUM_SNAPSHOTS * DECISIONS_BETWEEN):
        if number % DECISIONS_BETWEEN == 0:
            snapshots.append(engine.snapshot())
        if (engine.terminated | engine.truncated)[0]:
            engine.reset(number)
        engine.step(choose_actions(engine, luck.random((1, engine.num_players, 2))))
    return engine, tuple(snapshots)


def ranges_of(engine: BatchedEngine) -> dict[str, Range]:
    return dict(engine.game.state_limits(engine.scenario).ranges)


def copy(snapshot: Snapshot) -> Snapshot:
    return snapshot._replace(world=tuple(field.copy() for field in snapshot.world))


def draw_place(field: np.ndarray, luck: np.random.Generator) -> tuple[int, ...]:
    return tuple(int(luck.integers(size)) for size in field.shape)


def ends_at(bounds: Range, field: np.ndarray, place: tuple[int, ...]) -> tuple[Any, Any]:
    """The lowest and the highest value that are allowed there."""
    low, high = (np.broadcast_to(end, field.shape)[place] for end in (bounds.low, bounds.high))
    return low.item(), high.item()


def damage(
    engine: BatchedEngine, snapshot: Snapshot, others: tuple[Snapshot, ...], luck: Any
) -> Snapshot:
    """A few values changed within their ranges: drawn, one off, moved, or of another state."""
    damaged, names, ranges = copy(snapshot), engine._worlds._fields, ranges_of(engine)
    for _ in range(luck.integers(1, 4)):
        index = int(luck.integers(len(names)))
        field = damaged.world[index]
        place = draw_place(field, luck)
        low, high = ends_at(ranges[names[index]], field, place)
        kind = luck.integers(5)
        if kind == 0:
            field[...] = others[luck.integers(len(others))].world[index]
        elif kind == 1:
            field[place] = field[draw_place(field, luck)]
        elif kind == 2 and field.dtype.kind in "iu":
            field[place] = min(high, max(low, int(field[place]) + int(luck.choice((-1, 1)))))
        elif kind == 3:
            field[place] = luck.choice((low, high)) if field.dtype.kind != "u" else low
        else:
            share = float(luck.random())
            field[place] = low + type(low)(share * (high - low))
    return damaged


def use(engine: BatchedEngine, luck: np.random.Generator) -> None:
    """All that can be done with a world: see, draw, list actions, play on."""
    for _ in range(DECISIONS_AFTER):
        mask = engine.action_mask()
        for name in engine.spec.representations:
            if is_compiling() or name not in PICTURES:
                engine.observe(name)
        engine.observe("planes", worlds=[0])
        for player in (None, *range(engine.num_players)) if is_compiling() else ():
            engine.render(0, player)
        engine.map_names()
        engine.info()
        if luck.random() < 0.5:
            actions = choose_actions(engine, luck.random((1, engine.num_players, 2)))
        else:
            actions = luck.integers(0, engine.num_actions, mask.shape[:-1])
        engine.step(actions)


def is_taken(engine: BatchedEngine, damaged: Snapshot) -> bool:
    """Whether the engine goes on from it; a refusal names what is damaged."""
    try:
        engine.restore(damaged)
    except ValueError as error:
        if "the saved state is damaged" not in str(error):
            raise
        return False
    return True


def test_a_damaged_state_is_refused_or_plays_on(case, fuzz_rounds):
    engine, snapshots = play_snapshots(case)
    for luck in fuzz_rounds:
        snapshot = snapshots[luck.integers(len(snapshots))]
        faulthandler.dump_traceback_later(LONGEST_ROUND_SECONDS, exit=True, file=sys.__stderr__)
        if is_taken(engine, damage(engine, snapshot, snapshots, luck)):
            use(engine, luck)
        faulthandler.cancel_dump_traceback_later()


@pytest.mark.parametrize("game", IN_PROCESS)
def test_every_field_has_a_range_and_no_value_outside_of_it_is_taken(game):
    engine, snapshots = play_snapshots(Case(game, GAMES[game].default_scenario))
    luck = np.random.default_rng(2)
    ranges = ranges_of(engine)
    assert list(ranges) == list(engine._worlds._fields)
    for index, (name, bounds) in enumerate(ranges.items()):
        for _ in range(10):
            damaged = copy(snapshots[-1])
            field = damaged.world[index]
            place = draw_place(field, luck)
            for value in outside(field.dtype, *ends_at(bounds, field, place)):
                field[place] = value
                with pytest.raises(
                    ValueError, match=rf"saved state is damaged: {name}\b.* of world 0 is"
                ):
                    engine.restore(damaged)


def outside(dtype: np.dtype, low: Any, high: Any) -> list[Any]:
    """Values of the type that are not in low..high."""
    if dtype.kind == "f":
        return [low - 1, high + 1, np.nan, np.inf, -np.inf]
    least, most = np.iinfo(dtype).min, np.iinfo(dtype).max
    values = {least, low - 1, high + 1, most}
    return [value for value in values if least <= value <= most and not low <= value <= high]
