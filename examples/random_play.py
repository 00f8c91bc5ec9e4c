"""Plays Deep Line Wars with random legal actions through PettingZoo and prints mean returns."""

import argparse

from marl_cair.games import deep_line_wars


def play_game(env, seed):
    """Play one game; returns the return of each agent and the number of steps."""
    _, infos = env.reset(seed=seed)
    returns = dict.fromkeys(env.possible_agents, 0.0)
    num_steps = 0
    while env.agents:
        actions = {
            agent: env.action_space(agent).sample(infos[agent]["action_mask"])
            for agent in env.agents
        }
        _, rewards, _, _, infos = env.step(actions)
        num_steps += 1
        for agent, reward in rewards.items():
            returns[agent] += reward
    return returns, num_steps


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="10x15")
    parser.add_argument("--games", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    env = deep_line_wars.parallel_env(scenario=options.scenario)
    for number, agent in enumerate(env.possible_agents):
        env.action_space(agent).seed(options.seed + number)
    played = [play_game(env, options.seed + game) for game in range(options.games)]
    for agent in env.possible_agents:
        mean = sum(returns[agent] for returns, _ in played) / options.games
        print(f"{agent}: mean return {mean:+.2f}")
    print(f"mean steps of a game: {sum(steps for _, steps in played) / options.games:.0f}")


if __name__ == "__main__":
    main()
