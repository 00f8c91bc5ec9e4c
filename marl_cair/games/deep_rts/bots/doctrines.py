"""Doctrines: the numbers by which each scripted player of Deep RTS plays."""

from __future__ import annotations

from typing import NamedTuple


class Doctrine(NamedTuple):
    """The numbers of one scripted player; all share one compiled function."""

    workers_first: int  # peasants before the first barracks
    workers: int  # peasants in the end
    halls: int
    barracks: int
    wells: int  # where oil is wanted, and a pool is near
    upgrades: int  # levels of each
    attack_size: int  # soldiers that set out together
    caution: int  # percent of the soldiers at the target, above which it attacks
    free_food: int  # a farm is begun when less is left
    lumber_weight: int  # of gathering, against a weight of 100 for gold
    footmen: int  # shares of the army
    archers: int
    cavalry: int
    answers: int  # added to a share for each enemy in sight of the kind that it beats
    militia: int  # peasants that fight at once when soldiers are too few at home
    scouts: int  # 1: sends a peasant into the fog


_BOTS = ("economist", "rusher", "boomer", "archers", "turtle", "mixed")
_NUMBERS = {  # a column for each bot, the last for the teacher, see `teacher.py`
    "workers_first": (7, 4, 7, 4, 4, 4, 1),
    "workers": (16, 7, 18, 11, 10, 10, 5),
    "halls": (1, 1, 2, 1, 1, 1, 1),
    "barracks": (4, 3, 4, 3, 3, 3, 3),
    "wells": (1, 0, 1, 0, 1, 1, 1),
    "upgrades": (0, 0, 1, 0, 2, 0, 3),
    "attack_size": (8, 4, 12, 8, 14, 5, 11),
    "caution": (100, 0, 0, 0, 0, 120, 28),
    "free_food": (2, 1, 2, 1, 1, 1, 2),
    "lumber_weight": (50, 30, 55, 60, 40, 30, 40),
    "footmen": (1, 1, 1, 0, 1, 2, 2),
    "archers": (1, 0, 2, 1, 2, 1, 2),
    "cavalry": (2, 0, 1, 0, 0, 0, 0),
    "answers": (0, 0, 0, 0, 0, 2, 3),
    "militia": (6, 4, 6, 4, 8, 4, 5),
    "scouts": (0, 0, 0, 0, 0, 1, 1),
}
*_OF_BOTS, TEACHER = map(Doctrine, *_NUMBERS.values())
DOCTRINES = dict(zip(_BOTS, _OF_BOTS, strict=True))
NO_DOCTRINE = Doctrine(*(0 for _ in Doctrine._fields))
