"""`marl-cair explain`: play one game, or take a recorded one, and picture an agent's action values.

The folder gets `values.png` (action values and advantages at some steps), `actions.png` (actions
over the game), `overestimation.png` (largest value against the discounted return that followed),
`film.gif` (the game beside the values), `presence.png` for capsule networks, and `steps.npz` with
the numbers.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.checkpoint import find_agent, read_description
from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser, require_counts
from marl_cair.games import GAMES
from marl_cair.games.game import Agent, Game
from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.games.replays import Replay, read_replay, replay_steps
from marl_cair.league.agents.foreign import require_answers
from marl_cair.league.agents.load import find_trained
from marl_cair.league.play.playing import map_seeds
from marl_cair.training.collecting.recorded import REWARD_FIELDS
from marl_cair.training.settings.config_file import CONFIG_FILE, read_yaml
from marl_cair.training.settings.learner import LearnerSettings

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine
    from marl_cair.policies.actor import PolicyActor


@dataclasses.dataclass(frozen=True)
class ExplainedGame:
    """A recorded game of T steps as an agent in `seat` sees it. `observation` [T, *shape] and
    `action_mask` bool [T, A] before each step; `values` float32 [T, A] of `agent.values`;
    `rewards` float64 [T] in the unit of the values.
    """

    replay: Replay
    seat: int
    observation: NDArray[Any]
    action_mask: NDArray[np.bool_]
    values: NDArray[np.float32]
    rewards: NDArray[np.float64]
    ending: str  # won, lost, ended, out of time, or not finished: a recording that was cut off
    every: int  # steps from one decision of the agent to the next

    @property
    def played(self) -> NDArray[np.int32]:
        """The actions [T] of the seat in the game."""
        played: NDArray[np.int32] = self.replay.actions[:, self.seat]
        return played

    def discount(self, gamma: float) -> NDArray[np.float64]:
        """Discounted sums [T] of the rewards from each step to the end."""
        returns = np.zeros(len(self.rewards) + 1)
        for step in range(len(self.rewards) - 1, -1, -1):
            returns[step] = self.rewards[step] + gamma * returns[step + 1]
        return returns[:-1]


def run(arguments: Sequence[str]) -> int:
    """Play, write the folder and print its files; returns the exit code."""
    from marl_cair.cli.agent.pictures import save_all
    from marl_cair.policies.actor import PolicyActor

    parser = make_parser()
    options = parser.parse_args(arguments)
    require_counts(options, "steps")
    replay, every = read_replay(options.replay) if options.replay else None, 1
    _check_options(parser, options, replay)
    if replay is None:
        game, name, scenario = shared.choose_scenario(options, [options.agent])
        rival = f"against {options.opponent} " if game.make_spec(scenario).num_teams > 1 else ""
        about = f"{rival}on {game.name} {name}"
    else:
        game, scenario = GAMES[replay.game], replay.scenario
        about = f"in seat {options.seat} of {options.replay}"
    if game.make_spec(scenario).action_shape:
        raise ValueError(f"{game.name}: a seat chooses several actions per step in this scenario")
    load = shared.choose_load(options)
    agent = load(options.agent, game.name, scenario)
    if not isinstance(agent, PolicyActor) or agent.is_sampled:  # that one has probabilities
        raise ValueError(
            f"{options.agent} has no action values: give the folder of a greedy checkpoint"
        )
    trained_gamma, scale = read_discount(options.agent)
    gamma = trained_gamma if options.gamma is None else options.gamma
    fields = find_trained(game, read_description(options.agent))
    if replay is None:
        opponent = load(options.opponent, game.name, scenario)
        replay = play_game(agent, opponent, game, scenario, options.seed)
    else:
        decided = game.make_spec(game.scenario(fields.pop("scenario"), **fields))
        every = max(1, decided.ticks_per_step // replay.spec.ticks_per_step)
        gamma **= 1 / every  # of a step of the recording
    rewarded = {name: fields[name] for name in REWARD_FIELDS if name in fields}
    if "shaping_discount" in rewarded:
        rewarded["shaping_discount"] = trained_gamma ** (1 / every)
    explained = explain_game(agent, replay, rewarded, options.seat, every, scale)
    returns = explained.discount(gamma)
    names = save_all(explained, agent, returns, gamma, options.steps, Path(options.out))
    largest = explained.values.max(1)
    sys.stdout.write(
        f"{options.agent} {about}: {explained.ending} after {len(returns)} steps\n"
        f"largest value {largest.mean():.3f} on average, discounted return {returns.mean():.3f} "
        f"(gamma {gamma:g}, reward {fields['reward']}): "
        f"overestimation {np.mean(largest - returns):+.3f}\n"
        f"{options.out}: {', '.join(names)}\n"
    )
    return EXIT_DONE


def _check_options(
    parser: argparse.ArgumentParser, options: argparse.Namespace, replay: Replay | None
) -> None:
    """Raise ValueError for options that have no effect or are out of range, and for a recording
    without the seat.
    """
    for name in ("seat",) if replay is None else ("opponent", "seed", "game", "scenario", "fields"):
        if getattr(options, name) != parser.get_default(name):
            option = "--set" if name == "fields" else f"--{name}"
            where = "only with" if replay is None else "only without"
            raise ValueError(f"{option} has an effect {where} --replay: leave it out")
    if options.gamma is not None and not 0.0 <= options.gamma <= 1.0:
        raise ValueError(f"--gamma is {options.gamma}, it must be in 0..1")
    if replay is not None:
        last = len(replay.players) - 1
        if not 0 <= options.seat <= last:
            raise ValueError(f"--seat is {options.seat}, it must be in 0..{last}")
        if not len(replay.actions):
            raise ValueError(f"{options.replay} has no steps: give a game that was played")


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


def play_game(agent: Agent, opponent: Agent, game: Game, scenario: Any, seed: int) -> Replay:
    """Play the first map of `play_match`, `agent` in the first seat and in those of its team.

    Raises ForeignAgentError for an opponent that forfeits.
    """
    from marl_cair.games.engine import BatchedEngine

    map_seed = int(map_seeds(seed, np.zeros(1, np.int64))[0])
    engine = BatchedEngine(game, scenario)
    engine.reset(np.array([map_seed], np.uint64))
    teams = engine.spec.team_of_seat
    own, others = np.flatnonzero(teams == teams[0]), np.flatnonzero(teams != teams[0])
    for player in (agent, opponent):
        player.seed(seed)
    states = np.zeros((engine.num_players, find_state_size(agent, opponent)), np.float32)
    played = []
    while not (engine.terminated | engine.truncated)[0]:
        mask, actions = engine.action_mask()[0], np.zeros((1, engine.num_players), np.int32)
        for player, seats in ((agent, own), (opponent, others)):
            if len(seats):
                rows = engine.observe(player.representation)[0, seats].copy(), mask[seats].copy()
                actions[0, seats] = call_agent(player, states, (seats,), *rows)
                require_answers(player, actions[0, seats])
        played.append(actions[0])
        engine.step(actions)
    names = tuple(agent.name if team == teams[0] else opponent.name for team in teams)
    about = (game.name, scenario, game.version, map_seed, names)
    return Replay(*about, np.array(played), winner=None, is_complete=True)


def explain_game(
    agent: PolicyActor,
    replay: Replay,
    rewarded: Mapping[str, Any],
    seat: int,
    every: int,
    scale: float,
) -> ExplainedGame:
    """A recorded game as `agent` values it in a seat, with rewards times `scale`.

    rewarded: REWARD_FIELDS of the scenario that the values are about. The agent's memory takes each
    `every`-th step: those at which it would decide. Raises ReplayError as `replay_steps`.
    """
    scenario = dataclasses.replace(replay.scenario, **rewarded)
    if scenario != replay.scenario:  # hashes are of states and rewards
        replay = dataclasses.replace(replay, scenario=scenario, hashes={})
    states = np.zeros((1, find_state_size(agent)), np.float32)
    seen, masks, held, rewards = [], [], [], []
    for step, engine in enumerate(replay_steps(replay)):
        rewards.append(float(engine.rewards[0, seat]) * scale)
        ending = describe_ending(engine, seat)
        if step == len(replay.actions):
            break
        rows = engine.observe(agent.representation)[:, seat].copy(), engine.action_mask()[:, seat]
        held.append(states[0].copy())
        if step % every == 0:
            call_agent(agent, states, ([0],), *rows)
        seen.append(rows[0][0])
        masks.append(rows[1][0].copy())
    observation, mask = np.array(seen), np.array(masks)
    values = agent.values(observation, mask, np.array(held))
    paid = np.array(rewards[1:])
    return ExplainedGame(replay, seat, observation, mask, values, paid, ending, every)


def describe_ending(engine: BatchedEngine, seat: int) -> str:
    """How a game has ended for a seat."""
    winner, teams = int(engine.winner[0]), engine.spec.team_of_seat
    if engine.truncated[0]:
        return "out of time"
    if not engine.terminated[0]:
        return "not finished"
    return "ended" if winner < 0 else "won" if teams[winner] == teams[seat] else "lost"


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
    parser.add_argument(
        "--replay",
        metavar="FILE",
        help="a recorded game, in the place of one that is played against --opponent; FILE#3 is "
        "game 3, from 0, of a file with several",
    )
    parser.add_argument(
        "--seat", type=int, default=0, help="of the agent in --replay (default: %(default)s)"
    )
    shared.add_options(parser, "--seed", *shared.SCENARIO_OPTIONS, *shared.ANSWER_LIMITS)
    parser.add_argument(
        "--steps",
        type=int,
        default=4,
        help="steps with a choice in values.png, evenly over the game (default: %(default)s)",
    )
    parser.add_argument(
        "--gamma", type=float, help="discount of the return (default: the run's, else 0.99)"
    )
    parser.add_argument(
        "--out", default="runs/explain", help="folder of the pictures (default: %(default)s)"
    )
    return parser
