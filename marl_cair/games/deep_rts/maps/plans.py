"""Where bases may lie on a generated map, so that symmetries take each to the others."""

from __future__ import annotations

from dataclasses import dataclass

from marl_cair.games.deep_rts.maps.maps import (
    MAX_SIDE,
    MIN_SIDE,
    MIRROR_COLUMNS,
    MIRROR_ROWS,
    SWAP,
    MapError,
)

SYMMETRIES = {"auto": "any that fits", "rotate": "turns of the board", "mirror": "mirrors"}
MIN_BASE_RADIUS, MAX_BASE_RADIUS = 2, 5  # tiles from a spawn to the resources around its base

HALF_TURN = MIRROR_ROWS | MIRROR_COLUMNS
TURNS = (0, SWAP | MIRROR_COLUMNS, HALF_TURN, SWAP | MIRROR_ROWS)
MIRRORS = (0, MIRROR_COLUMNS, MIRROR_ROWS, HALF_TURN)


@dataclass(frozen=True)
class Plan:
    """How a board is divided: the images of the plots under the frames do not overlap."""

    frames: tuple[int, ...]
    plots: tuple[tuple[int, int, int, int], ...]  # first row, first column, rows, columns

    @property
    def base_radius(self) -> int:
        """The largest that fits into every plot."""
        side = min(min(plot[2:]) for plot in self.plots)
        return min(MAX_BASE_RADIUS, (side - 1) // 2)


def list_plans(rows: int, columns: int, num_players: int, symmetry: str) -> list[Plan]:
    """All ways to divide the board that leave room; an odd number of players gets a base more."""
    if num_players == 1:
        plans = [Plan((0,), ((0, 0, rows, columns),))]
    elif num_players in (2, 5, 6):
        frames = {"rotate": (HALF_TURN,), "mirror": (MIRROR_ROWS, MIRROR_COLUMNS)}
        parts = 1 if num_players == 2 else 3
        plans = [
            Plan((0, frame), _split(*half, parts))
            for half, lost in (
                ((rows // 2, columns), MIRROR_COLUMNS),
                ((rows, columns // 2), MIRROR_ROWS),
            )
            for kind in frames
            if symmetry in ("auto", kind)
            for frame in frames[kind]
            if frame != lost
        ]
    else:
        groups = [MIRRORS] if symmetry in ("auto", "mirror") else []
        if symmetry in ("auto", "rotate") and rows == columns:
            groups.append(TURNS)
        plots = _split(rows // 2, columns // 2, 1 if num_players <= 4 else 2)
        plans = [Plan(group, plots) for group in groups]
    return [plan for plan in plans if plan.base_radius >= MIN_BASE_RADIUS]


def _split(rows: int, columns: int, parts: int) -> tuple[tuple[int, int, int, int], ...]:
    """Cut the top left rectangle of the board into parts, across its longer side."""
    if rows > columns:
        cuts = [part * rows // parts for part in range(parts + 1)]
        return tuple((cuts[k], 0, cuts[k + 1] - cuts[k], columns) for k in range(parts))
    cuts = [part * columns // parts for part in range(parts + 1)]
    return tuple((0, cuts[k], rows, cuts[k + 1] - cuts[k]) for k in range(parts))


def require_room(rows: int, columns: int, num_players: int, symmetry: str) -> None:
    """Raise MapError, with a size that would do, where no plan leaves the bases room."""
    if list_plans(rows, columns, num_players, symmetry):
        return
    title = f"deep_rts map: {rows}x{columns} for {num_players} players"
    if symmetry == "rotate" and rows != columns and num_players in (3, 4, 7, 8):
        raise MapError(
            f"{title} cannot be turned by a quarter: make it square or choose the symmetry "
            "'mirror' or 'auto'"
        )
    side = next(
        side
        for side in range(MIN_SIDE, MAX_SIDE + 1)
        if list_plans(side, side, num_players, symmetry)
    )
    raise MapError(f"{title} is too small for their bases: give {side}x{side} or more")
