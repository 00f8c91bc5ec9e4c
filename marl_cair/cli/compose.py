"""`compose_config`: command-line words -> TrainConfig, by Hydra, refusing what is misspelt."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from marl_cair.cli.options import list_options
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.generative import GENERATORS
from marl_cair.lookup import find_by_name
from marl_cair.policies import NETWORKS
from marl_cair.training.config import NO_GENERATOR, SELF_PLAY, TrainConfig

CONFIG_FILE = "config.yaml"
SHORTHANDS = {
    "scenario": "game.scenario",
    "representation": "game.representation",
    "preset": "game.options.preset",
    "actions": "game.options.actions",
    "max_ticks": "game.options.max_ticks",
}
_ROOT = "marl_cair_train"


def list_groups() -> dict[str, dict[str, dict[str, Any]]]:
    """Group -> choice -> the settings that the choice changes: `policy=capsule` and the like."""
    bots = {name: None for game in GAMES for name in GAMES[game].bots}
    opponents: dict[str, dict[str, Any]] = {name: {"mixture": {name: 1.0}} for name in bots}
    opponents["self_play"] = {"mixture": SELF_PLAY}
    opponents["latest"] = {"mixture": {"latest": 1.0}}
    opponents["pool"] = {"mixture": {"pool": 1.0}}
    opponents["scripted"] = {"mixture": {"scripted": 1.0}}
    return {
        "game": {name: {"name": name, "scenario": GAMES[name].default_scenario} for name in GAMES},
        "policy": {name: {"body": name} for name in NETWORKS},
        "opponent": opponents,
        "generator": {name: {"name": name} for name in (*GENERATORS, NO_GENERATOR)},
    }


def compose_config(words: Sequence[str]) -> TrainConfig:
    """The configuration that `words` (`group=choice`, `option=value`) describe.

    Raises:
        UnknownNameError: an option or choice that does not exist; names the nearest.
        ValueError: a word that is no `name=value`, or a value that is not allowed.
    """
    overrides = [_read_word(word) for word in words]
    _register()
    try:
        GlobalHydra.instance().clear()
        with initialize(version_base="1.3", config_path=None):
            composed = compose(_ROOT, overrides=overrides)
        values = typing.cast(dict[str, Any], OmegaConf.to_container(composed, resolve=True))
        _replace_mixtures(values, words)
    except (HydraException, OmegaConfBaseException) as error:
        raise ValueError(f"{' '.join(words)}: {str(error).strip().splitlines()[0]}") from error
    return build_config(values)


def _read_word(word: str) -> str:
    """A word as Hydra takes it, its name checked."""
    name, equals, value = word.partition("=")
    if not equals:
        raise ValueError(f"{word!r} is no option: write name=value, for example seed=3")
    name = SHORTHANDS.get(name.lstrip("+"), name.lstrip("+"))
    groups = list_groups()
    if name in groups:
        find_by_name(f"{name} (marl-cair train {name}=...)", value, groups[name])
        return f"{name}={value}"
    for mapping in ("game.options", "opponent.mixture", "opponent.warmup_mixture"):
        if name == mapping or name.startswith(f"{mapping}."):
            return f"++{name}={value}"
    known = {option.path: None for option in list_options()} | dict.fromkeys(SHORTHANDS)
    find_by_name("option", name, known | dict.fromkeys(groups))
    return f"{name}={value}"


def _register() -> None:
    """Tell Hydra the defaults and the choices of each group."""
    store = ConfigStore.instance()
    defaults = _plain(dataclasses.asdict(TrainConfig()))
    groups = list_groups()
    for group, choices in groups.items():
        base = defaults.pop(group)
        for choice, changes in choices.items():
            # Mixtures and options are open dictionaries, so nothing here is closed to new keys;
            # misspelt options were refused before.
            store.store(name=choice, node={**base, **changes}, group=group)
    order: list[Any] = [{group: next(iter(choices))} for group, choices in groups.items()]
    store.store(name=_ROOT, node={"defaults": [*order, "_self_"], **defaults})


def _replace_mixtures(values: dict[str, Any], words: Sequence[str]) -> None:
    """A mixture that is given whole takes the place of the preset's, which Hydra would merge."""
    for word in words:
        name, _, text = word.partition("=")
        if name in ("opponent.mixture", "opponent.warmup_mixture"):
            given = OverridesParser.create().parse_override(f"{name}={text}").value()
            if not isinstance(given, dict):
                raise ValueError(f"{word}: write weights by name, for example {name}={{random:1}}")
            values["opponent"][name.partition(".")[2]] = {str(key): given[key] for key in given}


def build_config(values: Mapping[str, Any]) -> TrainConfig:
    """Dataclasses from nested plain values. Raises ValueError as their checks do."""
    config: TrainConfig = _build(TrainConfig, values)
    return config


def _build(kind: Any, value: Any, path: str = "") -> Any:
    """`value` as `kind`: dataclasses, tuples, optional values and plain numbers and text; `path`
    names it in errors.
    """
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        hints = typing.get_type_hints(kind)
        for name in value:
            find_by_name("option", name, hints)
        inside = f"{path}." if path else ""
        built = {name: _build(hints[name], value[name], inside + name) for name in value}
        if kind.__name__ == "GameSettings":
            built["options"] = _read_scenario_options(built)
        return kind(**built)
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        inner = next(part for part in parts if part is not type(None))
        return None if value is None else _build(inner, value, path)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"{path} is {value!r}, it must be a list, for example {path}=[a,b]")
        return tuple(_build(parts[0], item, path) for item in value)
    if origin is dict:
        return {name: _build(parts[1], value[name], f"{path}.{name}") for name in value}
    if kind is str and value is not None:
        return str(value)
    return _read_number(kind, value, path)


def _read_number(kind: Any, value: Any, path: str) -> Any:
    """Numbers of the right kind; 1e6 is a whole number, 1.5 is none."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind is float and is_number:
        return float(value)
    if kind is int and is_number and float(value).is_integer():
        return int(value)
    if kind in (int, float, bool) and not (kind is bool and isinstance(value, bool)):
        names = {int: "a whole number", float: "a number", bool: "true or false"}
        raise ValueError(f"{path} is {value!r}, it must be {names[kind]}")
    return value


def _read_scenario_options(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Options of the scenario with text kept as text: `preset=2017` arrives as a number."""
    options = dict(settings["options"])
    scenario = GAMES[settings["name"]].scenario(settings["scenario"])
    hints = typing.get_type_hints(type(scenario))
    for name, value in options.items():
        find_by_name(f"{settings['name']} option", name, hints)
        options[name] = _build(hints[name], value, f"game.options.{name}")
    return options


def save_config(config: TrainConfig) -> None:
    """Write the configuration to `<out>/config.yaml`, from which `resume` takes it."""
    text = OmegaConf.to_yaml(OmegaConf.create(_plain(dataclasses.asdict(config))))
    write_atomically(Path(config.out) / CONFIG_FILE, text)


def load_config(folder: str) -> TrainConfig:
    """The configuration of the run in `folder`.

    Raises:
        ValueError: the folder holds no run, or a damaged configuration.
    """
    path = Path(folder) / CONFIG_FILE
    if not path.is_file():
        raise ValueError(f"{folder} holds no run to resume: it has no {CONFIG_FILE}")
    try:
        values = typing.cast(dict[str, Any], OmegaConf.to_container(OmegaConf.load(path)))
    except Exception as error:  # whatever a damaged file makes the YAML reader raise
        raise ValueError(f"{path} cannot be read: {error}") from error
    return build_config(values)


def _plain(value: Any) -> Any:
    """Tuples as lists, all the way down: what YAML and Hydra hold."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
