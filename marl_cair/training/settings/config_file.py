"""Configurations as plain nested values and as the `config.yaml` of a run's folder."""

from __future__ import annotations

import dataclasses
import io
import math
import os
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.lookup import find_by_name
from marl_cair.stored import DamagedFileError, read_settings, sign_settings
from marl_cair.training.settings.config import (
    RENAMED_OPTIONS,
    EvaluationSettings,
    GameSettings,
    OpponentSettings,
    TrainConfig,
)

CONFIG_FILE = "config.yaml"
# What ends a run; a resumed run may have other values.
ENDS = {"total_frames": int, "max_minutes": float | None, "stop_score": float | None}


def save_config(config: TrainConfig) -> None:
    """Write the configuration to `<out>/config.yaml`, from which `resume` takes it."""
    write_settings(config, Path(config.out) / CONFIG_FILE)


def write_settings(settings: Any, path: Path) -> None:
    """Write a dataclass of settings to `path` as YAML."""
    from omegaconf import OmegaConf

    text = OmegaConf.to_yaml(OmegaConf.create(to_plain(dataclasses.asdict(settings))))
    write_atomically(path, sign_settings(text))


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """Plain values of a YAML file; what stands in `${}` stays as it is written.

    Raises:
        ValueError: no YAML, too large a file, aliases, which can stand for more than any memory
            holds, or a text that the checksum in its last line, where there is one, is not of.
    """
    from omegaconf import OmegaConf

    text = read_settings(path)
    try:
        if "*" in text and any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text)):
            raise ValueError("it holds aliases (*name): write out what they stand for")
        return OmegaConf.to_container(OmegaConf.load(io.StringIO(text)))
    except Exception as error:  # whatever a damaged file makes the YAML reader raise
        told = " ".join(f"{error}".split()) or type(error).__name__
        raise DamagedFileError(f"{path} cannot be read: {told}") from error


def fixed_settings(config: TrainConfig) -> dict[str, Any]:
    """The settings that a resumed run must share: all but how long, where, and whence."""
    values = dataclasses.asdict(config)
    for free in ("out", *ENDS, "initial_agent", "initial_generator"):
        del values[free]
    return values


def load_config(folder: str | os.PathLike[str], allow_code: AllowCode = False) -> TrainConfig:
    """The configuration of the run in `folder`, with `out` where the folder lies now.

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
    config = dataclasses.replace(build_config(values), out=str(folder))
    require_allowed(list_sources(config), allow_code, path)
    return config


def list_sources(config: TrainConfig) -> list[str]:
    """The agents that a run loads by name, as `load_agent` takes them."""
    return [*config.opponent.agents.values(), *config.demonstration.agents.values()]


def build_config(values: Mapping[str, Any]) -> TrainConfig:
    """Dataclasses from nested plain values. Raises ValueError as their checks do."""
    config: TrainConfig = build_value(TrainConfig, values)
    return config


def build_value(kind: Any, value: Any, path: str = "") -> Any:
    """`value` as `kind`: dataclasses, tuples, optional values and plain numbers and text.

    Raises ValueError that names `path` where the value is of another kind.
    """
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        inner = next(part for part in parts if part is not type(None))
        return None if value is None else build_value(inner, value, path)
    is_group = dataclasses.is_dataclass(kind) and isinstance(kind, type)
    if (is_group or origin is dict) and not isinstance(value, Mapping):
        raise ValueError(f"{path} is {value!r}, it must be values by name: {path}.name=value")
    if is_group:
        return _build_group(kind, value, f"{path}." if path else "")
    if origin is dict:
        return {name: build_value(parts[1], value[name], f"{path}.{name}") for name in value}
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"{path} is {value!r}, it must be a list, for example {path}=[a,b]")
        return tuple(build_value(parts[0], item, path) for item in value)
    if kind is str:
        if value is None or value == "":
            raise ValueError(f"{path} is {value!r}, it must be a text")
        return str(value)
    return _read_number(kind, value, path)


def _build_group(kind: Any, values: Mapping[str, Any], inside: str) -> Any:
    hints = typing.get_type_hints(kind)
    for name in values:
        if name in RENAMED_OPTIONS and kind is OpponentSettings:
            raise ValueError(
                f"{inside}{name} is called {inside}{RENAMED_OPTIONS[name]} now; a run of a "
                "marl_cair from before cannot be resumed, its agents play on"
            )
        find_by_name("option", name, hints)
    built = {name: build_value(hints[name], values[name], inside + name) for name in values}
    if kind is GameSettings:
        options = built.get("options", {})
        built["options"] = _read_scenario_options(built, options, "game.options")
    if kind is TrainConfig and "evaluation" in built:
        built["evaluation"] = _read_evaluation(built)
    return kind(**built)


def _read_evaluation(built: Mapping[str, Any]) -> EvaluationSettings:
    evaluation: EvaluationSettings = built["evaluation"]
    game = dataclasses.asdict(built.get("game", GameSettings()))
    own, *heldout = (
        _read_scenario_options(game, options, place)
        for place, options in evaluation.changes().items()
    )
    scenarios = dict(zip(evaluation.scenarios, heldout, strict=True))
    return dataclasses.replace(evaluation, options=own, scenarios=scenarios)


def _read_number(kind: Any, value: Any, path: str) -> Any:
    """Numbers of the right kind; 1e6 is a whole number, 1.5 is none."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and not math.isfinite(value):
        raise ValueError(f"{path} is {value!r}, it must be finite")
    if kind is float and is_number:
        return float(value)
    if kind is int and is_number and float(value).is_integer():
        return int(value)
    if kind in (int, float, bool) and not (kind is bool and isinstance(value, bool)):
        names = {int: "a whole number", float: "a number", bool: "true or false"}
        raise ValueError(f"{path} is {value!r}, it must be {names[kind]}")
    return value


def _read_scenario_options(
    settings: Mapping[str, Any], options: Mapping[str, Any], path: str
) -> dict[str, Any]:
    """Options of the scenario with text kept as text: `preset=2017` arrives as a number."""
    game = find_by_name("game", settings.get("name", GameSettings.name), GAMES)
    scenario = game.scenario(settings.get("scenario", GameSettings.scenario))
    return read_options(game.name, scenario, options, path)


def read_options(game: str, scenario: Any, options: Mapping[str, Any], path: str) -> dict[str, Any]:
    """`options` as the fields of `scenario` want them.

    Raises:
        UnknownNameError: no such field; ValueError: a value of another kind, by `path`.
    """
    hints = typing.get_type_hints(type(scenario))
    for name in options:
        find_by_name(f"{game} option", name, hints)
    return {
        name: build_value(hints[name], value, f"{path}.{name}") for name, value in options.items()
    }


def to_plain(value: Any) -> Any:
    """Tuples as lists, all the way down: what YAML and Hydra hold."""
    if isinstance(value, dict):
        return {name: to_plain(item) for name, item in value.items()}
    return [to_plain(item) for item in value] if isinstance(value, list | tuple) else value
