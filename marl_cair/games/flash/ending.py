"""Recognises the end of games that report nothing: by a picture of a region, or by the scene."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from marl_cair.games.flash.description import Description, DescriptionError, Ending
from marl_cair.games.flash.scenes import SceneClassifier


class EndReader:
    """Whether a picture uint8 [H, W, 3] of a SWF shows the end of a game."""

    def __init__(self, described: Description) -> None:
        self._ending = described.done if isinstance(described.done, Ending) else Ending()
        self._size = described.size

    def check(self) -> None:
        """Raise DescriptionError if the end's picture is none, or does not fit its region."""
        if self._ending.picture is not None:
            _ = self._expected

    def is_over(self, picture: NDArray[np.uint8]) -> bool:
        """Raises DescriptionError as `check` does."""
        if self._ending.scenes is not None:
            return self._classifier.find_scene(picture) in self._ending.names
        difference = np.abs(self._crop(picture).astype(np.int16) - self._expected)
        return bool(difference.mean() / 255.0 <= self._ending.within)

    def _crop(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        x, y, width, height = self._ending.region or (0, 0, *self._size)
        return picture[y : y + height, x : x + width]

    @cached_property
    def _expected(self) -> NDArray[np.int16]:
        picture = read_picture(self._ending.picture or Path())
        _, _, *region = self._ending.region or (0, 0, *self._size)
        if picture.shape[1::-1] == self._size:
            picture = self._crop(picture)
        if list(picture.shape[1::-1]) != region:
            raise DescriptionError(
                f"{self._ending.picture} has {picture.shape[1::-1]} pixels: give a picture of the "
                f"whole game, {self._size}, or of the region, {tuple(region)}"
            )
        return picture.astype(np.int16)

    @cached_property
    def _classifier(self) -> SceneClassifier:
        return SceneClassifier.load(self._ending.scenes or Path())


def read_picture(path: Path) -> NDArray[np.uint8]:
    """A PNG as uint8 [H, W, 3]. Raises DescriptionError if it is none."""
    try:
        return np.asarray(Image.open(path).convert("RGB"))
    except OSError as error:
        raise DescriptionError(f"{path} is no picture: {error}") from None
