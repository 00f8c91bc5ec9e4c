"""Action masks of the generator: learned from, and judged by, real next states."""

import torch


def test_masks_are_judged_by_the_next_state_that_is_given(trained, real_rows):
    rows, others = real_rows[:32].clone(), torch.zeros(32, 0, dtype=torch.int64)
    following, _, outcome = trained.average.decode(rows, others, None)
    rows["next", "observation"] = following
    same = trained.average.judge(rows, others)
    torch.testing.assert_close(same.mask, outcome.mask)
    rows["next", "observation"] = following.flip(-1)
    assert not torch.allclose(trained.average.judge(rows, others).mask, outcome.mask)


def test_masks_are_learned_from_real_next_states_alone(trained, real_rows):
    rows, heads = real_rows[:8], trained.network.outcome
    judged = trained.network.judge(rows, torch.zeros(8, 0, dtype=torch.int64))
    wrong = judged._replace(mask=judged.mask.clone())
    wrong.mask[::2] = -9.0
    real = slice(1, None, 2)
    losses = [heads.compute_losses(one, rows, 0.0, real)["mask"] for one in (judged, wrong)]
    assert float(losses[0]) == float(losses[1])
    assert float(heads.compute_losses(wrong, rows, 0.0)["mask"]) > 10.0 * float(losses[0])
    first = judged._make(part[:1] for part in judged)
    assert float(heads.compute_losses(first, rows[:1], 0.0, real)["mask"]) == 0.0
