"""Properties of whole games: money is conserved, masks tell the truth, rewards add up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.scenarios import SCENARIOS
from marl_cair.games.deep_line_wars.tables import (
    PRESETS,
    PROGRESS_PER_TILE,
    TOWER_NAMES,
    UNIT_NAMES,
)
from marl_cair.games.engine import BatchedEngine
from tests.games.cases import Luck, choose_actions
from tests.games.deep_line_wars.board import Board

seeds = st.integers(0, 2**32 - 1)
presets = st.sampled_from(list(PRESETS))
action_spaces = st.sampled_from(["spatial", "classic"])


FIELDS = ("gold", "lumber", "income", "health")


class Unit(NamedTuple):
    """A living unit, as the bookkeeper sees it."""

    kind: int
    arrives: bool  # in the next tick


def living_units(board: Board, player: int) -> dict[int, Unit]:
    """By slot; slots are reused only after the whole ring, so a slot is a name for a while."""
    world, speeds = board.world, PRESETS[board.engine.scenario.preset].unit_speed
    slots = world.unit_kind.shape[1]
    units = {}
    for age in range(world.num_units[player]):
        slot = (int(world.first_unit[player]) + age) % slots
        if world.unit_health[player, slot] > 0:
            kind = int(world.unit_kind[player, slot])
            way = int(world.unit_column[player, slot]) * PROGRESS_PER_TILE
            way += int(world.unit_progress[player, slot]) + speeds[kind]
            goal = (board.engine.scenario.columns - 1) * PROGRESS_PER_TILE
            units[slot] = Unit(kind, way >= goal)
    return units


class Books:
    """Gold, lumber, income and health of both players, kept by hand from what can be seen."""

    def __init__(self, board: Board) -> None:
        self.board, self.preset = board, PRESETS[board.engine.scenario.preset]
        self.gold, self.lumber, self.income, self.health = board.read(*FIELDS)

    def spend(self, player: int, name: str) -> None:
        verb, _, what = name.partition("_")
        if verb == "buy":
            kind = UNIT_NAMES.index(what)
            self.gold[player] -= self.preset.unit_cost_gold[kind]
            self.income[player] += self.preset.unit_income_gold[kind]
        elif verb == "build":
            kind = TOWER_NAMES.index(what.split("_")[0])
            self.gold[player] -= self.preset.tower_cost_gold[kind]
            self.lumber[player] -= self.preset.tower_cost_lumber[kind]

    def book_losses(self, before: list[dict[int, Unit]]) -> None:
        """A unit that is gone has arrived, if it could, or else was killed."""
        for player in range(2):
            left = living_units(self.board, player)
            for slot, unit in before[player].items():
                if unit.arrives:
                    assert slot not in left
                    self.health[1 - player] -= 1
                elif slot not in left:
                    self.gold[1 - player] += self.preset.unit_bounty_gold[unit.kind]

    def pay(self) -> None:
        if self.board.world.tick[0] % self.preset.income_interval_ticks == 0:
            for player in range(2):
                self.gold[player] += self.income[player]
                self.lumber[player] += self.preset.lumber_per_interval

    def check(self) -> None:
        assert self.board.read(*FIELDS) == [self.gold, self.lumber, self.income, self.health]
        assert min(*self.gold, *self.lumber) >= 0


@pytest.mark.slow
@settings(max_examples=12)
@given(seed=seeds, preset=presets, actions=action_spaces, gold=st.integers(0, 2_000))
def test_gold_lumber_income_and_health_follow_from_the_events(seed, preset, actions, gold):
    board = Board(seed=seed, preset=preset, actions=actions)
    board.world.gold[:] = gold
    books, engine = Books(board), board.engine
    for numbers in Luck.draw(350, 1, 2, seed).numbers:
        masks, chosen = engine.action_mask()[0], choose_actions(engine, numbers)
        before = [living_units(board, player) for player in (0, 1)]
        engine.step(chosen)
        for player, action in enumerate(chosen[0].tolist()):
            if masks[player, action]:
                books.spend(player, engine.spec.action_names[action])
        books.book_losses(before)
        books.pay()
        books.check()
        if engine.terminated[0]:
            break


def repeat_for_every_action(board: Board, player: int) -> BatchedEngine:
    """As many copies of the board's world as there are actions; in each, `player` takes one."""
    engine = board.engine
    many = BatchedEngine(engine.game, engine.scenario, engine.num_actions)
    many.reset(np.zeros(engine.num_actions, np.uint64))
    for field, held in zip(many._worlds, engine._worlds, strict=True):
        field[:] = held[0]  # also what no game can hold, which `restore` refuses
    actions = np.full((engine.num_actions, 2), board.noop)
    actions[:, player] = np.arange(engine.num_actions)
    many.step(actions)
    return many


def difference(many: BatchedEngine, action: int, noop: int) -> dict[str, np.ndarray]:
    """Fields of the world in which `action` was taken, less those of the no-op's world."""
    changes = {}
    for name, field in many._worlds._asdict().items():
        change = field[action].astype(np.int64) - field[noop].astype(np.int64)
        if change.any():
            changes[name] = change
    return changes


def check_effect(board: Board, player: int, name: str, changes: dict[str, np.ndarray]) -> None:
    """The action changed what its name says, of the player itself, and nothing else."""
    preset = PRESETS[board.engine.scenario.preset]
    verb, _, what = name.partition("_")
    own = np.eye(2, dtype=np.int64)[player]  # [1, 0] for player 0
    if verb == "buy":
        kind = UNIT_NAMES.index(what)
        assert (changes["gold"] == -preset.unit_cost_gold[kind] * own).all()
        assert (changes["income"] == preset.unit_income_gold[kind] * own).all()
        assert (changes["num_units"] == own).all()
        allowed = {"gold", "income", "num_units", "random"}
        assert {field for field in changes if not field.startswith("unit_")} == allowed
    elif verb == "build":
        kind, *cell = what.split("_")
        number = TOWER_NAMES.index(kind)
        row, column = (int(part[1:]) for part in cell) if cell else board.world.cursor[player]
        assert (changes["gold"] == -preset.tower_cost_gold[number] * own).all()
        lumber = -preset.tower_cost_lumber[number] * own
        assert (changes.get("lumber", np.zeros(2)) == lumber).all()
        assert np.argwhere(changes["tower_at"]).tolist() == [[player, row, column - 1]]
        assert changes["tower_at"][player, row, column - 1] == number + 1  # from NO_TOWER
        assert (changes["num_towers"] == own).all()
    elif verb == "cursor":
        moves = {"up": (-1, 0), "down": (1, 0), "right": (0, 1), "left": (0, -1)}
        assert changes["cursor"][player].tolist() == list(moves[what])
        assert set(changes) == {"cursor"}


@pytest.mark.slow
@settings(max_examples=12)
@given(
    seed=seeds,
    preset=presets,
    actions=action_spaces,
    player=st.integers(0, 1),
    gold=st.integers(0, 120),
    lumber=st.integers(0, 4),
)
def test_an_action_does_what_it_says_if_the_mask_allows_it_and_else_nothing(
    seed, preset, actions, player, gold, lumber
):
    board = Board(seed=seed, preset=preset, actions=actions)
    engine = board.engine
    for numbers in Luck.draw(60, 1, 2, seed).numbers:
        board.world.gold[:] += 10
        engine.step(choose_actions(engine, numbers))
    board.world.num_units[1 - player] = 0  # so that a new tower finds nothing to shoot at
    board.world.gold[:], board.world.lumber[:] = gold, lumber
    mask = engine.action_mask()[0, player]
    many = repeat_for_every_action(board, player)
    for action, name in enumerate(engine.spec.action_names):
        changes = difference(many, action, board.noop)
        if mask[action]:
            assert "illegal" not in changes, name
            assert bool(changes) == (action != board.noop), name
            check_effect(board, player, name, changes)
        else:
            assert set(changes) == {"illegal"}, name
            assert changes["illegal"].tolist() == np.eye(2)[player].tolist(), name


@settings(max_examples=6)
@given(seed=seeds, scenario=st.sampled_from(list(SCENARIOS)), actions=action_spaces)
def test_health_never_rises_and_rewards_cancel_out(seed, scenario, actions):
    engine = make_engine("deep_line_wars", scenario, actions=actions, reward="shaped")
    engine.reset(seed)
    before = engine._worlds.health.copy()
    for numbers in Luck.draw(120, 1, 2, seed).numbers:
        engine.step(choose_actions(engine, numbers))
        assert (engine._worlds.health <= before).all()
        assert engine.rewards[0, 0] == -engine.rewards[0, 1]
        before = engine._worlds.health.copy()


def potential(engine: BatchedEngine) -> float:
    """Of player 0, by hand."""
    health, income = engine._worlds.health[0].astype(float), engine._worlds.income[0].astype(float)
    return 0.5 * (health[0] - health[1]) / 50 + 0.3 * (income[0] - income[1]) / income.sum()


@settings(max_examples=8)
@given(
    seed=seeds,
    discount=st.floats(0.5, 1.0),
    health=st.sampled_from([2, 5, 50]),
    max_ticks=st.integers(300, 900),
)
def test_shaping_telescopes_to_the_potentials_at_the_ends(seed, discount, health, max_ticks):
    """The sum of discount^t * F_t is discount^T * potential_T - potential_0, however it is played.

    potential_T is 0 where the game was decided (Ng, Harada, Russell 1999).
    """
    options = {"shaping_discount": discount, "max_ticks": max_ticks}
    engines = [
        make_engine("deep_line_wars", reward=kind, **options) for kind in ("shaped", "sparse")
    ]
    for engine in engines:
        engine.reset(seed)
        engine._worlds.health[:] = health
        engine._worlds.gold[:] = (900, 300)
    shaped, sparse = engines
    start, total, weight = potential(shaped), 0.0, 1.0
    for numbers in Luck.draw(90, 1, 2, seed).numbers:
        chosen = choose_actions(shaped, numbers)
        for engine in engines:
            engine.step(chosen)
        total += weight * (float(shaped.rewards[0, 0]) - float(sparse.rewards[0, 0]))
        weight *= discount
        if shaped.terminated[0] or shaped.truncated[0]:
            break
    assert shaped.terminated[0] or shaped.truncated[0]
    end = 0.0 if shaped.terminated[0] else potential(shaped)
    assert abs(total - (weight * end - start)) < 1e-5  # rewards are float32
