"""The demonstration: trains a conv and a capsule network, rates them with bots, films a game."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path

import yaml
from tqdm import tqdm

from marl_cair.checkpoint import LATEST_FOLDER
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.play.film import save_film
from marl_cair.league.play.match import play_match, record_game
from marl_cair.training.curves import draw_curves
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.config_file import build_config
from marl_cair.training.trainer import train

FINISHED_FILE = "finished.txt"  # marks a run that a later call need not resume
GAME, SCENARIO = "deep_line_wars", "11x11"
TRAINED = "agents/deep_line_wars_10x15"  # of a checkout
NETWORKS = {"conv": "small_conv", "capsule": "capsule"}  # by name: a choice of policy=
RIVAL = "random"  # the bot that a network must beat before it is rated
# More bots than in the default: in minutes they teach more than a pool of beginners.
MIXTURE = {"random": 0.5, "bots": 0.3, "latest": 0.2}
NEXT = """
Look at   {out}/league/report.html  the ladder with 95 % intervals, win rates of pairs, games
          {out}/league/league.png   the same as a picture
          {out}/curves.png          learning curves, generator, actions
          {out}/game.gif            a game that the conv network wins against the bot `random`
          {out}/watch.gif           a game of a trained agent, agents/deep_line_wars_10x15
Try next  .venv/bin/marl-cair play deep_line_wars --opponent {out}/capsule/latest
          .venv/bin/marl-cair dashboard {out}/conv {out}/capsule
          .venv/bin/marl-cair train policy=capsule opponent=self_play total_frames=1000000
          .venv/bin/marl-cair league {out}/conv/latest {out}/capsule/latest counter economist
          .venv/bin/marl-cair games
"""


@dataclass(frozen=True)
class DemoSettings:
    """Length of the demonstration: by default at most 10 minutes on 2 cores that two other programs
    use too.
    """

    out: str = "runs/demo"  # output folder
    score: float = 0.95  # of the points against `random`, twice, at which a network is trained
    frames: int = 100_000  # environment steps at which a network that has not learned fails
    evaluation_games: int = 100  # games of each evaluation against `random`
    league_games: int = 20  # games of each pair
    num_worlds: int = 64  # environment copies in training
    seed: int = 0  # of everything random


def make_config(settings: DemoSettings, network: str) -> TrainConfig:
    """The default recipe, shortened: 20 % generated transitions once the generator is good enough.

    All networks after the first begin with the first one's generator.
    """
    frames, every = settings.frames, max(1, min(4_000, settings.frames // 4))
    first = next(iter(NETWORKS))
    policy = files("marl_cair") / "conf" / "policy" / f"{NETWORKS[network]}.yaml"
    return build_config(
        {
            "out": f"{settings.out}/{network}",
            "seed": settings.seed,
            "total_frames": frames,
            "stop_score": settings.score,
            "initial_generator": None if network == first else f"{settings.out}/{first}",
            "game": {"name": GAME, "scenario": SCENARIO},
            "policy": yaml.safe_load(policy.read_text("utf-8")),
            "opponent": {"mixture": MIXTURE, "snapshot_every_frames": frames},
            "collector": {"num_worlds": settings.num_worlds},
            "exploration": {"anneal_frames": min(10_000, frames // 2)},
            "replay": {
                "capacity_transitions": 100_000,
                "min_transitions": min(1_000, frames // 4),
            },
            "learner": {"frames_per_update": 32, "average_decay": 0.99},
            "generator": {"evaluate_every_frames": every},
            "evaluation": {
                "every_frames": every,
                "games": settings.evaluation_games,
                "bots": [RIVAL],
            },
            "checkpoint": {"every_frames": frames},
        }
    )


def run_demo(settings: DemoSettings) -> Path:
    """Train, rate, draw and film; returns the output folder.

    After an interrupt, finished stages are not repeated, and a training run is resumed.

    Raises:
        OutputFolderError: the folder holds other runs.
        ValueError: a network did not reach `settings.score`.
    """
    out, shown = Path(settings.out), Path(settings.out) / "watch.gif"
    if Path(TRAINED).exists() and not shown.exists():
        film_win(TRAINED, "counter", GAME, "10x15", settings.seed, shown)
        tqdm.write(f"[0/4] a game of {TRAINED}, to watch meanwhile: {shown}")
    for number, network in enumerate(NETWORKS, start=1):
        tqdm.write(f"[{number}/4] training the {network} network in {settings.out}/{network}")
        _train(settings, network)
    tqdm.write("[3/4] league of the networks and the scripted bots")
    agents = [f"{settings.out}/{network}/{LATEST_FOLDER}" for network in NETWORKS]
    league = run_league(
        LeagueConfig(
            agents=(*agents, *GAMES[GAME].bots),
            game=GAME,
            scenario=SCENARIO,
            games_per_pair=settings.league_games,
            seed=settings.seed,
            out=f"{settings.out}/league",
        ),
        partial(load_agent, game=GAME),
    )
    tqdm.write(league.text)
    tqdm.write("[4/4] filming a game")
    film_win(agents[0], RIVAL, GAME, SCENARIO, settings.seed, out / "game.gif")
    return out


def _train(settings: DemoSettings, network: str) -> None:
    """Train until the network beats `random`. Raises ValueError if it does not."""
    config = make_config(settings, network)
    finished = Path(config.out) / FINISHED_FILE
    if finished.exists():
        return
    names = list(NETWORKS)
    done = {name: f"{settings.out}/{name}" for name in names[: names.index(network) + 1]}
    curves = Path(settings.out) / "curves.png"
    result = train(config, resume=True)
    if result.was_interrupted:
        raise KeyboardInterrupt
    draw_curves(done, curves)
    if not result.reached_score:
        raise ValueError(
            f"the {network} network has not reached {settings.score:.0%} of the points against "
            f"{RIVAL} in {result.frames:,} environment steps (see {curves}): train longer with "
            f"--frames {2 * settings.frames}, or take another --out and --seed"
        )
    points = f"{result.last_row['confirmed_score']:.0%} of the points"
    games = f"{settings.evaluation_games} new games against {RIVAL}"
    text = f"{network}: {points} in {games} after {result.frames:,} environment steps"
    tqdm.write(text)
    write_atomically(finished, f"{text}\n")


def film_win(agent: str, opponent: str, game: str, scenario: str, seed: int, path: Path) -> None:
    """Write the first of 50 games that `agent` wins in seat 0, else the first, as a GIF."""
    rules = GAMES[game]
    played = rules.scenario(scenario)
    agents = load_agent(agent, game, played), load_agent(opponent, game, played)
    seeds = range(seed, seed + 50)
    won = (s for s in seeds if play_match(*agents, rules, played, 2, s).results[0].winner == 0)
    save_film(path, record_game(*agents, rules, played, next(won, seed)))
