"""Makes, saves and loads the generator of a training run."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

import torch

from marl_cair.checkpoint import CheckpointError, load_tensors, save_tensors
from marl_cair.files import atomic_path
from marl_cair.games import GAMES
from marl_cair.games.game import Game, GameSpec, Representation
from marl_cair.generative import GENERATORS
from marl_cair.generative.codecs import FrameCodec, VectorCodec, make_coded_generator
from marl_cair.generative.generator import CCDNGenerator, Generator
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.generative.thesis import ThesisGenerator
from marl_cair.outside import OutsideCodeError
from marl_cair.policies import NO_MEMORY
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.config import NO_GENERATOR, TrainConfig
from marl_cair.training.settings.config_file import learned_fields

GENERATOR_FILE = "generator.pt"  # in a run's folder
UNCHECKED = "grad_norm"  # may be infinite: generators skip such a step by themselves
_MADE_FOR = "made_for"  # entry of that file beside the generator's own
GRAY = "gray"  # one grey picture, 84 x 84
_ONE_STEP, _NONE = "1 with generator.name=ccdn_thesis", "0 with generator.name=ccdn_thesis"
SHADES_TAKEN_FOR_EQUAL = 8  # of 255, in pictures


def make_generator(
    config: TrainConfig, seen: Representation, spec: GameSpec, seed: int, source: str | None
) -> Generator | None:
    """The generator that `config` names, or None if it wants no generated transitions. It begins
    with the weights of the generator of the run in folder `source`, if given.

    Raises:
        ValueError: the representation is neither planes nor a stack of frames nor a vector; the
            generator at `source` is of another game, scenario or size, or none is wanted here.
        CheckpointError: there is none at `source`, or it cannot be read.
    """
    if not config.has_generator:
        if source is not None:
            raise ValueError(
                f"initial_generator is {source}, but this run has no generator: leave it out, or "
                f"set generator.name and synthetic_fraction (now {config.synthetic_fraction})"
            )
        return None
    generator = _make(config, seen, spec, seed)
    if source is not None:
        made_for = describe_task(GAMES[config.game.name], learned_fields(config), spec)
        load_knowledge(generator, source, made_for, config.generator.transfer)
    return generator


def move_generator(generator: Generator | None, device: torch.device) -> None:
    """Let it compute on `device`, with rows from and for the CPU; one from outside stays there."""
    own = getattr(generator, "generator", generator)  # behind a codec
    for part in vars(own).values() if isinstance(own, CCDNGenerator | ThesisGenerator) else ():
        if isinstance(part, torch.nn.Module):
            part.to(device)


def count_others(config: TrainConfig, spec: GameSpec) -> int:
    """Number of other seats whose actions are recorded for the generator."""
    return spec.num_players - 1 if config.has_generator else 0


def check_generator(config: TrainConfig) -> None:
    """Raise ValueError if a run of `config` cannot have the generator that it names."""
    spec = config.game.spec
    make_generator(config, spec.representations[config.game.representation], spec, 0, None)


def describe_task(game: Game, scenario: Mapping[str, Any], spec: GameSpec) -> dict[str, Any]:
    """What a generator's weights are trained for, as plain data; it is kept in their file.

    scenario: all its fields. `shaping_discount` is left out: it follows the learner's discount.
    """
    rules = {name: value for name, value in scenario.items() if name != "shaping_discount"}
    task = {"game": game.name, "version": game.version, "actions": spec.action_names}
    # Tuples become lists, as in saved settings.
    plain: dict[str, Any] = json.loads(json.dumps({**task, "scenario": rules}))
    return plain


def _check_task(saved: Mapping[str, Any], own: Mapping[str, Any], is_transfer: bool) -> None:
    """Raise ValueError unless weights for the task `saved` may begin with the task `own`."""
    accepted = own["version"], *GAMES[own["game"]].agents_of
    if saved["game"] != own["game"] or saved["version"] not in accepted:
        old, new = (f"{one['game']} version {one['version']}" for one in (saved, own))
        raise ValueError(f"it is of {old}, this run of {new}")
    if saved["actions"] != own["actions"]:
        pairs = enumerate(zip_longest(saved["actions"], own["actions"]))
        number, (old, new) = next(pair for pair in pairs if pair[1][0] != pair[1][1])
        raise ValueError(
            f"it has {len(saved['actions'])} actions, this run {len(own['actions'])}: the first "
            f"that differ are number {number}, {old} and {new}"
        )
    theirs, ours = saved["scenario"], own["scenario"]
    changed = [name for name in theirs if name in ours and theirs[name] != ours[name]]
    if changed and not is_transfer:
        old, new = (", ".join(f"{name}={of[name]}" for name in changed) for of in (theirs, ours))
        raise ValueError(
            f"it is of a scenario with {old}, this run's has {new}; generator.transfer=true begins "
            "with it all the same"
        )


def write_knowledge(generator: Generator, path: Path, made_for: Mapping[str, Any]) -> set[str]:
    """Write its weights and what they are made for; returns the names of the weights."""
    knowledge = generator.export_knowledge()
    save_tensors({**knowledge, _MADE_FOR: dict(made_for)}, path)
    return set(knowledge)


def save_generator(
    generator: Generator, folder: Path, made_for: Mapping[str, Any]
) -> dict[str, Any]:
    """Write its weights to `folder`; returns the rest of its state."""
    written = write_knowledge(generator, folder / GENERATOR_FILE, made_for)
    state = generator.state_dict()
    return {name: state[name] for name in state.keys() - written}


def restore_generator(generator: Generator, folder: Path, rest: Mapping[str, Any]) -> None:
    """Continue from the files and the state of `save_generator`."""
    knowledge = dict(load_tensors(folder / GENERATOR_FILE))
    knowledge.pop(_MADE_FOR, None)
    generator.load_state_dict({**knowledge, **rest})


def publish_generator(source: Path, folder: Path) -> None:
    """Link the file of `save_generator` in `source` from `folder`, for runs that begin with it: it
    is large, and it stays when `source` is deleted.
    """
    with atomic_path(folder / GENERATOR_FILE) as unfinished:
        try:
            unfinished.hardlink_to(source / GENERATOR_FILE)
        except OSError:  # a file system without hard links
            shutil.copyfile(source / GENERATOR_FILE, unfinished)


def take_over_generator(config: TrainConfig, before: Path) -> TrainConfig:
    """The settings of a run that begins with the generator of the run in `before`, if any."""
    if not (before / GENERATOR_FILE).is_file():
        return config
    return dataclasses.replace(config, initial_generator=str(before))


def load_knowledge(
    generator: Generator, source: str, made_for: Mapping[str, Any], is_transfer: bool = False
) -> None:
    """Begin with the weights of the generator in folder `source`. Raises as `make_generator`.

    made_for: the present task (`describe_task`). is_transfer: allow another scenario of its game.
    """
    path = Path(source) / GENERATOR_FILE
    if not path.is_file():
        raise CheckpointError(
            f"initial_generator is {source}, which has no {GENERATOR_FILE}: give the folder of a "
            "run that had a generator, such as runs/train"
        )
    knowledge = dict(load_tensors(path))
    try:
        saved = knowledge.pop(_MADE_FOR, None)
        if saved is not None:
            _check_task(saved, made_for, is_transfer)
        elif not is_transfer:
            raise ValueError(
                "an older version wrote it, without its game: generator.transfer=true trusts it"
            )
        generator.import_knowledge(knowledge)
    except ValueError as error:
        raise ValueError(
            f"initial_generator is {source}, which this run cannot begin with: {error}"
        ) from error
    except (KeyError, RuntimeError, TypeError) as error:
        raise CheckpointError(
            f"{path} is damaged ({error!r}): bring it back, or leave initial_generator out"
        ) from error


def _make(config: TrainConfig, seen: Representation, spec: GameSpec, seed: int) -> Generator:
    settings = config.generator
    model = dataclasses.replace(settings.model, seed=seed)
    if config.offline.dataset:
        model = dataclasses.replace(model, heldout_share=0.0, heldout_ends=0.0)
    else:
        share = model.heldout_share
        require(share > 0.0, "generator.model.heldout_share", share, "above 0: the gate needs rows")
    bound = spec.reward_bound * config.learner.reward_scale
    made = make_for_game(settings.name, model, seen, spec, bound, count_others(config, spec))
    if isinstance(made, ThesisGenerator):  # it knows no rewards but that of the real first step
        require(config.learner.n_steps == 1, "learner.n_steps", config.learner.n_steps, _ONE_STEP)
        require(settings.branch_steps == 0, "generator.branch_steps", settings.branch_steps, _NONE)
        memory = config.policy.memory
        require(memory == NO_MEMORY, "policy.memory", memory, f"{NO_MEMORY} with ccdn_thesis")
    return made


def make_for_game(
    name: str,
    model: GeneratorConfig,
    seen: Representation,
    spec: GameSpec,
    reward_bound: float,
    num_others: int,
) -> Generator:
    """The generator `name` for observations `seen` of the game.

    num_others: other seats whose actions are recorded.
    Raises ValueError for a representation that the generator cannot work on, OutsideCodeError for
    a generator from outside that lacks a method.
    """
    shape = seen.shape
    frames: dict[str, Any] = {}
    if len(shape) == 1:
        codec = VectorCodec(*(bounds.tolist() for bounds in seen.bounds()))
        shape, num_uniform = codec.shape, codec.num_uniform
    else:
        num_uniform = seen.num_uniform
    if seen.num_frames > 1 or seen.name == GRAY:
        frames = {"num_frames": seen.num_frames, "tolerance": SHADES_TAKEN_FOR_EQUAL}
    is_board = len(seen.shape) == 3 and seen.num_uniform > 0
    if is_board:
        frames = {
            "action_cells": spec.action_cells.tolist(),
            "static_planes": spec.static_planes,
            "exclusive_plane_groups": spec.exclusive_planes,
            "event_plane_groups": spec.event_planes,
        }
    if not (frames or len(seen.shape) == 1):
        raise ValueError(
            f"the generator {name!r} works on `planes`, `gray`, stacks of frames and vectors, not "
            f"on {seen.name!r}: set generator.name={NO_GENERATOR} or synthetic_fraction=0"
        )
    planes, rows, columns = shape
    about = GeneratorSpec(
        observation_shape=(planes, rows, columns),
        num_actions=spec.num_actions,
        num_uniform=num_uniform,
        noop_action=spec.noop_action,
        action_kinds=spec.action_groups.tolist(),
        reward_range=(-reward_bound, reward_bound),
        num_others=num_others,
        **frames,
    )
    made: Generator = GENERATORS.make(name, model, about)
    wanted = [member for member in vars(Generator) if not member.startswith("_")]
    if missing := [member for member in wanted if not hasattr(made, member)]:
        raise OutsideCodeError(
            f"generator {name} gave {type(made).__name__} without {', '.join(missing)}: it "
            "must have all methods of `marl_cair.generative.generator.Generator`"
        )
    if len(seen.shape) == 1:
        return make_coded_generator(made, codec)
    return make_coded_generator(made, FrameCodec()) if seen.num_frames > 1 else made
