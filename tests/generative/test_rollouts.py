"""Multi-step generated transitions."""

import copy

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.rollouts import Rollouts, imagine_sequences
from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT, check_transitions
from tests.generative.conftest import SMALL
from tests.generative.plane_game import INTERVAL, NOOP, SPEC, TIME_TO_INCOME

CLOCK = SPEC.num_spatial + TIME_TO_INCOME
GAMMA = 0.5


def wait(observation, mask):
    """The no-op, always."""
    assert mask[:, NOOP].all()
    return torch.full((len(observation),), NOOP)


def add_one(observation, mask):
    """Always add 1."""
    return torch.ones(len(observation), dtype=torch.int64)


def read_clock(observation):
    """Steps until income, int64 [N]."""
    return (observation[:, CLOCK, 0, 0].double() * INTERVAL / 255).round().long()


class CountingGenerator(CCDNGenerator):
    """States are numbers; the action is added, and the reward is the sum. 9 ends the episode.
    Transitions from numbers of `unsure` are rejected.
    """

    unsure: tuple[int, ...] = ()

    def generate(self, starts: TensorDict, num_rows: int):
        """`num_rows` transitions from the starts, in turn."""
        rows, accepted = self.predict(starts[torch.arange(num_rows) % len(starts)])
        return rows[accepted]

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """The transitions of the starts."""
        now = starts["observation"][:, 0, 0, 0].long()
        rows = make_steps(now, starts["action"])
        return rows, torch.tensor([int(number) not in self.unsure for number in now])


def make_steps(now, action):
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
        (0, (), 4, 1 + 2 / 2 + 3 / 4 + 4 / 8, 4),  # three generated steps
        (7, (), 2, 8 + 9 / 2, 9),  # to the end of the episode
        (8, (), 1, 9.0, 9),  # ends at once
        (0, (2,), 2, 1 + 2 / 2, 2),  # to the first rejection
        (0, (1,), 1, 1.0, 1),
    ],
)
def test_rows_are_discounted_sums_up_to_the_end_or_to_a_rejection(start, unsure, steps, total, end):
    generator = CountingGenerator(SMALL, SPEC)
    generator.unsure = unsure
    others = torch.tensor([4, start, 8])  # rows are independent
    rows = make_steps(others, torch.ones(3, dtype=torch.int64))
    before = rows.clone()
    made = Rollouts(generator, add_one, 0, 4, GAMMA).extend(rows, 3)
    row = made[1]
    assert row["steps_to_next_obs"].tolist() == [steps]
    assert float(row["next", "reward"]) == total
    assert int(row["next", "observation"].amax()) == end
    assert bool(row["next", "terminated"]) is bool(row["next", "done"]) is (end == 9)
    for key in ("observation", "action", "action_mask"):
        assert torch.equal(made[key], before[key])


def climb(num_floors):
    """Replay with n_steps=4 of episodes from 0 to 9."""
    real = make_replay_buffer(ReplayConfig(200, n_steps=4, gamma=GAMMA), SPEC.transition)
    steps = make_steps(torch.arange(9).repeat(num_floors), torch.ones(9 * num_floors).long())
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
def test_real_steps_are_continued_and_earlier_ends_are_generated(num_real, num_generated):
    generator = CountingGenerator(SMALL, SPEC)
    generator.unsure = (6,)
    rollouts = Rollouts(generator, add_one, num_real, num_generated, GAMMA)
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
        assert set(starts.tolist()) == set(range(9)) - {6 - num_real}  # steps from 6 are rejected
        # As many end as of real rows: all that start within reach of the end.
        assert torch.equal(made["next", "terminated"].flatten(), starts >= 9 - 4)


def test_branches_are_one_step_rows_up_to_an_end_or_a_rejection():
    generator = CountingGenerator(SMALL, SPEC)
    generator.unsure = (6,)
    made = Rollouts(generator, add_one, 0, 1, GAMMA).branch(climb(20), 900, 3)
    assert (made["steps_to_next_obs"] == 1).all()
    now, later = (made[key].flatten(1).amax(1) for key in ("observation", ("next", "observation")))
    assert torch.equal(later, now + 1)
    assert torch.equal(made["next", "reward"].flatten(), later.float())
    assert torch.equal(made["next", "terminated"].flatten(), later == 9)
    counts = torch.bincount(now.long(), minlength=9)
    # Of nine equally frequent starts, steps from n are those of roll-outs from n - 2 to n.
    assert counts[6] == 0
    assert counts[7] < 0.6 * counts[5]  # nothing reaches 7 through 6
    assert len(made) < 900


@pytest.mark.slow
def test_a_trained_generator_continues_like_the_game(trained, real_rows):
    generator = copy.deepcopy(trained)
    rollouts = Rollouts(generator, wait, 0, 4, GAMMA)
    made = rollouts.extend(generator.generate(real_rows[:500], 300), 3)
    check_transitions(made, SPEC.transition)
    steps = made["steps_to_next_obs"].squeeze(1)
    assert int(steps.min()) >= 1
    assert int(steps.max()) == 4
    assert float(steps.float().mean()) > 2.0
    going_on = ~made["next", "terminated"].squeeze(1)
    before, after = read_clock(made["observation"]), read_clock(made["next", "observation"])
    wanted = (before - steps - 1) % INTERVAL + 1
    assert float((after == wanted)[going_on].float().mean()) > 0.95


NUM_ENTRIES = 8


def count_up(observations, state, starts):
    """A network with memory: its state counts the entries since the episode began, and it values
    the action 1 most while the count is below 3, else 2.
    """
    states = []
    for begins in starts:
        state = torch.where(begins[:, None], 0.0, state) + 1.0
        states.append(state)
    counts = torch.stack(states)
    values = torch.zeros(*starts.shape, SPEC.num_actions)
    values[..., 1] = (counts[..., 0] < 3).float()
    values[..., 2] = (counts[..., 0] >= 3).float()
    return values, counts


def make_sequences(numbers, starts):
    """Sequences of numbers [N][T], in which episodes start at the entries `starts` [N]."""
    shape = len(numbers), NUM_ENTRIES
    seen = torch.tensor(numbers, dtype=torch.uint8)[:, :, None, None, None]
    begins = torch.zeros(shape, dtype=torch.bool)
    begins[torch.arange(shape[0]), torch.tensor(starts)] = True
    learned = torch.ones(shape, dtype=torch.bool)
    learned[:, -1] = False
    return TensorDict(
        {
            "observation": seen.expand(*shape, *SPEC.observation_shape).clone(),
            "action_mask": torch.ones(*shape, SPEC.num_actions, dtype=torch.bool),
            "action": torch.zeros(shape, dtype=torch.int64),
            "reward": torch.full(shape, -1.0),
            "terminated": torch.zeros(shape, dtype=torch.bool),
            "starts": begins,
            "learned": learned,
            "expert_action": torch.ones(shape, dtype=torch.int64),
            "opponent": torch.ones(shape, dtype=torch.int16),
            "state": torch.zeros(*shape, 1),
            "is_generated": torch.zeros(shape, dtype=torch.bool),
            "index": torch.ones(shape, dtype=torch.int64),
        },
        shape,
    )


def test_sequences_end_in_generated_steps_whose_state_is_that_of_the_real_ones_before():
    generator = CountingGenerator(SMALL, SPEC)
    generator.unsure = (4,)
    rows = make_sequences([[0] * 8, [6] * 8, [0] * 8, [1] * 8], [3, 0, 2, 0])
    rows["learned"][3, 3] = False  # the tail of an episode: nothing follows it
    made = imagine_sequences(generator, count_up, rows, 4)
    assert len(made) == 3
    # Entry 3 is the first whose step is generated. The counts there are 1, 4 and 2.
    numbers = made["observation"][:, :, 0, 0, 0].tolist()
    assert numbers[0] == [0, 0, 0, 0, 1, 2, 4, 4]  # 1, 1, 2, and from 4 on it is unsure
    assert numbers[1] == [6, 6, 6, 6, 8, 10, 10, 10]  # 10 ends the episode
    assert numbers[2] == [0, 0, 0, 0, 1, 3, 5, 7]
    learned = made["learned"].tolist()
    assert [row.index(True) for row in learned] == [3, 3, 3]
    assert [sum(row) for row in learned] == [3, 2, 4]
    assert made["reward"][0, 3:6].tolist() == [1.0, 2.0, 4.0]
    assert made["reward"][1, 3:5].tolist() == [8.0, 10.0]
    assert (made["terminated"] & made["learned"]).nonzero().tolist() == [[1, 4]]
    assert not made["starts"][:, 4:].any()
    assert made["starts"][0, 3]
    assert made["is_generated"].all()
    assert (made["index"] == -1).all()
    assert (made["expert_action"] == NO_ACTION).all()
    assert (made["opponent"] == NO_OPPONENT).all()
    assert torch.equal(made["observation"][:, :4], rows["observation"][:3, :4])
    assert (rows["observation"][:, :, 0, 0, 0] == rows["observation"][:, :1, 0, 0, 0]).all()


def test_where_nothing_can_be_generated_there_are_no_sequences():
    generator = CountingGenerator(SMALL, SPEC)
    generator.unsure = (4,)
    rows = make_sequences([[4] * 8], [0])
    assert len(imagine_sequences(generator, count_up, rows, 7)) == 0
    rows["learned"].fill_(False)
    assert len(imagine_sequences(generator, count_up, rows, 7)) == 0
