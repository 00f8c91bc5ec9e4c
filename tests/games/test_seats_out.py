"""Seats that are out while others continue, in TorchRL and Gymnasium; teams and points.

The expected values come from TorchRL's own wrapper of the PettingZoo environment, which has dead
agents.
"""

import numpy as np
import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import PettingZooWrapper, RewardSum, TransformedEnv
from torchrl.envs.utils import check_env_specs
from torchrl.modules import RandomPolicy

from marl_cair.games.game import NO_WINNER
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.torchrl_env import DONE_KEYS, GROUP, BatchedGameEnv
from marl_cair.league.play.standings import share_points
from tests.games import last_standing
from tests.games.last_standing import FINISH, GAME, LEAVE, NAME, NOOP, SCORE


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    last_standing.register(monkeypatch)


def make_env(scenario="ffa-3", num_worlds=1, **options):
    return BatchedGameEnv(NAME, scenario, num_worlds, seed=0, **options)


def act(env, state, actions):
    """One decision [B, P]; returns what the step stored, and the state to go on from."""
    return env.step_and_maybe_reset(state.copy().set((GROUP, "action"), torch.tensor(actions)))


def flags(stored, key):
    return stored["next", GROUP, key].squeeze(-1).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("scenario", GAME.scenarios)
def test_torchrl_accepts_games_that_seats_leave(scenario):
    torch.manual_seed(0)
    check_env_specs(make_env(scenario, 3), seed=0)


def test_a_seat_is_terminated_from_the_step_at_which_it_goes_out_and_the_world_goes_on():
    env = make_env()
    stored, state = act(env, env.reset(), [[NOOP, LEAVE, NOOP]])
    assert flags(stored, "terminated") == [[False, True, False]]
    assert flags(stored, "done") == [[False, True, False]]
    assert flags(stored, "truncated") == [[False] * 3]
    assert not any(stored["next", key].any() for key in DONE_KEYS)
    assert stored["next", GROUP, "reward"].squeeze(-1).tolist() == [[0.0, -1.0, 0.0]]
    assert state[GROUP, "done"].squeeze(-1).tolist() == [[False, True, False]]
    stored, _ = act(env, state, [[NOOP, NOOP, NOOP]])
    assert flags(stored, "terminated") == [[False, True, False]]
    assert stored["next", GROUP, "reward"].squeeze(-1).tolist() == [[0.0] * 3]


def test_the_root_is_done_when_the_last_one_has_won_and_the_next_game_is_for_all():
    env = make_env()
    _, state = act(env, env.reset(), [[NOOP, LEAVE, NOOP]])
    stored, state = act(env, state, [[LEAVE, NOOP, NOOP]])
    assert stored["next", "terminated"].item()
    assert flags(stored, "terminated") == [[True] * 3]
    assert stored["next", GROUP, "reward"].squeeze(-1).tolist() == [[-1.0, 0.0, 1.0]]
    assert not state[GROUP, "done"].any()
    assert env.seeds.episodes.tolist() == [2]


def test_a_team_mate_that_has_left_is_not_out():
    env = make_env("teams")
    stored, state = act(env, env.reset(), [[LEAVE, NOOP, NOOP, NOOP]])
    assert flags(stored, "done") == [[False] * 4]
    assert not state[GROUP, "action_mask"][0, 0, 1:].any()


def test_another_worlds_end_resets_that_world_alone():
    """TorchRL writes a reset flag for seats too, which must not restart the world they left."""
    env = make_env(num_worlds=2)
    _, state = act(env, env.reset(), [[NOOP, LEAVE, NOOP], [NOOP, NOOP, NOOP]])
    seen = state[GROUP, "observation"][0].clone()
    stored, state = act(env, state, [[NOOP] * 3, [FINISH, NOOP, NOOP]])
    assert stored["next", "done"].squeeze(-1).tolist() == [False, True]
    assert env.seeds.episodes.tolist() == [1, 2]
    assert state[GROUP, "done"].squeeze(-1).tolist() == [[False, True, False], [False] * 3]
    assert (state[GROUP, "observation"][0, :, 2] == seen[:, 2] + 1).all()
    assert torch.equal(state[GROUP, "observation"], torch.from_numpy(env.engine.observe("planes")))


def test_torchrls_collector_plays_games_to_their_end():
    """With random play some seats go out early in each batch, and no world is reset for that."""
    torch.manual_seed(0)
    env = make_env("ffa-4", 8)
    policy = RandomPolicy(env.full_action_spec[GROUP, "action"], action_key=(GROUP, "action"))
    collector = Collector(env, policy, frames_per_batch=8 * 40, total_frames=8 * 40)
    (data,) = iter(collector)
    out = data["next", GROUP, "terminated"].squeeze(-1)
    ended = data["next", "done"].squeeze(-1)
    assert (out.any(-1) & ~ended).any()
    tick = data[GROUP, "observation"][:, :, 0, 2, 0, 0].int()
    followed = ~ended[:, :-1]
    assert (tick[:, 1:] == tick[:, :-1] + 1)[followed].all()
    assert (tick[:, 1:] == 0)[~followed].all()
    before = data[GROUP, "done"].squeeze(-1)
    assert torch.equal(before[:, 1:][followed], out[:, :-1][followed])
    collector.shutdown()


def test_torchrls_reward_sum_counts_each_seats_last_reward_once():
    env = TransformedEnv(make_env(), RewardSum(reset_keys=["_reset"]))
    _, state = act(env, env.reset(), [[NOOP, LEAVE, NOOP]])
    stored, _ = act(env, state, [[LEAVE, NOOP, NOOP]])
    totals = stored["next", GROUP, "episode_reward"].squeeze(-1)
    assert totals.tolist() == [[-1.0, -1.0, 1.0]]


@pytest.mark.parametrize("scenario", ["ffa-4", "teams", "uneven", "alone"])
def test_what_live_seats_get_equals_torchrls_wrapper_with_dead_agents(scenario):
    """Of a seat that has left before, the wrapper shows zeros and says that it is truncated too."""
    native, luck = make_env(scenario), np.random.default_rng(1)
    wrapper = PettingZooWrapper(
        GameParallelEnv(NAME, scenario), use_mask=True, done_on_any=False, categorical_actions=True
    )
    native.set_seed(6)
    own, reference = native.reset(), wrapper.reset(seed=6)
    num_out = 0
    for _ in range(12):
        live = reference[GROUP, "mask"]
        legal = own[GROUP, "action_mask"][0].numpy()
        legal[:, FINISH] = False
        actions = torch.from_numpy(np.argmax(luck.random(legal.shape) * legal, axis=1))
        own, reference = (
            env.step(seen.copy().set((GROUP, "action"), chosen))["next"]
            for env, seen, chosen in ((native, own, actions[None]), (wrapper, reference, actions))
        )
        for key in ("observation", "reward", "done", "terminated", "truncated"):
            assert torch.equal(own[GROUP, key][0][live], reference[GROUP, key][live]), key
        for key in DONE_KEYS:
            assert torch.equal(own[key][0], reference[key]), key
        assert own[GROUP, "done"].squeeze().tolist() == reference[GROUP, "done"].squeeze().tolist()
        num_out += int(own[GROUP, "done"].sum())
        if own["done"].any():
            break
    assert num_out > 0


def test_a_saved_game_remembers_who_is_out():
    env, other = make_env(), make_env()
    act(env, env.reset(), [[NOOP, LEAVE, NOOP]])
    other.load_game_state(env.game_state())
    assert other.current()[GROUP, "done"].squeeze(-1).tolist() == [[False, True, False]]


# --- Gymnasium ---------------------------------------------------------------------------------


def test_a_gymnasium_game_ends_when_the_learners_seat_is_out():
    env = GameEnv(NAME, "ffa-4", opponent="idle", seat=2)
    env.reset(seed=0)
    assert env.step(np.int64(NOOP))[1:4] == (0.0, False, False)
    assert env.step(np.int64(LEAVE))[1:4] == (-1.0, True, False)
    assert not env.engine.terminated.any()


def test_a_gymnasium_vector_resets_a_world_that_the_learners_seat_has_left():
    env = GameVectorEnv(NAME, "ffa-4", num_envs=2, opponent="idle", seat=1)
    env.reset(seed=0)
    _, rewards, terminated, *_ = env.step(np.array([LEAVE, NOOP]))
    assert (rewards.tolist(), terminated.tolist()) == ([-1.0, 0.0], [True, False])
    seen, _, terminated, *_ = env.step(np.array([NOOP, NOOP]))
    assert not terminated.any()
    assert seen[:, 2, 0, 0].tolist() == [0, 2]


# --- teams and points ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "teams", "num_teams"),
    [
        ("ffa-3", [0, 1, 2], 3),
        ("teams", [0, 1, 1, 0], 2),
        ("uneven", [0, 1, 1, 0, 2, 1], 3),
        ("alone", [0], 1),
        ("together", [0, 0], 1),
    ],
)
def test_teams_are_numbered_by_their_first_seats(scenario, teams, num_teams):
    spec = GAME.make_spec(GAME.scenario(scenario))
    assert spec.team_of_seat.tolist() == teams
    assert spec.num_teams == num_teams


@pytest.mark.parametrize(
    ("winner", "was_out", "teams", "points"),
    [
        (1, [0, 0], [0, 1], [0.0, 1.0]),
        (NO_WINNER, [0, 0], [0, 1], [0.5, 0.5]),
        (2, [0, 0, 0, 0], [0, 1, 2, 0], [0.0, 0.0, 1.0]),
        (3, [1, 0, 0, 0], [0, 1, 1, 0], [1.0, 0.0]),
        (NO_WINNER, [0, 1, 0, 0], [0, 1, 2, 3], [1 / 3, 0.0, 1 / 3, 1 / 3]),
        (NO_WINNER, [1, 0, 0, 0], [0, 1, 1, 0], [0.5, 0.5]),
        (NO_WINNER, [1, 0, 0, 1], [0, 1, 1, 0], [0.0, 1.0]),
    ],
)
def test_a_win_is_a_point_and_a_draw_is_shared_by_the_teams_that_are_left(
    winner, was_out, teams, points
):
    outcome = np.array([winner], np.int8), np.array([was_out], np.bool_)
    assert share_points(*outcome, np.array(teams))[0].tolist() == pytest.approx(points)


def test_the_score_of_a_seat_is_what_the_map_seed_gave_it():
    env = make_env("alone")
    stored, _ = act(env, env.reset(), [[SCORE]])
    gain = env.engine.public_state(0)[3]
    assert stored["next", GROUP, "reward"].item() == pytest.approx(gain / 100)
