"""The random words: uniform, counted, and the same however many worlds there are."""

import numpy as np
import pytest
from scipy.stats import chisquare

from marl_cair.games.randomness import EpisodeSeeds, draw_below, episode_seeds, mix

NUM_DRAWS = 20_000
MASK = 2**64 - 1


def splitmix64(state: int) -> tuple[int, int]:
    """The published generator in plain integers: (next state, output)."""
    state = (state + 0x9E3779B97F4A7C15) & MASK
    word = state
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & MASK
    return state, word ^ (word >> 31)


def draw_many(limit: int, seed: int, count: int = NUM_DRAWS) -> np.ndarray:
    words = np.array([seed, 7], np.uint64)
    with np.errstate(over="ignore"):
        return np.array([draw_below(words, 0, limit) for _ in range(count)])


@pytest.mark.plain_python
def test_draws_are_the_published_generator_scaled_by_multiplication():
    state, expected = 42, []
    for _ in range(50):
        state, word = splitmix64(state)
        expected.append(((word >> 32) * 10) >> 32)
    assert draw_many(10, seed=42, count=50).tolist() == expected


def test_the_first_words_of_the_published_generator_from_0():
    """The outputs that Vigna's reference code prints from state 0."""
    words = [0x9E3779B97F4A7C15, 0x3C6EF372FE94F82A]
    with np.errstate(over="ignore"):
        outputs = [int(mix(np.uint64(word))) for word in words]
    assert outputs == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4]


@pytest.mark.parametrize("limit", [1, 2, 3, 10, 11, 17])
def test_draws_are_uniform_below_the_limit(limit):
    counts = np.bincount(draw_many(limit, seed=1), minlength=limit)
    assert len(counts) == limit
    assert limit == 1 or chisquare(counts).pvalue > 0.001


def test_pairs_of_draws_are_independent():
    draws = draw_many(5, seed=3)
    pairs = np.bincount(draws[:-1:2] * 5 + draws[1::2], minlength=25)
    assert chisquare(pairs).pvalue > 0.001


def test_a_draw_advances_only_its_own_word():
    words = np.array([1, 2], np.uint64)
    with np.errstate(over="ignore"):
        draw_below(words, 1, 6)
    assert words[0] == 1
    assert words[1] == 2 + 0x9E3779B97F4A7C15


def test_a_worlds_seed_does_not_depend_on_how_many_worlds_there_are():
    episodes = np.arange(10, dtype=np.int64) % 3
    many = episode_seeds(4, np.arange(10), episodes)
    for world in range(10):
        alone = episode_seeds(4, np.array([world]), episodes[[world]])
        assert alone.tolist() == [many[world]]
        assert alone.dtype == np.uint64


def test_seeds_worlds_and_episodes_never_share_a_game():
    worlds, episodes = (grid.ravel() for grid in np.meshgrid(np.arange(40), np.arange(40)))
    seeds = [episode_seeds(seed, worlds, episodes) for seed in (0, 1, 2, -1, 2**64 - 2)]
    assert len(np.unique(seeds)) == 5 * 1600


@pytest.mark.parametrize("seed", [0, 7, -3, 2**64 + 7, np.int64(7), np.uint64(2**63)])
def test_any_integer_is_a_seed(seed):
    worlds, episodes = np.arange(2), np.zeros(2, np.int64)
    expected = episode_seeds(int(seed) % 2**64, worlds, episodes)
    np.testing.assert_array_equal(episode_seeds(seed, worlds, episodes), expected)


def test_episodes_count_on_only_where_a_world_restarts():
    seeds = EpisodeSeeds(3, seed=1)
    first = seeds.next()
    second = seeds.next(np.array([True, False, True]))
    third = seeds.next()
    assert first.tolist() == episode_seeds(1, np.arange(3), np.zeros(3, np.int64)).tolist()
    assert second[1] == third[1]
    assert second[0] != third[0]
    assert seeds.episodes.tolist() == [3, 2, 3]


def test_episode_seeds_restart_at_episode_0_and_their_state_continues_elsewhere():
    seeds, other = EpisodeSeeds(2, seed=3), EpisodeSeeds(2, seed=8)
    first = seeds.next()
    seeds.restart(3)
    np.testing.assert_array_equal(seeds.next(np.array([True, False])), first)
    state = seeds.state_dict()
    expected = seeds.next()
    other.load_state_dict(state)
    np.testing.assert_array_equal(other.next(), expected)
    assert state["episodes"].tolist() == [1, 0]


def test_without_a_seed_every_run_is_another():
    assert EpisodeSeeds(1).seed != EpisodeSeeds(1).seed
