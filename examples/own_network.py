"""Trains a network that is defined here, resumes it, and plays it in a league with two bots."""

import argparse
from pathlib import Path

from torch import nn

from marl_cair import load_agent
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.policies.body import Body, require_planes
from marl_cair.training.settings.config_file import build_config
from marl_cair.training.trainer import train


class PooledBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F]: convolutions, then board means."""

    DEFAULT_HIDDEN_WIDTH = 64  # F, unless policy.hidden_width is set

    def __init__(self, observation_shape, config):
        super().__init__(observation_shape, config)
        planes, width = require_planes("pooled", observation_shape)[0], self.num_features
        self.layers = nn.Sequential(
            nn.Conv2d(planes, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ReLU(),
        )

    def forward(self, observation):
        return self.layers(observation).mean((2, 3))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=20_000, help="environment steps")
    parser.add_argument("--games", type=int, default=20, help="games of each pair")
    parser.add_argument("--out", default="runs/own_network")
    options = parser.parse_args()
    settings = {
        "out": options.out,
        "total_frames": options.frames,
        "synthetic_fraction": 0.0,
        "game": {"name": "deep_line_wars", "scenario": "11x11", "options": {"max_ticks": 200}},
        "policy": {"body": f"{Path(__file__).stem}:PooledBody"},
        "replay": {"min_transitions": 512},
    }
    first = train(build_config(settings), until_frames=options.frames // 2)
    last = train(build_config(settings), resume=True)
    print(f"trained for {first.frames} steps, resumed to {last.frames}")
    agents, out = (f"{options.out}/latest", "random", "rusher"), f"{options.out}_league"
    league = LeagueConfig(agents, scenario="11x11", games_per_pair=options.games, out=out)
    print(run_league(league, load_agent).text)


if __name__ == "__main__":
    main()
