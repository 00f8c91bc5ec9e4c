"""Every representation through every door, as the libraries check them.

The libraries' own checks are asked of every scenario in every representation: minutes long, in
`make test-all`. That two doors show the same whole games is asked of each representation and each
number of players, and in `make test-all` of every scenario in one of its representations.
"""

import warnings
from functools import partial
from itertools import cycle, islice
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from torchrl.envs.utils import check_env_specs

from marl_cair.games import GAMES, make_engine
from marl_cair.games.parallel_env import GameParallelEnv, make_aec_env
from marl_cair.games.registry import gymnasium_id
from marl_cair.games.torchrl_env import BatchedGameEnv
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from tests.games import test_gymnasium_env, test_torchrl_env
from tests.games.bot_play import make_bot
from tests.games.cases import IN_PROCESS, Case, Luck, choose_actions, ticks_of

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # PettingZoo's own, of its example games
    from pettingzoo.test import (
        api_test,
        max_cycles_test,
        parallel_api_test,
        parallel_seed_test,
        render_test,
    )

NUM_CYCLES = 15


def representations_of(game, scenario):
    return GAMES[game].make_spec(GAMES[game].scenario(scenario)).representations


def list_quick(game):
    """The first scenario for each number of players, and every representation, dealt in turn."""
    first = {}
    for name, scenario in GAMES[game].scenarios.items():
        first.setdefault(GAMES[game].make_spec(scenario).num_players, name)
    shown = list(representations_of(game, next(iter(first.values()))))
    turns = zip(cycle(first.values()), cycle(shown), strict=False)
    return [(game, *turn) for turn in islice(turns, max(len(first), len(shown)))]


EVERYTHING = [
    (game, scenario, representation)
    for game in IN_PROCESS
    for scenario in GAMES[game].scenarios
    for representation in representations_of(game, scenario)
]
QUICK = [case for game in IN_PROCESS for case in list_quick(game)]
CASES = ("game", "scenario", "representation")
EVERY = pytest.mark.parametrize(CASES, EVERYTHING)
# Every scenario once: a game's scenarios take its representations in turn, so that each is met.
ONCE = [
    (game, scenario, shown[number % len(shown)])
    for game in IN_PROCESS
    for number, scenario in enumerate(GAMES[game].scenarios)
    for shown in [list(representations_of(game, scenario))]
]


def mark_slow(cases):
    """`cases`, and those of QUICK; all but these are slow."""
    return [
        pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow)
        for case in dict.fromkeys([*QUICK, *cases])
    ]


EVERY_SOME_QUICK = pytest.mark.parametrize(CASES, mark_slow(EVERYTHING))
EACH = pytest.mark.parametrize(CASES, mark_slow(ONCE))
NUMBERS = pytest.mark.parametrize(
    ("game", "scenario"),
    [
        pytest.param(*case, marks=() if case in {one[:2] for one in QUICK} else pytest.mark.slow)
        for case in dict.fromkeys(case[:2] for case in EVERYTHING)
    ],
)


def test_the_quick_cases_have_every_representation_and_number_of_players():
    def counts(cases):
        return {
            (game, GAMES[game].make_spec(GAMES[game].scenario(scenario)).num_players)
            for game, scenario, _ in cases
        }

    def shown(cases):
        return {(game, representation) for game, _, representation in cases}

    assert shown(QUICK) == shown(EVERYTHING)
    assert counts(QUICK) == counts(EVERYTHING)


# --- PettingZoo --------------------------------------------------------------------------------


@pytest.mark.slow
@EVERY
@pytest.mark.filterwarnings("ignore:Observation numpy array is all zeros")  # heat maps, at first
def test_pettingzoo_accepts(game, scenario, representation):
    def make():
        return GameParallelEnv(game, scenario, representation=representation)

    parallel_api_test(make(), num_cycles=NUM_CYCLES)
    parallel_seed_test(make, num_cycles=NUM_CYCLES)
    api_test(make_aec_env(game, scenario, representation=representation), num_cycles=NUM_CYCLES)


def with_seed(make, **options):
    """An environment of one game: in most others, too, nothing is won in four moves."""
    env = make(**options)
    env.action_space(env.possible_agents[0]).seed(0)  # the space of all
    env.reset = partial(env.reset, seed=5)
    return env


@EVERY_SOME_QUICK
def test_pettingzoo_finds_max_cycles_kept(game, scenario, representation):
    chosen = {"scenario": scenario, "representation": representation}
    max_cycles_test(
        SimpleNamespace(
            parallel_env=partial(with_seed, partial(GameParallelEnv, game), **chosen),
            env=partial(with_seed, partial(make_aec_env, game), **chosen),
        )
    )


@EVERY_SOME_QUICK
def test_pettingzoo_accepts_the_pictures(game, scenario, representation):
    def make(render_mode):
        # The test first makes a window, which it does not use; we have none.
        mode = None if render_mode == "human" else render_mode
        return make_aec_env(game, scenario, representation=representation, render_mode=mode)

    render_test(make)


# --- Gymnasium ---------------------------------------------------------------------------------


@pytest.mark.slow
@EVERY
def test_gymnasium_accepts(game, scenario, representation):
    name = gymnasium_id(GAMES[game].gymnasium_prefix, scenario)
    env = gymnasium.make(name, representation=representation)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.slow
@EACH
@pytest.mark.parametrize("mode", test_gymnasium_env.MODES)
def test_gymnasiums_vectors_equal_single_games(game, scenario, representation, mode):
    limit = ticks_of(game, test_gymnasium_env.MAX_DECISIONS, scenario)
    env_id = gymnasium_id(GAMES[game].gymnasium_prefix, scenario)
    options = {"max_ticks": limit, "representation": representation}
    assert test_gymnasium_env.play_both(env_id, mode, 3, **options) > 0


# --- TorchRL -----------------------------------------------------------------------------------


@pytest.mark.slow
@EVERY
def test_torchrl_accepts(game, scenario, representation):
    check_env_specs(BatchedGameEnv(game, scenario, 2, representation=representation), seed=0)


@EACH
def test_torchrls_own_and_its_wrapped_environment_show_the_same(game, scenario, representation):
    case = Case(game, scenario, (("representation", representation),))
    check_env_specs(test_torchrl_env.wrapped(case), seed=0)
    test_torchrl_env.test_the_specs_equal_the_wrapped_ones(case)
    test_torchrl_env.test_the_native_environment_equals_the_wrapped_one_for_a_whole_game(case)


# --- bounds ------------------------------------------------------------------------------------


def numbers_of(engine):
    """The representations that are numbers, each with bounds of its own."""
    shown = engine.spec.representations.values()
    return [representation for representation in shown if representation.dtype is np.float32]


def assert_inside(engine):
    for shown in numbers_of(engine):
        seen, (low, high) = engine.observe(shown.name), shown.bounds()
        for entry, name in enumerate(shown.plane_names):
            least, most = seen[..., entry].min(), seen[..., entry].max()
            assert low[entry] <= least, (name, least, low[entry])
            assert most <= high[entry], (name, most, high[entry])


def ask(engine, bot, seat):
    return bot.act(engine.observe(bot.representation)[:, seat], engine.action_mask()[:, seat])


@pytest.mark.slow
@NUMBERS
@pytest.mark.parametrize("players", ["luck", "bots"])
def test_numbers_lie_within_their_bounds_in_whole_games(game, scenario, players):
    engine = make_engine(game, scenario)
    engine.reset(1)
    num_decisions = min(400, engine.spec.max_ticks // engine.spec.ticks_per_step)
    luck = Luck.draw(num_decisions, 1, engine.num_players)
    names = cycle(name for name in engine.game.bots if name != "random")
    bots = [make_bot(engine, next(names)) for _ in range(engine.num_players)]
    for numbers in luck.numbers:
        assert_inside(engine)
        if players == "luck":
            engine.step(choose_actions(engine, numbers))
        else:
            engine.step(np.stack([ask(engine, bot, seat) for seat, bot in enumerate(bots)], 1))
    assert_inside(engine)


@NUMBERS
def test_a_network_takes_the_bounds_of_every_number(game, scenario):
    engine = make_engine(game, scenario)
    engine.reset(0)
    for shown in numbers_of(engine):
        config = QNetworkConfig(body="mlp").with_bounds(shown.low, shown.high)
        assert len(config.vector_low) == len(config.vector_high) == len(shown.plane_names)
        network = make_q_network(config, shown.shape, engine.num_actions, seed=0)
        seen = torch.from_numpy(engine.observe(shown.name)[0])
        scaled = (seen - network.middle) / network.reach
        assert scaled.abs().max() <= 1.0 + 1e-6
