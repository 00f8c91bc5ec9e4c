"""Configurations as plain nested values and as the `config.yaml` of a run's folder."""

from __future__ import annotations

import dataclasses
import io
import math
import os
import shlex
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.league.agents.allowed_code import AllowCode, is_code, require_allowed
from marl_cair.lookup import check_name, find_by_name
from marl_cair.outside import is_place
from marl_cair.stored import DamagedFileError, read_settings, sign_settings
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.config import GameSettings, TrainConfig

CONFIG_FILE = "config.yaml"
# Options that a resumed run may change, with their types: its limits, and what it runs on.
CHANGEABLE: dict[str, Any] = {"max_minutes": float | None, "stop_score": float | None}
CHANGEABLE |= {"total_frames": int, "device": str, "torch_threads": int | None}


def save_config(config: TrainConfig) -> None:
    """Write the configuration to `<out>/config.yaml`, which `resume` reads."""
    write_settings(config, Path(config.out) / CONFIG_FILE)


def write_settings(settings: Any, path: Path) -> None:
    """Write a dataclass of settings to `path` as YAML."""
    from omegaconf import OmegaConf

    text = OmegaConf.to_yaml(OmegaConf.create(to_plain(dataclasses.asdict(settings))))
    write_atomically(path, sign_settings(text))


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """Plain values of a YAML file, without interpolation: `${}` stays as it is written.

    Raises:
        ValueError: no YAML, too large a file, aliases (which can expand beyond any memory), or a
            text that does not match the checksum in its last line, if there is one.
    """
    from omegaconf import OmegaConf

    text = read_settings(path)
    try:
        if "*" in text and any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text)):
            raise ValueError("it holds aliases (*name): write out what they stand for")
        return OmegaConf.to_container(OmegaConf.load(io.StringIO(text)))
    except Exception as error:  # a damaged file can raise anything in the YAML reader
        reason = " ".join(f"{error}".split()) or type(error).__name__
        raise DamagedFileError(f"{path} cannot be read: {reason}") from error


def fixed_settings(config: TrainConfig) -> dict[str, Any]:
    """The settings that a resumed run must share: all but folder, beginnings and `CHANGEABLE`."""
    values = dataclasses.asdict(config)
    for free in ("out", *CHANGEABLE, "initial_agent", "initial_generator"):
        del values[free]
    return values


def load_config(folder: str | os.PathLike[str], allow_code: AllowCode = False) -> TrainConfig:
    """The configuration of the run in `folder`, with the present folder as `out`.

    allow_code: which code that it names may run; see `league.agents.allowed_code`.

    Raises:
        CodeNotAllowedError: it names agents that are code, and they are not allowed.
        ValueError: the folder holds no run, or a damaged configuration.
    """
    path = Path(folder) / CONFIG_FILE
    if not path.is_file():
        raise ValueError(f"{str(folder)!r} holds no run to resume: it has no {CONFIG_FILE}")
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise ValueError(f"{path} holds {values!r:.80}, it must be options by name")
    config: TrainConfig = read_stored(path, TrainConfig, values)
    config = dataclasses.replace(config, out=str(folder))
    require_allowed(list_sources(config), allow_code, path)
    return config


def names_code(config: TrainConfig) -> bool:
    """Whether a run has code from outside, which needs permission to be resumed."""
    return any(map(is_code, list_sources(config)))


def resume_command(config: TrainConfig) -> str:
    """The command line that resumes a run."""
    allow = " allow_code=true" if names_code(config) else ""
    return f"marl-cair train resume={shlex.quote(config.out)}{allow}"


def list_sources(config: TrainConfig) -> list[str]:
    """Names of code that a run may have: its agents, as `load_agent` takes them, and classes and
    functions `module:attribute` of networks, heads, losses, explorations, samplers and generators.
    """
    agents = [*config.opponent.agents.values(), *config.demonstration.agents.values()]
    names = [*config.opponent.mixture, config.generator.name]
    names += [config.learner.algorithm, config.exploration.kind, config.replay.sampler]
    return [*agents, *config.policy.list_code(), *filter(is_place, names)]


def learned_fields(config: TrainConfig) -> dict[str, Any]:
    """Fields of the scenario that the learner plays: with its own reward and discount."""
    fields = dataclasses.asdict(config.game.played_scenario) | {
        "reward": config.game.learned_reward
    }
    if "shaping_discount" in fields:
        fields["shaping_discount"] = config.learner.gamma
    return fields


def build_config(values: Mapping[str, Any]) -> TrainConfig:
    """Dataclasses from nested plain values. Raises ValueError as their checks do."""
    config: TrainConfig = build_value(TrainConfig, values)
    return config


def read_stored(path: Path, kind: Any, values: Any) -> Any:
    """`build_value` of the values in the file `path`, which its errors name."""
    try:
        return build_value(kind, values)
    except (ValueError, TypeError) as error:  # TypeError: a field is missing
        raise ValueError(f"{path}, perhaps of another version of marl_cair: {error}") from error


def build_value(kind: Any, value: Any, path: str = "") -> Any:
    """Convert plain `value` to `kind`: a dataclass, mapping, tuple, optional value, number or text.

    Raises ValueError that names `path` if the value is of another kind.
    """
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        inner = next(part for part in parts if part is not type(None))
        return None if value is None else build_value(inner, value, path)
    is_group = dataclasses.is_dataclass(kind) and isinstance(kind, type)
    if is_group or origin is dict:
        allowed = f"values by name: {path}.name=value"
        require(isinstance(value, Mapping), path, value, allowed)
        if is_group:
            return _build_group(kind, value, f"{path}." if path else "")
        return {name: build_value(parts[1], value[name], f"{path}.{name}") for name in value}
    if origin is tuple:
        require(isinstance(value, list | tuple), path, value, f"a list, for example {path}=[a,b]")
        return tuple(build_value(parts[0], item, path) for item in value)
    return _read_single(kind, value, path)


def _build_group(kind: Any, values: Mapping[str, Any], inside: str) -> Any:
    hints = typing.get_type_hints(kind)
    for name in values:
        check_name("option", name, hints)
    built = {name: build_value(hints[name], values[name], inside + name) for name in values}
    if kind is GameSettings:
        built["options"] = _read_changes(built, built.get("options", {}), "game.options")
    if kind is TrainConfig and "evaluation" in built:
        evaluation = built["evaluation"]
        game = dataclasses.asdict(built.get("game", GameSettings()))
        changes = evaluation.changes()
        own, *heldout = (_read_changes(game, changes[place], place) for place in changes)
        scenarios = dict(zip(evaluation.scenarios, heldout, strict=True))
        built["evaluation"] = dataclasses.replace(evaluation, options=own, scenarios=scenarios)
    return kind(**built)


_KINDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}


def _read_single(kind: Any, value: Any, path: str) -> Any:
    """A number, truth value or text; 1e6 is a whole number, 1.5 is none."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    require(not is_number or math.isfinite(value), path, value, "finite")
    if kind not in _KINDS:
        return value
    fits = {
        int: is_number and float(value).is_integer(),
        float: is_number,
        bool: isinstance(value, bool),
        str: value not in (None, ""),
    }
    require(fits[kind], path, value, _KINDS[kind])
    return kind(value)


def _read_changes(game: Mapping[str, Any], changes: Mapping[str, Any], path: str) -> dict[str, Any]:
    """Changed fields of a game's scenario, converted to the fields' types."""
    chosen = find_by_name("game", game.get("name", GameSettings.name), GAMES)
    scenario = chosen.scenario(game.get("scenario", GameSettings.scenario))
    return read_options(chosen.name, scenario, changes, path)


def read_options(game: str, scenario: Any, options: Mapping[str, Any], path: str) -> dict[str, Any]:
    """Convert `options` to the types of the fields of `scenario`; `preset=2017` stays a text.

    Raises:
        UnknownNameError: no such field; ValueError: a value of another kind, by `path`.
    """
    hints = typing.get_type_hints(type(scenario))
    for name in options:
        check_name(f"{game} option", name, hints)
    return {name: build_value(hints[name], options[name], f"{path}.{name}") for name in options}


def to_plain(value: Any) -> Any:
    """Tuples become lists, at any depth, as YAML and Hydra want them."""
    if isinstance(value, dict):
        return {name: to_plain(item) for name, item in value.items()}
    return [to_plain(item) for item in value] if isinstance(value, list | tuple) else value
