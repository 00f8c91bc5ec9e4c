"""Named configurations of Deep RTS: maps, players, numbers, actions, goal, fog and time."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

from marl_cair.games.checks.scenario import (
    check_shaping_discount,
    check_switch,
    check_time,
    check_whole_number,
    read_whole_numbers,
)
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
REWARDS = {"sparse": "+1 win, -1 loss, 0 draw", "shaped": "sparse plus a potential difference"}
# What ends a game and pays; `conquest` ends with the last player or team, the others are races.
GOALS = {
    "conquest": "be the last player or team standing",
    "gold": "bring in goal_amount gold",
    "lumber": "bring in goal_amount lumber",
    "score": "the highest score when the time is over",
    "army": "train goal_amount soldiers",
}
PAYS = {
    "conquest": "+1 last standing, -1 fallen",
    "gold": "1 in all, for {} gold",
    "lumber": "1 in all, for {} lumber",
    "score": "score / 100",
    "army": "1 in all, for {} soldiers",
}
MAX_TEAM = 127  # as the rules hold it
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
    reward: str = "sparse"  # or "shaped"; only of conquest
    shaping_discount: float = 0.99  # gamma of the potential difference, per decision
    fog: bool = False
    ticks_per_step: int = 10  # game ticks that one decision lasts
    max_ticks: int = 10_000  # time limit
    tile_pixels: int = 8  # pixels along a tile of the representation `image`, at most 32
    unit_capacity: int = 0  # units of a player; 0 = a quarter of the cells, at most 200

    def __post_init__(self) -> None:
        check_whole_number("deep_rts", self, "num_players", 1, t.MAX_PLAYERS)
        check_time("deep_rts", self)
        check_whole_number("deep_rts", self, "tile_pixels", 1, 32)
        check_whole_number("deep_rts", self, "unit_capacity", 0, t.MAX_UNITS)
        check_whole_number("deep_rts", self, "goal_amount", 0, 1_000_000)
        find_by_name("deep_rts preset", self.preset, t.PRESETS)
        find_by_name("deep_rts action space", self.actions, ACTION_SPACES)
        find_by_name("deep_rts reward", self.reward, REWARDS)
        find_by_name("deep_rts goal", self.goal, GOALS)
        check_shaping_discount("deep_rts", self)
        check_switch("deep_rts", self, "fog")
        self._check_map()
        self._check_goal()
        self._check_army()
        self._check_teams()

    def _check_map(self) -> None:
        name: object = os.fspath(self.map) if isinstance(self.map, os.PathLike) else self.map
        if not isinstance(name, str) or not name:
            raise ValueError(
                f"deep_rts: map is {self.map!r}, it must be the name of a map or the path of a "
                "map file"
            )
        object.__setattr__(self, "map", name)  # a path as the text that it stands for

    def _check_goal(self) -> None:
        if self.goal in ("gold", "lumber", "army") and self.goal_amount < 1:
            raise ValueError(
                f"deep_rts: the goal {self.goal} needs a goal_amount of at least 1, it is "
                f"{self.goal_amount}"
            )
        if self.goal == "conquest" and self.num_players < 2:
            raise ValueError(
                "deep_rts: the goal conquest needs at least 2 players, num_players is 1; choose "
                "another goal"
            )

    def _check_army(self) -> None:
        army = read_whole_numbers(self, "army")
        if army is None or (army and (len(army) != 4 or min(army) < 0 or sum(army) == 0)):
            raise ValueError(
                f"deep_rts: army is {self.army!r}, it must be () or the numbers of peasants, "
                "footmen, archers and cavalry, at least one in all"
            )

    def _check_teams(self) -> None:
        teams = read_whole_numbers(self, "teams")
        if teams is None or not all(0 <= team <= MAX_TEAM for team in teams):
            raise ValueError(
                f"deep_rts: teams is {self.teams!r}, it must be () or the team of each seat, a "
                f"whole number in 0..{MAX_TEAM}"
            )
        if not teams:
            return
        if len(self.teams) != self.num_players:
            raise ValueError(
                f"deep_rts: teams names {len(self.teams)} seats, num_players is "
                f"{self.num_players}; give each seat one team"
            )
        if len(set(self.teams)) < 2 and self.goal == "conquest":
            raise ValueError(
                f"deep_rts: all seats are of team {self.teams[0]}, conquest needs at least two "
                "teams"
            )

    @property
    def maps(self) -> tuple[GameMap, ...]:
        """The maps that games of this scenario are played on, all of one size.

        `map` names a built-in map, a set of generated maps (of which each game draws one), a
        generated map as generated-<rows>x<columns>-<players>p-<seed>, the path of a map file, or
        several of these with + between them: smaller ones then stand in the middle of walls.
        They are read when first asked for, not when the scenario is named.

        Raises:
            MapError: a file that cannot be read or played.
            UnknownNameError: no such map; names the nearest.
            ValueError: fewer spawns than players.
        """
        maps = _load_maps(self.map)
        for game_map in maps:
            if len(game_map.spawns) < self.num_players:
                raise ValueError(
                    f"deep_rts: the map {game_map.name} has {len(game_map.spawns)} spawns, "
                    f"num_players is {self.num_players}; choose another map or fewer players"
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
        if sum(self.army) > slots:
            raise ValueError(
                f"deep_rts: army is {self.army}, {sum(self.army)} units, and the unit_capacity of "
                f"this board is {slots}; take a smaller army or a larger unit_capacity"
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
        return (generator.generate_map(*map(int, match.groups())),)
    if name.endswith((".txt", ".json", ".tmj")):
        try:
            return (maps.read_map(name),)
        except OSError as error:
            raise formats.MapError(
                f"map {name}: the file cannot be read ({error.strerror or error}); give the path "
                "of one that is there"
            ) from error
    find_by_name("deep_rts map", name, {**maps.BUILT_IN_MAPS, **generator.MAP_SETS})
    return (maps.load_map(name),)


_DUEL = {"15x15": "15x15-2p-crossing", "31x31": "31x31-2p-ridge"}
_MAZE = {"15x15": "lava-maze-15", "31x31": "lava-maze-31"}
_FOUR = {"15x15": "generated-15x15-4p-3", "31x31": "31x31-4p-quarters"}
_SIX = {"15x15": "generated-15x15-6p-5", "31x31": "31x31-6p-frontier"}
_TICKS = {"15x15": 10_000, "31x31": 20_000}
ECONOMY_TICKS = 6_000  # the thesis's first 600 seconds


def _list_scenarios(size: str) -> dict[str, Scenario]:
    """The kinds of games on boards of one size, without fog."""
    alone = Scenario(map=_DUEL[size], num_players=1, goal="score", max_ticks=3_000)
    duel = Scenario(map=_DUEL[size], max_ticks=_TICKS[size])
    four = replace(duel, map=_FOUR[size], num_players=4)
    return {
        f"1v1-{size}": duel,
        f"GoldCollect-{size}": replace(alone, goal="gold", goal_amount=200),
        f"LumberCollect-{size}": replace(alone, goal="lumber", goal_amount=200),
        f"Economy-{size}": replace(alone, max_ticks=ECONOMY_TICKS),
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


def _with_fog(scenarios: dict[str, Scenario]) -> dict[str, Scenario]:
    foggy = {f"{name}-fog": replace(plain, fog=True) for name, plain in scenarios.items()}
    return {**scenarios, **foggy}


SCENARIOS = {**_with_fog(_list_scenarios("15x15")), **_with_fog(_list_scenarios("31x31"))}
