"""Trains sb3-contrib's MaskablePPO against a bot and prints its mean return in new games."""

import argparse

import gymnasium
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_util import make_vec_env

import marl_cair  # noqa: F401  # registers the Gymnasium ids


def evaluate(model, env_id, opponent, games):
    """The mean return of greedy play."""
    env = gymnasium.make(env_id, representation="vector", opponent=opponent)
    total = 0.0
    for game in range(games):
        observation, info = env.reset(seed=1_000_000 + game)
        ended = False
        while not ended:
            action, _ = model.predict(
                observation, action_masks=info["action_mask"].astype(bool), deterministic=True
            )
            observation, reward, terminated, truncated, info = env.step(int(action))
            total += float(reward)
            ended = terminated or truncated
    return total / games


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", default="marl_cair/DeepLineWars-11x11-v0")
    parser.add_argument("--opponent", default="random")
    parser.add_argument("--steps", type=int, default=50_000)
    parser.add_argument("--games", type=int, default=20)
    options = parser.parse_args()
    env = make_vec_env(
        options.env,
        n_envs=8,
        seed=0,
        env_kwargs={"representation": "vector", "opponent": options.opponent, "reward": "shaped"},
    )
    model = MaskablePPO("MlpPolicy", env, n_steps=64, batch_size=128, seed=0, device="cpu")
    model.learn(options.steps)
    mean = evaluate(model, options.env, options.opponent, options.games)
    print(f"mean return in {options.games} games: {mean:+.2f}")


if __name__ == "__main__":
    main()
