"""Recognises scenes (menu, stage, over) of SWFs that report nothing: a trainable classifier.

FlashRL had a network for it; here it is softmax regression on 16 x 12 colours of the
picture, which takes a second to train on a few pictures of each scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import atomic_path

ROWS, COLUMNS = 12, 16  # of the small picture that is classified
NUM_STEPS, LEARNING_RATE, WEIGHT_DECAY = 500, 1.0, 1e-3


@dataclass(frozen=True)
class SceneClassifier:
    """Softmax regression: names of S scenes, weights float64 [F + 1, S]."""

    names: tuple[str, ...]
    weights: NDArray[np.float64]

    @classmethod
    def train(cls, pictures: Mapping[str, Sequence[NDArray[np.uint8]]]) -> Self:
        """Fit to pictures uint8 [H, W, 3] of each scene, all scenes weighted equally.

        Raises:
            ValueError: less than two scenes, or a scene without pictures.
        """
        if len(pictures) < 2 or not all(map(len, pictures.values())):
            counts = {name: len(shown) for name, shown in pictures.items()}
            raise ValueError(f"the pictures are {counts}, give some of each of two scenes or more")
        names = tuple(sorted(pictures))
        features = np.stack([_reduce(one) for name in names for one in pictures[name]])
        which = np.repeat(np.arange(len(names)), [len(pictures[name]) for name in names])
        weight = 1.0 / (len(names) * np.bincount(which)[which])
        weights = np.zeros((features.shape[1], len(names)))
        for _ in range(NUM_STEPS):
            chances = _softmax(features @ weights)
            chances[np.arange(len(which)), which] -= 1.0
            slope = features.T @ (chances * weight[:, None]) + WEIGHT_DECAY * weights
            weights -= LEARNING_RATE * slope / len(names)
        return cls(names, weights)

    def find_chances(self, picture: NDArray[np.uint8]) -> dict[str, float]:
        """The probability of each scene."""
        chances = _softmax(_reduce(picture)[None] @ self.weights)[0]
        return dict(zip(self.names, chances.tolist(), strict=True))

    def find_scene(self, picture: NDArray[np.uint8]) -> str:
        """The likeliest scene of a picture uint8 [H, W, 3]."""
        chances = self.find_chances(picture)
        return max(chances, key=lambda name: chances[name])

    def save(self, path: Path) -> None:
        """Write names and weights as .npz."""
        with atomic_path(path) as unfinished, unfinished.open("wb") as file:
            np.savez(file, names=np.array(self.names), weights=self.weights)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote. Raises ValueError if it is something else."""
        try:
            with np.load(path, allow_pickle=False) as held:
                names, weights = tuple(map(str, held["names"])), np.asarray(held["weights"])
        except (OSError, KeyError, ValueError) as error:
            raise ValueError(f"{path} is no scene classifier: {error}") from None
        if weights.shape != (3 * ROWS * COLUMNS + 1, len(names)) or weights.dtype != np.float64:
            raise ValueError(f"{path} is no scene classifier: its weights are {weights.shape}")
        return cls(names, weights)


def _reduce(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Mean colours of 12 x 16 parts, -1..1, and a 1: float64 [577]."""
    edges = [
        np.linspace(0, n, parts + 1).astype(int)
        for n, parts in zip(picture.shape[:2], (ROWS, COLUMNS), strict=True)
    ]
    sums = np.add.reduceat(picture.astype(np.float64), edges[0][:-1], axis=0)
    sums = np.add.reduceat(sums, edges[1][:-1], axis=1)
    areas = np.diff(edges[0])[:, None, None] * np.diff(edges[1])[None, :, None]
    return np.append((sums / areas / 127.5 - 1.0).ravel(), 1.0)


def _softmax(values: NDArray[np.float64]) -> NDArray[np.float64]:
    chances = np.exp(values - values.max(1, keepdims=True))
    return np.asarray(chances / chances.sum(1, keepdims=True), np.float64)
