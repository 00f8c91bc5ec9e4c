"""The roll of a blow: the formula of each preset, armour, upgrades, what is counted."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import combat
from tests.games.deep_rts.skirmish import Skirmish, call, face_off


def roll_blows(attacker: int, target: int, num_blows: int = 20_000, **options) -> np.ndarray:
    skirmish, unit, other = face_off(attacker, target, **options)
    world, rules = skirmish.world, skirmish.rules
    blows = np.zeros(num_blows, int)
    for tick in range(num_blows):
        world.clock[s.TICK] = tick
        blows[tick] = call(combat.blow, world, rules, unit, other)
    return blows


@pytest.mark.parametrize(
    ("attacker", "target", "mean", "low", "high"),
    [
        (t.PEASANT, t.PEASANT, 11.4, 6, 19),
        (t.PEASANT, t.FOOTMAN, 10.8, 5, 18),
        (t.PEASANT, t.ARCHER, 11.4, 6, 19),
        (t.FOOTMAN, t.PEASANT, 13.9, 8, 22),
        (t.FOOTMAN, t.FOOTMAN, 13.3, 7, 21),
        (t.FOOTMAN, t.ARCHER, 13.9, 8, 22),
        (t.ARCHER, t.PEASANT, 13.3, 8, 20),
        (t.ARCHER, t.FOOTMAN, 12.6, 7, 20),
        (t.ARCHER, t.ARCHER, 13.3, 8, 20),
    ],
)
def test_blows_in_the_original_are_those_that_were_measured(attacker, target, mean, low, high):
    """The table of 200,000 rolls of the original; here its highest share can
    be rolled exactly.
    """
    blows = roll_blows(attacker, target, 4_000, preset="original")
    assert blows.mean() == pytest.approx(mean, abs=0.3)
    assert low <= blows.min() <= low + 1
    assert high - 1 <= blows.max() <= high + 1


@pytest.mark.parametrize(
    ("attacker", "mean"), [(t.PEASANT, 8.4), (t.FOOTMAN, 10.9), (t.ARCHER, 10.2)]
)
def test_blows_on_a_farm_in_the_original_lose_its_armour(attacker, mean):
    assert roll_blows(attacker, t.FARM, 4_000, preset="original").mean() == pytest.approx(
        mean, abs=0.3
    )


@pytest.mark.parametrize(
    ("preset", "attacker", "target", "low", "high"),
    [
        # A whole roll d = uniform(min, max) + piercing - 0.12 armour, then 50..100 % of it.
        ("thesis", t.PEASANT, t.PEASANT, 2, 11),
        ("thesis", t.FOOTMAN, t.FOOTMAN, 2, 12),
        ("thesis", t.ARCHER, t.FARM, 1, 8),
        # The same, then 75..125 %.
        ("drill", t.PEASANT, t.PEASANT, 3, 13),
        ("drill", t.FOOTMAN, t.FOOTMAN, 4, 15),
        ("drill", t.CAVALRY, t.CAVALRY, 5, 19),
    ],
)
def test_a_blow_lies_within_its_formula(preset, attacker, target, low, high):
    blows = roll_blows(attacker, target, 4_000, preset=preset)
    assert (blows.min(), blows.max()) == (low, high)
    numbers = t.PRESETS[preset]
    middle = (numbers.damage_min[attacker] + numbers.damage_max[attacker]) / 2
    middle += numbers.piercing[attacker] - 0.12 * numbers.armour[target]
    middle *= (numbers.roll_low_percent + numbers.roll_high_percent) / 200
    assert blows.mean() == pytest.approx(middle - 0.5, abs=0.3)  # rounded down


def test_blades_and_plates_change_the_blows_of_soldiers_only():
    for kind, by_blades in ((t.FOOTMAN, 2), (t.ARCHER, 2), (t.PEASANT, 0)):
        skirmish, unit, other = face_off(kind, t.FOOTMAN, preset="drill")
        skirmish.world.clock[s.TICK] = 77
        means = []
        for blades, plates in ((0, 0), (1, 0), (0, 2)):
            skirmish.world.players[0, s.UPGRADES + t.BLADES] = blades
            skirmish.world.players[1, s.UPGRADES + t.PLATES] = plates
            rolls = []
            for tick in range(500):
                skirmish.world.clock[s.TICK] = tick
                rolls.append(call(combat.blow, skirmish.world, skirmish.rules, unit, other))
            means.append(np.mean(rolls))
        assert means[1] - means[0] == pytest.approx(by_blades, abs=0.1)
        assert means[0] - means[2] == pytest.approx(0.12 * 2 * 4, abs=0.1)


def test_the_dice_know_the_tick_and_the_unit_but_not_the_seat():
    skirmish = Skirmish(seed=3)
    units = [skirmish.put(player, t.FOOTMAN, 4 + 6 * player, 4) for player in (0, 1)]
    first, second = [], []
    for tick in range(200):
        skirmish.world.clock[s.TICK] = tick
        first.append(call(combat.blow, skirmish.world, skirmish.rules, *units))
        second.append(call(combat.blow, skirmish.world, skirmish.rules, *units[::-1]))
    assert skirmish.get(units[0], s.UNIT_SERIAL) == skirmish.get(units[1], s.UNIT_SERIAL)
    assert first == second
    assert len(set(first)) > 5


def test_damage_is_counted_up_to_the_health_that_was_left():
    skirmish, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    skirmish.put(1, t.PEASANT, 1, 1)
    skirmish.set(other, s.UNIT_HEALTH, 1)
    skirmish.attack(unit, other)
    skirmish.wait(2)
    assert not skirmish.is_alive(other)
    assert skirmish.world.players[:, s.DAMAGE_DONE].tolist() == [1, 0]
    assert skirmish.world.players[:, s.DAMAGE_TAKEN].tolist() == [0, 1]
