"""Make maps of any size from a seed: fair by symmetry, always connected, the same everywhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps import maps
from marl_cair.games.deep_rts.maps.formats import MapError
from marl_cair.games.deep_rts.maps.maps import MAX_SIDE, MIN_SIDE, MIRROR_COLUMNS, MIRROR_ROWS, SWAP

NUM_ATTEMPTS = 64
MIN_BASE_RADIUS, MAX_BASE_RADIUS = 2, 5  # tiles from a spawn to the resources around its base
GOLD_PATCHES = 2  # contested ones, before symmetry multiplies them
# Percent of all tiles before ways are cleared, size of a clump, how straight it is.
TERRAIN = {
    t.DESERT: (8, 14, 0),
    t.WATER: (6, 12, 0),
    t.LUMBER_TILE: (14, 12, 1),
    t.WALL: (6, 6, 3),
    t.LAVA: (2, 5, 1),
}
TRAIN_SEEDS, TEST_SEEDS = range(100_000), range(1_000_000, 1_001_000)  # never share a seed
_SIZES = (
    *((10, 10, 2), (15, 15, 1), (15, 15, 2), (21, 21, 2), (31, 31, 2)),
    *((31, 31, 4), (31, 31, 6), (64, 64, 2), (64, 64, 8)),
)
# Sets of maps of one size: rows, columns, players, seeds.
MAP_SETS = {
    f"{split}-{rows}x{columns}-{players}p": (rows, columns, players, seeds)
    for rows, columns, players in _SIZES
    for split, seeds in (("train", TRAIN_SEEDS), ("test", TEST_SEEDS))
}

HALF_TURN = MIRROR_ROWS | MIRROR_COLUMNS
TURNS = (0, SWAP | MIRROR_COLUMNS, HALF_TURN, SWAP | MIRROR_ROWS)
MIRRORS = (0, MIRROR_COLUMNS, MIRROR_ROWS, HALF_TURN)

Cell = tuple[int, int]
_FREE, _BASE, _RESOURCE = range(3)  # the use of a cell while a map is made


def map_set(name: str, num_maps: int) -> tuple[maps.GameMap, ...]:
    """Return the first maps of a set of MAP_SETS."""
    rows, columns, players, seeds = MAP_SETS[name]
    return tuple(generate_map(rows, columns, players, seed) for seed in seeds[:num_maps])


def generate_map(rows: int, columns: int, num_players: int, seed: int) -> maps.GameMap:
    """Return the map of `seed`, the same on every machine.

    rows, columns: 8..128; num_players: 1..8; seed: 0..2**63 - 1.
    All bases have the same ground around them, so that every seat walks equally far to its nearest
    tile of each resource. With 2 and 4 players the whole map is symmetric; an odd number of them
    leaves one base of a symmetric map free.
    Raises MapError where the players' bases do not fit, ValueError for a value out of range.
    """
    for option, value, low, high in (
        ("rows", rows, MIN_SIDE, MAX_SIDE),
        ("columns", columns, MIN_SIDE, MAX_SIDE),
        ("num_players", num_players, 1, t.MAX_PLAYERS),
        ("seed", seed, 0, 2**63 - 1),
    ):
        if not low <= value <= high:
            raise ValueError(f"deep_rts map: {option} is {value}, it must be in {low}..{high}")
    plans = list_plans(rows, columns, num_players)
    name = f"generated-{rows}x{columns}-{num_players}p-{seed}"
    if not plans:
        sides = range(MIN_SIDE, MAX_SIDE + 1)
        side = next(side for side in sides if list_plans(side, side, num_players))
        raise MapError(f"map {name}: too small for the bases: take {side}x{side} or more")
    for attempt in range(NUM_ATTEMPTS):
        bits = np.random.PCG64(np.random.SeedSequence([seed, rows, columns, num_players, attempt]))
        board = _Board(rows, columns, num_players, plans, bits)
        if board.is_connected:
            return maps.make_map(name, board.tiles, board.spawns)
    raise MapError(
        f"map {name}: no way between the bases was found in {NUM_ATTEMPTS} attempts: take another "
        "seed or a larger map"
    )


# --- where bases may lie -------------------------------------------------------------------------


@dataclass(frozen=True)
class Plan:
    """A division of a board: the images of the plots under the frames do not overlap."""

    frames: tuple[int, ...]
    plots: tuple[tuple[int, int, int, int], ...]  # first row, first column, rows, columns

    @property
    def base_radius(self) -> int:
        """The largest that fits into every plot."""
        side = min(min(plot[2:]) for plot in self.plots)
        return min(MAX_BASE_RADIUS, (side - 1) // 2)


def list_plans(rows: int, columns: int, num_players: int) -> list[Plan]:
    """All ways to divide the board that leave room; an odd number of players gets a base more."""
    if num_players == 1:
        plans = [Plan((0,), ((0, 0, rows, columns),))]
    elif num_players in (2, 5, 6):
        parts = 1 if num_players == 2 else 3
        halves = (((rows // 2, columns), MIRROR_ROWS), ((rows, columns // 2), MIRROR_COLUMNS))
        plans = [
            Plan((0, frame), _split(*half, parts))
            for half, mirror in halves
            for frame in (HALF_TURN, mirror)
        ]
    else:
        plots = _split(rows // 2, columns // 2, 1 if num_players <= 4 else 2)
        plans = [Plan(group, plots) for group in (MIRRORS, TURNS)[: 1 + (rows == columns)]]
    return [plan for plan in plans if plan.base_radius >= MIN_BASE_RADIUS]


def _split(rows: int, columns: int, parts: int) -> tuple[tuple[int, int, int, int], ...]:
    """Cut the top left rectangle of the board into parts, across its longer side."""
    cuts = [part * max(rows, columns) // parts for part in range(parts + 1)]
    if rows > columns:
        return tuple((cuts[k], 0, cuts[k + 1] - cuts[k], columns) for k in range(parts))
    return tuple((0, cuts[k], rows, cuts[k + 1] - cuts[k]) for k in range(parts))


class _Board:
    """A map in the making; every change is made to all images of a cell at once."""

    def __init__(
        self,
        rows: int,
        columns: int,
        num_players: int,
        plans: Sequence[Plan],
        bits: np.random.PCG64,
    ) -> None:
        self.rows, self.columns = rows, columns
        # The bits of a generator are the same in all versions of NumPy; its distributions are not.
        self._bits, self._words = bits, list[int]()
        self.plan = plans[self.below(len(plans))]
        self.tiles = np.full((rows, columns), t.GRASS, dtype=np.uint8)
        self.owners = np.full((rows, columns), _FREE, dtype=np.uint8)
        largest = self.plan.base_radius
        smallest = min(largest, 3 if largest < MAX_BASE_RADIUS else 4)
        self.radius = smallest + self.below(largest - smallest + 1)
        self.bases = [self._place_base(*plot) for plot in self.plan.plots]
        self._stamp_bases()
        places = sorted(image for base in self.bases for image in self.images(*base))
        self._place_contested(places)
        for kind, (percent, size, straight) in TERRAIN.items():
            self._scatter(kind, percent, size, straight)
        self.is_connected = self._clear_ways(places)
        while len(places) > num_players:
            places.pop(self.below(len(places)))
        self.spawns = tuple(places)

    def below(self, limit: int) -> int:
        """A random number in 0..limit - 1."""
        if not self._words:
            self._words = self._bits.random_raw(512).tolist()
        return (self._words.pop() >> 16) % limit

    def images(self, row: int, column: int) -> list[Cell]:
        """The images of a cell under the symmetries of the plan, itself first."""
        shape = (self.rows, self.columns)
        return [maps.to_own(frame, row, column, *shape) for frame in self.plan.frames]

    def _place_base(self, first_row: int, first_column: int, rows: int, columns: int) -> Cell:
        """A spawn within its plot, in the outer two thirds of the room that it has there."""
        free_rows, free_columns = rows - 2 * self.radius, columns - 2 * self.radius
        row_slack, column_slack = -(-2 * free_rows // 3), -(-2 * free_columns // 3)
        return (
            first_row + self.radius + self.below(row_slack),
            first_column + self.radius + self.below(column_slack),
        )

    def _stamp_bases(self) -> None:
        """Open ground with the same resources on its outer sides at every base."""
        resources = self._draw_base_resources()
        reach = range(-self.radius, self.radius + 1)
        for row, column in self.bases:
            for image_row, image_column in (
                cell for dr in reach for dc in reach for cell in self.images(row + dr, column + dc)
            ):
                self.owners[image_row, image_column] = _BASE
        for row, column in self.bases:
            # The outer sides look away from the centre, so the inner ones stay open.
            row_sign = -1 if 2 * row < self.rows else 1
            column_sign = -1 if 2 * column < self.columns else 1
            for kind, along_row, along_column, is_within in resources:
                cell = row + row_sign * along_row, column + column_sign * along_column
                is_inside = 0 <= cell[0] < self.rows and 0 <= cell[1] < self.columns
                if is_inside and (is_within or self.owners[cell] == _FREE):
                    self.paint(cell, kind, _RESOURCE)

    def _draw_base_resources(self) -> list[tuple[int, int, int, bool]]:
        """Clumps along the outer row and the outer column: (tile, outward offsets, is in base)."""
        radius = self.radius
        side = [(radius, k) for k in range(-radius + 1, radius + 1)]
        side += [(k, radius) for k in range(radius - 1, -radius, -1)]
        more = 1 if radius > MIN_BASE_RADIUS else 0
        clumps = [
            (t.GOLD_TILE, 2 + more),
            (t.LUMBER_TILE, 2 + 2 * more),
            (t.STONE_TILE, 1 + more),
            (t.OIL_TILE, 1),
        ]
        gaps = len(side) - sum(length for _, length in clumps)
        resources, at = [], 0
        while clumps:
            skipped = self.below(gaps // len(clumps) + 1)
            gaps -= skipped
            at += skipped
            kind, length = clumps.pop(self.below(len(clumps)))
            for row, column in side[at : at + length]:
                resources.append((kind, row, column, True))
                if kind in (t.GOLD_TILE, t.LUMBER_TILE):
                    behind = (row + 1, column) if row == radius else (row, column + 1)
                    resources.append((kind, *behind, False))
            at += length
        return resources

    def paint(self, cell: Cell, kind: int, owner: int) -> int:
        """Set a cell and its images; returns how many they are."""
        images = set(self.images(*cell))
        for image in images:
            self.tiles[image] = kind
            self.owners[image] = owner
        return len(images)

    def _place_contested(self, places: Sequence[Cell]) -> None:
        """Clumps of resources where all bases are far."""
        kinds = [t.GOLD_TILE] * GOLD_PATCHES + [t.STONE_TILE, t.OIL_TILE]
        grid = np.indices(self.tiles.shape)
        away = np.full(self.tiles.shape, MAX_SIDE)
        for row, column in places:
            away = np.minimum(away, np.maximum(abs(grid[0] - row), abs(grid[1] - column)))
        far = away >= max(self.radius + 3, 3 * int(away.max()) // 4)
        cells = [(int(row), int(column)) for row, column in np.argwhere(far)]
        size = 2 + min(self.rows, self.columns) // 16
        for kind in kinds if cells else ():
            cell = cells[self.below(len(cells))]
            self._grow(cell, kind, 1 if kind == t.OIL_TILE else size, 0, _RESOURCE)

    def _scatter(self, kind: int, percent: int, size: int, straight: int) -> None:
        """Grow clumps of a kind until they cover a share of the map, or no more room is found."""
        missing = self.rows * self.columns * percent // 100
        scale = max(1, min(self.rows, self.columns) // 24)
        for _ in range(4 * missing):
            if missing <= 0:
                return
            cell = self.below(self.rows), self.below(self.columns)
            length = min(missing, size * scale // 2 + self.below(size * scale))
            missing -= self._grow(cell, kind, length, straight, _FREE)

    def _grow(self, cell: Cell, kind: int, size: int, straight: int, owner: int) -> int:
        """Paint along a random walk over free grass; returns how many cells are new.

        straight: the walk turns at one step in straight + 1.
        """
        row, column = cell
        step, painted = (0, 0), 0
        for _ in range(3 * size):
            if painted >= size or not (0 <= row < self.rows and 0 <= column < self.columns):
                break
            if self.owners[row, column] == _FREE and self.tiles[row, column] == t.GRASS:
                painted += self.paint((row, column), kind, owner)
            if step == (0, 0) or self.below(straight + 1) == 0:
                step = ((0, 1), (1, 0), (0, -1), (-1, 0))[self.below(4)]
            row, column = row + step[0], column + step[1]
        return painted

    def _clear_ways(self, places: Sequence[Cell]) -> bool:
        """Open ways without lava from the first base to all others and to contested resources.

        False where resources bar the way, which are never cleared.
        """
        parents = self._find_ways(places[0])
        goals = list(places)
        if any(goal not in parents for goal in goals):
            return False
        contested = np.argwhere(self.owners == _RESOURCE)
        goals += [parents[cell] for cell in map(tuple, contested.tolist()) if cell in parents]
        is_wide = min(self.rows, self.columns) >= 20
        cleared: set[Cell] = set()
        for goal in goals:
            cell = goal
            while cell not in cleared and cell != places[0]:
                cleared.add(cell)
                cell = parents[cell]
        for row, column in sorted(cell for cell in cleared if self._is_obstacle(cell)):
            block = [(row, column), (row + 1, column), (row, column + 1), (row + 1, column + 1)]
            for place in block if is_wide else block[:1]:
                if self._is_obstacle(place):
                    self.paint(place, t.GRASS, _FREE)
        return True

    def _is_obstacle(self, cell: Cell) -> bool:
        """Whether a cell is terrain that bars or burns walkers, and not a resource of a clump."""
        if cell[0] >= self.rows or cell[1] >= self.columns:
            return False
        return bool(self.owners[cell] == _FREE) and self.tiles[cell] not in (t.GRASS, t.DESERT)

    def _find_ways(self, start: Cell) -> dict[Cell, Cell]:
        """From each cell the next one on a way to `start` with the least to clear.

        Ways go in the four straight directions. Resources are reached, never crossed.
        """
        is_blocked = (~np.isin(self.tiles, (t.GRASS, t.DESERT))).tolist()
        is_end = (self.owners == _RESOURCE).tolist()
        parents: dict[Cell, Cell] = {}
        # By what they clear, then by length: ways to come wait in two queues.
        queue, costlier = deque([(start, start)]), deque[tuple[Cell, Cell]]()
        while queue or costlier:
            if not queue:
                queue, costlier = costlier, queue
            cell, parent = queue.popleft()
            if cell in parents:
                continue
            parents[cell] = parent
            row, column = cell
            if is_end[row][column]:
                continue
            for near in (row + 1, column), (row, column + 1), (row - 1, column), (row, column - 1):
                if 0 <= near[0] < self.rows and 0 <= near[1] < self.columns and near not in parents:
                    waits = costlier if is_blocked[near[0]][near[1]] else queue
                    waits.append((near, cell))
        return parents
