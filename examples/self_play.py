"""Trains a network by self-play with a pool of past selves, then rates it against two bots."""

import argparse

from marl_cair import GAMES, load_agent
from marl_cair.league.play.match import play_match
from marl_cair.policies.config import QNetworkConfig
from marl_cair.training.settings.config import (
    GameSettings,
    GeneratorSettings,
    OpponentSettings,
    TrainConfig,
)
from marl_cair.training.settings.evaluation import EvaluationSettings
from marl_cair.training.trainer import train


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=100_000, help="environment steps")
    parser.add_argument("--games", type=int, default=20)
    parser.add_argument("--out", default="runs/example")
    options = parser.parse_args()
    config = TrainConfig(
        out=options.out,
        total_frames=options.frames,
        synthetic_fraction=0.0,
        game=GameSettings("deep_line_wars", "11x11"),
        policy=QNetworkConfig(body="conv"),
        generator=GeneratorSettings(name="none"),
        opponent=OpponentSettings(
            mixture={"latest": 0.5, "pfsp": 0.3, "bots": 0.2},
            snapshot_every_frames=max(1, options.frames // 4),
        ),
        evaluation=EvaluationSettings(every_frames=max(1, options.frames // 5), games=32),
    )
    result = train(config, resume=True)  # the same command again resumes an interrupted run
    game = GAMES["deep_line_wars"]
    scenario = game.scenario("11x11")
    agent = load_agent(f"{options.out}/latest")
    print(f"trained for {result.frames} steps")
    for bot in ("random", "counter"):
        opponent = game.bot(bot, scenario)
        match = play_match(agent, opponent, game, scenario, options.games, seed=1_000_000)
        print(f"score against {bot}: {match.score:.0%}")


if __name__ == "__main__":
    main()
