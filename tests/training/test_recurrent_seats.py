"""Recurrent agents in the seats of training: opponents, demonstrators, and the learner itself."""

import numpy as np
import pytest
import torch

from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.replay.transition import NO_ACTION
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import (
    DemonstrationSettings,
    OpponentSettings,
    TrainConfig,
)
from marl_cair.training.settings.learner import LearnerSettings
from tests.recurrent_agents import choose_in_turn, require_ticks
from tests.training.runs import by_game, small

pytestmark = pytest.mark.usefixtures("test_game")
AGENTS = {"counting": "tests.recurrent_agents:make_counting"}
NETWORK = {"network": "tests.recurrent_agents:make_recurrent"}


def make_config(folder, scenario, agents=AGENTS, **changes):
    share = {"latest": 0.3, **{name: 0.7 / len(agents) for name in agents}}
    opponent = OpponentSettings(share, agents=agents, snapshot_every_frames=128)
    return small(folder, scenario, opponent=opponent, **changes)


def collect(run, num_batches=6):
    """Data [B, T] of some batches; the run stays open."""
    batches = iter(run.collector)
    return torch.cat([next(batches) for _ in range(num_batches)], 1)


def counting(agent):
    """The `Counting` object of a foreign agent."""
    return agent._agent


# --- opponents -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["duel", "ffa-4", "teams"])
def test_an_opponent_begins_each_game_with_a_fresh_state(tmp_path, scenario):
    run = TrainingRun(make_config(tmp_path / "run", scenario))
    collect(run)
    (member,) = (kept for kept in run.book.pool.members if kept.name == "counting")
    agent = counting(run.book.pool.agent(member.number))
    assert require_ticks(agent) > 20
    assert max(steps.max() for steps, _ in agent.calls) > 2
    run.close()


@pytest.mark.slow
def test_a_resumed_run_continues_the_states_of_its_games(tmp_path):
    config = make_config(tmp_path / "run", "ffa-3")
    run = TrainingRun(config)
    collect(run, 3)
    run.save_state()
    held = run.router.export_state()["recurrent"]
    assert (held[0, ..., 0] > 1).any()
    run.close()
    run = TrainingRun(config, resume=True)
    assert torch.equal(run.router.export_state()["recurrent"], held)
    (member,) = (kept for kept in run.book.pool.members if kept.name == "counting")
    agent = counting(run.book.pool.agent(member.number))
    agent.calls.clear()
    collect(run, 3)
    assert agent.calls[0][0].max() > 0
    assert require_ticks(agent) > 20
    run.close()


@pytest.mark.parametrize("damage", ["shape", "dtype", "nan"])
def test_damaged_states_are_refused_and_older_runs_have_none(tmp_path, damage):
    run = TrainingRun(make_config(tmp_path / "run", "ffa-3"))
    collect(run, 1)
    state = run.router.export_state()
    held = state["recurrent"]
    broken = {"shape": held[:1], "dtype": held.double(), "nan": held * float("nan")}[damage]
    with pytest.raises(ValueError, match="recurrent "):
        run.router.import_state({**state, "recurrent": broken})
    del state["recurrent"]
    run.router.import_state(state)
    assert run.router.export_state()["recurrent"].shape == (2, *held.shape[1:-1], 0)
    run.close()


# --- demonstrators -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["duel", "ffa-3"])
@pytest.mark.parametrize("advise", [False, True])
@pytest.mark.parametrize("turn", [None, 2])
def test_a_demonstrator_counts_from_the_step_at_which_it_begins(tmp_path, scenario, advise, turn):
    """Beside an opponent that counts too."""
    shown = DemonstrationSettings(agents=AGENTS, share=0.5, advise=advise, turn_decisions=turn)
    run = TrainingRun(make_config(tmp_path / "run", scenario, demonstration=shown))
    data, steps = collect(run), set()
    run.close()
    for game in by_game(data):
        if game["player", "observation"][0, 0, 2].any():  # its first steps are not collected
            continue
        count = np.zeros(run.spec.num_players, np.int64)
        for step in game:
            group = step["player"]
            chosen, mask = group["expert_action"].numpy(), group["action_mask"].numpy()
            asked = chosen != NO_ACTION
            expected = choose_in_turn(count, mask)
            assert chosen[asked].tolist() == expected[asked].tolist()
            count = np.where(asked, count + 1, 0)
            steps |= set(count.tolist())
    assert steps >= {0, 1, 2, 3}


PQN = LearnerSettings(algorithm="pqn")

# --- the learner ---------------------------------------------------------------------------------


@pytest.fixture
def recurrent_policy():
    return QNetworkConfig(hidden_width=8, memory="lstm", memory_width=6)


def test_memory_without_replay_refuses_a_generator():
    with pytest.raises(ValueError, match="policy.memory is 'gru', which learns from sequences of"):
        TrainConfig(policy=QNetworkConfig(memory="gru"), learner=PQN)
    TrainConfig(policy=QNetworkConfig(memory="gru"))  # with replay it may have one


@pytest.mark.parametrize("demonstrated", [False, True])
@pytest.mark.parametrize("scenario", ["duel", "ffa-3", "teams"])
def test_the_states_of_the_learner_are_those_of_its_network_over_each_game(
    tmp_path, recurrent_policy, scenario, demonstrated
):
    """Also through games in which a demonstrator plays some of its steps."""
    turns = DemonstrationSettings(bots=("idle",), share=0.5, turn_decisions=2)
    changes = {"demonstration": turns} if demonstrated else {}
    config = make_config(tmp_path / "run", scenario, policy=recurrent_policy, **changes)
    run = TrainingRun(config)
    data, compared = collect(run), 0
    for game in by_game(data):
        seen = game["player", "observation"]
        first = game["player", "learned"][0]
        if seen[0, 0, 2].any():  # its first steps have not been collected
            continue
        starts = torch.zeros(len(seen), int(first.sum()), dtype=torch.bool)
        starts[0] = True
        with torch.no_grad():
            _, states = run.learner.network.unroll(
                seen[:, first], torch.ones(starts.shape[1], 12), starts
            )
        learned = game["player", "learned"][:, first]
        held = game["player", "state"][:, first]
        assert not held[0].any()
        going_on = learned[1:] & learned[:-1]
        torch.testing.assert_close(held[1:][going_on], states[:-1][going_on])
        compared += int(going_on.sum())
    assert compared > 30
    run.close()


@pytest.mark.slow
def test_a_recurrent_learner_resumes_within_its_games_with_the_same_bits(
    tmp_path, recurrent_policy
):
    demonstration = DemonstrationSettings(agents=AGENTS, share=0.3, turn_decisions=3, advise=True)
    changes = {"policy": recurrent_policy, "demonstration": demonstration}
    config = make_config(tmp_path / "run", "ffa-3", {**AGENTS, **NETWORK}, **changes)
    run = TrainingRun(config)
    collect(run, 2)
    run.save_state()
    wanted = collect(run, 3)
    run.close()
    run = TrainingRun(config, resume=True)
    found = collect(run, 3)
    run.close()
    for key in ("state", "action", "expert_action", "observation"):
        assert torch.equal(found["player", key], wanted["player", key])
    assert wanted["player", "state"].any()
