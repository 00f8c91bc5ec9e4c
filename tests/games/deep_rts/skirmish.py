"""One world of Deep RTS on a small map of text that a test sets up by hand and plays by ticks."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.orders import orders
from marl_cair.games.deep_rts.rules import roster
from marl_cair.games.deep_rts.rules.rulebook import SEAT_FRAME, Rules
from marl_cair.games.deep_rts.tables import NUM_RESOURCES, PEASANT, PRESETS, PRODUCT_NAMES
from marl_cair.games.engine import BatchedEngine

# The preset `drill`: numbers for the tests of rules, which balancing the game does not change.
# conftest.py adds it to the presets while tests of this folder run.
DRILL = replace(
    PRESETS["balanced"],
    cost_gold=(50, 80, 70, 120, 300, 150, 60, 150, 80),
    cost_lumber=(0, 0, 30, 0, 150, 100, 40, 80, 60),
    cost_stone=(0, 0, 0, 0, 0, 0, 0, 40, 0),
    build_ticks=(120, 150, 150, 200, 400, 300, 150, 300, 150),
    damage_min=(2, 2, 3, 4, 0, 0, 0, 0, 0),
    damage_max=(9, 9, 9, 12, 0, 0, 0, 0, 0),
    piercing=(2, 4, 2, 4, 0, 0, 0, 0, 0),
    armour=(0, 4, 0, 6, 10, 10, 10, 10, 10),
    walk_ticks=(11, 11, 11, 7, 0, 0, 0, 0, 0),
    attack_ticks=(10, 10, 10, 10, 0, 0, 0, 0, 0),
    upgrade_gold=(150, 150),
    upgrade_oil=(30, 30),
    upgrade_ticks=(300, 300),
    upgrade_bonus=(2, 4),
    tile_yield=(0, 0, 0, 0, 0, 1, 1, 1, 1),
    carry_capacity=10,
    oil_ticks=20,
)
RICH = (5_000, 5_000, 5_000, 5_000)  # a store that no test empties
LASTING = 30_000  # hit points of a unit that no test kills
CALM = {"preset": "thesis"}  # no unit attacks without an order
# Grass with a gold tile in the corner, as every map needs a resource.
MEADOW = "\n".join(["." * 15 + "G", ".1" + "." * 14, *["." * 16] * 12, "." * 14 + "2.", "." * 16])


def read_engine(text: str, **options: Any) -> BatchedEngine:
    """An engine that plays on the map of `text`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "skirmish.txt"
        path.write_text("\n".join(text.split()) + "\n")
        return make_engine("deep_rts", map=str(path), **options)


class Skirmish:
    """One world without units (`is_empty`), to which a test adds what it needs.

    A step is one tick, and the game lasts until the time limit, unless options change that. Rows
    and columns are those of the map's text.
    """

    def __init__(
        self, text: str = MEADOW, seed: int = 0, is_empty: bool = True, **options: Any
    ) -> None:
        chosen = {"preset": "drill", "ticks_per_step": 1, "goal": "score", "max_ticks": 1_000_000}
        is_empty = is_empty and "army" not in options
        if is_empty:
            chosen["army"] = (1, 0, 0, 0)
        self.engine = read_engine(text, **chosen | options)
        self.engine.reset(seed)
        # Views: what is written here is what the engine plays on.
        self.world = s.World(*(field[0] for field in self.engine._worlds))
        self.rules: Rules = self.engine._rules
        shape = (1, self.engine.num_players, *self.engine.spec.action_shape)
        self.noops = np.full(shape, self.engine.spec.noop_action, np.int32)
        if is_empty:
            for player in range(self.engine.num_players):
                for unit in self.units_of(player):
                    call(roster.remove_unit, self.world, self.rules, unit)

    # --- reading -----------------------------------------------------------------------------

    @property
    def tick(self) -> int:
        return int(self.world.clock[s.TICK])

    def cell(self, row: int, column: int) -> int:
        return (row + 1) * self.rules.stride + column + 1

    def place(self, unit: int) -> tuple[int, int]:
        """Row and column of a unit."""
        cell = self.get(unit, s.UNIT_CELL)
        return cell // self.rules.stride - 1, cell % self.rules.stride - 1

    def get(self, unit: int, *columns: int) -> Any:
        """A number of a unit, or several as a tuple."""
        values = self.world.units[unit, list(columns)].tolist()
        return values[0] if len(values) == 1 else tuple(values)

    def set(self, unit: int, column: int, value: int) -> None:
        self.world.units[unit, column] = value

    def units_of(self, player: int) -> list[int]:
        """The player's slots, from its oldest unit to its newest."""
        return self.world.roster[player, : self.world.players[player, s.NUM_UNITS]].tolist()

    def is_alive(self, unit: int) -> bool:
        return self.get(unit, s.UNIT_KIND) >= 0

    def occupant(self, row: int, column: int) -> int:
        return int(self.world.board[s.OCCUPANT, self.cell(row, column)])

    def tile(self, row: int, column: int) -> int:
        return int(self.world.board[s.TILE, self.cell(row, column)])

    def amount(self, row: int, column: int) -> int:
        return int(self.world.board[s.AMOUNT, self.cell(row, column)])

    def set_amount(self, row: int, column: int, amount: int) -> None:
        self.world.board[s.AMOUNT, self.cell(row, column)] = amount

    def store(self, player: int) -> list[int]:
        """Gold, lumber, stone, oil."""
        return self.world.players[player, s.RESOURCES : s.RESOURCES + NUM_RESOURCES].tolist()

    def gathered(self, player: int) -> list[int]:
        return self.world.players[player, s.GATHERED : s.GATHERED + NUM_RESOURCES].tolist()

    def fill_store(self, player: int, *amounts: int) -> None:
        self.world.players[player, s.RESOURCES : s.RESOURCES + len(amounts)] = amounts

    def queue(self, unit: int) -> list[int]:
        length = self.get(unit, s.UNIT_QUEUE_LENGTH)
        return self.world.units[unit, s.UNIT_QUEUE : s.UNIT_QUEUE + length].tolist()

    # --- changing ----------------------------------------------------------------------------

    def put(self, player: int, kind: int, row: int, column: int) -> int:
        """A finished unit that idles; its slot. Food is not counted."""
        assert self.occupant(row, column) == s.NO_UNIT
        return call(roster.add_unit, self.world, self.rules, player, kind, self.cell(row, column))

    def kill(self, *units: int) -> None:
        """Set the health to 0: the units are removed at the end of the next tick."""
        for unit in units:
            self.set(unit, s.UNIT_HEALTH, 0)
            self.world.clock[s.NUM_FALLEN] += 1

    def set_tile(self, row: int, column: int, tile: int, amount: int = 0) -> None:
        self.world.board[[s.TILE, s.AMOUNT], self.cell(row, column)] = tile, amount

    def order(self, unit: int, order: int, row: int = -1, column: int = -1) -> None:
        """Replace the unit's order; some orders need no place."""
        goal = self.cell(row, column) if row >= 0 else s.NO_GOAL
        call(orders.give_order, self.world, unit, order, goal)

    def attack(self, unit: int, target: int, order: int = s.ATTACK) -> None:
        self.order(unit, order)
        self.set(unit, s.UNIT_TARGET, target)
        self.set(unit, s.UNIT_TARGET_SERIAL, self.get(target, s.UNIT_SERIAL))

    def select(self, unit: int) -> None:
        self.world.players[unit // self.rules.slots, s.CURSOR] = unit

    # --- playing -----------------------------------------------------------------------------

    def wait(self, num_steps: int = 1) -> None:
        for _ in range(num_steps):
            self.engine.step(self.noops)

    def action(self, name: str) -> int:
        return self.engine.spec.action_names.index(name)

    def go(self, player: int, row: int, column: int) -> str:
        """The name of the action with which a seat sends its unit to a place of the map."""
        frame = self.rules.seats[0, player, SEAT_FRAME]
        own = int(self.rules.own_cell[frame, self.cell(row, column)])
        return f"go_r{own // self.rules.columns}_c{own % self.rules.columns}"

    def is_legal(self, player: int, name: str) -> bool:
        return bool(self.engine.action_mask()[0, player, self.action(name)])

    def play(self, *names: str) -> None:
        """One step by the names of the seats' actions; other seats do nothing."""
        actions = self.noops.copy()
        for player, name in enumerate(names):
            actions[0, player] = self.action(name)
        self.engine.step(actions)

    def own_place(self, unit: int) -> tuple[int, int, int]:
        """The unit's owner, and its row and column in its owner's view."""
        player = unit // self.rules.slots
        frame = self.rules.seats[0, player, SEAT_FRAME]
        row, column = self.rules.own_place[frame, self.get(unit, s.UNIT_CELL)].tolist()
        return player, row, column

    def command(self, orders: dict[int, str]) -> None:
        """One step of `grid`: an order for each of these units, by its name."""
        actions = self.noops.copy()
        for unit, name in orders.items():
            actions[(0, *self.own_place(unit))] = self.action(name)
        self.engine.step(actions)

    def may(self, unit: int, name: str) -> bool:
        """True where the mask of `grid` allows the order."""
        mask = self.engine.action_mask()[(0, *self.own_place(unit))]
        return bool(mask[self.action(name)])

    def make(self, unit: int, product: int) -> None:
        """One step: the unit's owner selects it and orders the product."""
        self.select(unit)
        self.play(*["noop"] * (unit // self.rules.slots), f"make_{PRODUCT_NAMES[product]}")

    def illegal(self) -> list[int]:
        return self.engine.illegal_actions[0].tolist()


def face_off(attacker: int, target: int, away: int = 1, **options) -> tuple[Skirmish, int, int]:
    """Two units `away` tiles from each other; the target of player 1 lasts."""
    skirmish = Skirmish(**(CALM | options))
    unit = skirmish.put(0, attacker, 8, 4)
    other = skirmish.put(1, target, 8, 4 + away)
    skirmish.set(other, s.UNIT_HEALTH, LASTING)
    return skirmish, unit, other


def ticks_until(skirmish: Skirmish, unit: int, place: tuple[int, int], limit: int = 400) -> int:
    """Ticks until the unit stands at the place."""
    start = skirmish.tick
    while skirmish.place(unit) != place:
        skirmish.wait()
        assert skirmish.tick - start <= limit
    return skirmish.tick - start


def call(function: Any, *arguments: Any) -> Any:
    """Call a rule outside of the engine as plain Python: nothing is compiled for a single test."""
    with np.errstate(over="ignore"):
        if is_compiling():
            return function.py_func(*arguments)
        return function(*arguments)


def draw_actions(engine: BatchedEngine, luck: np.random.Generator) -> NDArray[np.int32]:
    """A legal action of every seat: first a kind of action, then one of that kind."""
    groups = engine.spec.action_groups
    drawn = [[draw_action(seat, groups, luck) for seat in world] for world in engine.action_mask()]
    return np.array(drawn, np.int32)


def play_random(engine: BatchedEngine, num_steps: int, seed: int, draw: Any = draw_actions) -> Any:
    """Play legal actions from a reset by `seed`; yields after each step, then starts a new game
    where one has ended.
    """
    luck = np.random.default_rng(seed)
    engine.reset(seed)
    for step in range(num_steps):
        engine.step(draw(engine, luck))
        yield step
        if engine.terminated[0] or engine.truncated[0]:
            engine.reset(step)


def draw_action(
    mask: NDArray[np.bool_], groups: NDArray[np.int16], luck: np.random.Generator
) -> Any:
    """One seat's legal action; of `grid` an order for about half of its units."""
    if mask.ndim > 1:
        orders = np.zeros(mask.shape[:-1], np.int32)
        for row, column in np.argwhere(mask[..., 1:].any(axis=-1)):
            if luck.random() < 0.5:
                orders[row, column] = draw_action(mask[row, column], groups, luck)
        return orders
    legal = np.flatnonzero(mask)
    kinds = groups[legal]
    return int(luck.choice(legal[kinds == luck.choice(np.unique(kinds))]))


def start(**options: Any) -> tuple[Skirmish, int]:
    """A rich player 0 with a peasant at (8, 8); player 1 has one far off."""
    skirmish = Skirmish(**options)
    skirmish.fill_store(0, *RICH)
    skirmish.fill_store(1, *RICH)
    worker = skirmish.put(0, PEASANT, 8, 8)
    skirmish.put(1, PEASANT, 1, 1)
    return skirmish, worker


def feed(skirmish: Skirmish, player: int, food: int = 50) -> None:
    skirmish.world.players[player, s.FOOD_MADE] += food


def of(skirmish: Skirmish, player: int, column: int) -> int:
    return int(skirmish.world.players[player, column])
