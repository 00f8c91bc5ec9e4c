"""Multi-step generated transitions."""

import copy

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative import CCDNGenerator
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.rollouts import Rollouts
from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT, check_transitions
from tests.generative.plane_game import INTERVAL, NOOP, SPEC, TIME_TO_INCOME

CLOCK = SPEC.num_spatial + TIME_TO_INCOME
GAMMA, ROUNDS = 0.5, 4


def wait(observation, mask):
    """The no-op, always."""
    assert mask[:, NOOP].all()
    return torch.full((len(observation),), NOOP)


def go_up(observation, mask):
    """One stair."""
    return torch.ones(len(observation), dtype=torch.int64)


def read_clock(observation):
    """Steps until income, int64 [N]."""
    return (observation[:, CLOCK, 0, 0].double() * INTERVAL / 255).round().long()


class Staircase(CCDNGenerator):
    """Its states are numbers that go up by the action; each step pays the number reached. 9 is the
    end, and it does not answer for what follows on a number of `unsure`.
    """

    unsure: tuple[int, ...] = ()

    def generate(self, starts: TensorDict, num_rows: int):
        """One step up from as many of the starts."""
        rows, accepted = self.predict(starts[torch.arange(num_rows) % len(starts)])
        return rows[accepted]

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """One step up, by hand."""
        now = starts["observation"][:, 0, 0, 0].long()
        rows = make_stairs(now, starts["action"])
        return rows, torch.tensor([int(number) not in self.unsure for number in now])


def make_stairs(now, action):
    rows = make_empty_transitions(SPEC, len(now))
    reached = now + action
    rows["observation"][:] = now[:, None, None, None]
    rows["next", "observation"][:] = reached[:, None, None, None]
    rows["action"], rows["action_mask"][:] = action, True
    rows["next", "action_mask"][:] = True
    rows["next", "reward"] = reached[:, None].float()
    rows["next", "terminated"] = rows["next", "done"] = (reached >= 9)[:, None]
    return rows


@pytest.mark.parametrize(
    ("start", "unsure", "steps", "total", "end"),
    [
        (0, (), 4, 1 + 2 / 2 + 3 / 4 + 4 / 8, 4),  # three more, as asked for
        (7, (), 2, 8 + 9 / 2, 9),  # to the end of the game
        (8, (), 1, 9.0, 9),  # over at once
        (0, (2,), 2, 1 + 2 / 2, 2),  # as far as it is sure
        (0, (1,), 1, 1.0, 1),
    ],
)
def test_rows_are_discounted_sums_up_to_the_end_or_to_what_is_unsure(
    trained, start, unsure, steps, total, end
):
    stairs = Staircase(trained.config, SPEC)
    stairs.unsure = unsure
    others = torch.tensor([4, start, 8])  # each row goes its own way
    rows = make_stairs(others, torch.ones(3, dtype=torch.int64))
    before = rows.clone()
    made = Rollouts(stairs, go_up, 0, 4, GAMMA, ROUNDS).extend(rows, 3)
    row = made[1]
    assert row["steps_to_next_obs"].tolist() == [steps]
    assert float(row["next", "reward"]) == total
    assert int(row["next", "observation"].amax()) == end
    assert bool(row["next", "terminated"]) is bool(row["next", "done"]) is (end == 9)
    for key in ("observation", "action", "action_mask"):
        assert torch.equal(made[key], before[key])


def climb(num_floors):
    """Replay of returns of four steps that holds games from 0 up to the 9th stair."""
    real = make_replay_buffer(ReplayConfig(200, n_steps=4, gamma=GAMMA), SPEC.transition)
    steps = make_stairs(torch.arange(9).repeat(num_floors), torch.ones(9 * num_floors).long())
    ends = steps["next", "terminated"].flatten()
    final = ends.nonzero().flatten()
    no = torch.zeros(len(steps), 1, dtype=torch.bool)
    real.extend_rollout(
        Rollout(
            observation=steps["observation"][:, None],
            action_mask=steps["action_mask"][:, None],
            action=steps["action"][:, None],
            reward=steps["next", "reward"],
            terminated=ends[:, None],
            truncated=no,
            learned=~no,
            expert_action=torch.full((len(steps), 1), NO_ACTION),
            opponent=torch.full((len(steps), 1), NO_OPPONENT, dtype=torch.int16),
            final_step=final,
            final_observation=steps["next", "observation"][final],
            final_action_mask=steps["next", "action_mask"][final],
        )
    )
    return real


@pytest.mark.parametrize(("num_real", "num_generated"), [(3, 1), (2, 2), (0, 4)])
def test_real_steps_are_gone_on_with_and_ends_are_generated_where_they_come_sooner(
    trained, num_real, num_generated
):
    stairs = Staircase(trained.config, SPEC)
    stairs.unsure = (6,)
    rollouts = Rollouts(stairs, go_up, num_real, num_generated, GAMMA, ROUNDS)
    made = rollouts.generate(climb(20), 300)
    assert 200 < len(made) <= 300
    for row in made:
        start, steps = int(row["observation"].amax()), int(row["steps_to_next_obs"])
        rewards = [start + 1 + step for step in range(steps)]
        assert float(row["next", "reward"]) == pytest.approx(
            sum(GAMMA**step * reward for step, reward in enumerate(rewards))
        )
        assert int(row["next", "observation"].amax()) == start + steps
        assert bool(row["next", "terminated"]) == (start + steps == 9)
    lengths = made["steps_to_next_obs"].flatten()
    starts = made["observation"].flatten(1).amax(1)
    assert int(lengths.max()) == 4
    if num_real:
        assert set(starts.tolist()) == set(range(9)) - {6 - num_real}  # nothing is sure on 6
        # As many end as of real rows: all that begin no further away than they reach.
        assert torch.equal(made["next", "terminated"].flatten(), starts >= 9 - 4)


def test_a_trained_generator_goes_on_as_the_game_does(trained, real_rows):
    generator = copy.deepcopy(trained)
    rollouts = Rollouts(generator, wait, 0, 4, GAMMA, ROUNDS)
    made = rollouts.extend(generator.generate(real_rows[:500], 300), 3)
    check_transitions(made, SPEC.transition)
    steps = made["steps_to_next_obs"].squeeze(1)
    assert 1 <= int(steps.min()) < int(steps.max()) <= 4
    assert float(steps.float().mean()) > 2.0
    going_on = ~made["next", "terminated"].squeeze(1)
    before, after = read_clock(made["observation"]), read_clock(made["next", "observation"])
    wanted = (before - steps - 1) % INTERVAL + 1
    assert float((after == wanted)[going_on].float().mean()) > 0.95


def test_predictions_are_of_the_actions_that_are_given(trained, real_rows):
    generator = copy.deepcopy(trained)
    starts = real_rows[:300].select("observation", "action_mask", "action")
    rows, accepted = generator.predict(starts)
    check_transitions(rows[accepted], SPEC.transition)
    for key in ("observation", "action_mask", "action"):
        assert torch.equal(rows[key], starts[key])
    assert 0.3 < float(accepted.float().mean()) < 1.0
