"""Plays an agent of `marl-cair export` with onnxruntime, without torch."""

import argparse
import json

import onnxruntime

from marl_cair import GAMES
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.league.agents.foreign import ForeignAgent
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import play_alone


class OnnxAgent:
    """An object with `act`, as for every agent."""

    def __init__(self, path):
        self.session = onnxruntime.InferenceSession(path)
        self.about = self.session.get_modelmeta().custom_metadata_map
        self.name, self.representation = self.about["name"], self.about["representation"]
        self.state_size = int(self.about["state_size"])  # 0 without memory

    def act(self, observation, action_mask, state=None):
        given = {"observation": observation, "action_mask": action_mask}
        if state is None:
            return self.session.run(["action"], given)[0]
        # The match keeps the state of each game, zeros at its start.
        return self.session.run(["action", "next_state"], {**given, "state": state})


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", help="agent.onnx")
    parser.add_argument("--opponent", default="random", help="a bot, in games with opponents")
    parser.add_argument("--games", type=int, default=20)
    options = parser.parse_args()
    exported = OnnxAgent(options.file)
    game = GAMES[exported.about["game"]]
    fields = restore_fields(json.loads(exported.about["scenario_options"]))
    scenario = game.scenario(exported.about["scenario"], **fields)
    spec = game.make_spec(scenario)
    agent = ForeignAgent(exported, options.file, spec, options.file)
    if spec.num_teams == 1:
        alone = play_alone(agent, game, scenario, options.games, 0)
        print(f"{agent.name}: mean score {alone.scores.mean():.3f} in {alone.games} games")
        return
    match = play_match(
        agent, game.bot(options.opponent, scenario), game, scenario, options.games, 0
    )
    print(f"{agent.name} against {options.opponent}: {match.score:.1%} of {match.games} games")
    if match.forfeits:
        print(f"{len(match.forfeits)} games were forfeited: {match.forfeits[0]}")


if __name__ == "__main__":
    main()
