"""`marl-cair train`: words of the command line -> a training run."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.checkpoint import LATEST_FOLDER, read_description
from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED
from marl_cair.cli.compose import SHORTHANDS, compose_config, list_groups, read_value
from marl_cair.cli.options import find_choices, list_options
from marl_cair.cli.parser import refuse_repeats
from marl_cair.files import find_folder
from marl_cair.lookup import find_by_name
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.config_file import CONFIG_FILE, ENDS, build_value, load_config
from marl_cair.training.settings.recipes import RECIPES

_ALLOW_CODE = "allow_code"


def run(arguments: Sequence[str]) -> int:
    """Train as `arguments` say; returns the exit code."""
    if any(word in ("-h", "--help") for word in arguments):
        sys.stdout.write(describe_options())
        return EXIT_DONE
    from marl_cair.training.trainer import train

    config, resume = read_arguments(arguments)
    result = train(config, resume=resume)
    told = (
        f"{result.frames:,} frames, {result.updates:,} updates; agent in {result.folder}/latest\n"
    )
    sys.stdout.write(told)
    if result.was_interrupted:
        sys.stderr.write(f"interrupted and saved: go on with marl-cair train resume={config.out}\n")
        return EXIT_INTERRUPTED
    return EXIT_DONE


def read_arguments(arguments: Sequence[str]) -> tuple[TrainConfig, bool]:
    """The configuration, and whether a run is to be resumed.

    Raises:
        ValueError: as `compose_config`; or a setting that a resumed run cannot change.
    """
    refuse_repeats(arguments)
    words = dict(word.partition("=")[::2] for word in arguments)
    if "resume" not in words:
        if _ALLOW_CODE in words:
            raise ValueError(
                f"{_ALLOW_CODE} is for resume=FOLDER: leave it out here, code that you name runs"
            )
        return compose_config(arguments), False
    folder = words.pop("resume")
    if not folder:
        raise ValueError("resume names no folder: write resume=FOLDER, for example resume=runs/a")
    allow_code = words.pop(_ALLOW_CODE, "false")
    if allow_code not in ("true", "false"):
        raise ValueError(f"{_ALLOW_CODE} is {allow_code!r}, it must be true or false")
    config = load_config(folder, allow_code == "true")
    _refuse_without_state(Path(folder), config)
    changes = {}
    for name, value in words.items():
        kind = find_by_name("option of a resumed run", name, ENDS)
        changes[name] = build_value(kind, read_value(f"{name}={value}"), name)
    return dataclasses.replace(config, **changes), True


def _refuse_without_state(folder: Path, config: TrainConfig) -> None:
    """Raise ValueError for a run that has ended and whose state is gone, as those of best responses
    are deleted: it would begin anew, and write over its agent.
    """
    from marl_cair.training.run import RESUME_FOLDER

    agent = find_folder(folder / LATEST_FOLDER)
    if find_folder(folder / RESUME_FOLDER).is_dir() or not agent.is_dir():
        return
    if read_description(agent).frames >= config.total_frames:
        raise ValueError(
            f"{str(folder)!r} has ended, and its state ({RESUME_FOLDER}) is not there any more: "
            f"begin a new run with its agent, initial_agent={agent}"
        )


def describe_options() -> str:
    """The text of `marl-cair train --help`: every option with default, unit and choices."""
    choices = find_choices()
    lines = [
        "usage: marl-cair train [group=choice ...] [option=value ...]",
        "       marl-cair train resume=FOLDER [total_frames=N] [max_minutes=M] [stop_score=S]",
        "                       [allow_code=true]",
        "",
        "example: marl-cair train game=deep_line_wars policy=capsule opponent=self_play seed=3",
        "",
        "allow_code=true also runs the code that the run's config.yaml names, and lists it",
        "",
        "groups (each sets several options at once):",
    ]
    lines += [f"  {group:10} {', '.join(names)}" for group, names in list_groups().items()]
    lines += ["", "recipes (recipe=NAME; words beside it go before its own):"]
    for name, recipe in RECIPES.items():
        lines += [f"  {name}: {recipe.about}", f"      {' '.join(map(shlex.quote, recipe.words))}"]
    lines += ["", "shorthands: " + ", ".join(f"{a} = {b}" for a, b in SHORTHANDS.items())]
    lines += ["", f"options (a run's own are in <out>/{CONFIG_FILE}):"]
    for option in list_options():
        told = [option.comment] if option.comment else []
        if option.path in choices:
            told.append(f"one of {', '.join(choices[option.path])}")
        lines.append(f"  {option.path} = {option.default}")
        lines += [f"      {text}" for text in told]
    return "\n".join(lines) + "\n"
