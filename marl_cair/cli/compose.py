"""`compose_config`: command-line words -> TrainConfig, by Hydra, refusing what is misspelt."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterable, Sequence
from typing import Any

from marl_cair.cli.options import list_options
from marl_cair.cli.parser import refuse_repeats
from marl_cair.games import GAMES
from marl_cair.generative import GENERATORS
from marl_cair.lookup import find_by_name
from marl_cair.policies import NETWORKS
from marl_cair.self_play.samplers import LEAGUE_SAMPLERS, SAMPLERS
from marl_cair.training.settings.config import NO_GENERATOR, SELF_PLAY, TrainConfig
from marl_cair.training.settings.config_file import build_config, to_plain
from marl_cair.training.settings.recipes import RECIPES

SHORTHANDS = {
    "scenario": "game.scenario",
    "representation": "game.representation",
    "preset": "game.options.preset",
    "actions": "game.options.actions",
    "max_ticks": "game.options.max_ticks",
    "map": "game.options.map",
    "heldout_map": "evaluation.scenarios.heldout.map",
}
_RECIPE = "recipe"
# Values by names of the user's own.
_OPEN = (
    "game.options",
    "opponent.mixture",
    "opponent.warmup_mixture",
    "opponent.agents",
    "demonstration.agents",
    "evaluation.options",
    "evaluation.scenarios",
)
_ROOT = "marl_cair_train"


def list_groups() -> dict[str, dict[str, dict[str, Any]]]:
    """Group -> choice -> the settings that the choice changes: `policy=capsule` and the like."""
    games = GAMES.ask_each(lambda game: (game.default_scenario, tuple(game.bots)))
    bots = {name: None for _, names in games.values() for name in names}
    opponents: dict[str, dict[str, Any]] = {"self_play": {"mixture": SELF_PLAY}}
    for name in (*(name for name in SAMPLERS if name not in LEAGUE_SAMPLERS), *bots):
        opponents[name] = {"mixture": {name: 1.0}}
    return {
        "game": {
            name: {"name": name, "scenario": scenario} for name, (scenario, _) in games.items()
        },
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
    from hydra import compose, initialize
    from hydra.core.global_hydra import GlobalHydra
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    refuse_repeats(words, [full_name(word) for word in words])
    words = expand_recipe(words)
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


def expand_recipe(words: Sequence[str]) -> list[str]:
    """`recipe=NAME` gives way to the recipe's words, less those whose option or group is given.

    Raises:
        UnknownNameError: no such recipe; names the nearest.
    """
    named = [word.partition("=")[2] for word in words if word.partition("=")[0] == _RECIPE]
    rest = [word for word in words if word.partition("=")[0] != _RECIPE]
    if not named:
        return rest
    return override(find_by_name("recipe", named[0], RECIPES).words, rest)


def override(defaults: Iterable[str], words: Sequence[str]) -> list[str]:
    """`words`, and before them those of `defaults` whose option or group they do not set."""
    given = {name for word in words for name in _find_set_options(word)}
    chosen = {full_name(word) for word in words}
    kept = [
        word
        for word in defaults
        if full_name(word) not in chosen
        and not any(f"{full_name(word)}.".startswith(f"{name}.") for name in given)
    ]
    return [*kept, *words]


def _find_set_options(word: str) -> list[str]:
    """The options that a word sets: of a group, those that its choice changes."""
    name, choice = full_name(word), word.partition("=")[2]
    groups = list_groups()
    if name not in groups:
        return [name]
    return [f"{name}.{option}" for option in groups[name].get(choice, ())]


def full_name(word: str) -> str:
    """The option or group that a word sets, where it is a shorthand too."""
    name = word.partition("=")[0].lstrip("+")
    return SHORTHANDS.get(name, name)


def read_value(word: str) -> Any:
    """The value of `name=value` as Hydra reads it. Raises ValueError where it cannot."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        return OverridesParser.create().parse_override(word).value()
    except HydraException as error:
        raise ValueError(f"{word}: {str(error).strip().splitlines()[0]}") from error


def _read_word(word: str) -> str:
    """A word as Hydra takes it, its name checked."""
    _, equals, value = word.partition("=")
    if not equals:
        raise ValueError(f"{word!r} is no option: write name=value, for example seed=3")
    name = full_name(word)
    groups = list_groups()
    if name in groups:
        find_by_name(f"{name} (marl-cair train {name}=...)", value, groups[name])
        return f"{name}={value}"
    for mapping in _OPEN:
        if name == mapping or name.startswith(f"{mapping}."):
            return f"++{name}={value}"
    known = {option.path: None for option in list_options()} | dict.fromkeys(SHORTHANDS)
    find_by_name("option", name, known | dict.fromkeys([*groups, _RECIPE]))
    return f"{name}={value}"


def _register() -> None:
    """Tell Hydra the defaults and the choices of each group."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    defaults = to_plain(dataclasses.asdict(TrainConfig()))
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
    """A mixture that is given whole takes the place of the preset's, which Hydra would merge;
    single weights beside it change it.
    """
    names = [word.partition("=")[0] for word in words]
    for word in words:
        name, _, text = word.partition("=")
        if name in ("opponent.mixture", "opponent.warmup_mixture"):
            given = read_value(f"{name}={text}")
            if not isinstance(given, dict):
                raise ValueError(f"{word}: write weights by name, for example {name}={{random:1}}")
            mixture = values["opponent"][name.partition(".")[2]]
            single = [
                other.removeprefix(f"{name}.") for other in names if other.startswith(f"{name}.")
            ]
            values["opponent"][name.partition(".")[2]] = {
                **{str(key): given[key] for key in given},
                **{who: mixture[who] for who in single},
            }
