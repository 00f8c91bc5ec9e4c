"""Named configurations of Deep RTS: maps, players, numbers, actions, goal, fog and time."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

from marl_cair.games.checks import scenario as checks
from marl_cair.games.deep_rts import tables as t
from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.games.deep_rts.maps.maps import GameMap

GYMNASIUM_PREFIX = "DeepRTS"  # of the ids marl_cair/DeepRTS-<scenario>-v0

ACTION_SPACES = {
    "unit": "order x target cell for the unit under the cursor",
    "classic": "the original's 16 actions for the unit under the cursor",
    "grid": "one order for each own unit at once, at the cell where it stands",
}
REWARDS = {
    "sparse": "+1 win, -1 loss, 0 draw",
    "shaped": "sparse plus a potential difference, which keeps the optimal policy",
    "gains": "sparse plus the change of the own share in all worth",
}
# The reward of each goal: of the last player or team standing, and of races; {}: goal_amount.
GOALS = {
    "conquest": "+1 last standing, -1 fallen",
    "gold": "1 in all, for {} gold",
    "lumber": "1 in all, for {} lumber",
    "score": "score / 100",
    "army": "1 in all, for {} soldiers",
}
MAX_TEAM = 127
_RANGES = (
    ("num_players", 1, t.MAX_PLAYERS),
    ("tile_pixels", 1, 32),
    ("unit_capacity", 0, t.MAX_UNITS),
    ("goal_amount", 0, 1_000_000),
)
MAPS_OF_A_SET = 64  # of a set of maps, one is drawn for each game


@dataclass(frozen=True)
class Scenario:
    """Settings of one kind of game.

    Raises:
        ValueError: a value is outside what is allowed; the message names field, value and range.
        MapError: the map cannot be read or cannot be played by so many.
    """

    map: str = "15x15-2p-crossing"  # see `maps`
    num_players: int = 2
    teams: tuple[int, ...] = ()  # the team of each seat; () = each seat for itself
    preset: str = "balanced"  # numbers of units and tiles: see tables.PRESETS
    actions: str = "unit"  # see ACTION_SPACES
    goal: str = "conquest"  # see GOALS
    goal_amount: int = 0  # of the goals gold, lumber and army
    army: tuple[int, ...] = ()  # units of each mobile kind at the start, in place of a base
    reward: str = "sparse"  # see REWARDS; others only of conquest
    shaping_discount: float = 0.99  # gamma of the potential difference, per decision
    fog: bool = False
    ticks_per_step: int = 10  # game ticks that one decision lasts
    max_ticks: int = 10_000  # time limit
    tile_pixels: int = 8  # pixels along a tile of the representation `image`, at most 32
    unit_capacity: int = 0  # units of a player; 0 = a quarter of the cells, at most 200

    def __post_init__(self) -> None:
        checks.check_time("deep_rts", self)
        for field, low, high in _RANGES:
            checks.check_whole_number("deep_rts", self, field, low, high)
        find_by_name("deep_rts preset", self.preset, t.PRESETS)
        find_by_name("deep_rts action space", self.actions, ACTION_SPACES)
        find_by_name("deep_rts reward", self.reward, REWARDS)
        find_by_name("deep_rts goal", self.goal, GOALS)
        checks.check_shaping_discount("deep_rts", self)
        checks.check_switch("deep_rts", self, "fog")
        if isinstance(self.map, os.PathLike):
            object.__setattr__(self, "map", os.fspath(self.map))
        given = f"map is {self.map!r}"  # the fields as they were given
        t.require(
            isinstance(self.map, str) and bool(self.map),
            f"{given}, it must be the name of a map or the path of a map file",
        )
        t.require(
            self.goal not in ("gold", "lumber", "army") or self.goal_amount >= 1,
            f"the goal {self.goal} needs a goal_amount of at least 1, it is {self.goal_amount}",
        )
        t.require(
            self.goal != "conquest" or self.num_players >= 2,
            "the goal conquest needs at least 2 players, num_players is 1; choose another goal",
        )
        given = f"army is {self.army!r}"
        army = checks.read_whole_numbers(self, "army")
        is_army = army is not None and len(army) == 4 and min(army) >= 0 and sum(army) > 0
        t.require(
            army == () or is_army,
            f"{given}, it must be () or the numbers of peasants, footmen, archers and cavalry, at "
            "least one in all",
        )
        given = f"teams is {self.teams!r}"
        teams = checks.read_whole_numbers(self, "teams")
        t.require(
            teams is not None and all(0 <= team <= MAX_TEAM for team in teams),
            f"{given}, it must be () or the team of each seat, a whole number in 0..{MAX_TEAM}",
        )
        t.require(
            len(self.teams) in (0, self.num_players),
            f"teams names {len(self.teams)} seats, num_players is {self.num_players}; give each "
            "seat one team",
        )
        t.require(
            self.goal != "conquest" or len(set(self.teams)) != 1,
            f"teams is {self.teams}, conquest needs at least two teams",
        )

    @property
    def maps(self) -> tuple[GameMap, ...]:
        """The maps that games of this scenario are played on, all of one size.

        `map` names a built-in map, a set of generated maps (of which each game draws one), a
        generated map as generated-<rows>x<columns>-<players>p-<seed>, the path of a map file, or
        several of these with + between them: smaller ones then stand in the middle of walls.
        They are loaded at the first use.

        Raises:
            MapError: a file that cannot be read or played.
            UnknownNameError: no such map; names the nearest.
            ValueError: fewer spawns than players.
        """
        maps = _load_maps(self.map)
        for game_map in maps:
            t.require(
                len(game_map.spawns) >= self.num_players,
                f"the map {game_map.name} has {len(game_map.spawns)} spawns, num_players is "
                f"{self.num_players}; choose another map or fewer players",
            )
        return maps

    @property
    def rows(self) -> int:
        """Rows of the board."""
        return int(self.maps[0].tiles.shape[0])

    @property
    def columns(self) -> int:
        """Columns of the board."""
        return int(self.maps[0].tiles.shape[1])

    @property
    def num_cells(self) -> int:
        """Cells of the board with its border."""
        return (self.rows + 2) * (self.columns + 2)

    @property
    def slots_per_player(self) -> int:
        """Unit slots of each player. Raises ValueError where the army has more units."""
        slots = self.unit_capacity or min(t.MAX_UNITS, max(16, self.rows * self.columns // 4))
        t.require(
            sum(self.army) <= slots,
            f"army is {self.army}, {sum(self.army)} units, and the unit_capacity of this board is "
            f"{slots}; take a smaller army or a larger unit_capacity",
        )
        return slots


_GENERATED = re.compile(r"generated-(\d+)x(\d+)-(\d+)p-(\d+)")


@cache
def _load_maps(name: str) -> tuple[GameMap, ...]:
    # Naming a scenario needs none of these.
    from marl_cair.games.deep_rts.maps import formats, generator, maps

    if "+" in name:
        return maps.pad_maps([one for part in name.split("+") for one in _load_maps(part)])
    if name in generator.MAP_SETS:
        return generator.map_set(name, MAPS_OF_A_SET)
    if match := _GENERATED.fullmatch(name):
        rows, columns, players, seed = map(int, match.groups())
        return (generator.generate_map(rows, columns, players, seed),)
    if name.endswith((".txt", ".json", ".tmj")):
        try:
            return (maps.read_map(name),)
        except OSError as error:
            raise formats.MapError(
                f"map {name}: the file cannot be read ({error.strerror or error}); give the path "
                "of one that exists"
            ) from error
    find_by_name("deep_rts map", name, {**maps.BUILT_IN_MAPS, **generator.MAP_SETS})
    return (maps.load_map(name),)


_DUEL = {"15x15": "15x15-2p-crossing", "31x31": "31x31-2p-ridge"}
_MAZE = {"15x15": "lava-maze-15", "31x31": "lava-maze-31"}
_FOUR = {"15x15": "generated-15x15-4p-3", "31x31": "31x31-4p-quarters"}
_SIX = {"15x15": "generated-15x15-6p-5", "31x31": "31x31-6p-frontier"}
_TICKS = {"15x15": 10_000, "31x31": 20_000}


def _list_scenarios(size: str) -> dict[str, Scenario]:
    """The scenarios on boards of one size, without fog and with it."""
    alone = Scenario(map=_DUEL[size], num_players=1, goal="score", max_ticks=3_000)
    duel = Scenario(map=_DUEL[size], max_ticks=_TICKS[size])
    four = replace(duel, map=_FOUR[size], num_players=4)
    plain = {
        f"1v1-{size}": duel,
        f"GoldCollect-{size}": replace(alone, goal="gold", goal_amount=200),
        f"LumberCollect-{size}": replace(alone, goal="lumber", goal_amount=200),
        f"Economy-{size}": replace(alone, max_ticks=6_000),  # the thesis's first 600 seconds
        f"LavaMaze-{size}": replace(
            alone, map=_MAZE[size], goal="gold", goal_amount=1, army=(1, 0, 0, 0), ticks_per_step=5
        ),
        f"Army-{size}": replace(alone, goal="army", goal_amount=5, max_ticks=6_000),
        f"Skirmish-{size}": replace(duel, army=(0, 4, 3, 1), ticks_per_step=5, max_ticks=3_000),
        f"FFA-3-{size}": replace(four, num_players=3),
        f"FFA-4-{size}": four,
        f"FFA-6-{size}": replace(four, map=_SIX[size], num_players=6),
        f"Teams-2v2-{size}": replace(four, teams=(0, 1, 1, 0)),
    }
    return plain | {f"{name}-fog": replace(game, fog=True) for name, game in plain.items()}


SCENARIOS = _list_scenarios("15x15") | _list_scenarios("31x31")
