"""Deep Q-learning with memory: stored states replay exactly, losses, resumed runs, refusals."""

from copy import deepcopy

import pytest
import torch

from marl_cair.games.torchrl_env import GROUP
from marl_cair.league.agents.load import load_agent
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.training import trainer
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.collecting.rollout import by_time, make_rollout
from marl_cair.training.learner import Learner
from marl_cair.training.losses import DqnLoss, mask_values
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import (
    CollectorSettings,
    DemonstrationSettings,
    GeneratorSettings,
    ReplaySettings,
    TrainConfig,
)
from marl_cair.training.settings.learner import LOSSES, LearnerSettings, NfspSettings
from tests.training import runs

NONE = GeneratorSettings("none")
BURN_IN, STEPS = 3, 8


def recurrent(folder, frames=768, memory="lstm", priority_alpha=0.0, min_steps=300, **changes):
    replay = {"sequence_steps": STEPS, "burn_in_steps": BURN_IN, "priority_alpha": priority_alpha}
    settings = {
        "policy": QNetworkConfig(hidden_width=16, memory=memory, memory_width=6),
        "generator": NONE,
        "replay": ReplaySettings(3_000, 300, min_transitions=min_steps, **replay),
        "learner": LearnerSettings(batch_size=32, n_steps=3, gamma=0.9),
        **changes,
    }
    return runs.tiny(folder, frames, **settings)


@pytest.mark.slow
@pytest.mark.parametrize("memory", ["lstm", "gru"])
def test_sequences_are_what_was_collected_and_their_states_replay(tmp_path, memory):
    run = TrainingRun(recurrent(tmp_path / "run", memory=memory))
    batches, data, places = iter(run.collector), [], {}
    for _ in range(8):
        data.append(next(batches).clone())
        learned = by_time(data[-1][GROUP, "learned"])
        slots = run.replay.real.extend_rollout(make_rollout(data[-1], 1.0))
        begin = learned.shape[0] * (len(data) - 1)
        for slot, (step, stream) in zip(slots.tolist(), learned.nonzero().tolist(), strict=True):
            places[slot] = (begin + step, stream)
    run.close()
    game = torch.cat(data, 1)
    held = {
        name: by_time(game[GROUP, name])
        for name in ("observation", "action_mask", "action", "state", "expert_action", "opponent")
    }
    held["reward"] = by_time(game["next", GROUP, "reward"]).squeeze(-1)
    held["terminated"] = by_time(game["next", GROUP, "terminated"]).squeeze(-1)
    storage = run.replay.real.storage
    slots = storage.sampleable_slots()
    slots = torch.tensor([slot for slot in slots.tolist() if slot in places])  # no ends of episodes
    batch, compared = storage.get(slots), 0
    with torch.no_grad():
        _, states = run.learner.network.unroll(
            batch["observation"].transpose(0, 1), batch["state"][:, 0], batch["starts"].T
        )
    for row, slot in enumerate(slots.tolist()):
        first, stream = places[slot]
        is_first = bool(batch["starts"][row, BURN_IN]) and storage._ring.state_row[slot] == -1
        before, offset = None, BURN_IN if is_first else 0
        assert torch.equal(batch["state"][row, 0], held["state"][first, stream])
        step = first
        for entry in range(offset, offset + STEPS):
            if held["action"].shape[0] <= step:
                break
            is_tail = before is not None and bool(game_ends(game, step - 1, stream)) and before
            if is_tail:  # the final observation takes an entry
                assert not batch["learned"][row, entry]
                before = False
                continue
            if not bool(batch["learned"][row, entry]) and entry >= BURN_IN:
                break
            for name in ("observation", "action_mask", "action", "reward", "terminated"):
                assert torch.equal(batch[name][row, entry], held[name][step, stream]), name
            if step + 1 < len(held["state"]) and not game_ends(game, step, stream):
                after = held["state"][step + 1, stream]
                torch.testing.assert_close(states[entry, row], after, rtol=1e-5, atol=1e-6)
                compared += 1
            before, step = True, step + 1
    assert compared > 200


def game_ends(game, step, stream):
    """Whether the seat's episode ends with the step, counted over all batches."""
    players = game[GROUP, "action"].shape[-1]
    return bool(game["next", GROUP, "done"][stream // players, step, stream % players, 0])


def fill(folder, **changes):
    """A run with enough steps to learn from, that has not learned yet."""
    run = TrainingRun(recurrent(folder, min_steps=2_900, **changes))
    steps = trainer.iterate(run, Timers())
    while run.replay.real.num_sampleable < 600:
        next(steps)
    run.close()
    return run


@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("priority_alpha", [0.0, 0.5])
def test_the_loss_is_that_of_one_step_after_another(tmp_path, double, priority_alpha):
    settings = LearnerSettings(batch_size=32, n_steps=3, gamma=0.9, double=double)
    run = fill(tmp_path / "run", learner=settings, priority_alpha=priority_alpha)
    network = run.learner.network
    target = make_q_network(network.config, network.observation_shape, network.num_actions, 7)
    batch = run.replay.sample()
    assert batch.shape == (4, BURN_IN + STEPS + 1)
    result = DqnLoss(settings)(network, target, batch)

    def unroll(one):
        state, values = batch["state"][:, 0], []
        for entry in range(batch.shape[1]):
            state = state.masked_fill(batch["starts"][:, entry, None], 0.0)
            value, state = one(batch["observation"][:, entry], state)
            state = state.detach() if entry < BURN_IN else state  # no gradient through the burn-in
            values.append(value)
        return torch.stack(values, 1)

    values, rated = unroll(network), unroll(target)
    chooser = mask_values(values if double else rated, batch["action_mask"]).argmax(-1)
    losses, weights = [], []
    for row, entry in batch["learned"].nonzero().tolist():
        total, last = 0.0, entry
        for step in range(3):
            total += 0.9**step * float(batch["reward"][row, entry + step])
            last = entry + step
            if not batch["learned"][row, last + 1]:
                break
        if not batch["terminated"][row, last]:
            ahead = rated[row, last + 1, chooser[row, last + 1]]
            total += 0.9 ** (last + 1 - entry) * float(ahead.detach())
        chosen = values[row, entry, batch["action"][row, entry]]
        assert float(result.td_error[row, entry]) == pytest.approx(
            total - float(chosen.detach()), abs=1e-5
        )
        losses.append(torch.nn.functional.smooth_l1_loss(chosen, torch.tensor(total)))
        weight = batch["priority_weight"][row, entry] if priority_alpha else torch.tensor(1.0)
        weights.append(weight)
    weights = torch.stack(weights)
    expected = (torch.stack(losses) * weights).sum() / weights.sum()
    torch.testing.assert_close(result.loss, expected)
    wanted = torch.autograd.grad(expected, list(network.parameters()))
    found = torch.autograd.grad(result.loss, list(network.parameters()))
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("priority_alpha", [pytest.param(0.0, marks=pytest.mark.slow), 0.6])
def test_td_errors_fall(tmp_path, priority_alpha):
    run = fill(tmp_path / "run", priority_alpha=priority_alpha)
    # Targets that stay: neither the target network nor the chosen actions change.
    still = LearnerSettings(
        n_steps=3, learning_rate=3e-3, double=False, target="hard", target_every_updates=999
    )
    learner, storage = Learner(run.learner.network, still), run.replay.real.storage
    whole = storage.get(storage.sampleable_slots())

    def measure():
        with torch.no_grad():
            found = learner.loss(learner.network, learner.target, whole)
        return float(found.td_error.abs()[whole["learned"]].mean())

    before = measure()
    for number in range(80):
        batch = run.replay.sample()
        learner.update(batch)
        run.replay.note_errors(batch, number / 80)
    assert measure() < 0.4 * before


@pytest.mark.slow
@pytest.mark.parametrize("priority_alpha", [0.0, 0.6])
def test_a_run_resumes_to_the_same_bits(tmp_path, priority_alpha):
    whole, _ = runs.train_whole_and_in_parts(
        tmp_path, lambda folder: recurrent(folder, priority_alpha=priority_alpha), until=512
    )
    assert load_agent(whole / "latest").state_size == 12


def test_demonstrations_count_where_steps_are_learned(tmp_path):
    shown = DemonstrationSettings(bots=("counter",), share=1.0)
    run = fill(tmp_path / "run", demonstration=shown)
    batch = run.replay.sample()
    other = deepcopy(batch)
    other["expert_action"] = batch["expert_action"].masked_fill(~batch["learned"], -1)
    assert not torch.equal(other["expert_action"], batch["expert_action"])
    found = [deepcopy(run.learner).update(one)["loss/margin"] for one in (batch, other)]
    assert float(found[0]) > 0.0
    assert torch.equal(*found)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"generator": GeneratorSettings(), "learner": LearnerSettings(algorithm="pqn")},
            "without replay no generated one has a state: set generator=none, or policy.mem",
        ),
        (
            {"generator": GeneratorSettings(), "learner": LearnerSettings(batch_size=16)},
            "learner.batch_size is 16, it must be so large that some of its 2 sequences are gene",
        ),
        ({"nfsp": NfspSettings(enabled=True)}, "NFSP's reservoir holds single steps: set nfsp"),
        (
            {"learner": LearnerSettings(batch_size=30)},
            "learner.batch_size is 30, it must be a multiple of replay.sequence_steps, which is 8",
        ),
        (
            {"replay": ReplaySettings(1_000, min_transitions=100)},
            r"capacity_transitions is 1000, it must be 1600 or more, for the sequences of 32 seats",
        ),
    ],
)
def test_what_does_not_fit_a_memory_is_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        recurrent(tmp_path, **changes)


def test_a_buffer_that_holds_no_whole_row_is_refused():
    replay, many = ReplaySettings(5_000, min_transitions=100), CollectorSettings(num_worlds=2_560)
    with pytest.raises(ValueError, match="transitions is 5000, it must be 10240 or more: "):
        TrainConfig(replay=replay, collector=many)


def test_a_loss_of_single_transitions_is_refused_with_a_memory(monkeypatch):
    monkeypatch.setattr(LOSSES["dqn"], "READS_SEQUENCES", False)
    with pytest.raises(ValueError, match="this loss reads single transitions: set learner.algor"):
        TrainConfig(policy=QNetworkConfig(memory="gru"), generator=NONE)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sequence_steps": 1}, "replay.sequence_steps is 1, it must be 2 or more"),
        ({"burn_in_steps": -1}, "replay.burn_in_steps is -1"),
        ({"burn_in_steps": 16}, "burn_in_steps is 16, it must be below replay.sequence_steps"),
    ],
)
def test_lengths_out_of_range_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        ReplaySettings(**changes)


def test_the_estimate_of_memory_counts_stored_states(tmp_path, monkeypatch):
    asked = {}
    monkeypatch.setattr(
        "marl_cair.training.memory.require_memory",
        lambda name, num_bytes: asked.setdefault(name.split(" = ")[0], []).append(num_bytes),
    )
    for policy in (
        QNetworkConfig(hidden_width=16),
        QNetworkConfig(hidden_width=16, memory="lstm", memory_width=400),
    ):
        TrainingRun(recurrent(tmp_path / policy.memory, policy=policy)).close()
    without, with_states = asked["replay.capacity_transitions"]
    assert with_states - without == 3_000 * 4 * 800 // (STEPS - BURN_IN)
    without, with_states = asked["learner.batch_size"]
    assert with_states == pytest.approx(without * (1 + (BURN_IN + 1) / STEPS), abs=1_000)
