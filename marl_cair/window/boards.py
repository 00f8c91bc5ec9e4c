"""`Board`: where the cells of a game's board lie in its picture, as its `rendering` draws them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Cell = tuple[int, int]  # row and column of the own view
Point = tuple[float, float]  # too, within a cell: 2.5 is the middle of row 2


@dataclass(frozen=True)
class Board:
    """Cells of `tile` pixels of the picture, the first at (`left`, `top`).

    height: of a cell, where it is no square.
    """

    rows: int
    columns: int
    tile: float
    top: float
    left: float
    height: float | None = None

    @property
    def row_pixels(self) -> float:
        """Pixels from one row to the next."""
        return self.tile if self.height is None else self.height

    def find_point(self, x: float, y: float) -> Point | None:
        """The point of the board at a pixel of the picture; None beside the board."""
        row, column = (y - self.top) / self.row_pixels, (x - self.left) / self.tile
        return (row, column) if self.contains(row, column) else None

    def contains(self, row: float, column: float) -> bool:
        """Whether there is such a cell or point."""
        return 0 <= row < self.rows and 0 <= column < self.columns

    def find_box(self, row: float, column: float) -> tuple[float, float]:
        """Left and top of a cell in the picture."""
        return self.left + column * self.tile, self.top + row * self.row_pixels


def find_cell(point: Point) -> Cell:
    """The cell of a point."""
    return int(point[0]), int(point[1])


def find_middle(cell: Cell) -> Point:
    """The point in the middle of a cell."""
    return cell[0] + 0.5, cell[1] + 0.5


def find_board(game: str, scenario: Any, rules: Any, height: int, width: int) -> Board | None:
    """The board in a picture of a game, [height, width]; None for games without one."""
    if game == "deep_line_wars":
        from marl_cair.games.deep_line_wars.rendering import board_box

        tile, top, left = getattr(board_box, "py_func", board_box)(rules)
        return Board(scenario.rows, scenario.columns, tile, top, left)
    if game == "deep_rts":
        from marl_cair.games.deep_rts.art import rendering as rts

        side = rts.tile_side(scenario.rows, scenario.columns)
        top = height - rts.MARGIN - scenario.rows * side
        return Board(
            scenario.rows, scenario.columns, side, top, (width - scenario.columns * side) // 2
        )
    if game == "deep_maze":
        from marl_cair.games.deep_maze import rendering as maze

        longest = max(scenario.rows, scenario.columns)
        tile, first = maze.BOARD_SIDE / longest, maze.MARGIN + maze.FRAME
        top, left = (
            first + (longest - count) * maze.BOARD_SIDE // (2 * longest)
            for count in (scenario.rows, scenario.columns)
        )
        return Board(scenario.rows, scenario.columns, tile, top, left)
    if game == "flash" and scenario.actions == "mouse":
        from marl_cair.games.flash.description import find_description

        columns, rows = find_description(scenario.description).mouse_grid
        return Board(rows, columns, width / columns, 0.0, 0.0, height / rows)
    return None
