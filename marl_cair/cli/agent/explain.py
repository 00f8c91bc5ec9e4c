"""`marl-cair explain`: play one game and picture the agent's action values in it.

The folder gets `values.png` (action values and advantages at some steps), `actions.png` (actions
over the game), `overestimation.png` (largest value against the discounted return that followed),
`film.gif` (the game beside the values), `presence.png` for capsule networks, and `steps.npz` with
the numbers.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.checkpoint import find_agent, read_description
from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser, require_counts
from marl_cair.games.game import Agent, Game
from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.league.agents.foreign import require_answers
from marl_cair.league.play.playing import map_seeds
from marl_cair.training.settings.config_file import CONFIG_FILE, read_yaml
from marl_cair.training.settings.learner import LearnerSettings

if TYPE_CHECKING:
    from marl_cair.policies.actor import PolicyActor


@dataclasses.dataclass(frozen=True)
class ExplainedGame:
    """One game of T steps as the agent in the first seat saw it. `observation` [T, *shape] and
    `action_mask` bool [T, A] before each step; `values` float32 [T, A] of `agent.values`; `played`
    int32 [T, P], the actions of all seats; `rewards` float64 [T] in the unit of the values.
    """

    game: Game
    scenario: Any
    map_seed: int
    observation: NDArray[Any]
    action_mask: NDArray[np.bool_]
    values: NDArray[np.float32]
    played: NDArray[np.int32]
    rewards: NDArray[np.float64]
    ending: str  # won, lost, drawn or out of time

    def discount(self, gamma: float) -> NDArray[np.float64]:
        """Discounted sums [T] of the rewards from each step to the end."""
        returns = np.zeros(len(self.rewards) + 1)
        for step in range(len(self.rewards) - 1, -1, -1):
            returns[step] = self.rewards[step] + gamma * returns[step + 1]
        return returns[:-1]


def run(arguments: Sequence[str]) -> int:
    """Play, write the folder and print its files; returns the exit code."""
    from marl_cair.cli.agent.pictures import draw_all
    from marl_cair.policies.actor import PolicyActor

    options = make_parser().parse_args(arguments)
    require_counts(options, "steps")
    game, name, scenario = shared.choose_scenario(options, [options.agent])
    load = shared.choose_load(options)
    agent = load(options.agent, game.name, scenario)
    if not isinstance(agent, PolicyActor):
        raise ValueError(f"{options.agent} has no action values: give the folder of a checkpoint")
    opponent = load(options.opponent, game.name, scenario)
    gamma, scale = read_discount(options.agent)
    gamma = gamma if options.gamma is None else options.gamma
    if not 0.0 <= gamma <= 1.0:
        raise ValueError(f"--gamma is {gamma}, it must be in 0..1")
    reward = read_description(options.agent).scenario_options.get("reward", game.rated_reward)
    scenario = dataclasses.replace(scenario, reward=reward)  # that the values are about
    explained = play_game(agent, opponent, game, scenario, options.seed, scale)
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    returns = explained.discount(gamma)
    np.savez_compressed(
        folder / "steps.npz",
        observation=explained.observation,
        action_mask=explained.action_mask,
        values=explained.values,
        action=explained.played[:, 0],
        reward=explained.rewards,
        discounted_return=returns,
        gamma=gamma,
    )
    names = draw_all(explained, agent, returns, gamma, options.steps, folder)
    largest = explained.values.max(1)
    sys.stdout.write(
        f"{options.agent} against {options.opponent} on {game.name} {name}: {explained.ending} "
        f"after {len(returns)} steps\n"
        f"largest value {largest.mean():.3f} on average, discounted return {returns.mean():.3f} "
        f"(gamma {gamma:g}): overestimation {np.mean(largest - returns):+.3f}\n"
        f"{folder}: {', '.join([*names, 'steps.npz'])}\n"
    )
    return EXIT_DONE


def read_discount(agent: str) -> tuple[float, float]:
    """Discount and reward scale of the agent's training run, the defaults if it is not there."""
    place = find_agent(agent).absolute()
    for folder in (place.parent, place.parent.parent):
        if (folder / CONFIG_FILE).is_file():
            learner = read_yaml(folder / CONFIG_FILE).get("learner", {})
            default = LearnerSettings()
            gamma = learner.get("gamma", default.gamma)
            return float(gamma), float(learner.get("reward_scale", default.reward_scale))
    return LearnerSettings().gamma, LearnerSettings().reward_scale


def play_game(
    agent: PolicyActor, opponent: Agent, game: Game, scenario: Any, seed: int, scale: float
) -> ExplainedGame:
    """Play the first map of `play_match`, `agent` in the first seat and in those of its team.

    Rewards are multiplied by `scale`. Raises ValueError for scenarios in which a seat chooses
    several actions per step, ForeignAgentError for an opponent that forfeits.
    """
    from marl_cair.games.engine import BatchedEngine

    map_seed = int(map_seeds(seed, np.zeros(1, np.int64))[0])
    engine = BatchedEngine(game, scenario)
    if engine.spec.action_shape:
        raise ValueError(f"{game.name}: a seat chooses several actions per step in this scenario")
    engine.reset(np.array([map_seed], np.uint64))
    teams = engine.spec.team_of_seat
    own, others = np.flatnonzero(teams == teams[0]), np.flatnonzero(teams != teams[0])
    for player in (agent, opponent):
        player.seed(seed)
    states = np.zeros((engine.num_players, find_state_size(agent, opponent)), np.float32)
    seen, masks, held, played, rewards = [], [], [], [], []
    while not (engine.terminated | engine.truncated)[0]:
        mask, actions = engine.action_mask()[0], np.zeros((1, engine.num_players), np.int32)
        held.append(states[0, : agent.state_size].copy())
        for player, seats in ((agent, own), (opponent, others)):
            if len(seats):
                rows = engine.observe(player.representation)[0, seats].copy(), mask[seats].copy()
                actions[0, seats] = call_agent(player, states, (seats,), *rows)
                require_answers(player, actions[0, seats])
        seen.append(engine.observe(agent.representation)[0, 0].copy())
        masks.append(mask[0].copy())
        played.append(actions[0])
        engine.step(actions)
        rewards.append(float(engine.rewards[0, 0]) * scale)
    winner = int(engine.winner[0])
    if engine.truncated[0]:
        ending = "out of time"
    else:
        ending = "ended" if winner < 0 else "won" if teams[winner] == teams[0] else "lost"
    observation, mask = np.array(seen), np.array(masks)
    values = agent.values(observation, mask, np.array(held))
    steps = np.array(played), np.array(rewards)
    return ExplainedGame(game, scenario, map_seed, observation, mask, values, *steps, ending)


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair explain",
        description=__doc__,
        epilog="example: marl-cair explain runs/demo/capsule --opponent counter --out runs/why",
    )
    parser.add_argument("agent", metavar="AGENT", help=shared.CHECKPOINT_HELP)
    parser.add_argument(
        "--opponent", default="random", help=f"{shared.AGENT_HELP} (default: %(default)s)"
    )
    shared.add_options(parser, "--seed", *shared.SCENARIO_OPTIONS, *shared.ANSWER_LIMITS)
    parser.add_argument(
        "--steps",
        type=int,
        default=4,
        help="number of steps, evenly over the game, in values.png (default: %(default)s)",
    )
    parser.add_argument(
        "--gamma", type=float, help="discount of the return (default: the run's, else 0.99)"
    )
    parser.add_argument(
        "--out", default="runs/explain", help="folder of the pictures (default: %(default)s)"
    )
    return parser
