"""Settings of a league of learners, and the YAML file that they are written in."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.games import GAMES
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.lookup import find_by_name
from marl_cair.self_play.shared_folder import LEAGUE_EXPLOITER, MAIN, MAIN_EXPLOITER, ROLES
from marl_cair.training.settings.checks import require, require_once
from marl_cair.training.settings.config import OpponentSettings, TrainConfig
from marl_cair.training.settings.config_file import (
    build_config,
    build_value,
    list_sources,
    read_yaml,
    to_plain,
)

# What the league says for its learners.
_TAKEN = ("out", "seed", "total_frames", "max_minutes", "stop_score")
_TAKEN_OPPONENT = ("mixture", "warmup_mixture", "snapshot_every_frames", "snapshot_margin")


@dataclass(frozen=True)
class RoleSettings:
    """The learners of one role, after AlphaStar (Vinyals et al. 2019, "Grandmaster level in
    StarCraft II using multi-agent reinforcement learning", methods, and its pseudocode).
    """

    learners: int = 1  # how many learners of this role
    mixture: dict[str, float] = field(  # weights by name of who is met, as opponent.mixture
        default_factory=lambda: {"pfsp": 1.0}
    )
    warmup_mixture: dict[str, float] = field(  # weights by name in opponent.warmup_frames
        default_factory=lambda: {"random": 1.0}
    )
    snapshot_every_frames: int = 100_000  # frames after which a player is frozen in any case
    snapshot_margin: float | None = 0.2  # sooner if a win rate surely above 1/2 by it; null: never
    reset_chance: float = 0.0  # that the learner begins anew once it has frozen a player
    begins_as_main: bool = False  # anew means with a main agent's network then, not with a new one
    training: dict[str, Any] = field(  # options of `marl-cair train` for this role alone, by group
        default_factory=dict
    )


def _main() -> RoleSettings:
    # AlphaStar: 35 % self-play, 50 % PFSP over all past players, 15 % who is forgotten; a twentieth
    # of bots keeps it from losing to what nobody in the league plays.
    mixture = {"main_self_play": 0.33, "pfsp": 0.48, "forgotten": 0.14, "bots": 0.05}
    return RoleSettings(mixture=mixture, snapshot_margin=0.1)


def _main_exploiter() -> RoleSettings:
    # A new network loses every game against a main agent of some age, and learns nothing by it.
    return RoleSettings(mixture={"main_agents": 1.0}, reset_chance=1.0, begins_as_main=True)


def _league_exploiter() -> RoleSettings:
    return RoleSettings(mixture={"pfsp": 1.0}, reset_chance=0.25)


@dataclass(frozen=True)
class LeagueSettings:
    """A league of learners."""

    out: str = "runs/league_train"  # output folder
    seed: int = 0  # of everything random in the league
    total_frames: int = 1_000_000  # decisions of one world, of each learner; the league ends there
    slice_frames: int = 50_000  # decisions of a learner before the next one's turn
    max_minutes: float | None = None  # of this sitting; null: no limit
    final_games: int = 40  # games of each pair in the evaluation at the end; 0: none
    final_bots: tuple[str, ...] = ("random",)  # bots that take part in it
    final_past: int = 4  # players that each learner froze last, which take part in it too
    main: RoleSettings = field(default_factory=_main)
    main_exploiter: RoleSettings = field(default_factory=_main_exploiter)
    league_exploiter: RoleSettings = field(default_factory=_league_exploiter)
    training: dict[str, Any] = field(  # options of `marl-cair train` for all learners, by group
        default_factory=dict
    )

    def __post_init__(self) -> None:
        for name in ("total_frames", "slice_frames"):
            require(getattr(self, name) >= 1, name, getattr(self, name), "1 or more")
        require(0 <= self.seed < 2**63, "seed", self.seed, "0 or more")
        minutes, games = self.max_minutes, self.final_games
        require(minutes is None or minutes > 0, "max_minutes", minutes, "above 0, or null")
        require(games >= 0, "final_games", games, "0 or more")
        require(self.final_past >= 0, "final_past", self.final_past, "0 or more")
        for name in ROLES:
            role = self.role(name)
            require(role.learners >= 0, f"{name}.learners", role.learners, "0 or more")
            chance = role.reset_chance
            require(0 <= chance <= 1, f"{name}.reset_chance", chance, "a chance in 0..1")
        require(self.main.learners >= 1, "main.learners", self.main.learners, "1 or more")
        self._check_learners()

    def _check_learners(self) -> None:
        main = self.learner_config(MAIN).game
        for name in (MAIN_EXPLOITER, LEAGUE_EXPLOITER):
            if self.role(name).learners:
                other = self.learner_config(name).game
                played = (other.name, other.scenario, other.options)
                if played != (main.name, main.scenario, main.options):
                    raise ValueError(f"{name}.training.game is another than main's: all play one")
                allowed = f"{main.representation!r} as main's: they play one another's past"
                seen, place = other.representation, f"{name}.training.game.representation"
                require(seen == main.representation, place, seen, allowed)
        game = GAMES[main.name]
        teams = game.make_spec(game.scenario(main.scenario, **main.options)).num_teams
        allowed = "a scenario of two or more teams: a league is of rivals"
        require(teams > 1, "training.game.scenario", main.scenario, allowed)
        games = self.final_games
        allowed = "even: every map seed is played once in each seat"
        require(teams != 2 or games % 2 == 0, "final_games", games, allowed)
        for bot in self.final_bots:
            find_by_name(f"{game.name} bot", bot, game.bots)
        require_once("final_bots", self.final_bots)

    def role(self, name: str) -> RoleSettings:
        """The settings of one of ROLES."""
        settings: RoleSettings = getattr(self, name)
        return settings

    @property
    def learners(self) -> list[tuple[str, str]]:
        """Name and role of each, in the order of their turns: main agents first."""
        return [(f"{role}_{n}", role) for role in ROLES for n in range(self.role(role).learners)]

    def list_sources(self) -> list[str]:
        """The agents that the learners load by name, beside one another."""
        roles = {role for _, role in self.learners}
        return [one for role in sorted(roles) for one in list_sources(self.learner_config(role))]

    def learner_config(self, role: str, out: str = "unused", seed: int = 0) -> TrainConfig:
        """The training of a learner of `role`. Raises ValueError for options that cannot be."""
        settings = self.role(role)
        for place, given in (("training", self.training), (f"{role}.training", settings.training)):
            refuse_given(place, given, _TAKEN, "the league has its own, {name}")
            why = "set it for a role, main.{name}"
            opponent = given.get("opponent", {})
            allowed = f"options by name: {place}.opponent.name"
            require(isinstance(opponent, Mapping), f"{place}.opponent", opponent, allowed)
            refuse_given(f"{place}.opponent", opponent, _TAKEN_OPPONENT, why)
        values = _merge(self.training, settings.training)
        opponent = {
            **values.get("opponent", {}),
            **{name: getattr(settings, name) for name in _TAKEN_OPPONENT},
        }
        if not opponent.get("warmup_frames", OpponentSettings.warmup_frames):
            del opponent["warmup_mixture"]
        return build_config({**values, "opponent": opponent, "out": out, "seed": seed})


def derive_seed(seed: int, learner: int, generation: int) -> int:
    """The seed of one generation of one learner, by its place in the order of turns."""
    words = np.random.SeedSequence([seed, learner, generation]).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


def load_league(path: str | Path, allow_code: AllowCode = False) -> LeagueSettings:
    """The league that a YAML file describes; what it leaves out has the defaults.

    allow_code: which code that it names may run; see `league.agents.allowed_code`.

    Raises:
        CodeNotAllowedError: it names agents that are code, and they are not allowed.
        ValueError: no such file, no YAML, an unknown option, or a value that is not allowed.
    """
    settings = build_league(read_options(path))
    require_allowed(settings.list_sources(), allow_code, path)
    return settings


def read_options(path: str | Path) -> dict[str, Any]:
    """What stands in a YAML file. Raises ValueError: no such file, no YAML, or no options."""
    place = Path(path)
    if not place.is_file():
        raise ValueError(f"{path} is no file: give a YAML file, or begin with --example")
    values = read_yaml(place)
    if not isinstance(values, dict) or not values:  # an empty file is hardly meant
        raise ValueError(f"{path} must hold options by name, for example seed: 3")
    return typing.cast(dict[str, Any], values)


def build_league(values: Mapping[str, Any]) -> LeagueSettings:
    """A league from nested plain values. Raises as `load_league`."""
    filled = dict(values)
    for name, default in (
        (MAIN, _main()),
        (MAIN_EXPLOITER, _main_exploiter()),
        (LEAGUE_EXPLOITER, _league_exploiter()),
    ):
        given = filled.get(name) or {}
        if not isinstance(given, Mapping):
            raise ValueError(f"{name} is {given!r}, it must be options by name")
        filled[name] = {**to_plain(dataclasses.asdict(default)), **given}
    league: LeagueSettings = build_value(LeagueSettings, filled)
    return league


def refuse_given(place: str, given: object, names: Collection[str], advice: str) -> None:
    """Raise ValueError where one of `names` is given at `place`; the advice may hold {name}. What
    are no options by name is left to who reads them.
    """
    for name in names:
        if isinstance(given, Mapping) and name in given:
            raise ValueError(f"{place}.{name} is given: {advice.format(name=name)}")


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values, those of `changes` first; a mapping in a group is replaced whole."""
    merged = dict(base)
    for name, value in changes.items():
        below = merged.get(name)
        is_group = isinstance(value, Mapping) and isinstance(below, Mapping)
        merged[name] = {**below, **value} if is_group and below is not None else value
    return merged
