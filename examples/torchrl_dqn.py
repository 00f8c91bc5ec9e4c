"""Trains a masked double DQN with TorchRL on the batched environment; it plays both seats."""

import argparse

import torch
from torchrl.data import Categorical, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, SoftUpdate

import marl_cair


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=2_000, help="steps of each environment copy")
    parser.add_argument("--num-envs", type=int, default=64)
    options = parser.parse_args()
    torch.manual_seed(0)
    game = {"scenario": "11x11", "reward": "shaped", "representation": "vector"}
    env = marl_cair.make_torchrl_env("deep_line_wars", num_worlds=options.num_envs, seed=0, **game)
    spec = env.engine.spec
    num_inputs, num_actions = spec.representations["vector"].shape[0], env.engine.num_actions
    network = torch.nn.Sequential(
        torch.nn.LayerNorm(num_inputs),
        torch.nn.Linear(num_inputs, 128),
        torch.nn.ReLU(),
        torch.nn.Linear(128, num_actions),
    )
    actor = QValueActor(network, spec=Categorical(num_actions), action_mask_key="action_mask")
    loss_of = DQNLoss(actor, action_space="categorical", delay_value=True, double_dqn=True)
    loss_of.make_value_estimator(gamma=0.99)
    target = SoftUpdate(loss_of, eps=0.99)
    optimiser = torch.optim.Adam(loss_of.parameters(), lr=5e-4)
    replay = TensorDictReplayBuffer(storage=LazyTensorStorage(100_000), batch_size=256)
    state, num_won = env.reset(), 0
    for step in range(options.steps):
        epsilon = max(0.05, 1 - 2 * step / options.steps)
        with torch.no_grad():
            greedy = actor(state["player"].flatten().clone())["action"].view(options.num_envs, -1)
        explores = torch.rand(greedy.shape) < epsilon
        legal = env.rand_action(state.clone())["player", "action"]
        state["player", "action"] = torch.where(explores, legal, greedy)
        stepped, state = env.step_and_maybe_reset(state)
        seats = stepped["player"].clone().set("next", stepped["next", "player"].clone())
        replay.extend(seats.flatten())
        num_won += int((env.last.winner >= 0).sum())
        loss = loss_of(replay.sample())["loss"]
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        target.step()
    print(f"{options.steps * options.num_envs} steps, {num_won} games won, loss {loss:.4f}")


if __name__ == "__main__":
    main()
