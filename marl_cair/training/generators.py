"""The generator of a training run, made for what its agents see."""

from __future__ import annotations

import dataclasses

import numpy as np

from marl_cair.games.game import GameSpec, Representation
from marl_cair.generative import GENERATORS
from marl_cair.generative.coded import CodedGenerator, FrameCodec
from marl_cair.generative.generator import Generator
from marl_cair.generative.settings import GeneratorSpec
from marl_cair.generative.vectors import VectorCodec
from marl_cair.training.config import NO_GENERATOR, TrainConfig

SHADES_TAKEN_FOR_EQUAL = 8  # of 255, in pictures


def make_generator(
    config: TrainConfig, seen: Representation, spec: GameSpec, seed: int
) -> Generator | None:
    """The generator that `config` names, or None where it wants no generated transitions.

    Raises:
        ValueError: agents see neither planes nor a stack of frames nor a vector.
    """
    settings = config.generator
    if settings.name == NO_GENERATOR or config.synthetic_fraction == 0:
        return None
    make = GENERATORS[settings.name]
    model = dataclasses.replace(settings.model, seed=seed)
    bound = spec.reward_bound * config.learner.reward_scale

    def specify(
        shape: tuple[int, ...], num_uniform: int, num_frames: int = 1, tolerance: int = 0
    ) -> GeneratorSpec:
        planes, rows, columns = shape
        return GeneratorSpec(
            observation_shape=(planes, rows, columns),
            num_actions=spec.num_actions,
            num_uniform=num_uniform,
            noop_action=spec.noop_action,
            action_kinds=spec.action_groups.tolist(),
            reward_range=(-bound, bound),
            num_frames=num_frames,
            tolerance=tolerance,
        )

    if len(seen.shape) == 1:
        codec = VectorCodec(*(bounds.tolist() for bounds in seen.bounds()))
        return CodedGenerator(make(model, specify(codec.shape, codec.num_uniform)), codec)
    if seen.num_frames > 1:
        of_frames = specify(seen.shape, 0, seen.num_frames, SHADES_TAKEN_FOR_EQUAL)
        return CodedGenerator(make(model, of_frames), FrameCodec())
    if seen.dtype is not np.uint8 or seen.num_uniform == 0:
        raise ValueError(
            f"the generator {settings.name!r} works on `planes`, stacks of frames and vectors, "
            f"not on {seen.name!r}: set generator.name={NO_GENERATOR} or synthetic_fraction=0"
        )
    of_planes = dataclasses.replace(
        specify(seen.shape, seen.num_uniform),
        action_cells=spec.action_cells.tolist(),
        static_planes=spec.static_planes,
        exclusive_plane_groups=spec.exclusive_planes,
        event_plane_groups=spec.event_planes,
    )
    return make(model, of_planes)
