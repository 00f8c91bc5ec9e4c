"""Plays a league of an agent written here and three bots, and prints the ladder."""

import argparse
from pathlib import Path

import numpy as np

from marl_cair import load_agent
from marl_cair.league.league import LeagueConfig, run_league


class Spender:
    """Plays the legal action with the highest number: in Deep Line Wars the dearest tower."""

    name = "spender"
    representation = "vector"  # what it observes

    def act(self, observation: np.ndarray, action_mask: np.ndarray) -> np.ndarray:
        """Observations [N, ...] and masks bool [N, A] of N games -> one legal action each, [N]."""
        num_actions = action_mask.shape[1]
        return num_actions - 1 - action_mask[:, ::-1].argmax(1)


def make_spender(scenario, spec):
    """Makes the agent; commands name it `examples.league:make_spender`."""
    return Spender()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--games", type=int, default=40, help="games of each pair")
    parser.add_argument("--out", default="runs/example_league")
    options = parser.parse_args()
    config = LeagueConfig(
        agents=(f"{Path(__file__).stem}:make_spender", "random", "rusher", "turtle"),
        scenario="11x11",
        games_per_pair=options.games,
        out=options.out,
    )
    print(run_league(config, load_agent).text)
    print(f"report: {options.out}/report.html")


if __name__ == "__main__":
    main()
