"""Deep Line Wars by hand: units by digits, towers by a digit and a click on a cell."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from marl_cair.games.deep_line_wars.tables import PRESETS, TOWER_NAMES, UNIT_NAMES
from marl_cair.window.boards import Board, Cell, Point, find_cell
from marl_cair.window.controls.controls import LEFT, BoardControls, Button, Mark, find_action
from marl_cair.window.session import Moment, Session

UNIT_KEYS = (pygame.K_1, pygame.K_2, pygame.K_3, pygame.K_4)
TOWER_KEYS = (pygame.K_5, pygame.K_6, pygame.K_7)
ILLEGAL_COLOUR, CHOSEN_COLOUR = "#de4438", "#facc48"


class LineWarsControls(BoardControls):
    """Both action spaces: `classic` moves the game's own cursor to the clicked cell first."""

    lines: Sequence[tuple[str, str]] = (
        ("1 2 3 4", "send a unit"),
        ("5 6 7", "choose a tower"),
        ("left click", "build the chosen tower there"),
        ("right click", "choose no tower"),
        *BoardControls.lines,
    )

    def __init__(self, session: Session, seat: int, board: Board) -> None:
        super().__init__(session, seat, board)
        self.preset = PRESETS[session.scenario.preset]
        self.is_classic = session.scenario.actions == "classic"
        self.tower = -1  # kind that a click builds

    def press(self, key: int, moment: Moment) -> bool:
        if key in UNIT_KEYS:
            kind = UNIT_KEYS.index(key)
            self.message = self._refuse(moment, self.preset.unit_cost_gold[kind], 0)
            if not self.message:
                self.orders.append(find_action(self.spec, f"buy_{UNIT_NAMES[kind]}"))
        elif key in TOWER_KEYS:
            kind = TOWER_KEYS.index(key)
            self.tower = -1 if kind == self.tower else kind
            self.message = (
                "" if self.tower < 0 else f"click a cell of your half: {TOWER_NAMES[kind]}"
            )
        else:
            return super().press(key, moment)
        return True

    def click(self, point: Point, button: int, moment: Moment) -> None:
        cell = find_cell(point)
        if button != LEFT:
            self.tower, self.message = -1, ""
        elif self.tower < 0:
            self.message = "choose a tower first: 5, 6 or 7"
        else:
            self.message = self.find_fault(cell, moment)
            if not self.message:
                self.orders.extend(self._build(cell, moment))

    def find_fault(self, cell: Cell, moment: Moment) -> str:
        """Why the chosen tower cannot be built at a cell; "" if it can."""
        row, column = cell
        if not 1 <= column <= self.session.scenario.build_columns:
            return "towers stand in your own half, not in its first column"
        if moment.world.tower_at[0, self.seat, row, column - 1] >= 0:
            return "a tower stands there"
        gold = self.preset.tower_cost_gold[self.tower]
        return self._refuse(moment, gold, self.preset.tower_cost_lumber[self.tower])

    def _refuse(self, moment: Moment, gold: int, lumber: int) -> str:
        owned = moment.numbers.resources
        for name, price in (("gold", gold), ("lumber", lumber)):
            if owned[name][self.seat] < price:
                return f"not enough {name}: it costs {price}, you have {owned[name][self.seat]:.0f}"
        return ""

    def _build(self, cell: Cell, moment: Moment) -> list[int]:
        kind = f"build_{TOWER_NAMES[self.tower]}"
        if not self.is_classic:
            return [find_action(self.spec, f"{kind}_r{cell[0]}_c{cell[1]}")]
        row, column = moment.world.cursor[0, self.seat].tolist()
        steps = ["cursor_down" if cell[0] > row else "cursor_up"] * abs(cell[0] - row)
        steps += ["cursor_right" if cell[1] > column else "cursor_left"] * abs(cell[1] - column)
        return [find_action(self.spec, name) for name in (*steps, kind)]

    def list_buttons(self, moment: Moment) -> list[Button]:
        preset = self.preset
        units = [
            Button(key, name.replace("_", " "), f"{gold} gold", not self._refuse(moment, gold, 0))
            for key, name, gold in zip(UNIT_KEYS, UNIT_NAMES, preset.unit_cost_gold, strict=True)
        ]
        prices = zip(preset.tower_cost_gold, preset.tower_cost_lumber, strict=True)
        towers = [
            Button(
                TOWER_KEYS[kind],
                f"{TOWER_NAMES[kind]} tower",
                f"{gold} gold" + (f", {lumber} lumber" if lumber else ""),
                not self._refuse(moment, gold, lumber),
                kind == self.tower,
            )
            for kind, (gold, lumber) in enumerate(prices)
        ]
        return units + towers

    def mark_pointer(self, cell: Cell, moment: Moment) -> list[Mark]:
        """The cell under the mouse, red where the chosen tower cannot be built."""
        if self.tower < 0:
            return []
        is_free = not self.find_fault(cell, moment)
        return [Mark(cell, CHOSEN_COLOUR if is_free else ILLEGAL_COLOUR)]
