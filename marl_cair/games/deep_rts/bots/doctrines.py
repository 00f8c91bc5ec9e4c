"""How each scripted player of Deep RTS plays, in numbers."""

from __future__ import annotations

from typing import NamedTuple


class Doctrine(NamedTuple):
    """How one scripted player plays: numbers only, so that all share one compiled function."""

    workers_first: int  # peasants before the first barracks
    workers: int  # peasants in the end
    halls: int
    barracks: int
    wells: int  # where oil is wanted, and a pool is near
    upgrades: int  # levels of each
    attack_size: int  # soldiers that set out together
    caution: int  # sets out with more than this percentage of the soldiers at the target
    free_food: int  # a farm is begun when less is left
    lumber_weight: int  # of gathering, against a weight of 100 for gold
    footmen: int  # shares of the army
    archers: int
    cavalry: int
    answers: int  # added to a share for each enemy in sight of the kind that it beats
    militia: int  # peasants that fight at once when soldiers are too few at home
    scouts: int  # 1: sends a peasant into the fog


DOCTRINES = {
    "economist": Doctrine(
        workers_first=7,
        workers=16,
        halls=1,
        barracks=4,
        wells=1,
        upgrades=0,
        attack_size=8,
        caution=100,
        free_food=2,
        lumber_weight=50,
        footmen=1,
        archers=1,
        cavalry=2,
        answers=0,
        militia=6,
        scouts=0,
    ),
    "rusher": Doctrine(
        workers_first=3,
        workers=7,
        halls=1,
        barracks=3,
        wells=0,
        upgrades=0,
        attack_size=4,
        caution=0,
        free_food=1,
        lumber_weight=30,
        footmen=1,
        archers=0,
        cavalry=0,
        answers=0,
        militia=0,
        scouts=0,
    ),
    "boomer": Doctrine(
        workers_first=7,
        workers=18,
        halls=2,
        barracks=4,
        wells=1,
        upgrades=1,
        attack_size=12,
        caution=0,
        free_food=2,
        lumber_weight=55,
        footmen=1,
        archers=2,
        cavalry=1,
        answers=0,
        militia=6,
        scouts=0,
    ),
    "archers": Doctrine(
        workers_first=3,
        workers=11,
        halls=1,
        barracks=3,
        wells=0,
        upgrades=0,
        attack_size=8,
        caution=0,
        free_food=1,
        lumber_weight=60,
        footmen=0,
        archers=1,
        cavalry=0,
        answers=0,
        militia=0,
        scouts=0,
    ),
    "turtle": Doctrine(
        workers_first=3,
        workers=10,
        halls=1,
        barracks=3,
        wells=1,
        upgrades=2,
        attack_size=14,
        caution=0,
        free_food=1,
        lumber_weight=40,
        footmen=1,
        archers=2,
        cavalry=0,
        answers=0,
        militia=8,
        scouts=0,
    ),
    "mixed": Doctrine(
        workers_first=4,
        workers=10,
        halls=1,
        barracks=3,
        wells=1,
        upgrades=0,
        attack_size=5,
        caution=120,
        free_food=1,
        lumber_weight=30,
        footmen=2,
        archers=1,
        cavalry=0,
        answers=2,
        militia=4,
        scouts=1,
    ),
}
NO_DOCTRINE = Doctrine(*(0 for _ in Doctrine._fields))
