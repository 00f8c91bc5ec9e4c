"""The planes of Deep RTS's main representation: their names and numbers."""

from marl_cair.games.deep_rts import tables as t

FULL = 255
UNIFORM_NAMES = (
    *(f"own {name}" for name in t.RESOURCE_NAMES),
    "own food used",
    "own food limit",
    *(f"own {name}" for name in t.UPGRADE_NAMES),
    "time left",
)
PLANE_NAMES = (
    *t.TILE_NAMES[1:],
    "resource left",
    *t.UNIT_NAMES,
    *("own", "ally", "enemy", "health", "walking", "working", "fighting", "progress"),
    *("under construction", "own with an order"),
    *("own carrying gold", "own carrying lumber", "own carrying stone"),
    *("selected", "visible", "explored"),
    *UNIFORM_NAMES,
)
FIRST_TILE = 0  # minus grass, which has no plane
RESOURCE_LEFT = t.NUM_TILE_KINDS - 1
FIRST_KIND = RESOURCE_LEFT + 1
OWN = FIRST_KIND + t.NUM_KINDS
ALLY, ENEMY, HEALTH, IS_WALKING, IS_WORKING, IS_FIGHTING = range(OWN + 1, OWN + 7)
PROGRESS, IS_RISING, HAS_ORDER, CARRIES = range(OWN + 7, OWN + 11)
SELECTED, VISIBLE, EXPLORED, FIRST_UNIFORM = range(CARRIES + 3, CARRIES + 7)
OWN_FOOD = FIRST_UNIFORM + t.NUM_RESOURCES
FOOD_LIMIT = OWN_FOOD + 1
FIRST_UPGRADE_PLANE = FOOD_LIMIT + 1
TIME_LEFT = FIRST_UPGRADE_PLANE + t.NUM_UPGRADES
NUM_UNIFORM = len(UNIFORM_NAMES)

LOG_STEP = 12.0  # levels that a doubling of a store is worth: 2**20 fits
FOOD_STEP = 5  # levels for one food, of at most 50
UPGRADE_STEP = 100
