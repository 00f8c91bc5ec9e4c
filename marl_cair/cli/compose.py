"""Compose the configurations of `marl-cair train` from command-line words, with Hydra.

Hydra composes `marl_cair/conf/train.yaml` on structured configs made from the settings'
dataclasses. It writes nothing: training starts when all jobs are composed.
"""

from __future__ import annotations

import dataclasses
import os
import re
import sys
import tempfile
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.resources import files
from typing import Any, NamedTuple

from marl_cair.cli.parser import refuse_repeats
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.generative import GENERATORS
from marl_cair.lookup import UnknownNameError, check_name
from marl_cair.policies import NETWORKS
from marl_cair.self_play.samplers import LEAGUE_SAMPLERS, SAMPLERS
from marl_cair.training.settings.config import GameSettings, TrainConfig
from marl_cair.training.settings.config_file import build_config, build_value
from marl_cair.training.settings.learner import OF_REPLAY
from marl_cair.training.settings.options import list_options
from marl_cair.training.settings.replay import ReplaySettings

SHORTHANDS = {
    "scenario": "game.scenario",
    "representation": "game.representation",
    "preset": "game.options.preset",
    "actions": "game.options.actions",
    "max_ticks": "game.options.max_ticks",
    "map": "game.options.map",
    "heldout_map": "evaluation.scenarios.heldout.map",
}
ELSEWHERE = {  # the last parts of options' names in other libraries, and what they are here
    "lr": "learner.learning_rate",
    "tau": "learner.target_tau",
    "num_envs": "collector.num_worlds",
    "n_envs": "collector.num_worlds",
    "total_timesteps": "total_frames",
    "buffer_size": "replay.capacity_transitions",
    "learning_starts": "replay.min_transitions",
    "train_freq": "learner.frames_per_update",
}
_OTHER_RATES = ("nfsp", "generator")  # these have a learning rate of their own
GROUPS = ("game", "policy", "opponent", "generator", "recipe")
CONF_MODULE = "marl_cair.conf"
CONF = files("marl_cair") / "conf"
_OF_SAMPLER = ("sampler", "priority_alpha", "priority_beta")  # of `replay`
_IN_GROUPS = ("opponent.mixture",)  # the group `opponent` sets it
_WHOLE_NUMBERS = re.compile(r"\d+(\.\d+)?e\+?\d+", re.IGNORECASE)


class Job(NamedTuple):
    """One configuration of a command, named by its swept options; "" where none is swept."""

    config: TrainConfig
    name: str


def compose_config(words: Sequence[str]) -> TrainConfig:
    """The configuration that `words` (`group=choice`, `option=value`) describe.

    Raises:
        UnknownNameError: no such option or choice; names the nearest.
        ValueError: a word that is no `name=value`, or a value that is not allowed.
    """
    from hydra import compose, initialize_config_module
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    refuse_repeats(words, [full_name(word) for word in words])
    register(words)
    try:  # `hydra.main`, which reads flags too, composes twice
        with initialize_config_module(CONF_MODULE, version_base="1.3"):
            values: Any = OmegaConf.to_container(compose("train", rewrite(words)), resolve=True)
    except (HydraException, OmegaConfBaseException) as error:
        _explain(words, error)
    return build_config(values)


def run_hydra(arguments: Sequence[str]) -> list[Job]:
    """The jobs that Hydra composes from words and its own flags. Raises as `compose_config`, and
    SystemExit after `--help`, or for an unknown flag.
    """
    import hydra
    from hydra.core.hydra_config import HydraConfig
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    flags, words = _split_flags(arguments)
    refuse_repeats(words, [full_name(word) for word in words])
    register(words)
    composed: list[tuple[Any, list[str]]] = []

    def collect(config: Any) -> None:
        overrides = HydraConfig.get().overrides.task
        composed.append((OmegaConf.to_container(config, resolve=True), list(overrides)))

    application = hydra.main(f"pkg://{CONF_MODULE}", "train", version_base="1.3")(collect)
    with tempfile.TemporaryDirectory() as scratch:  # Hydra's record of a sweep
        rewritten = [*rewrite(words), f"hydra.sweep.dir={scratch}"]
        try:
            with _hydra_arguments([*flags, *rewritten]):
                application()
        except (HydraException, OmegaConfBaseException) as error:
            _explain(words, error)
    if not composed:  # `--cfg` has printed them: now they are checked
        run_hydra([*_list_folders(flags), *words])
        return []
    varied = [set(words) for _, words in composed]
    common = set.intersection(*varied) if varied else set()
    jobs = [
        Job(build_config(values), _name_job(w for w in words if w not in common))
        for values, words in composed
    ]
    if not any(job.config.learner.learns_from_replay for job in jobs):
        _refuse_of_replay(words, [job.config for job in jobs])
    return jobs


def _refuse_of_replay(words: Sequence[str], configs: Sequence[TrainConfig]) -> None:
    """Raise ValueError for options of replay, given by hand, which the algorithm does not read.

    Those of recipes are left: "recipe=dqn" and "recipe=pqn" join those of a game.
    """
    unread = {f"learner.{name}" for name in OF_REPLAY}
    every = [item.name for item in dataclasses.fields(ReplaySettings)]
    has_generator = any(config.has_generator for config in configs)
    unread |= {f"replay.{name}" for name in (_OF_SAMPLER if has_generator else every)}
    for name in filter(unread.__contains__, map(full_name, words)):
        raise ValueError(
            f"{name} has no effect with learner.algorithm={configs[0].learner.algorithm}, which "
            "learns from the newest steps: leave it out"
        )


def _list_folders(flags: list[str]) -> list[str]:
    """Those of Hydra's flags, with their values, that say where settings are read."""
    found: list[str] = []
    for flag, value in zip(flags, [*flags[1:], ""], strict=True):
        if flag.partition("=")[0] in _FOLDER_FLAGS:
            found += [flag] if "=" in flag else [flag, value]
    return found


def _split_flags(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Hydra's flags with their values, and the words `name=value`."""
    flags: list[str] = []
    words: list[str] = []
    known = {option.path for option in list_options()} | {*SHORTHANDS, *GROUPS}
    for argument in arguments:
        name, equals, value = argument.lstrip("-").partition("=")
        if argument.startswith("--") and name.replace("-", "_") in known:
            raise ValueError(
                f"{argument}: settings of training have no dashes: write "
                f"{name.replace('-', '_')}={value if equals else '...'}"
            )
        takes_value = bool(flags) and flags[-1] in _FLAGS_WITH_VALUE
        (flags if argument.startswith("-") or takes_value else words).append(argument)
    return flags, words


_FOLDER_FLAGS = {"--config-dir", "-cd", "--config-name", "-cn"}
_FLAGS_WITH_VALUE = {"--cfg", "-c", "--package", "-p", *_FOLDER_FLAGS}


@contextmanager
def _hydra_arguments(arguments: list[str]) -> Iterator[None]:
    """Hydra reads sys.argv, and raises instead of printing where HYDRA_FULL_ERROR is 1."""
    kept, full = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv, os.environ["HYDRA_FULL_ERROR"] = ["marl-cair train", *arguments], "1"
    try:
        yield
    finally:
        sys.argv = kept
        os.environ.pop("HYDRA_FULL_ERROR")
        if full is not None:
            os.environ["HYDRA_FULL_ERROR"] = full


def rewrite(words: Sequence[str]) -> list[str]:
    """Words as Hydra takes them: shorthands in full, 1e6 as a whole number, new keys of mappings
    without `+`. A whole mapping replaces its default, with which Hydra would merge it: it is set to
    null first.
    """
    mappings = [o.path for o in list_options() if typing.get_origin(o.kind) is dict]
    whole: list[str] = []
    single: list[str] = []
    for word in words:
        name, (_, equals, value) = full_name(word), word.partition("=")
        text = f"{name}{equals}{','.join(map(_as_whole_number, value.split(',')))}"
        if name in mappings:
            whole += [f"++{name}=null", text]
        else:
            is_new = any(name.startswith(f"{mapping}.") for mapping in mappings)
            single.append(f"++{text}" if is_new else text)
    return [*whole, *single]


def _as_whole_number(text: str) -> str:
    if _WHOLE_NUMBERS.fullmatch(text) and float(text).is_integer():
        return str(int(float(text)))
    return text


def override(defaults: Iterable[str], words: Sequence[str]) -> list[str]:
    """`defaults` and `words`, without the defaults whose option or group `words` set."""
    given = {full_name(word) for word in words}
    return [*(word for word in defaults if full_name(word) not in given), *words]


def full_name(word: str) -> str:
    """The option or group that a word sets, shorthands in full."""
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


def list_choices(group: str) -> list[str]:
    """The YAML files of a group, those in folders as "folder/name", without the parts that they
    share (`_*.yaml`).
    """
    choices: list[str] = []
    for entry in (CONF / group).iterdir():
        if entry.is_dir():
            choices += [f"{entry.name}/{name}" for name in list_choices(f"{group}/{entry.name}")]
        elif entry.name.endswith(".yaml") and not entry.name.startswith("_"):
            choices.append(entry.name.removesuffix(".yaml"))
    return sorted(choices)


def list_all_choices(group: str) -> list[str]:
    """The YAML files of a group, then what is chosen without one: of installed packages too."""
    return list(dict.fromkeys([*list_choices(group), *_MORE_CHOICES.get(group, dict)()]))


def read_about(recipe: str) -> str:
    """A recipe's description: its second line, below Hydra's own."""
    return (CONF / "recipe" / f"{recipe}.yaml").read_text("utf-8").splitlines()[1].lstrip("# ")


def register(words: Sequence[str]) -> None:
    """Store the structured configs, and choices of `words` without a file: a bot or a sampler as
    `opponent`, a game of an installed package.
    """
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    if "settings.yaml" not in store.repo:
        store.store(name="settings", node=make_schema(TrainConfig))
    for word in words:
        group, _, choices = word.partition("=")
        for choice in choices.split(",") if group in _MORE_CHOICES else ():
            if choice not in list_choices(group):
                more = _MORE_CHOICES[group]()
                if choice in more:
                    store.store(group=group, name=choice, node=more[choice])


def list_opponents() -> dict[str, dict[str, Any]]:
    """Settings of the group `opponent` by bot or sampler: a mixture of it alone."""
    bots = {
        name
        for names in GAMES.apply_to_all(lambda game: tuple(game.bots)).values()
        for name in names
    }
    names = [*(name for name in SAMPLERS if name not in LEAGUE_SAMPLERS), *sorted(bots)]
    return {name: {"mixture": {name: 1.0}} for name in names}


def list_games() -> dict[str, dict[str, Any]]:
    """Settings of the group `game` by name: the default scenario, and the first representation of
    those without planes.
    """

    def describe(game: Game) -> dict[str, Any]:
        seen = [*game.make_spec(game.scenario()).representations]
        chosen = {} if GameSettings.representation in seen else {"representation": seen[0]}
        return {"name": game.name, "scenario": game.default_scenario, **chosen}

    return GAMES.apply_to_all(describe)


_MORE_CHOICES: dict[str, Callable[[], Mapping[str, dict[str, Any]]]] = {
    "game": list_games,
    "opponent": list_opponents,
    "policy": lambda: {name: {"body": name} for name in NETWORKS},
    "generator": lambda: {name: {"name": name} for name in GENERATORS},
}


def make_schema(owner: type, prefix: str = "") -> type:
    """A dataclass as OmegaConf takes it: not frozen, no tuples, numbers as they are written."""
    hints = typing.get_type_hints(owner)
    fields: list[Any] = []
    for item in dataclasses.fields(owner):
        kind, path = hints[item.name], f"{prefix}{item.name}"
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            below = make_schema(kind, f"{path}.")
            fields.append((item.name, below, dataclasses.field(default_factory=below)))
            continue
        make = item.default_factory
        default = item.default if make is dataclasses.MISSING else make()
        if path in _IN_GROUPS:
            default = {}
        default = list(default) if isinstance(default, tuple) else default
        fields.append(_make_field(item.name, kind, default))
    return dataclasses.make_dataclass(owner.__name__, fields)


def _make_field(name: str, kind: Any, default: Any) -> tuple[str, Any, Any]:
    origin = typing.get_origin(kind)
    if origin is dict:
        kind = Any  # one that is given whole is set to null first
    elif origin is tuple:
        kind = list[Any]
    elif kind is int:
        kind = int | float
    elif kind == int | None:
        kind = int | float | None
    return name, kind, dataclasses.field(default_factory=lambda: default)


def _name_job(words: Iterable[str]) -> str:
    """A folder's name for the options that differ between jobs."""
    return "_".join(re.sub(r"[^\w.+-]+", "-", word.lstrip("+")) for word in words)


def _explain(words: Sequence[str], error: Exception) -> typing.NoReturn:
    """Raise an error of ours in place of Hydra's: the first unknown name or wrong value."""
    if "Ambiguous value" in f"{error}":
        raise ValueError(
            f"{' '.join(words)}: several values for one option need --multirun; write a list as "
            "[a,b]"
        ) from error
    options = {option.path: option for option in list_options()}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(
                f"{word!r} is no option: write name=value, for example seed=3"
            ) from error
        name = full_name(word)
        if name in GROUPS:
            if name == "opponent" and re.search(r"[:/\[]", value):
                raise ValueError(
                    f"{word}: several opponents are 'opponent.mixture={{random: 1, counter: 1}}', "
                    "a checkpoint's folder or module:function is given a name: "
                    "'opponent.agents={mine: FOLDER}' 'opponent.mixture={mine: 1}'"
                ) from error
            for choice in value.strip("[]").split(","):
                check_name(f"{name} (marl-cair train {name}=...)", choice, list_all_choices(name))
            continue
        kinds = [path for path in options if name == path or name.startswith(f"{path}.")]
        group, _, last = name.rpartition(".")
        if not kinds and last in ELSEWHERE and group.partition(".")[0] not in _OTHER_RATES:
            raise UnknownNameError(f"unknown option {name!r}: here it is {ELSEWHERE[last]!r}")
        check_name("option", kinds[0] if kinds else name, [*options, *SHORTHANDS, *GROUPS])
        if name in options:
            build_value(options[name].kind, read_value(word), name)
    raise ValueError(f"{' '.join(words)}: {str(error).strip().splitlines()[0]}") from error
