"""Action selection: masks, exploration probabilities, random streams, networks as agents."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.policies.actor import (
    CHUNK_ROWS,
    MaskedEpsilonGreedy,
    MaskedSampling,
    PolicyActor,
    masked_argmax,
)
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

NAN, INF = float("nan"), float("inf")
GROUPS = [7, 3, 3, 3, 9, 9]  # six actions in three groups, in no order and with gaps


def all_legal(num_rows: int, num_actions: int) -> torch.Tensor:
    return torch.ones(num_rows, num_actions, dtype=torch.bool)


def make_actor(**settings_) -> PolicyActor:
    network = make_q_network(QNetworkConfig(), (3, 10, 15), 6, seed=0)
    return PolicyActor(network, "student", "planes", MaskedEpsilonGreedy(1, GROUPS), **settings_)


def random_batch(num_rows: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(0)
    observation = generator.integers(0, 256, (num_rows, 3, 10, 15), dtype=np.uint8)
    mask = generator.random((num_rows, 6)) < 0.5
    mask[:, 0] = True
    return observation, mask


value = st.one_of(st.floats(-3, 3, width=32), st.sampled_from([NAN, INF, -INF]))


@pytest.mark.slow
@given(
    st.integers(1, 8).flatmap(
        lambda n: st.tuples(
            st.lists(value, min_size=n, max_size=n),
            st.lists(st.booleans(), min_size=n, max_size=n).filter(any),
        )
    )
)
@settings(max_examples=200, deadline=None)
def test_argmax_is_legal_and_largest_and_lowest_among_equals(row):
    values, mask = row
    chosen = masked_argmax(torch.tensor([values]), torch.tensor([mask])).item()
    lowest = torch.finfo(torch.float32).min
    ranks = [max(lowest, -INF if math.isnan(v) else v) for v in values]
    legal = [index for index, allowed in enumerate(mask) if allowed]
    assert chosen == max(legal, key=lambda index: (ranks[index], -index))


def test_an_illegal_action_never_wins_even_against_nothing_but_nan():
    values = torch.tensor([[INF, NAN, NAN], [9.0, -INF, -INF], [NAN, NAN, -5.0]])
    mask = torch.tensor([[False, True, True], [False, False, True], [False, True, True]])
    assert masked_argmax(values, mask).tolist() == [1, 2, 2]


def test_a_row_without_legal_actions_is_named():
    mask = torch.tensor([[True, False], [False, False]])
    with pytest.raises(ValueError, match="row 1 of the action mask allows no action: the no-op"):
        masked_argmax(torch.zeros(2, 2), mask)


def test_a_mask_of_another_shape_or_dtype_is_refused():
    with pytest.raises(ValueError, match=r"the mask has shape \(2, 3\).*pass a bool mask of the"):
        masked_argmax(torch.zeros(2, 2), all_legal(2, 3))
    with pytest.raises(ValueError, match=r"dtype torch.float32.*pass a bool mask"):
        masked_argmax(torch.zeros(2, 2), torch.ones(2, 2))


def frequencies(mask: list[bool], groups: list[int] | None, epsilon: float = 1.0) -> torch.Tensor:
    num_rows = 60_000
    values = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).expand(num_rows, 6)
    explore = MaskedEpsilonGreedy(3, groups)
    actions = explore(values, torch.tensor(mask).expand(num_rows, 6), epsilon)
    return torch.bincount(actions, minlength=6) / num_rows


def assert_frequencies(found: torch.Tensor, expected: list[float]) -> None:
    wanted = torch.tensor(expected)
    assert torch.equal(found > 0, wanted > 0)
    torch.testing.assert_close(found, wanted, rtol=0.0, atol=0.01)  # 5 standard deviations


def test_exploration_draws_legal_groups_alike_then_their_legal_actions():
    assert_frequencies(frequencies([True] * 6, GROUPS), [1 / 3, 1 / 9, 1 / 9, 1 / 9, 1 / 6, 1 / 6])
    legal = [True, False, True, True, False, False]
    assert_frequencies(frequencies(legal, GROUPS), [1 / 2, 0, 1 / 4, 1 / 4, 0, 0])


def test_exploration_without_groups_draws_legal_actions_alike():
    legal = [True, False, True, True, False, False]
    assert_frequencies(frequencies(legal, None), [1 / 3, 0, 1 / 3, 1 / 3, 0, 0])


def test_epsilon_is_the_share_of_exploring_rows():
    found = frequencies([True] * 6, GROUPS, epsilon=0.3)
    assert_frequencies(found, [0.1, 1 / 30, 1 / 30, 1 / 30, 0.05, 0.75])


@given(seed=st.integers(0, 2**31), num_actions=st.integers(1, 40), grouped=st.booleans())
@settings(max_examples=60, deadline=None)
def test_exploration_is_always_legal(seed, num_actions, grouped):
    generator = torch.Generator().manual_seed(seed)
    mask = torch.rand(64, num_actions, generator=generator) < 0.2
    mask[torch.arange(64), torch.randint(num_actions, (64,), generator=generator)] = True
    groups = torch.randint(5, (num_actions,), generator=generator) if grouped else None
    actions = MaskedEpsilonGreedy(seed, groups)(torch.zeros(64, num_actions), mask, 1.0)
    assert mask[torch.arange(64), actions].all()


def test_each_row_has_an_epsilon_of_its_own():
    num_rows = 400
    values = torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]).expand(num_rows, 6)
    epsilon = (torch.arange(num_rows) % 2).float()
    mask = torch.tensor([True, False, True, True, True, True]).expand(num_rows, 6)
    actions = MaskedEpsilonGreedy(0)(values, mask, epsilon)
    assert (actions[0::2] == 0).all()
    assert 120 < (actions[1::2] != 0).sum() < 190  # expected 160, standard deviation 5.7


def test_the_stream_depends_on_seed_and_number_of_rows_and_continues_from_its_state():
    values, mask = torch.zeros(50, 6), all_legal(50, 6)
    before = torch.get_rng_state()
    first, second = MaskedEpsilonGreedy(5, GROUPS), MaskedEpsilonGreedy(5, GROUPS)
    first(values, mask, 0.0)
    second(values + 1.0, mask, 1.0)
    state = first.state_dict()
    actions = first(values, mask, 1.0)
    assert torch.equal(actions, second(values, mask, 1.0))
    restored = MaskedEpsilonGreedy(99, GROUPS)
    restored.load_state_dict(state)
    assert torch.equal(restored(values, mask, 1.0), actions)
    restored.seed(5)
    restored(values, mask, 0.0)
    assert torch.equal(restored(values, mask, 1.0), actions)
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("epsilon", [-0.1, 1.1, NAN, torch.tensor([0.5, 2.0])])
def test_an_epsilon_that_is_no_probability_is_refused(epsilon):
    with pytest.raises(ValueError, match=r"but a probability must lie in 0\.\.1"):
        MaskedEpsilonGreedy(0)(torch.zeros(2, 6), all_legal(2, 6), epsilon)


def test_an_epsilon_or_groups_of_another_length_are_refused():
    with pytest.raises(ValueError, match=r"epsilon has shape \(3,\), but must be a number or one"):
        MaskedEpsilonGreedy(0)(torch.zeros(2, 6), all_legal(2, 6), torch.zeros(3))
    with pytest.raises(ValueError, match="action_groups has 6 entries, but there are 5 actions"):
        MaskedEpsilonGreedy(0, GROUPS)(torch.zeros(2, 5), all_legal(2, 5), 0.0)


@pytest.mark.parametrize("groups", [[0.5, 1.0], [[0, 1]], np.zeros(0, dtype=np.int16)])
def test_groups_that_are_no_integers_per_action_are_refused(groups):
    with pytest.raises(ValueError, match="must be one integer for each action"):
        MaskedEpsilonGreedy(0, groups)


def test_an_actor_plays_the_best_legal_action_of_its_network():
    actor = make_actor()
    observation, mask = random_batch(40)
    actions = actor.act(observation, mask)
    values = actor.network(torch.from_numpy(observation))
    assert actions.dtype == np.int64
    assert actions.tolist() == masked_argmax(values, torch.from_numpy(mask)).tolist()
    without = PolicyActor(actor.network, "student", "planes")
    assert without.act(observation, mask).tolist() == actions.tolist()


@pytest.mark.parametrize("num_rows", [0, 1, CHUNK_ROWS, CHUNK_ROWS + 1, 2 * CHUNK_ROWS + 30])
def test_chunks_do_not_change_the_values(num_rows):
    observation = torch.from_numpy(random_batch(num_rows)[0])
    actor = make_actor()
    values = actor.compute_values(observation)
    assert values.shape == (num_rows, 6)
    torch.testing.assert_close(values, actor.network(observation).detach())


def test_values_carry_no_gradient_but_can_be_used_in_training():
    values = make_actor().compute_values(torch.from_numpy(random_batch(4)[0]))
    assert not values.requires_grad
    assert not values.is_inference()
    values += 1.0


def test_an_actor_takes_the_masks_of_pettingzoo_and_as_many_as_observations():
    actor, (observation, mask) = make_actor(), random_batch(3)
    numbers = mask.astype(np.int8)
    assert (actor.act(observation, numbers) == actor.act(observation, mask)).all()
    np.testing.assert_array_equal(
        actor.values(observation, numbers), actor.values(observation, mask)
    )
    with pytest.raises(ValueError, match=r"the mask has shape \(1, 6\).*\(3, 6\)"):
        actor.values(observation, mask[:1])
    with pytest.raises(ValueError, match=r"the mask has shape \(6,\)"):
        actor.values(observation, mask[0])


def test_an_actor_takes_read_only_arrays_as_they_are():
    observation, mask = random_batch(4)
    expected = make_actor().act(observation, mask)
    observation.flags.writeable = mask.flags.writeable = False
    assert make_actor().act(observation, mask).tolist() == expected.tolist()


def test_an_actor_reproduces_its_exploration_from_seed_and_state():
    actor = make_actor(epsilon=1.0)
    observation, mask = random_batch(60)
    actor.seed(4)
    first = actor.act(observation, mask).tolist()
    state = actor.state_dict()
    second = actor.act(observation, mask).tolist()
    actor.seed(4)
    assert actor.act(observation, mask).tolist() == first != second
    actor.load_state_dict(state)
    assert actor.act(observation, mask).tolist() == second


def test_an_epsilon_for_one_call_overrides_the_actors_own():
    observation, mask = (torch.from_numpy(array) for array in random_batch(60))
    actor = make_actor(epsilon=1.0)
    greedy = make_actor().select_actions(observation, mask)
    assert torch.equal(actor.select_actions(observation, mask, epsilon=0.0), greedy)
    assert not torch.equal(actor.select_actions(observation, mask), greedy)


class TestSampling:
    """`MaskedSampling`: softmax over the legal values."""

    def test_actions_have_the_probabilities_of_the_softmax_over_legal_values(self):
        values = torch.tensor([[1.0, 5.0, 0.0, -1.0]]).expand(20_000, -1)
        mask = torch.tensor([[True, False, True, True]]).expand(20_000, -1)
        counts = MaskedSampling(3)(values, mask, 0.0).bincount(minlength=4) / 20_000
        expected = torch.tensor([1.0, -torch.inf, 0.0, -1.0]).softmax(0)
        assert counts[1] == 0
        assert (counts - expected).abs().max() < 0.02

    def test_an_agent_that_samples_reports_these_probabilities(self):
        network = make_q_network(QNetworkConfig(), (3, 10, 15), 6, seed=0)
        agent = PolicyActor(network, "student", "planes", MaskedSampling(3))
        observation, mask = (one[:1].repeat(4_000, 0) for one in random_batch(1))
        reported = agent.values(observation[:1], mask[:1])[0]
        assert np.isneginf(reported[~mask[0]]).all()
        counts = np.bincount(agent.act(observation, mask), minlength=6) / 4_000
        assert np.abs(counts - reported)[mask[0]].max() < 0.03
        assert reported[mask[0]].sum() == pytest.approx(1.0)

    def test_an_illegal_action_is_never_sampled(self):
        values = torch.tensor([[1e30, -1e30, 80.0, 1e30]]).expand(500, -1)
        mask = torch.tensor([[False, True, False, False]]).expand(500, -1)
        assert (MaskedSampling(0)(values, mask, 0.0) == 1).all()
        for strange in (torch.nan, torch.inf, -torch.inf):
            values = torch.tensor([[5.0, strange, 2.0]]).expand(500, -1)
            mask = torch.tensor([[False, True, True]]).expand(500, -1)
            assert (MaskedSampling(0)(values, mask, 0.0) != 0).all()
        with pytest.raises(ValueError, match="row 0 of the action mask allows no action"):
            MaskedSampling(0)(values, torch.zeros_like(mask), 0.0)

    def test_a_saved_stream_continues(self):
        sampling, values = MaskedSampling(0), torch.zeros(50, 4)
        mask = torch.ones(50, 4, dtype=torch.bool)
        sampling(values, mask, 0.5)
        again = MaskedSampling(9)
        again.load_state_dict(sampling.state_dict())
        assert torch.equal(sampling(values, mask, 0.5), again(values, mask, 0.5))


def test_no_rows_with_an_action_at_each_cell_give_no_actions():
    values, mask = torch.zeros(0, 2, 3, 4), torch.ones(0, 2, 3, 4, dtype=torch.bool)
    assert MaskedEpsilonGreedy(0)(values, mask, 0.5).shape == (0, 2, 3)
