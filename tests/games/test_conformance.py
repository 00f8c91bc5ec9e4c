"""Every scenario in every representation through every door: minutes long, in `make test-all`."""

import warnings

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env
from torchrl.envs.utils import check_env_specs

from marl_cair.games import GAMES
from marl_cair.games.parallel_env import make_aec_env, make_parallel_env
from marl_cair.games.registry import gymnasium_id
from marl_cair.games.torchrl_env import BatchedGameEnv

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # PettingZoo's own, of its example games
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]

EVERYTHING = [
    (game, scenario, representation)
    for game in GAMES
    for scenario in GAMES[game].scenarios
    for representation in GAMES[game].make_spec(GAMES[game].scenario(scenario)).representations
]
NUM_CYCLES = 15
EVERY = pytest.mark.parametrize(("game", "scenario", "representation"), EVERYTHING)


@EVERY
def test_pettingzoo_accepts(game, scenario, representation):
    def make():
        return make_parallel_env(game, scenario, representation=representation)

    parallel_api_test(make(), num_cycles=NUM_CYCLES)
    parallel_seed_test(make, num_cycles=NUM_CYCLES)
    api_test(make_aec_env(game, scenario, representation=representation), num_cycles=NUM_CYCLES)


@EVERY
def test_gymnasium_accepts(game, scenario, representation):
    name = gymnasium_id(GAMES[game].gymnasium_prefix, scenario)
    env = gymnasium.make(name, representation=representation)
    check_env(env.unwrapped, skip_render_check=True)


@EVERY
def test_torchrl_accepts(game, scenario, representation):
    check_env_specs(BatchedGameEnv(game, scenario, 2, representation=representation), seed=0)
