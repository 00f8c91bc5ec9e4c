"""Observations of seats as Gymnasium spaces: shared by the PettingZoo and Gymnasium doors."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Representation

VECTOR = "vector"


def make_observation_space(
    engine: BatchedEngine, representation: str, with_mask: bool, with_vector: bool
) -> spaces.Space[Any]:
    """One seat's space: a Box, or a Dict where the mask or the vector is asked for."""
    box = _make_box(engine.representation(representation))
    if not with_mask and not with_vector:
        return box
    parts: dict[str, spaces.Space[Any]] = {"observation": box}
    if with_mask:
        parts["action_mask"] = spaces.Box(0, 1, (engine.num_actions,), np.int8)
    if with_vector:
        parts[VECTOR] = _make_box(engine.representation(VECTOR))
    return spaces.Dict(parts)


def look(
    engine: BatchedEngine, representation: str, with_mask: bool, with_vector: bool
) -> NDArray[Any] | dict[str, NDArray[Any]]:
    """What all seats see, fresh arrays [B, P, ...] in the form of `make_observation_space`."""
    seen = engine.observe(representation)
    if not with_mask and not with_vector:
        return seen
    parts = {"observation": seen}
    if with_mask:
        parts["action_mask"] = engine.action_mask().view(np.int8)
    if with_vector:
        parts[VECTOR] = engine.observe(VECTOR)
    return parts


def _make_box(representation: Representation) -> spaces.Box:
    return spaces.Box(0, representation.high, representation.shape, representation.dtype)
