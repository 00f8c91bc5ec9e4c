"""Settings of policy-space response oracles, and the YAML file that they are written in."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from marl_cair.games import GAMES
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.league.agents.mixtures import SLACK
from marl_cair.lookup import find_by_name
from marl_cair.training.population.league_settings import derive_seed, read_options, refuse_given
from marl_cair.training.settings.checks import require, require_once
from marl_cair.training.settings.config import ENDLESS_FRAMES, GameSettings, TrainConfig
from marl_cair.training.settings.config_file import (
    build_config,
    build_value,
    list_sources,
    to_plain,
)

# What a round says for its response.
_TAKEN = ("out", "seed", "total_frames", "max_minutes", "stop_score", "initial_agent")
_TAKEN_OPPONENT = ("mixture", "agents", "snapshot_every_frames", "snapshot_margin")


@dataclass(frozen=True)
class PsroSettings:
    """Best responses, one after the other, each to mixtures of all that were there before:
    policy-space response oracles (Lanctot et al. 2017, "A unified game-theoretic approach to
    multiagent reinforcement learning"), between two teams.
    """

    out: str = "runs/psro"  # output folder
    seed: int = 0  # of everything random
    rounds: int = 8  # best responses, one after the other
    round_frames: int = 200_000  # decisions of one world in which a response learns
    first_round_frames: int = 400_000  # the same where nobody is there yet whom it could begin as
    max_minutes: float | None = None  # of this sitting; null: no limit
    begin_with: tuple[str, ...] = ()  # agents that take part from the start: checkpoint folders
    bots: tuple[str, ...] = ("random",)  # bots that are met, and to be safe against
    games_per_pair: int = 40  # games of each pair, by which agents are weighed
    even_share: float = 0.25  # of a response's games are against all alike, the rest by mixtures
    slack: float = SLACK  # of a mixture's least score (0..1), that its evenness may cost
    training: dict[str, Any] = field(  # options of `marl-cair train` for all responses, by group
        default_factory=dict
    )

    def __post_init__(self) -> None:
        for name in ("rounds", "round_frames", "first_round_frames"):
            require(getattr(self, name) >= 1, name, getattr(self, name), "1 or more")
        require(0 <= self.seed < 2**63, "seed", self.seed, "0 or more")
        minutes, games = self.max_minutes, self.games_per_pair
        require(minutes is None or minutes > 0, "max_minutes", minutes, "above 0, or null")
        require(games >= 2 and games % 2 == 0, "games_per_pair", games, "even and 2 or more")
        require(0 <= self.even_share <= 1, "even_share", self.even_share, "0..1")
        require(0 < self.slack < 1, "slack", self.slack, "above 0, below 1")
        for name, given in (("begin_with", self.begin_with), ("bots", self.bots)):
            require_once(name, given)
        require(len(self.bots) > 0, "bots", list(self.bots), "one or more: the first to be met")
        refuse_given("training", self.training, _TAKEN, "each response has its own")
        why = "responses meet bots, begin_with, and one another"
        refuse_given("training.opponent", self.training.get("opponent"), _TAKEN_OPPONENT, why)
        self._check_game()

    def _check_game(self) -> None:
        about = self.game
        game = GAMES[about.name]
        for bot in self.bots:
            find_by_name(f"{game.name} bot", bot, game.bots)
        spec = game.make_spec(game.scenario(about.scenario, **about.options))
        allowed = "a scenario of two teams: what a mixture is worth is reckoned for two"
        require(spec.num_teams == 2, "training.game.scenario", about.scenario, allowed)
        config = self.response_config(0, {}, None)
        if config.nfsp.enabled:
            raise ValueError(
                "training.nfsp.enabled is True, but responses begin as one another, which an "
                "average policy cannot: leave it out; mixtures take its place here"
            )
        least = 2 * config.replay.min_transitions
        for name in ("round_frames", "first_round_frames"):
            allowed = f"{least} or more, twice training.replay.min_transitions"
            require(getattr(self, name) >= least, name, getattr(self, name), allowed)

    @property
    def game(self) -> GameSettings:
        """What is played."""
        return build_config(self.training).game

    def response_config(
        self, number: int, met: Mapping[str, tuple[str, float]], start: str | None
    ) -> TrainConfig:
        """The training of response `number`, 0, 1, ..., but for its folder.

        met: source and weight of each opponent by name; where it is empty, all bots alike. start:
        folder of the agent that it begins as; None: it begins anew.

        Raises ValueError for options that cannot be, CheckpointError where `start` is no agent's.
        """
        names = {name: source for name, (source, _) in met.items() if name not in self.bots}
        weights = {name: weight for name, (_, weight) in met.items()}
        opponent = {
            "warmup_frames": 50_000,
            **self.training.get("opponent", {}),
            "mixture": weights or dict.fromkeys(self.bots, 1.0),
            "agents": names,
            "snapshot_every_frames": ENDLESS_FRAMES,
            "snapshot_margin": None,
        }
        frames = self.first_round_frames if start is None else self.round_frames
        checkpoint = {"every_frames": max(1, frames // 4), **self.training.get("checkpoint", {})}
        about = {
            "checkpoint": checkpoint,
            "seed": derive_seed(self.seed, number, 0),
            "total_frames": frames,
        }
        config = build_config({**self.training, "opponent": opponent, **about})
        if start is None:
            return config
        from marl_cair.training.initial_network import begin_as

        return begin_as(start, config)


def load_psro(path: str | Path, allow_code: AllowCode = False) -> PsroSettings:
    """What a YAML file describes; what it leaves out has the defaults.

    allow_code: which code that it names may run; see `league.agents.allowed_code`.

    Raises:
        CodeNotAllowedError: it names agents that are code, and they are not allowed.
        ValueError: no such file, no YAML, an unknown option, or a value that is not allowed.
    """
    settings = build_psro(read_options(path))
    require_allowed(list_sources(settings.response_config(0, {}, None)), allow_code, path)
    return settings


def build_psro(values: Mapping[str, Any]) -> PsroSettings:
    """The same from nested plain values. Raises as `load_psro`."""
    settings: PsroSettings = build_value(PsroSettings, values)
    return settings


def fixed_options(settings: PsroSettings) -> dict[str, Any]:
    """What must stay the same when a folder is gone on with."""
    free = ("out", "rounds", "max_minutes")
    values = to_plain(dataclasses.asdict(settings))
    return {name: value for name, value in values.items() if name not in free}
