"""Settings of policy-space response oracles, and the YAML file that they are written in."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from marl_cair.games import GAMES
from marl_cair.league.agents.mixtures import SLACK
from marl_cair.lookup import check_name
from marl_cair.training.population.league_settings import derive_seed, refuse_given
from marl_cair.training.settings import checks, config_file
from marl_cair.training.settings.checks import Allowed, Count, Positive, Seed, Share, require
from marl_cair.training.settings.config import ENDLESS_FRAMES, GameSettings, TrainConfig

# Options that a round sets for its response.
_TAKEN = ("out", "seed", "total_frames", "max_minutes", "stop_score", "initial_agent")
_TAKEN_OPPONENT = ("mixture", "agents", "snapshot_every_frames", "snapshot_margin")
_Slack = Annotated[float, Allowed(lambda x: 0 < x < 1, "above 0, below 1")]
_Pairs = Annotated[int, Allowed(lambda n: n >= 2 and n % 2 == 0, "even and 2 or more")]


@dataclass(frozen=True)
class PsroSettings:
    """Best responses, one after the other, each to mixtures of all earlier agents: policy-space
    response oracles (Lanctot et al. 2017, "A unified game-theoretic approach to multiagent
    reinforcement learning"), between two teams.
    """

    out: str = "runs/psro"  # output folder
    seed: Seed = 0  # of everything random
    rounds: Count = 8  # best responses, one after the other
    round_frames: Count = 200_000  # environment steps in which a response learns
    first_round_frames: Count = 400_000  # the same for a response that begins with a new network
    max_minutes: Positive | None = None  # of this call; null: no limit
    begin_with: tuple[str, ...] = ()  # agents that take part from the start: checkpoint folders
    bots: tuple[str, ...] = ("random",)  # opponents that the mixture is to be safe against too
    games_per_pair: _Pairs = 40  # games of each pair, by which agents are weighed
    even_share: Share = 0.25  # of a response's games, with all agents alike as opponents
    slack: _Slack = SLACK  # of a mixture's least score (0..1), that its evenness may cost
    training: dict[str, Any] = field(default_factory=dict)  # options of `marl-cair train`, by group

    def __post_init__(self) -> None:
        checks.check_fields(self)
        checks.require_once("begin_with", self.begin_with)
        checks.require_once("bots", self.bots)
        require(len(self.bots) > 0, "bots", [], "one or more: the first opponents")
        refuse_given("training", self.training, _TAKEN, "each response has its own")
        advice = "opponents are bots, begin_with, and earlier responses"
        refuse_given("training.opponent", self.training.get("opponent"), _TAKEN_OPPONENT, advice)
        for bot in self.bots:
            check_name(f"{self.game.name} bot", bot, GAMES[self.game.name].bots)
        allowed = "a scenario of two teams: a mixture is solved for two"
        is_of_two = self.game.spec.num_teams == 2
        require(is_of_two, "training.game.scenario", self.game.scenario, allowed)
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
        """The game of all responses."""
        return config_file.build_config(self.training).game

    def response_config(
        self, number: int, met: Mapping[str, tuple[str, float]], start: str | None
    ) -> TrainConfig:
        """The training of response `number`, 0, 1, ..., but for its folder.

        met: source and weight of each opponent by name; empty: all bots, evenly. start: folder of
        the agent that it begins as; None: a new network.

        Raises ValueError for options that are refused, CheckpointError if `start` is no agent's.
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
        config = config_file.build_config({**self.training, "opponent": opponent, **about})
        if start is None:
            return config
        from marl_cair.training.initial_network import begin_as

        return begin_as(start, config)

    def list_sources(self) -> list[str]:
        """Names of code, as `config_file.list_sources`."""
        return config_file.list_sources(self.response_config(0, {}, None))


def build_psro(values: Mapping[str, Any]) -> PsroSettings:
    """The settings from nested plain values. Raises ValueError as their checks do."""
    settings: PsroSettings = config_file.build_value(PsroSettings, values)
    return settings


def fixed_options(settings: PsroSettings) -> dict[str, Any]:
    """The settings that a continued run must share."""
    values = config_file.to_plain(dataclasses.asdict(settings)).items()
    return {name: value for name, value in values if name not in ("out", "rounds", "max_minutes")}
