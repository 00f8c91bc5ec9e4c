"""`Pen`: writes text, bars and lines on a pygame surface, downwards from the top."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path

import matplotlib as mpl
import pygame

from marl_cair.window import colours
from marl_cair.window.colours import Colour

LINE = 17  # pixels from one line of text to the next
MARGIN = 10
TEXT, SMALL = 12, 11  # pixels
NARROWEST = 0.55  # of a text's own width


@cache
def _load_font(size: int) -> pygame.font.Font:
    """DejaVu Sans, which comes with matplotlib: the same on every machine."""
    pygame.font.init()
    return pygame.font.Font(Path(mpl.get_data_path()) / "fonts/ttf/DejaVuSans.ttf", size)


@lru_cache(maxsize=4096)
def write(text: str, colour: Colour = colours.INK, size: int = TEXT) -> pygame.Surface:
    """Text as a surface, kept for the next time."""
    return _load_font(size).render(text, True, colour)


@lru_cache(maxsize=4096)
def fit(text: str, room: int, colour: Colour = colours.INK, size: int = TEXT) -> pygame.Surface:
    """Text in `room` pixels: squeezed to NARROWEST at most, then ended with an ellipsis."""
    shown = write(text, colour, size)
    while text and shown.get_width() * NARROWEST > room:
        text = text[:-1].rstrip()
        shown = write(f"{text}\N{HORIZONTAL ELLIPSIS}", colour, size)
    box = max(1, room), shown.get_height()  # pygame crashes where it scales an empty text up
    return shown if shown.get_width() <= box[0] else pygame.transform.smoothscale(shown, box)


class Pen:
    """Draws one thing below another on `surface`; `y` is where the next begins."""

    def __init__(self, surface: pygame.Surface) -> None:
        self.surface, self.y = surface, MARGIN
        self.width = surface.get_width() - 2 * MARGIN

    def heading(self, text: str) -> None:
        """A line of a section's name."""
        self.y += 6
        self.surface.blit(write(text, colours.DIM, SMALL), (MARGIN, self.y))
        self.y += LINE

    def line(self, text: str, colour: Colour = colours.INK, swatch: Colour | None = None) -> None:
        """A line of text, after a square of a player's colour."""
        left = MARGIN
        if swatch is not None:
            self.swatch(left, swatch)
            left += 16
        self.surface.blit(write(text, colour), (left, self.y))
        self.y += LINE

    def swatch(self, left: int, colour: Colour) -> None:
        """A square of a player's colour, with a light edge that shows it on any ground."""
        box = (left, self.y + 1, 11, 11)
        pygame.draw.rect(self.surface, colour, box)
        pygame.draw.rect(self.surface, colours.DIM, box, 1)

    def table(
        self, names: Sequence[str], rows: Sequence[Sequence[str]], swatches: Sequence[Colour]
    ) -> None:
        """Columns of numbers with their names above, a row for each player."""
        step = (self.width - 16) / max(1, len(names))
        for row in (names, *rows):
            is_head = row is names
            if not is_head:
                self.swatch(MARGIN, swatches[0])
                swatches = swatches[1:]
            for place, text in enumerate(row):
                colour, size = (colours.DIM, SMALL) if is_head else (colours.INK, TEXT)
                shown = write(text, colour, size)
                right = MARGIN + 16 + round((place + 1) * step)
                self.surface.blit(shown, (right - shown.get_width(), self.y))
            self.y += LINE

    def bars(
        self, label: str, shares: Sequence[float], number: str, inks: Sequence[Colour]
    ) -> None:
        """Bars of `shares` 0..1, one below another, beside a label and a number."""
        left, right = MARGIN + 122, MARGIN + self.width - 70
        self.surface.blit(fit(label, 118, colours.INK, SMALL), (MARGIN, self.y))
        shown = write(number, colours.INK, SMALL)
        self.surface.blit(shown, (MARGIN + self.width - shown.get_width(), self.y))
        high = max(3, 9 // len(shares))
        for place, (share, ink) in enumerate(zip(shares, inks, strict=True)):
            box = pygame.Rect(left, self.y + 3 + place * high, right - left, high)
            pygame.draw.rect(self.surface, colours.BACKGROUND, box)
            box.width = round(box.width * max(0.0, min(1.0, share)))
            pygame.draw.rect(self.surface, ink, box)
        self.y += max(LINE - 1, high * len(shares) + 6)

    def graph(
        self, title: str, lines: Sequence[Sequence[float]], inks: Sequence[Colour], height: int
    ) -> None:
        """Lines over time, in one frame, with their smallest and largest value."""
        every = [value for line in lines for value in line] or [0.0]
        low, high = min(0.0, *every), max(1e-9, *every)
        tall = (height - 4) / (high - low)  # pixels of 1
        self.surface.blit(write(title, colours.DIM, SMALL), (MARGIN, self.y))
        right = MARGIN + self.width
        for line, ink in [*zip(lines, inks, strict=True)][::-1]:
            shown = write(f"{line[-1]:.4g}" if line else "", colours.INK, SMALL)
            right -= shown.get_width() + 8
            self.surface.blit(shown, (right + 8, self.y))
            self.surface.fill(ink, (right + 8, self.y + 13, shown.get_width(), 2))
        self.y += LINE - 2
        box = pygame.Rect(MARGIN, self.y, self.width, height)
        pygame.draw.rect(self.surface, colours.BACKGROUND, box)
        for line, ink in zip(lines, inks, strict=True):
            if len(line) > 1:
                every_nth = -(-len(line) // box.width)
                kept = [*line[::every_nth], line[-1]]
                across = (box.width - 3) / (len(kept) - 1)
                points = [
                    (box.left + 1 + index * across, box.bottom - 2 - (value - low) * tall)
                    for index, value in enumerate(kept)
                ]
                pygame.draw.lines(self.surface, ink, False, points, 2)
        self.y += height + 4
