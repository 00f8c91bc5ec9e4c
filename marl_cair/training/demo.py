"""The demonstration: train a conv and a capsule network, rate them with the bots, show a game."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tqdm import tqdm

from marl_cair.checkpoint import LATEST_FOLDER
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.league.agents import load_agent
from marl_cair.league.film import save_film
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.config import (
    CheckpointSettings,
    CollectorSettings,
    EvaluationSettings,
    ExplorationSettings,
    OpponentSettings,
    ReplaySettings,
    TrainConfig,
)
from marl_cair.training.curves import draw_curves
from marl_cair.training.learner_settings import LearnerSettings
from marl_cair.training.trainer import train

FINISHED_FILE = "finished.txt"  # in the folder of a run that a later call need not go on with
GAME, SCENARIO = "deep_line_wars", "10x15"
NETWORKS = ("conv", "capsule")
# More of the bots than the default has: in minutes they teach more than a pool of beginners does.
MIXTURE = {"latest": 0.3, "uniform": 0.1, "bots": 0.5, "random": 0.1}
NEXT = """
Look at   {out}/league/report.html  the ladder with 95 % intervals, who beats whom, games to watch
          {out}/league/league.png   the same as a picture
          {out}/curves.png          learning curves, generator, actions
          {out}/game.gif            a game of the conv network against the bot `counter`
Try next  .venv/bin/marl-cair train policy=capsule opponent=self_play total_frames=1000000
          .venv/bin/marl-cair league {out}/conv/latest {out}/capsule/latest counter economist
          .venv/bin/marl-cair games
          .venv/bin/tensorboard --logdir {out}
"""


@dataclass(frozen=True)
class DemoSettings:
    """How long the demonstration is. The defaults end within 10 minutes on 2 cores."""

    out: str = "runs/demo"  # output folder
    frames: int = 200_000  # decisions of each network
    max_minutes: float = 3.4  # minutes of training of each network
    evaluation_games: int = 32  # games of each evaluation against a bot
    league_games: int = 40  # games of each pair
    num_worlds: int = 128  # games at one time in training
    seed: int = 0  # of everything random


@dataclass(frozen=True)
class _Redraw:
    """Draws the curves anew at each logged row."""

    runs: dict[str, str]
    path: Path

    def __call__(self, row: dict[str, float]) -> None:
        draw_curves(self.runs, self.path)


def make_config(settings: DemoSettings, network: str) -> TrainConfig:
    """The default recipe, shortened: random first, then self-play; 20 % generated rows."""
    warmup = settings.frames // 20
    every = max(1, settings.frames // 8)
    return TrainConfig(
        out=f"{settings.out}/{network}",
        seed=settings.seed,
        total_frames=settings.frames,
        max_minutes=settings.max_minutes,
        policy=QNetworkConfig(body=network),
        opponent=OpponentSettings(MIXTURE, warmup, {"random": 1.0}, snapshot_every_frames=every),
        collector=CollectorSettings(num_worlds=settings.num_worlds),
        exploration=ExplorationSettings(anneal_frames=max(1, settings.frames * 3 // 10)),
        replay=ReplaySettings(
            capacity_transitions=100_000, min_transitions=min(5_000, settings.frames // 4)
        ),
        learner=LearnerSettings(),
        evaluation=EvaluationSettings(
            every_frames=every, games=settings.evaluation_games, bots=("random", "counter")
        ),
        checkpoint=CheckpointSettings(every_frames=settings.frames),
    )


def run_demo(settings: DemoSettings) -> Path:
    """Train, rate, draw and film; returns the output folder.

    A stage that an earlier, interrupted call has finished is not repeated; a training run that was
    interrupted goes on. Raises OutputFolderError for a folder that holds other runs.
    """
    folder = Path(settings.out)
    for number, network in enumerate(NETWORKS, start=1):
        config = make_config(settings, network)
        tqdm.write(f"[{number}/4] training the {network} network in {config.out}")
        finished = Path(config.out) / FINISHED_FILE
        if finished.exists():
            continue
        done = {name: f"{settings.out}/{name}" for name in NETWORKS[:number]}
        result = train(config, resume=True, listen=_Redraw(done, folder / "curves.png"))
        if result.was_interrupted:
            raise KeyboardInterrupt
        write_atomically(finished, f"{result.frames} decisions\n")
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
    scenario = GAMES[GAME].scenario(SCENARIO)
    best, rival = load_agent(agents[0], GAME, scenario), load_agent("counter", GAME, scenario)
    save_film(best, rival, GAMES[GAME], scenario, settings.seed, folder / "game.gif")
    return folder
