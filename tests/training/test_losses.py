"""Losses of Q-learning: TorchRL's numbers, Q(lambda) returns, and runs without replay."""

import dataclasses
from copy import deepcopy

import numpy as np
import pytest
import torch
from torchrl.data import Categorical
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

from marl_cair.checkpoint import load_tensors
from marl_cair.games.torchrl_env import GROUP
from marl_cair.league.agents.load import load_agent
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training import losses
from marl_cair.training.learner import DivergedError
from marl_cair.training.newest_steps import DoubleValues, iterate_batches, make_rows
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import GeneratorSettings
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.settings.learner import LearnerSettings, NfspSettings
from tests.replay.streams import make_transitions
from tests.training import runs

PQN = LearnerSettings(algorithm="pqn", optimizer="radam", minibatches=2)
SPEC = TransitionSpec((2, 8, 8), 5)


def make_batch(num_rows=32):
    rng = np.random.default_rng(1)
    batch = make_transitions(rng, num_rows, SPEC)
    batch["steps_to_next_obs"] = torch.from_numpy(rng.integers(1, 4, (num_rows, 1)))
    return batch


@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("measure", ["smooth_l1", "l2"])
@pytest.mark.parametrize("is_weighted", [True, False])
def test_dqn_has_the_numbers_of_torchrl(double, measure, is_weighted):
    networks = [
        make_q_network(QNetworkConfig(hidden_width=8), (2, 8, 8), 5, seed) for seed in (0, 1)
    ]
    batch = make_batch()
    if is_weighted:
        batch["priority_weight"] = torch.linspace(0.1, 1.0, len(batch))
    actor = QValueActor(
        deepcopy(networks[0]),
        in_keys=["observation"],
        spec=Categorical(5, dtype=torch.int64),
        action_mask_key="action_mask",
    )
    theirs = DQNLoss(
        actor,
        loss_function=measure,
        delay_value=True,
        double_dqn=double,
        action_space="categorical",
    )
    theirs.make_value_estimator(gamma=0.9)
    SoftUpdate(theirs, tau=0.01)  # else it warns
    for name, weight in networks[1].state_dict().items():
        theirs.target_value_network_params["module", "0", "module", *name.split(".")].data.copy_(
            weight
        )
    settings = LearnerSettings(gamma=0.9, double=double, loss=measure)
    own = losses.DqnLoss(settings)(*networks, batch)
    expected = theirs(batch)["loss"]
    torch.testing.assert_close(own.loss, expected)
    torch.testing.assert_close(own.td_error.square(), batch["td_error"].flatten())
    own.loss.backward()
    expected.backward()
    for name, weight in networks[0].named_parameters():
        wanted = theirs.value_network_params["module", "0", "module", *name.split(".")].grad
        torch.testing.assert_close(weight.grad, wanted)


def test_lambda_returns_are_the_weighted_mean_of_all_longer_returns():
    rng = np.random.default_rng(0)
    steps, streams, gamma, q_lambda = 9, 40, 0.9, 0.7
    reward, best = rng.normal(size=(2, steps, streams))
    terminated = rng.random((steps, streams)) < 0.15
    is_end = terminated | (rng.random((steps, streams)) < 0.15)
    found = losses.find_lambda_returns(
        *(torch.from_numpy(array) for array in (reward, best, terminated, is_end)), gamma, q_lambda
    )
    for stream in range(streams):
        for start in range(steps):
            expected, weight, total = 0.0, 1.0, 0.0
            for step in range(start, steps):
                total += gamma ** (step - start) * reward[step, stream]
                ahead = 0.0 if terminated[step, stream] else best[step, stream]
                n_step = total + gamma ** (step - start + 1) * ahead
                if is_end[step, stream] or step == steps - 1:
                    expected += weight * n_step
                    break
                expected += weight * (1 - q_lambda) * n_step
                weight *= q_lambda
            assert found[start, stream] == pytest.approx(expected, abs=1e-9)


def make_noise(network):
    """Make the newest weights others than the averaged ones, which have collected."""
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weight in network.parameters():
            weight.add_(0.02 * torch.randn(weight.shape, generator=generator))


@pytest.mark.parametrize(
    ("q_lambda", "traces", "gap"),
    [(0.0, "peng", 0.0), (0.9, "peng", 0.0), (0.9, "watkins", 0.0), (0.9, "watkins", 0.7)],
)
def test_targets_of_a_run_are_those_of_its_games(tmp_path, q_lambda, traces, gap):
    settings = dataclasses.replace(PQN, q_lambda=q_lambda, traces=traces, gamma=0.9, action_gap=gap)
    run = TrainingRun(runs.tiny(tmp_path / "run", learner=settings))
    data = next(iter(run.collector))
    make_noise(run.learner.network)
    rows = make_rows(data, DoubleValues(run.actor, run.newest), settings)
    following = data["next", GROUP]
    seen, mask = following["observation"].flatten(0, 2), following["action_mask"].flatten(0, 2)
    action = losses.mask_values(run.actor.compute_values(seen), mask).argmax(-1, keepdim=True)
    best = run.newest.compute_values(seen).gather(-1, action).view(data[GROUP, "learned"].shape)
    best = best.masked_fill(following["terminated"].squeeze(-1), 0.0)
    reward = following["reward"].squeeze(-1)
    found, learned = {}, data[GROUP, "learned"]
    ends = following["done"].squeeze(-1)
    values = run.actor.compute_values(data[GROUP, "observation"].flatten(0, 2))
    values = losses.mask_values(values, data[GROUP, "action_mask"].flatten(0, 2))
    explored = data[GROUP, "action"].flatten() != values.argmax(-1)
    explored = explored.view(learned.shape)
    found_explored = data[GROUP, "action"] != data[GROUP, "best_action"]
    assert torch.equal(found_explored[learned], explored[learned])
    own = run.newest.compute_values(data[GROUP, "observation"].flatten(0, 2))
    best_now, taken = (
        own.gather(-1, data[GROUP, name].view(-1, 1)).view(learned.shape)
        for name in ("best_action", "action")
    )
    lost = gap * (best_now - taken).clamp(min=0.0)
    assert (lost[learned] > 0).any() == (gap > 0)
    for world, step, seat in learned.nonzero().tolist():
        rest, place = None, (world, step, seat)
        is_last = step == data.shape[1] - 1 or bool(ends[place])
        if not is_last and learned[world, step + 1, seat]:
            is_cut = traces == "watkins" and explored[world, step + 1, seat]
            rest = None if is_cut else (world, step + 1, seat)
        found[place] = (float(reward[place]), float(best[place]), rest)

    def find_return(place):
        gain, ahead, rest = found[place]
        longer = ahead if rest is None else find_return(rest)
        return gain + 0.9 * (q_lambda * longer + (1 - q_lambda) * ahead)

    by_time = sorted(found, key=lambda place: (place[1], place[0], place[2]))
    expected = torch.tensor([find_return(place) - float(lost[place]) for place in by_time])
    torch.testing.assert_close(rows["target"], expected, atol=1e-5, rtol=1e-4)
    chosen = torch.stack([data[GROUP, "action"][place] for place in by_time])
    assert torch.equal(rows["action"], chosen)


@pytest.mark.parametrize(
    ("name", "value", "default"),
    [
        ("action_gap", 0.7, 0.0),
        ("q_lambda", 0.5, 0.9),
        ("traces", "peng", "watkins"),
        ("epochs", 4, 2),
        ("minibatches", 8, 4),
    ],
)
def test_a_setting_of_pqn_without_it_is_refused(name, value, default):
    refusal = f"learner.{name} is '?{value}'?.*{default} with learner.algorithm=dqn"
    with pytest.raises(ValueError, match=refusal):
        LearnerSettings(**{name: value})


def test_generated_transitions_join_with_their_share(tmp_path):
    run = TrainingRun(runs.tiny(tmp_path / "run", learner=PQN))
    rows = make_rows(next(iter(run.collector)), DoubleValues(run.actor, run.newest), PQN)
    kept = TransitionSpec(run.seen.shape, run.spec.num_actions)
    run.replay.generated.extend(make_transitions(np.random.default_rng(0), 64, kept))

    double = DoubleValues(run.actor, run.newest)
    given = rows, PQN, double, run.replay.sample_generated

    def list_batches():
        return list(iterate_batches(*given, run.shuffling))

    assert sum(int(batch["is_generated"].sum()) for batch in list_batches()) == 0
    run.replay.generated_open = True
    batches = list_batches()
    assert len(batches) == PQN.epochs * PQN.minibatches
    assert sum(len(batch) - int(batch["is_generated"].sum()) for batch in batches) == 2 * len(rows)
    for batch in batches:
        assert float(batch["is_generated"].float().mean()) == pytest.approx(0.2, abs=0.01)
        assert torch.isfinite(batch["target"]).all()


def test_a_run_without_replay_resumes_to_the_same_bits(tmp_path):
    runs.train_whole_and_in_parts(
        tmp_path, lambda folder: runs.tiny(folder, 768, learner=PQN), until=384
    )


def recurrent(folder, frames=768, memory="lstm"):
    policy = QNetworkConfig(hidden_width=16, memory=memory, memory_width=8, norm="layer")
    settings = dataclasses.replace(PQN, q_lambda=0.0, gamma=0.9)
    none = GeneratorSettings("none")
    return runs.tiny(folder, frames, learner=settings, policy=policy, generator=none)


@pytest.mark.parametrize("memory", ["lstm", "gru"])
def test_targets_of_a_network_with_memory_continue_its_states(tmp_path, memory):
    run = TrainingRun(recurrent(tmp_path / "run", memory=memory))
    batches = iter(run.collector)
    first = next(batches).clone()
    second = next(batches)
    make_noise(run.learner.network)
    rows = make_rows(first, DoubleValues(run.actor, run.newest), run.config.learner)
    learned = first[GROUP, "learned"]
    streams = learned.transpose(0, 1).flatten(1).any(0).nonzero().squeeze(1)
    assert rows.shape == (len(streams), first.shape[1])
    ends = first["next", GROUP, "done"].squeeze(-1)
    compared = 0
    for row, stream in enumerate(streams.tolist()):
        world, seat = divmod(stream, learned.shape[2])
        for step in range(first.shape[1]):
            place = (world, step, seat)
            if not learned[place]:
                continue
            assert bool(rows["starts"][row, step]) == (
                step > 0 and bool(ends[world, step - 1, seat])
            )
            later = first if step + 1 < first.shape[1] else second
            after = (world, (step + 1) % first.shape[1], seat)
            if not ends[place] and later[GROUP, "learned"][after]:
                expected = float(first["next", GROUP, "reward"][place])
                seen, kept = (later[GROUP, name][after][None] for name in ("observation", "state"))
                values = run.newest.step(seen, kept)[0][0]
                expected += 0.9 * float(values[later[GROUP, "best_action"][after]])
                assert float(rows["target"][row, step]) == pytest.approx(expected, abs=1e-5)
                compared += step + 1 == first.shape[1]
    assert compared > 8
    result = run.learner.loss(run.learner.network, run.learner.target, rows)
    state, values = rows["state"][:, 0], []
    for step in range(first.shape[1]):  # one step after another, as it has played
        state = state.masked_fill(rows["starts"][:, step, None], 0.0)
        value, state = run.learner.network(rows["observation"][:, step], state)
        values.append(value)
    torch.testing.assert_close(result.values, torch.stack(values, 1))
    chosen = torch.stack(values, 1).gather(-1, rows["action"].unsqueeze(-1)).squeeze(-1)
    error = (rows["target"] - chosen)[rows["learned"]]
    torch.testing.assert_close(
        result.loss, torch.nn.functional.smooth_l1_loss(error, torch.zeros_like(error))
    )
    run.close()


@pytest.mark.slow  # one at each cell of a board, quick: test_action_shapes
def test_a_recurrent_run_resumes_to_the_same_bits(tmp_path):
    whole, _ = runs.train_whole_and_in_parts(tmp_path, recurrent, until=384)
    assert load_agent(whole / "latest").state_size == 16


def test_settings_that_need_a_replay_buffer_are_refused(tmp_path):
    for changes in (
        {"demonstration": DemonstrationSettings(bots=("counter",))},
        {"nfsp": NfspSettings(enabled=True)},
    ):
        with pytest.raises(ValueError, match=r"learner\.algorithm is 'pqn'"):
            runs.tiny(tmp_path, learner=PQN, **changes)


def test_a_run_whose_loss_is_not_finite_stops_and_saves_the_batch(tmp_path, monkeypatch):
    run = TrainingRun(runs.tiny(tmp_path / "run"))
    steps = runs.fill_replays(run)
    before = deepcopy(run.learner.network.state_dict())
    sample = run.replay.sample

    def sample_damaged():
        batch = sample()
        batch["next", "reward"][3] = torch.nan
        return batch

    monkeypatch.setattr(run.replay, "sample", sample_damaged)
    with pytest.raises(DivergedError, match="loss nan.*diverged_batch.pt"):
        next(steps)
    saved = load_tensors(tmp_path / "run" / "diverged_batch.pt")
    assert torch.isnan(saved["next.reward"][3]).all()
    for name, weight in run.learner.network.state_dict().items():
        assert torch.equal(weight, before[name])
    run.close()
