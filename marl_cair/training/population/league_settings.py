"""Settings of a league of learners, and the YAML file that they are written in."""

from __future__ import annotations

import typing
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.games import GAMES
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.lookup import check_name
from marl_cair.self_play.shared_folder import LEAGUE_EXPLOITER, MAIN, MAIN_EXPLOITER, ROLES
from marl_cair.training.settings import checks, config_file
from marl_cair.training.settings.checks import Count, Natural, Positive, Seed, Share, require
from marl_cair.training.settings.config import TrainConfig

# Options that the league sets for its learners.
_TAKEN = ("out", "seed", "total_frames", "max_minutes", "stop_score")
_TAKEN_OPPONENT = ("mixture", "snapshot_every_frames", "snapshot_margin")
_ROLE_DEFAULTS: dict[str, dict[str, Any]] = {
    # AlphaStar: 35 % self-play, 50 % PFSP over all past players, 15 % forgotten ones. A twentieth
    # of bots keeps it from losing to strategies that no league member plays.
    MAIN: {
        "mixture": {"main_self_play": 0.33, "pfsp": 0.48, "forgotten": 0.14, "bots": 0.05},
        "snapshot_margin": 0.1,
    },
    # A new network loses every game against a main agent of some age, and learns nothing from it.
    MAIN_EXPLOITER: {"mixture": {"main_agents": 1.0}, "reset_chance": 1.0, "begins_as_main": True},
    LEAGUE_EXPLOITER: {"mixture": {"pfsp": 1.0}, "reset_chance": 0.25},
}


@dataclass(frozen=True)
class RoleSettings:
    """The learners of one role, after AlphaStar (Vinyals et al. 2019, "Grandmaster level in
    StarCraft II using multi-agent reinforcement learning", methods, and its pseudocode).
    """

    learners: Natural = 1  # how many learners of this role
    mixture: dict[str, float] = field(default_factory={"pfsp": 1.0}.copy)  # as opponent.mixture
    snapshot_every_frames: int = 100_000  # frames after which a player is frozen in any case
    snapshot_margin: float | None = 0.2  # sooner if a win rate surely above 1/2 by it; null: never
    reset_chance: Share = 0.0  # that the learner is reset once it has frozen a player
    begins_as_main: bool = False  # a reset learner has a main agent's network, not a new one
    training: dict[str, Any] = field(default_factory=dict)  # options of `marl-cair train`, by group


@dataclass(frozen=True)
class LeagueSettings:
    """A league of learners."""

    out: str = "runs/league_train"  # output folder
    seed: Seed = 0  # of everything random in the league
    total_frames: Count = 1_000_000  # environment steps of each learner; the league ends there
    slice_frames: Count = 50_000  # environment steps of a learner before the next one's turn
    max_minutes: Positive | None = None  # of this call; null: no limit
    final_games: Natural = 40  # games of each pair in the evaluation at the end; 0: none
    final_bots: tuple[str, ...] = ("random",)  # bots that take part in it
    final_past: Natural = 4  # players that each learner froze last, which take part in it too
    main: RoleSettings = field(default_factory=partial(RoleSettings, **_ROLE_DEFAULTS[MAIN]))
    main_exploiter: RoleSettings = field(
        default_factory=partial(RoleSettings, **_ROLE_DEFAULTS[MAIN_EXPLOITER])
    )
    league_exploiter: RoleSettings = field(
        default_factory=partial(RoleSettings, **_ROLE_DEFAULTS[LEAGUE_EXPLOITER])
    )
    training: dict[str, Any] = field(default_factory=dict)  # options of `marl-cair train`, by group

    def __post_init__(self) -> None:
        checks.check_fields(self)
        for name in ROLES:
            checks.check_fields(self.role(name), f"{name}.")
        require(self.main.learners >= 1, "main.learners", self.main.learners, "1 or more")
        main = self.learner_config(MAIN).game
        for name in (MAIN_EXPLOITER, LEAGUE_EXPLOITER):
            if self.role(name).learners:
                other = self.learner_config(name).game
                played = (other.name, other.scenario, other.options)
                if played != (main.name, main.scenario, main.options):
                    raise ValueError(f"{name}.training.game is another than main's: all play one")
                seen, place = other.representation, f"{name}.training.game.representation"
                allowed = f"{main.representation!r} as main's: they play one another's past"
                require(seen == main.representation, place, seen, allowed)
        teams, games = main.spec.num_teams, self.final_games
        allowed = "a scenario of two or more teams: a league is of rivals"
        require(teams > 1, "training.game.scenario", main.scenario, allowed)
        allowed = "even: every map seed is played once in each seat"
        require(teams != 2 or games % 2 == 0, "final_games", games, allowed)
        for bot in self.final_bots:
            check_name(f"{main.name} bot", bot, GAMES[main.name].bots)
            GAMES[main.name].bot(bot, main.rated_scenario)  # raises for one that cannot play there
        checks.require_once("final_bots", self.final_bots)
        is_league = not games or len(self.learners) + len(self.final_bots) > 1
        require(is_league, "final_bots", [], "one or more with one learner, or final_games=0")

    def role(self, name: str) -> RoleSettings:
        """The settings of one of ROLES."""
        settings: RoleSettings = getattr(self, name)
        return settings

    @property
    def learners(self) -> list[tuple[str, str]]:
        """Name and role of each, in the order of their turns: main agents first."""
        return [(f"{role}_{n}", role) for role in ROLES for n in range(self.role(role).learners)]

    def list_sources(self) -> list[str]:
        """Sources of the agents that the learners load, beside one another."""
        configs = [
            self.learner_config(role) for role in sorted({role for _, role in self.learners})
        ]
        return [source for config in configs for source in config_file.list_sources(config)]

    def learner_config(self, role: str, out: str = "unused", seed: int = 0) -> TrainConfig:
        """The training of a learner of `role`. Raises ValueError for options that are refused."""
        settings = self.role(role)
        for place, given in (("training", self.training), (f"{role}.training", settings.training)):
            refuse_given(place, given, _TAKEN, "the league has its own, {name}")
            opponent = given.get("opponent", {})
            allowed = f"options by name: {place}.opponent.name"
            require(isinstance(opponent, Mapping), f"{place}.opponent", opponent, allowed)
            refuse_given(
                f"{place}.opponent", opponent, _TAKEN_OPPONENT, "set it for a role, main.{name}"
            )
        values = _merge(self.training, settings.training)
        own = {name: getattr(settings, name) for name in _TAKEN_OPPONENT}
        opponent = {**values.get("opponent", {}), **own}
        return config_file.build_config({**values, "opponent": opponent, "out": out, "seed": seed})


def derive_seed(seed: int, learner: int, generation: int) -> int:
    """The seed of one generation of one learner, by its place in the order of turns."""
    words = np.random.SeedSequence([seed, learner, generation]).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


def load_settings(
    path: str | Path, build: Callable[[Mapping[str, Any]], Any], allow_code: AllowCode = False
) -> Any:
    """The league or the responses that a YAML file describes; missing options have their defaults.

    build: `build_league` or `psro_settings.build_psro`.
    allow_code: which code that it names may run; see `league.agents.allowed_code`.

    Raises:
        CodeNotAllowedError: it names agents that are code, and they are not allowed.
        ValueError: no such file, no YAML, an unknown option, or a value that is not allowed.
    """
    settings = build(read_options(path))
    require_allowed(settings.list_sources(), allow_code, path)
    return settings


def read_options(path: str | Path) -> dict[str, Any]:
    """Options in a YAML file. Raises ValueError: no such file, no YAML, or no options."""
    place = Path(path)
    if not place.is_file():
        raise ValueError(f"{path} is no file: give a YAML file, or begin with --example")
    values = config_file.read_yaml(place)
    if not isinstance(values, dict) or not values:  # an empty file is a mistake
        raise ValueError(f"{path} must hold options by name, for example seed: 3")
    return typing.cast(dict[str, Any], values)


def build_league(values: Mapping[str, Any]) -> LeagueSettings:
    """A league from nested plain values. Raises ValueError as its checks do."""
    filled = dict(values)
    for name, defaults in _ROLE_DEFAULTS.items():
        given = filled.get(name) or {}
        require(isinstance(given, Mapping), name, given, "options by name")
        filled[name] = {**defaults, **given}
    league: LeagueSettings = config_file.build_value(LeagueSettings, filled)
    return league


def refuse_given(place: str, given: object, names: Collection[str], advice: str) -> None:
    """Raise ValueError if one of `names` is given at `place`; the advice may hold {name}. A value
    that is no mapping passes: its reader refuses it.
    """
    for name in names:
        if isinstance(given, Mapping) and name in given:
            raise ValueError(f"{place}.{name} is given: {advice.format(name=name)}")


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values, with `changes` over `base`; a mapping within a group is replaced whole."""
    merged = dict(base)
    for name, value in changes.items():
        below = merged.get(name)
        is_group = isinstance(value, Mapping) and isinstance(below, Mapping)
        merged[name] = {**below, **value} if is_group and below is not None else value
    return merged
