"""`marl-cair train`: train an agent with the settings on the command line, or resume a run."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from marl_cair.checkpoint import LATEST_FOLDER, read_description
from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED
from marl_cair.cli.compose import (
    CONF,
    GROUPS,
    SHORTHANDS,
    list_all_choices,
    list_choices,
    read_about,
    read_value,
    run_hydra,
)
from marl_cair.cli.parser import refuse_repeats
from marl_cair.files import find_folder
from marl_cair.games import GAMES
from marl_cair.lookup import find_by_name
from marl_cair.self_play.samplers import LEAGUE_SAMPLERS, SAMPLERS
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.config_file import (
    CHANGEABLE,
    CONFIG_FILE,
    build_value,
    load_config,
    resume_command,
)
from marl_cair.training.settings.options import list_options

_ALLOW_CODE = "allow_code"


def run(arguments: Sequence[str]) -> int:
    """Train one job after another; returns the exit code."""
    if any(word in ("-h", "--help") for word in arguments):
        sys.stdout.write(describe_options())
        return EXIT_DONE
    if any(word.startswith("resume=") for word in arguments):
        return _train(read_resume(arguments), resume=True)
    if any(word.partition("=")[0] == _ALLOW_CODE for word in arguments):
        raise ValueError(
            f"{_ALLOW_CODE} is for resume=FOLDER: leave it out here, named code runs anyway"
        )
    jobs = run_hydra(arguments)
    for number, job in enumerate(jobs, 1):
        config = job.config
        if len(jobs) > 1:
            config = dataclasses.replace(config, out=f"{config.out}/{job.name}")
            sys.stdout.write(f"job {number} of {len(jobs)}: out={config.out}\n")
        is_begun = len(jobs) > 1 and (Path(config.out) / CONFIG_FILE).is_file()
        if code := _train(config, resume=is_begun):
            return code
    return EXIT_DONE


def _train(config: TrainConfig, resume: bool) -> int:
    from marl_cair.training.run import BEST_FOLDER
    from marl_cair.training.trainer import train

    command = resume_command(config)
    result = train(config, resume=resume, resume_with=command)
    best = result.folder / BEST_FOLDER
    where = f"agent in {result.folder}/{LATEST_FOLDER}" + f", the best in {best}" * best.is_dir()
    sys.stdout.write(f"{result.frames:,} frames, {result.updates:,} updates; {where}\n")
    if result.was_interrupted:
        sys.stderr.write(f"interrupted and saved: resume with {command}\n")
        return EXIT_INTERRUPTED
    if resume and not result.last_row:
        more = "a higher stop_score, or null," if result.reached_score else "a larger total_frames"
        sys.stdout.write(f"the run had ended: {more} continues it\n")
    return EXIT_DONE


def read_resume(arguments: Sequence[str]) -> TrainConfig:
    """The configuration of the run in `resume=FOLDER`, changed by the other words.

    Raises:
        ValueError: the folder holds no run, or a setting that a resumed run cannot change.
    """
    refuse_repeats(arguments)
    words = dict(word.partition("=")[::2] for word in arguments)
    folder = words.pop("resume")
    if not folder:
        raise ValueError("resume names no folder: write resume=FOLDER, for example resume=runs/a")
    allow_code = words.pop(_ALLOW_CODE, "false")
    if allow_code not in ("true", "false"):
        raise ValueError(f"{_ALLOW_CODE} is {allow_code!r}, it must be true or false")
    config = load_config(folder, allow_code == "true")
    _refuse_without_state(Path(folder), config)
    changes: dict[str, Any] = {}
    for name, value in words.items():
        kind = find_by_name("option of a resumed run", name, CHANGEABLE)
        changes[name] = build_value(kind, read_value(f"{name}={value}"), name)
    agent, goal = find_folder(Path(folder) / LATEST_FOLDER), changes.get("total_frames")
    if goal is not None and goal < config.total_frames and agent.is_dir():
        done = read_description(agent).frames
        require(goal >= done, "total_frames", goal, f"{done} or more, where {folder} is already")
    return dataclasses.replace(config, **changes)


def _refuse_without_state(folder: Path, config: TrainConfig) -> None:
    """Raise ValueError for a run that has ended and whose state was deleted (as of best responses):
    it would begin again and overwrite its agent.
    """
    from marl_cair.training.run import RESUME_FOLDER

    agent = find_folder(folder / LATEST_FOLDER)
    if find_folder(folder / RESUME_FOLDER).is_dir() or not agent.is_dir():
        return
    if read_description(agent).frames >= config.total_frames:
        raise ValueError(
            f"{str(folder)!r} has ended, and its state ({RESUME_FOLDER}) was deleted: begin a new "
            f"run with its agent, initial_agent={agent}"
        )


def describe_options() -> str:
    """The text of `marl-cair train --help`: every option with its default and meaning. Hydra's own
    help takes a second more and has no meanings.
    """
    lines = [_USAGE, "== Configuration groups ==", ""]
    named = {"game": [*GAMES], "opponent": list_choices("opponent")}  # games take seconds to load
    for group in GROUPS[:-1]:
        names = named.get(group) or list_all_choices(group)
        lines.append(f"  {group}: {', '.join(names)}")
    lines += ["    opponent also takes any bot of the game (marl-cair games) and these samplers:"]
    lines += ["    " + ", ".join(name for name in SAMPLERS if name not in LEAGUE_SAMPLERS)]
    lines += ["", "  recipe (settings that were tested; other options override them):"]
    lines += [f"    {name}: {read_about(name)}" for name in list_choices("recipe")]
    lines += [f"  Groups and recipes are YAML files to read and copy: {CONF}", ""]
    lines += ["== Config ==", ""]
    lines += [f"  {short} is short for {name}" for short, name in SHORTHANDS.items()] + [""]
    for option in list_options():
        lines += [f"  {option.path} = {option.default}", f"      {option.comment}"]
    return "\n".join(lines).replace("None", "null") + "\n"  # as options are written


_USAGE = f"""usage: marl-cair train [group=choice ...] [option=value ...]
       marl-cair train --multirun seed=0,1,2 policy=conv,capsule out=runs/sweep
       marl-cair train resume=FOLDER [total_frames=N] [max_minutes=M] [stop_score=S]
                       [device=D] [torch_threads=T] [allow_code=true]

--multirun, -m    one run for each combination of values, in folders of their own below out=;
                  the same command again resumes them
--cfg job         print the composed configuration, check it and exit
--config-dir DIR  also read groups and recipes from this folder, for example DIR/recipe/mine.yaml
--hydra-help      flags of Hydra
allow_code=true   also run the code that the run's {CONFIG_FILE} names, and list it

example: marl-cair train game=deep_line_wars policy=capsule opponent=self_play seed=3
"""
