"""`Camera`: which part of a picture is shown, at a whole number of pixels for each of its own."""

from __future__ import annotations

from dataclasses import dataclass

MAX_ZOOM = 16
Rect = tuple[int, int, int, int]  # left, top, width, height


@dataclass
class Camera:
    """Shows a picture of `size` in `area` of the window; pictures that fit are centred.

    Attributes:
        area: left, top, width, height of the window's part.
        size: width and height of the picture.
        zoom: pixels of the window for each of the picture; 0: the largest that fits, at least 1.
        left, top: of the shown part, in pixels of the picture.
    """

    area: Rect = (0, 0, 1, 1)
    size: tuple[int, int] = (1, 1)
    zoom: int = 0
    left: float = 0.0
    top: float = 0.0

    @property
    def scale(self) -> int:
        """Pixels of the window for each of the picture, 1 or more."""
        fits = min(self.area[2] // self.size[0], self.area[3] // self.size[1])
        return self.zoom or max(1, min(MAX_ZOOM, fits))

    @property
    def is_whole(self) -> bool:
        """Whether the whole picture is shown."""
        width, height = self.size[0] * self.scale, self.size[1] * self.scale
        return width <= self.area[2] and height <= self.area[3]

    def corner(self) -> tuple[int, int]:
        """Where the picture's upper left corner lies in the window; maybe outside `area`."""
        corner = []
        for axis, first in enumerate((self.left, self.top)):
            room, length = self.area[2 + axis], self.size[axis] * self.scale
            centred = (room - length) // 2
            scrolled = -max(0, min(round(first * self.scale), length - room))
            corner.append(self.area[axis] + (centred if length <= room else scrolled))
        return corner[0], corner[1]

    def to_picture(self, x: float, y: float) -> tuple[float, float]:
        """The pixel of the picture at a pixel of the window; maybe outside the picture."""
        left, top = self.corner()
        return (x - left) / self.scale, (y - top) / self.scale

    def contains(self, x: float, y: float) -> bool:
        """Whether a pixel of the window lies in the area."""
        left, top, width, height = self.area
        return left <= x < left + width and top <= y < top + height

    def scroll(self, right: float, down: float) -> None:
        """Move the shown part by pixels of the window."""
        self.left, self.top = self._clip(
            self.left + right / self.scale, self.top + down / self.scale
        )

    def centre_on(self, x: float, y: float) -> None:
        """Show a pixel of the picture in the middle."""
        width, height = self.area[2] / self.scale, self.area[3] / self.scale
        self.left, self.top = self._clip(x - width / 2, y - height / 2)

    def change_zoom(self, step: int, x: float, y: float) -> None:
        """Zoom by whole steps; the pixel of the window at (x, y) stays where it is."""
        at_x, at_y = self.to_picture(x, y)
        self.zoom = max(1, min(MAX_ZOOM, self.scale + step))
        offset_x, offset_y = (x - self.area[0]) / self.zoom, (y - self.area[1]) / self.zoom
        self.left, self.top = self._clip(at_x - offset_x, at_y - offset_y)

    def _clip(self, left: float, top: float) -> tuple[float, float]:
        most = [max(0.0, self.size[axis] - self.area[2 + axis] / self.scale) for axis in range(2)]
        return max(0.0, min(left, most[0])), max(0.0, min(top, most[1]))
