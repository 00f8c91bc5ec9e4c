"""Deep RTS by hand: select with the left button, order with the right, produce by digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pygame
from numpy.typing import NDArray

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.definition import WAYS
from marl_cair.games.deep_rts.orders.grid import REACH_TILES
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.window.boards import Board, Cell, Point, find_cell
from marl_cair.window.controls.controls import LEFT, BoardControls, Button, Mark, find_action
from marl_cair.window.session import Moment, Session

PRODUCT_KEYS = (pygame.K_1, pygame.K_2, pygame.K_3, pygame.K_4, pygame.K_5)
SELECTED_COLOUR = "#f4f6ff"
# The keys of the original's 16 actions.
CLASSIC_KEYS = {
    pygame.K_q: "move_up_left",
    pygame.K_w: "move_up",
    pygame.K_e: "move_up_right",
    pygame.K_a: "move_left",
    pygame.K_d: "move_right",
    pygame.K_z: "move_down_left",
    pygame.K_x: "move_down",
    pygame.K_c: "move_down_right",
    pygame.K_LEFTBRACKET: "previous_unit",
    pygame.K_RIGHTBRACKET: "next_unit",
    pygame.K_SPACE: "attack",
    pygame.K_RETURN: "harvest",
    pygame.K_1: "build_0",
    pygame.K_2: "build_1",
    pygame.K_3: "build_2",
}


class Unit(NamedTuple):
    """An own unit or building on the board; one that walks is drawn `ahead` of its cell."""

    slot: int
    serial: int
    kind: int
    row: int  # of the own view
    column: int
    half: int  # cells around its middle
    is_idle: bool
    ahead: Point = (0.0, 0.0)

    @property
    def is_mobile(self) -> bool:
        """Whether it walks."""
        return self.kind < t.NUM_MOBILE_KINDS

    @property
    def corner(self) -> Point:
        """The upper left of where it is drawn."""
        return self.row - self.half + self.ahead[0], self.column - self.half + self.ahead[1]

    @property
    def middle(self) -> Point:
        """The middle of where it is drawn."""
        return self.row + 0.5 + self.ahead[0], self.column + 0.5 + self.ahead[1]

    def covers(self, point: Point) -> bool:
        """Whether it is drawn at a point."""
        return all(
            abs(own - other) <= self.half + 0.5
            for own, other in zip(self.middle, point, strict=True)
        )


class Order(NamedTuple):
    """An order that waits to be carried out."""

    slot: int
    serial: int
    verb: str  # go, advance, stop, cancel or make_<product>
    cell: Cell = (0, 0)  # of the own view


class RtsControls(BoardControls):
    """Action spaces `unit` (selects a unit, then orders it) and `grid` (all units at once)."""

    lines: Sequence[tuple[str, str]] = (
        ("left click", "select; draw a box for several"),
        ("right click", "go there, gather, attack, repair"),
        ("A, then click", "walk there and fight on the way"),
        ("1 2 3 4 5", "build or train"),
        ("S", "stop"),
        ("C", "cancel what is built or trained"),
        ("U", "select the next idle peasant"),
        *BoardControls.lines,
    )

    def __init__(self, session: Session, seat: int, board: Board) -> None:
        super().__init__(session, seat, board)
        self.rules = session.game.make_rules(session.scenario)
        self.preset = t.PRESETS[session.scenario.preset]
        self.is_grid = bool(self.spec.action_shape)
        self.selected: list[tuple[int, int]] = []  # slot and serial
        self.advances = False  # A was pressed: the next click is an advance
        self._under_way: set[Order] = set()  # of `grid`: given, and not there yet

    # --- what is there ----------------------------------------------------------------------------

    def list_units(self, moment: Moment) -> list[Unit]:
        """The own units on the board, without builders inside their sites."""
        world, seat = moment.world, self.seat
        frame = self.rules.seats[world.clock[0, s.MAP_INDEX], seat, rb.SEAT_FRAME]
        slots = world.roster.shape[2]
        units = []
        for slot in range(seat * slots, (seat + 1) * slots):
            row = world.units[0, slot]
            if row[s.UNIT_KIND] == t.NO_KIND or row[s.UNIT_STATE] == s.INSIDE:
                continue
            kind, cell = int(row[s.UNIT_KIND]), int(row[s.UNIT_CELL])
            place = self.rules.own_place[frame, cell].tolist()
            half = int(self.rules.kinds[kind, rb.KIND_HALF_SIZE])
            is_idle = bool(row[s.UNIT_ORDER] == s.NO_ORDER)
            serial, ahead = int(row[s.UNIT_SERIAL]), self._find_ahead(moment, slot, frame)
            units.append(Unit(slot, serial, kind, place[0], place[1], half, is_idle, ahead))
        return units

    def _find_ahead(self, moment: Moment, slot: int, frame: int) -> Point:
        """Rows and columns by which an own unit is drawn ahead of its cell while it walks, as
        `art.scene.piece_of` has it.
        """
        world = moment.world
        row = world.units[0, slot]
        if row[s.UNIT_STATE] != s.WALKING:
            return 0.0, 0.0
        since = int(row[s.UNIT_SINCE])
        lasts = max(1, int(world.due[0, slot]) - since)
        percent = min(100, 100 * (int(world.clock[0, s.TICK]) - since) // lasts)
        share = self.board.tile * percent // 100 / self.board.tile  # whole pixels
        own = self.rules.own_direction[frame].tolist().index(row[s.UNIT_FACING])
        return share * int(rb.ROW_STEP[own]), share * int(rb.COLUMN_STEP[own])

    def list_selected(self, moment: Moment) -> list[Unit]:
        """The selected units that are alive; forgets the others."""
        units = {(unit.slot, unit.serial): unit for unit in self.list_units(moment)}
        self.selected = [key for key in self.selected if key in units]
        return [units[key] for key in self.selected]

    def find_unit(self, point: Point, moment: Moment) -> Unit | None:
        """The own unit that is drawn at a point: the nearest that can walk, else a building."""
        found = [unit for unit in self.list_units(moment) if unit.covers(point)]
        return min(
            found,
            key=lambda unit: (not unit.is_mobile, math.dist(unit.middle, point)),
            default=None,
        )

    def find_start(self, moment: Moment) -> Cell:
        units = self.list_units(moment)
        return (units[0].row, units[0].column) if units else super().find_start(moment)

    # --- keys and clicks --------------------------------------------------------------------------

    def press(self, key: int, moment: Moment) -> bool:
        chosen = self.list_selected(moment)
        if key in PRODUCT_KEYS:
            products = t.PRODUCTS[chosen[0].kind] if chosen else ()
            if (number := PRODUCT_KEYS.index(key)) < len(products):
                self.order(chosen[:1], f"make_{t.PRODUCT_NAMES[products[number]]}")
            else:
                self.message = "the selected unit makes nothing of that number"
        elif key == pygame.K_a:
            self.advances = bool(chosen)
            self.message = "click where to fight" if chosen else "select soldiers first"
        elif key == pygame.K_s:
            self.order(chosen, "stop")
        elif key == pygame.K_c:
            self.order(chosen[:1], "cancel")
        elif key == pygame.K_u:
            self._select_idle(moment)
        else:
            return super().press(key, moment)
        return True

    def _select_idle(self, moment: Moment) -> None:
        idle = [u for u in self.list_units(moment) if u.kind == t.PEASANT and u.is_idle]
        last = self.selected[0][0] if self.selected else -1
        chosen = next((unit for unit in idle if unit.slot > last), idle[0] if idle else None)
        self.message = "" if chosen else "no peasant is idle"
        self.select([chosen] if chosen else [])

    def select(self, units: Sequence[Unit]) -> None:
        """Select these units instead of those before."""
        self.selected = [(unit.slot, unit.serial) for unit in units]
        self.advances = False

    def click(self, point: Point, button: int, moment: Moment) -> None:
        if button == LEFT and not self.advances:
            unit = self.find_unit(point, moment)
            self.select([unit] if unit else [])
            self.message = t.UNIT_NAMES[unit.kind].replace("_", " ") if unit else ""
            return
        chosen = self.list_selected(moment)
        if not chosen:
            self.message = "select units first: left click, or draw a box"
            return
        self.message = ""
        self.order(chosen, "advance" if self.advances else "go", find_cell(point))
        self.advances = False

    def drag(self, first: Cell, last: Cell, moment: Moment) -> None:
        rows, columns = (sorted(pair) for pair in zip(first, last, strict=True))
        inside = [
            unit
            for unit in self.list_units(moment)
            if rows[0] <= unit.middle[0] < rows[1] + 1
            and columns[0] <= unit.middle[1] < columns[1] + 1
        ]
        self.select([unit for unit in inside if unit.is_mobile] or inside[:1])
        self.message = f"{len(self.selected)} selected"

    def order(self, units: Sequence[Unit], verb: str, cell: Cell = (0, 0)) -> None:
        """Queue an order for each unit, in the place of those that it waits for."""
        keys = {(unit.slot, unit.serial) for unit in units}
        if not verb.startswith("make_"):
            kept = [order for order in self.orders if (order.slot, order.serial) not in keys]
            self.orders.clear()
            self.orders.extend(kept)
        self.orders.extend(Order(unit.slot, unit.serial, verb, cell) for unit in units)

    # --- actions ----------------------------------------------------------------------------------

    def choose(self, moment: Moment) -> Any:
        units = {(unit.slot, unit.serial): unit for unit in self.list_units(moment)}
        for order in [o for o in self.orders if (o.slot, o.serial) not in units]:
            self.orders.remove(order)
        if self.is_grid:
            return self._choose_grid(units, moment)
        while self.orders:
            order = self.orders[0]
            unit = units[order.slot, order.serial]
            if moment.world.players[0, self.seat, s.CURSOR] != unit.slot:
                action = find_action(self.spec, f"select_r{unit.row}_c{unit.column}")
                if moment.mask[self.seat, action]:
                    return action
                self.orders.popleft()  # it is covered: nothing can select it now
                continue
            self.orders.popleft()
            name = order.verb
            if name in ("go", "advance"):
                name = f"{name}_r{order.cell[0]}_c{order.cell[1]}"
            return self.check(find_action(self.spec, name), moment)
        return None

    def _choose_grid(
        self, units: dict[tuple[int, int], Unit], moment: Moment
    ) -> NDArray[np.int64] | None:
        """One order for each unit; those to farther cells stay until the unit is there."""
        actions = np.full(self.spec.action_shape, self.spec.noop_action, np.int64)
        given, kept = set(), []
        for order in self.orders:
            unit = units[order.slot, order.serial]
            distance = np.subtract(order.cell, (unit.row, unit.column))
            is_far = order.verb in ("go", "advance") and np.abs(distance).max() > REACH_TILES
            if unit.slot in given or (is_far and not unit.is_idle and order in self._under_way):
                kept.append(order)
                continue
            legal = moment.mask[self.seat, unit.row, unit.column]
            action = self._find_grid_action(order, distance, legal)
            if action is None:
                self.message = f"{order.verb.replace('_', ' ')}: not possible now"
                continue
            given.add(unit.slot)
            actions[unit.row, unit.column] = action
            kept += [order] if is_far else []
        self.orders.clear()
        self.orders.extend(kept)
        self._under_way = set(kept)
        return actions if given else None

    def _find_grid_action(
        self, order: Order, distance: NDArray[np.int64], legal: NDArray[np.bool_]
    ) -> int | None:
        """The legal action of a unit that serves the order best; None for none."""
        if order.verb == "advance":
            signs = np.sign(distance).tolist()
            steps = list(zip(rb.ROW_STEP, rb.COLUMN_STEP, strict=True))
            name = f"advance_{WAYS[steps.index(tuple(signs))]}" if any(signs) else "noop"
        elif order.verb == "go":
            near = np.clip(distance, -REACH_TILES, REACH_TILES)
            name = f"go_r{near[0]:+d}_c{near[1]:+d}" if near.any() else "noop"
            if np.abs(distance).max() > REACH_TILES:
                return self._step_towards(distance, legal)
        else:
            name = order.verb
        action = find_action(self.spec, name)
        return action if legal[action] else None

    def _step_towards(self, distance: NDArray[np.int64], legal: NDArray[np.bool_]) -> int | None:
        """The legal "go" of the window that ends nearest to a farther cell."""
        best, least = None, float(np.hypot(*distance))
        for row in range(-REACH_TILES, REACH_TILES + 1):
            for column in range(-REACH_TILES, REACH_TILES + 1):
                away = float(np.hypot(distance[0] - row, distance[1] - column))
                if (row or column) and away < least:
                    action = find_action(self.spec, f"go_r{row:+d}_c{column:+d}")
                    if legal[action]:
                        best, least = action, away
        return best

    # --- what is shown ----------------------------------------------------------------------------

    def list_buttons(self, moment: Moment) -> list[Button]:
        chosen = self.list_selected(moment)
        if not chosen:
            return []
        buttons = []
        costs = slice(rb.PRODUCT_COST, rb.PRODUCT_COST + t.NUM_RESOURCES)
        for key, product in zip(PRODUCT_KEYS, t.PRODUCTS[chosen[0].kind], strict=False):
            prices = self.rules.product[product, costs]
            owned = [moment.numbers.resources[name][self.seat] for name in t.RESOURCE_NAMES]
            listed = zip(prices.tolist(), t.RESOURCE_NAMES, strict=True)
            price = ", ".join(f"{amount} {name}" for amount, name in listed if amount)
            is_possible = bool(
                self.rules.product[product, rb.PRODUCT_IS_ENABLED] and (owned >= prices).all()
            )
            label = t.PRODUCT_NAMES[product].replace("_", " ")
            buttons.append(Button(key, label, price, is_possible))
        if chosen[0].kind in (t.FOOTMAN, t.ARCHER, t.CAVALRY):
            buttons.append(Button(pygame.K_a, "advance", "", True, self.advances))
        key, label = (pygame.K_s, "stop") if chosen[0].is_mobile else (pygame.K_c, "cancel")
        return [*buttons, Button(key, label, "", True)]

    def list_marks(self, moment: Moment) -> list[Mark]:
        marks = [
            Mark(unit.corner, SELECTED_COLOUR, 2 * unit.half + 1)
            for unit in self.list_selected(moment)
        ]
        return marks + super().list_marks(moment)
