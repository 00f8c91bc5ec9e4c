"""Damage of a blow: the formula of each preset, armour, upgrades, statistics."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import combat
from tests.games.deep_rts.skirmish import Skirmish, call, face_off


def roll_blows(game: Skirmish, unit: int, target: int, num_blows: int = 4_000) -> np.ndarray:
    blows = np.zeros(num_blows, int)
    for tick in range(num_blows):
        game.world.clock[s.TICK] = tick
        blows[tick] = call(combat.blow, game.world, game.rules, unit, target)
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
        (t.PEASANT, t.FARM, 8.4, None, None),
        (t.FOOTMAN, t.FARM, 10.9, None, None),
        (t.ARCHER, t.FARM, 10.2, None, None),
    ],
)
def test_blows_in_the_original_equal_the_measured_ones(attacker, target, mean, low, high):
    """Measured in 200,000 rolls of the original; here its highest share can be rolled exactly."""
    blows = roll_blows(*face_off(attacker, target, preset="original"))
    assert blows.mean() == pytest.approx(mean, abs=0.3)
    if low is not None:
        assert low <= blows.min() <= low + 1
        assert high - 1 <= blows.max() <= high + 1


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
def test_blow_lies_within_its_formula(preset, attacker, target, low, high):
    blows = roll_blows(*face_off(attacker, target, preset=preset))
    assert (blows.min(), blows.max()) == (low, high)
    numbers = t.PRESETS[preset]
    middle = (numbers.damage_min[attacker] + numbers.damage_max[attacker]) / 2
    middle += numbers.piercing[attacker] - 0.12 * numbers.armour[target]
    middle *= (numbers.roll_low_percent + numbers.roll_high_percent) / 200
    assert blows.mean() == pytest.approx(middle - 0.5, abs=0.3)  # rounded down


@pytest.mark.parametrize(("kind", "by_blades"), [(t.FOOTMAN, 2), (t.ARCHER, 2), (t.PEASANT, 0)])
def test_blades_and_plates_change_blows_of_soldiers_only(kind, by_blades):
    game, unit, other = face_off(kind, t.FOOTMAN, preset="drill")
    means = []
    for blades, plates in ((0, 0), (1, 0), (0, 2)):
        game.world.players[0, s.UPGRADES + t.BLADES] = blades
        game.world.players[1, s.UPGRADES + t.PLATES] = plates
        means.append(roll_blows(game, unit, other, 500).mean())
    assert means[1] - means[0] == pytest.approx(by_blades, abs=0.1)
    assert means[0] - means[2] == pytest.approx(0.12 * 2 * 4, abs=0.1)


def test_dice_depend_on_tick_and_unit_but_not_on_seat():
    game = Skirmish(seed=3)
    units = [game.put(player, t.FOOTMAN, 4 + 6 * player, 4) for player in (0, 1)]
    first = roll_blows(game, *units, 200).tolist()
    assert game.get(units[0], s.UNIT_SERIAL) == game.get(units[1], s.UNIT_SERIAL)
    assert first == roll_blows(game, *units[::-1], 200).tolist()
    assert len(set(first)) > 5
