"""Unit, building, tile and upgrade numbers of Deep RTS: one row per preset, one column per kind.

Sources: `thesis` holds the numbers of the public code of June 2018 (the thesis's game), `original`
those of its last version (2023); `balanced` is ours, argued in this folder's README.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

TILE_NAMES = ("grass", "desert", "lava", "wall", "water", "lumber", "gold", "stone", "oil")
NUM_TILE_KINDS = len(TILE_NAMES)
GRASS, DESERT, LAVA, WALL, WATER, LUMBER_TILE, GOLD_TILE, STONE_TILE, OIL_TILE = range(9)
WALKABLE_TILES = (GRASS, DESERT, LAVA)

RESOURCE_NAMES = ("gold", "lumber", "stone", "oil")
NUM_RESOURCES = len(RESOURCE_NAMES)
GOLD, LUMBER, STONE, OIL = range(NUM_RESOURCES)
NO_RESOURCE = -1
MAX_RESOURCE = 1_000_000  # thesis, table "Player Resources"
MAX_UNITS = 200
MAX_PLAYERS = 8
# The resource in a tile of each kind. Oil comes out of a well that stands on it, not by hand.
TILE_RESOURCE = (-1, -1, -1, -1, -1, LUMBER, GOLD, STONE, OIL)

_MOBILE_NAMES = ("peasant", "footman", "archer", "cavalry")
NUM_MOBILE_KINDS = len(_MOBILE_NAMES)  # kinds below walk, kinds from here on are buildings
UNIT_NAMES = (*_MOBILE_NAMES, "town_hall", "barracks", "farm", "smithy", "oil_well")
NUM_KINDS = len(UNIT_NAMES)
PEASANT, FOOTMAN, ARCHER, CAVALRY, TOWN_HALL, BARRACKS, FARM, SMITHY, OIL_WELL = range(NUM_KINDS)
NO_KIND = -1

UPGRADE_NAMES = ("blades", "plates")  # damage and armour of the owner's soldiers
NUM_UPGRADES = len(UPGRADE_NAMES)
BLADES, PLATES = range(NUM_UPGRADES)

# The products of orders: a unit or building by its kind, then the upgrades.
PRODUCT_NAMES = (*UNIT_NAMES, *UPGRADE_NAMES)
NUM_PRODUCTS = len(PRODUCT_NAMES)
FIRST_UPGRADE = NUM_KINDS
# Products of each kind, in the order of the original's Build0, Build1, Build2 and beyond.
_PRODUCTS_OF = {
    PEASANT: (TOWN_HALL, FARM, BARRACKS, SMITHY, OIL_WELL),
    TOWN_HALL: (PEASANT,),
    BARRACKS: (FOOTMAN, ARCHER, CAVALRY),
    SMITHY: (FIRST_UPGRADE + BLADES, FIRST_UPGRADE + PLATES),
}
PRODUCTS = tuple(_PRODUCTS_OF.get(kind, ()) for kind in range(NUM_KINDS))
MAX_PRODUCTS = max(len(products) for products in PRODUCTS)

TICKS_PER_SECOND = 10

# Allowed values of a preset for each kind, both ends included.
_RANGES = {
    "health": (1, 30_000),
    **dict.fromkeys(("cost_gold", "cost_lumber", "cost_stone", "cost_oil"), (0, MAX_RESOURCE)),
    **dict.fromkeys(("range_tiles", "sight_tiles"), (0, 15)),
}


def require(is_valid: bool, message: str) -> None:
    """Raise ValueError with the message unless `is_valid`."""
    if not is_valid:
        raise ValueError(f"deep_rts: {message}")


@dataclass(frozen=True)
class Preset:
    """All numbers of one version of the game. Tuples run over the kinds of UNIT_NAMES.

    Raises:
        ValueError: a table that cannot work; names the field, the kind and what is allowed.
    """

    #   peasant, footman, archer, cavalry, town hall, barracks, farm, smithy, oil well
    is_enabled: tuple[bool, ...]
    health: tuple[int, ...]  # hit points
    cost_gold: tuple[int, ...]
    cost_lumber: tuple[int, ...]
    cost_stone: tuple[int, ...]
    cost_oil: tuple[int, ...]
    food_produced: tuple[int, ...]
    food_consumed: tuple[int, ...]
    build_ticks: tuple[int, ...]
    damage_min: tuple[int, ...]  # hit points, uniform integer roll
    damage_max: tuple[int, ...]
    piercing: tuple[int, ...]  # added to each hit after armour
    range_tiles: tuple[int, ...]  # to the nearest cell of the target; 1 reaches diagonals
    armour: tuple[int, ...]
    sight_tiles: tuple[int, ...]
    walk_ticks: tuple[int, ...]  # for one tile of grass
    attack_ticks: tuple[int, ...]  # from one blow to the next
    size_tiles: tuple[int, ...]  # side of the square that it covers, odd
    #   tiles, in the order of TILE_NAMES
    walk_percent: tuple[int, ...]  # of walk_ticks; 0: no unit can walk there
    tile_damage: tuple[int, ...]  # hit points per tick of a unit there
    tile_amount: tuple[int, ...]  # resource units in a fresh tile
    tile_yield: tuple[int, ...]  # units carried for one unit taken
    #   upgrades: blades, plates
    upgrade_gold: tuple[int, ...] = (600, 600)  # per level
    upgrade_oil: tuple[int, ...] = (50, 50)
    upgrade_ticks: tuple[int, ...] = (600, 600)
    upgrade_levels: tuple[int, ...] = (2, 2)
    upgrade_bonus: tuple[int, ...] = (2, 4)  # damage a hit, armour; per level
    #   all players
    start_gold: int = 1500
    start_lumber: int = 750
    start_stone: int = 0
    start_oil: int = 0
    wealth: int = 1  # each game multiplies its start's stores by a number in 1..wealth
    start_food: int = 1  # without any building
    food_limit: int = 100
    harvest_ticks: int = 6  # for one unit of a resource
    carry_capacity: int = 10
    oil_ticks: int = 20  # for one unit of oil from a well
    armour_percent: int = 12  # of armour that a hit loses
    adds_minimum_twice: bool = False  # the original's roll is min + uniform(min, max)
    roll_low_percent: int = 50  # a hit does between these shares of its damage
    roll_high_percent: int = 100
    harvests_forever: bool = True  # a worker goes back for more by itself
    has_auto_attack: bool = True  # idle soldiers attack what comes into sight
    has_instant_build: bool = False
    starts_with_hall: bool = True
    start_peasants: int = 1
    repair_percent: int = 25  # of the price for repairing a building from 0 to full

    def __post_init__(self) -> None:
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            if isinstance(value, tuple):
                is_of_tiles = name.startswith(("tile_", "walk_percent"))
                is_upgrade = name.startswith("upgrade_")
                expected = (
                    NUM_TILE_KINDS if is_of_tiles else NUM_UPGRADES if is_upgrade else NUM_KINDS
                )
                require(
                    len(value) == expected,
                    f"{name} has {len(value)} values, it needs {expected}, one for each kind",
                )
                value = min(value)
            require(value >= 0, f"{name} is {value}, it must not be negative")
        most = MAX_RESOURCE // max(1, *self.start_stores)
        require(1 <= self.wealth <= most, f"wealth is {self.wealth}, allowed are 1..{most}")
        for kind, name in enumerate(UNIT_NAMES):
            self._check_kind(kind, name)

    @property
    def start_stores(self) -> tuple[int, ...]:
        """What a player has of each resource at the start."""
        return self.start_gold, self.start_lumber, self.start_stone, self.start_oil

    def _check_kind(self, kind: int, name: str) -> None:
        for field, (low, high) in _RANGES.items():
            value = getattr(self, field)[kind]
            require(
                low <= value <= high, f"{field} of {name} is {value}, allowed are {low}..{high}"
            )
        damage_min, damage_max = self.damage_min[kind], self.damage_max[kind]
        require(
            damage_max >= damage_min,
            f"damage_max of {name} is {damage_max}, below its damage_min {damage_min}",
        )
        walk, attack, size = self.walk_ticks[kind], self.attack_ticks[kind], self.size_tiles[kind]
        require(
            kind >= NUM_MOBILE_KINDS or (walk >= 1 and attack >= 1 and size == 1),
            f"{name} moves, so its walk_ticks ({walk}) and attack_ticks ({attack}) must be at "
            f"least 1 and its size_tiles ({size}) 1",
        )
        require(
            size in (1, 3, 5),
            f"size_tiles of {name} is {size}, allowed are 1, 3 and 5 (the site lies around its "
            "builder)",
        )
        food = self.food_consumed[kind]
        require(
            food <= self.food_limit,
            f"{name} consumes {food} food, more than the food limit of {self.food_limit}",
        )


_ORIGINAL = Preset(
    is_enabled=(True, True, True, False, True, True, True, False, False),
    health=(30, 60, 40, 80, 1200, 800, 400, 600, 300),
    cost_gold=(400, 600, 500, 800, 500, 700, 500, 600, 400),
    cost_lumber=(0, 0, 50, 0, 250, 450, 250, 300, 200),
    cost_stone=(0, 0, 0, 0, 0, 0, 0, 0, 0),
    cost_oil=(0, 0, 0, 50, 0, 0, 0, 0, 0),
    food_produced=(0, 0, 0, 0, 1, 0, 4, 0, 0),
    food_consumed=(1, 1, 1, 2, 0, 0, 0, 0, 0),
    build_ticks=(450, 600, 750, 700, 600, 1000, 1000, 800, 500),
    damage_min=(2, 2, 3, 4, 0, 0, 0, 0, 0),
    damage_max=(9, 9, 9, 12, 0, 0, 0, 0, 0),
    piercing=(2, 4, 2, 4, 0, 0, 0, 0, 0),
    range_tiles=(1, 1, 4, 1, 0, 0, 0, 0, 0),
    armour=(0, 4, 0, 6, 0, 20, 20, 20, 20),
    sight_tiles=(2, 3, 4, 4, 4, 3, 2, 3, 2),
    walk_ticks=(11, 11, 11, 7, 0, 0, 0, 0, 0),
    attack_ticks=(10, 10, 10, 10, 0, 0, 0, 0, 0),
    size_tiles=(1, 1, 1, 1, 3, 3, 1, 3, 1),
    #            grass, desert, lava, wall, water, lumber, gold, stone, oil
    walk_percent=(100, 50, 50, 0, 0, 0, 0, 0, 0),
    tile_damage=(0, 0, 1, 0, 0, 0, 0, 0, 0),
    tile_amount=(0, 0, 0, 0, 0, 1000, 1000, 1000, 1000),
    tile_yield=(0, 0, 0, 0, 0, 1, 1, 1, 1),
    adds_minimum_twice=True,
    roll_low_percent=100,
    roll_high_percent=150,
    has_auto_attack=False,
    has_instant_build=True,
    starts_with_hall=False,
)

PRESETS = {
    "original": _ORIGINAL,
    "thesis": replace(
        _ORIGINAL,
        adds_minimum_twice=False,
        roll_low_percent=50,
        roll_high_percent=100,
        harvest_ticks=5,
        harvests_forever=False,
    ),
    "balanced": replace(
        _ORIGINAL,
        is_enabled=(True,) * NUM_KINDS,
        health=(30, 60, 40, 90, 600, 400, 200, 300, 150),
        damage_min=(2, 6, 2, 7, 0, 0, 0, 0, 0),
        damage_max=(6, 12, 5, 15, 0, 0, 0, 0, 0),
        piercing=(1, 3, 2, 3, 0, 0, 0, 0, 0),
        walk_ticks=(11, 9, 11, 7, 0, 0, 0, 0, 0),
        attack_ticks=(10, 12, 8, 12, 0, 0, 0, 0, 0),
        cost_gold=(50, 80, 70, 120, 250, 150, 60, 150, 80),
        cost_lumber=(0, 0, 30, 0, 100, 100, 40, 80, 60),
        cost_stone=(0, 0, 0, 0, 0, 0, 0, 30, 0),
        cost_oil=(0, 0, 0, 30, 0, 0, 0, 0, 0),
        food_produced=(0, 0, 0, 0, 5, 0, 5, 0, 0),
        build_ticks=(100, 100, 100, 140, 400, 250, 120, 250, 120),
        sight_tiles=(4, 4, 6, 5, 6, 5, 4, 4, 3),
        armour=(0, 0, 0, 20, 10, 10, 10, 10, 10),
        upgrade_gold=(100, 100),
        upgrade_oil=(20, 20),
        upgrade_ticks=(200, 200),
        upgrade_bonus=(2, 8),
        oil_ticks=10,
        tile_amount=(0, 0, 0, 0, 0, 300, 500, 300, 300),
        tile_yield=(0, 0, 0, 0, 0, 2, 2, 2, 1),
        carry_capacity=20,
        start_gold=200,
        start_lumber=100,
        start_food=0,
        harvest_ticks=5,
        adds_minimum_twice=False,
        roll_low_percent=75,
        roll_high_percent=125,
        has_auto_attack=True,
        has_instant_build=False,
        start_peasants=3,
        starts_with_hall=True,
    ),
}
PRESETS["wealthy"] = replace(PRESETS["balanced"], wealth=10)
PRESETS["wealthy_3"] = replace(PRESETS["balanced"], wealth=3)
