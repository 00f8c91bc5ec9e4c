"""Quality numbers on boards that are small enough to count by hand."""

import pytest
import torch

from marl_cair.generative import quality
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.quality import Imagined, find_auc, find_calibration_error
from tests.generative.plane_game import ENEMY_UNITS, GOLD, NUM_SPATIAL, OWN_UNITS, SPEC

GOLD_PLANE = NUM_SPATIAL + GOLD


def make_walk():
    """One row: an own unit walks from (2, 1) to (2, 2), an enemy unit appears, gold is spent."""
    rows = make_empty_transitions(SPEC, 1)
    rows["observation"][0, OWN_UNITS, 2, 1] = 64
    rows["observation"][0, GOLD_PLANE] = 30
    rows["next", "observation"] = rows["observation"].clone()
    later = rows["next", "observation"]
    later[0, OWN_UNITS, 2, 1], later[0, OWN_UNITS, 2, 2] = 0, 64
    later[0, ENEMY_UNITS, 0, 6] = 64
    later[0, GOLD_PLANE] = 20
    return rows


def imagine_as(observation, rows):
    zeros = torch.zeros(len(rows))
    return Imagined(observation, rows["action_mask"], zeros, zeros, zeros)


def test_a_copy_has_no_changed_cells_and_the_truth_all():
    rows = make_walk()
    copied = quality.measure_rows(rows, imagine_as(rows["observation"], rows), SPEC)
    assert copied["cells/changed_f1"] == copied["cells/moved"] == copied["cells/exact"] == 0.0
    right = quality.measure_rows(rows, imagine_as(rows["next", "observation"], rows), SPEC)
    assert right["cells/changed_f1"] == right["cells/moved"] == right["cells/exact"] == 1.0
    plane = f"plane_{OWN_UNITS}/"
    assert right[f"{plane}copy_accuracy"] == copied[f"{plane}accuracy"] == pytest.approx(33 / 35)


def test_errors_of_a_constant_reward_are_shares_of_it():
    rows = make_empty_transitions(SPEC, 4)
    for constant, error in ((0.02, 0.05), (0.0, 0.2)):
        rows["next", "reward"][:] = constant
        made = imagine_as(rows["observation"], rows)._replace(
            reward=torch.full((4,), constant + 0.001)
        )
        found = quality.measure_rows(rows, made, SPEC)
        assert found["reward/constant_error"] == pytest.approx(error, abs=1e-4)


def test_half_of_a_move_counts_half():
    """It left its cell but did not arrive; the new enemy unit is no move."""
    rows = make_walk()
    guess = rows["next", "observation"].clone()
    guess[0, OWN_UNITS, 2, 2] = 0
    found = quality.measure_rows(rows, imagine_as(guess, rows), SPEC)
    assert found["cells/moved"] == 0.0
    assert found["cells/changed_f1"] == pytest.approx(2 * 2 / (3 + 2))
    guess[0, OWN_UNITS, 2, 2] = 50  # it arrived, but was not wounded in truth
    found = quality.measure_rows(rows, imagine_as(guess, rows), SPEC)
    assert (found["cells/moved"], found["cells/moved_exactly"]) == (1.0, 0.0)


def test_moves_that_are_claimed_in_vain_lower_the_precision():
    rows = make_walk()
    guess = rows["next", "observation"].clone()
    guess[0, OWN_UNITS, 1, 2] = guess[0, OWN_UNITS, 3, 2] = guess[0, OWN_UNITS, 3, 0] = 64
    found = quality.measure_rows(rows, imagine_as(guess, rows), SPEC)
    assert (found["cells/moved"], found["cells/moved_precision"]) == (1.0, 0.25)


@pytest.mark.parametrize(
    ("shares", "steps"), [([0.9, 0.7, 0.6, 0.5, 0.8], 4), ([0.5, 0.9], 0), ([0.7] * 5, 16)]
)
def test_roll_outs_are_as_long_as_all_their_steps_are_good(shares, steps):
    named = zip(quality.HORIZONS, shares, strict=False)
    numbers = {f"open_loop/{horizon}_changed_f1": share for horizon, share in named}
    assert quality.find_safe_steps(numbers, 0.6) == steps


def make_chain(num_steps):
    """A unit that walks right through row 2, and one that appears in row 0 at step 2."""
    rows = make_empty_transitions(SPEC, num_steps)
    for step in range(num_steps):
        for key, place in (("observation", step), (("next", "observation"), step + 1)):
            rows[key][step, OWN_UNITS, 2, place] = 64
            if place > 1:
                rows[key][step, OWN_UNITS, 0, place - 2] = 64
    for name, values in (("episode", 0), ("seat", 1), ("step", torch.arange(num_steps))):
        rows[name] = torch.zeros(num_steps, dtype=torch.int64) + values
    return rows


def test_chains_are_consecutive_steps_of_a_seat():
    rows = make_chain(6)
    rows = torch.cat([rows[4:], rows[:3]])  # step 3 is missing
    assert quality.find_chains(rows, 3, 10).tolist() == [[2, 3, 4]]
    assert quality.find_chains(rows, 2, 10).tolist() == [[2, 3], [3, 4], [0, 1]]
    assert quality.find_chains(rows, 5, 10).shape == (0, 5)


def test_open_loop_moves_are_those_of_units_that_were_there():
    rows = make_chain(4)

    def walk(seen):
        """Perfect for the unit in row 2; the other one is unknown."""
        guess = seen["observation"].clone()
        guess[:, OWN_UNITS] = 0
        guess[:, OWN_UNITS, 2, 1:] = seen["observation"][:, OWN_UNITS, 2, :-1]
        return imagine_as(guess, seen)

    found = quality.measure_open_loop(rows, quality.find_chains(rows, 4, 1), walk, SPEC)
    assert found["open_loop/1_exact"] == 1.0
    assert found["open_loop/4_exact"] == 0.0
    assert found["open_loop/4_moved"] == 1.0
    assert found["open_loop/2_changed_f1"] == pytest.approx(2 * 2 / (3 + 2))


def test_vectors_have_an_error_beside_that_of_a_copy():
    rows = make_empty_transitions(SPEC, 2)
    now, later = torch.zeros(2, 3), torch.ones(2, 3)
    rows["observation"], rows["next", "observation"] = now, later
    found = quality.measure_rows(rows, imagine_as(torch.full((2, 3), 0.75), rows), SPEC)
    assert found["vector/error_of_copy"] == pytest.approx(0.25)
    assert found["cells/exact"] == 0.0


@pytest.mark.parametrize(
    ("scores", "labels", "expected"),
    [
        ([0.1, 0.2, 0.9], [False, False, True], 1.0),
        ([0.9, 0.2, 0.1], [False, False, True], 0.0),
        ([0.5, 0.5], [False, True], 0.5),
        ([0.5], [True], None),
    ],
)
def test_auc(scores, labels, expected):
    assert find_auc(torch.tensor(scores), torch.tensor(labels)) == expected


def test_calibration_error_is_the_gap_between_odds_and_frequency():
    odds = torch.tensor([0.25] * 4 + [0.9] * 2)
    labels = torch.tensor([True, False, False, False, False, False])
    assert find_calibration_error(odds, labels) == pytest.approx(2 * 0.9 / 6)
