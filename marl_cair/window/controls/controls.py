"""`Controls`, what a person's hands do in one seat, and `KeyControls`: a key for each action."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pygame

from marl_cair.window.boards import Board, Cell, Point, find_cell, find_middle
from marl_cair.window.session import Moment, Session

LEFT, RIGHT = 1, 3  # mouse buttons, as pygame counts them
ARROWS = {
    pygame.K_UP: (-1, 0),
    pygame.K_DOWN: (1, 0),
    pygame.K_LEFT: (0, -1),
    pygame.K_RIGHT: (0, 1),
}
NO_PLACE = (-1, -1)


class Button(NamedTuple):
    """A field of the bar below the game; a click presses its key."""

    key: int
    label: str
    price: str
    is_possible: bool
    is_chosen: bool = False


class Mark(NamedTuple):
    """A frame around cells of the own view, or between them."""

    corner: Point
    colour: str
    size: int = 1  # cells along a side


class Controls:
    """Turns keys and clicks of a person in `seat` into actions, at most one for each step.

    Attributes:
        lines: (keys, what they do) for the menu.
        message: what the person should know, e.g. why an order was not possible.
    """

    lines: Sequence[tuple[str, str]] = ()

    def __init__(self, session: Session, seat: int) -> None:
        self.session, self.spec, self.seat = session, session.spec, seat
        self.message = ""
        self.orders: deque[Any] = deque()

    @property
    def is_ready(self) -> bool:
        """Whether an order waits to be carried out."""
        return bool(self.orders)

    def claims(self, key: int) -> bool:
        """Whether a key is the game's even where the window has a hotkey of it."""
        return False

    def press(self, key: int, moment: Moment) -> bool:
        """A key was pressed; False if it means nothing here."""
        return False

    def release(self, key: int) -> None:
        """A key was released."""

    def click(self, point: Point, button: int, moment: Moment) -> None:
        """A point of the board was clicked."""

    def drag(self, first: Cell, last: Cell, moment: Moment) -> None:
        """A box of cells was drawn with the left button."""
        self.click(find_middle(last), LEFT, moment)

    def choose(self, moment: Moment) -> Any:
        """The next order as an action of the game that is legal at `moment`; None for none."""
        if not self.orders:
            return None
        return self.check(self.orders.popleft(), moment)

    def check(self, action: int, moment: Moment) -> int | None:
        """The action if it is legal, else None and a message."""
        if moment.mask[self.seat, action]:
            return action
        name = self.spec.action_names[action].replace("_", " ")
        self.message = f"{name}: not possible now"
        return None

    def list_buttons(self, moment: Moment) -> list[Button]:
        """The bar below the game."""
        return []

    def list_marks(self, moment: Moment) -> list[Mark]:
        """Frames on the board: what is selected, where the keys point."""
        return []

    def mark_pointer(self, cell: Cell, moment: Moment) -> list[Mark]:
        """Frames at the cell under the mouse."""
        return []


class KeyControls(Controls):
    """A key for each action.

    keys: code of a key -> action.
    """

    def __init__(self, session: Session, seat: int, keys: Mapping[int, int]) -> None:
        super().__init__(session, seat)
        self._keys = keys
        names = [pygame.key.name(key) or "?" for key in keys]
        actions = [self.spec.action_names[action].replace("_", " ") for action in keys.values()]
        self.lines = tuple(zip(names, actions, strict=True))

    def press(self, key: int, moment: Moment) -> bool:
        if key not in self._keys:
            return False
        self.orders.clear()  # the newest key counts
        action = self.check(self._keys[key], moment)
        if action is not None:
            self.message = ""
            self.orders.append(action)
        return True


class BoardControls(Controls):
    """Keys and mouse that point at cells: arrows move a frame, Enter and Space click there."""

    lines: Sequence[tuple[str, str]] = (
        ("arrows", "move the frame"),
        ("Enter", "as a left click at the frame"),
        ("Space", "as a right click at the frame"),
    )

    def __init__(self, session: Session, seat: int, board: Board) -> None:
        super().__init__(session, seat)
        self.board, self.frame = board, NO_PLACE

    def press(self, key: int, moment: Moment) -> bool:
        if key in ARROWS:
            self._move_frame(*ARROWS[key], moment)
        elif key in (pygame.K_RETURN, pygame.K_SPACE):
            if self.frame == NO_PLACE:
                self.frame = self.find_start(moment)
            button = LEFT if key == pygame.K_RETURN else RIGHT
            self.click(find_middle(self.frame), button, moment)
        else:
            return False
        return True

    def _move_frame(self, rows: int, columns: int, moment: Moment) -> None:
        if self.frame == NO_PLACE:
            self.frame = self.find_start(moment)
            return
        row, column = self.frame[0] + rows, self.frame[1] + columns
        if self.board.contains(row, column):
            self.frame = row, column

    def find_start(self, moment: Moment) -> Cell:
        """Where the frame appears."""
        return self.board.rows // 2, self.board.columns // 2

    def list_marks(self, moment: Moment) -> list[Mark]:
        return [] if self.frame == NO_PLACE else [Mark(self.frame, "#5efcf2")]


class ClickControls(BoardControls):
    """Games whose actions are clicks in a grid."""

    lines: Sequence[tuple[str, str]] = (
        ("left click", "click there"),
        *BoardControls.lines[:2],
    )

    def click(self, point: Point, button: int, moment: Moment) -> None:
        row, column = find_cell(point)
        if button == LEFT:
            self.orders.append(find_action(self.spec, f"click {column} {row}"))


def find_action(spec: Any, name: str) -> int:
    """The number of an action by its name."""
    return int(spec.action_names.index(name))
