"""`Scene`: draws the window: the game, marks, minimap, bar of buttons, panels, messages, menu."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pygame

from marl_cair.window import colours
from marl_cair.window.camera import Rect
from marl_cair.window.colours import list_seat_colours
from marl_cair.window.controls.controls import NO_PLACE, Button, Mark
from marl_cair.window.hotkeys import GESTURES, HOTKEYS
from marl_cair.window.panels import draw_panels
from marl_cair.window.pen import LINE, MARGIN, SMALL, fit, write
from marl_cair.window.representations import GAP, count_across

if TYPE_CHECKING:
    from marl_cair.window.window import Window

PANEL_WIDTH, SCROLLBAR = 344, 4
WHEEL_LINES = 3  # of panels, for each notch of the mouse wheel
BAR_HEIGHT, BUTTON_WIDTH = 58, 148
MINIMAP_PIXELS = 150
LEAST_WIDTH = 2 * PANEL_WIDTH  # narrower windows show no panels
PANEL_SECONDS = 0.5  # panels are drawn again after a step, and so often without one


class Scene:
    """Draws a window, part by part; parts that have not changed are kept as surfaces."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self._picture: pygame.Surface | None = None
        self._scaled: pygame.Surface | None = None
        self._panels = pygame.Surface((PANEL_WIDTH, 1))
        self._panels_height, self._panels_top = 0, 0  # what they need, and what is scrolled away
        self._panels_box = pygame.Rect(0, 0, 0, 0)
        self._drawn: dict[str, Any] = {}  # from what each part was drawn
        self._buttons: list[tuple[Rect, Button]] = []
        self._minimap: Rect | None = None

    def draw(self) -> None:
        """Draw everything on the window's surface."""
        window, surface = self.window, self.window.surface
        width, height = surface.get_size()
        shows_panels = window.shown["panels"] and width >= LEAST_WIDTH
        right = PANEL_WIDTH if shows_panels else 0
        wide, high = max(1, width - right), max(1, height - BAR_HEIGHT)
        camera, strip = window.camera, MINIMAP_PIXELS + 2 * MARGIN
        camera.size = window.moment.picture.shape[1], window.moment.picture.shape[0]
        camera.area = (0, 0, wide, high)
        if not camera.is_whole and camera.size[0] * camera.scale <= wide - strip:
            camera.area = (0, 0, wide - strip, high)  # there is room for the minimap beside it
        surface.fill(colours.BACKGROUND)
        surface.set_clip(pygame.Rect(0, 0, wide, high))
        self._draw_picture()
        self._draw_marks()
        self._draw_minimap()
        surface.set_clip(None)
        self._draw_bar(wide, height)
        self._panels_box = pygame.Rect(width - right, 0, right, height)
        if shows_panels:
            self._draw_panels()
        if window.shown["menu"]:
            self._draw_menu()

    # --- the game ---------------------------------------------------------------------------------

    def _draw_picture(self) -> None:
        window, camera = self.window, self.window.camera
        picture = window.moment.picture
        if self._drawn.get("picture") is not picture:
            self._drawn["picture"] = picture
            self._picture = pygame.image.frombuffer(picture.tobytes(), camera.size, "RGB")
            self._drawn["scale"] = None
        original = self._picture
        if original is None:
            return
        scale = camera.scale
        if self._drawn.get("scale") != scale:
            self._drawn["scale"] = scale
            self._scaled = original.copy()
            if scale > 1:
                size = camera.size[0] * scale, camera.size[1] * scale
                self._scaled = pygame.transform.scale(original, size)
            self._draw_presence(self._scaled)
            self._draw_names(self._scaled)
        if self._scaled is not None:
            window.surface.blit(self._scaled, camera.corner())

    def _draw_names(self, scaled: pygame.Surface) -> None:
        """Names of planes over them."""
        moment, scale = self.window.moment, self.window.camera.scale
        if not moment.view.representation:
            return
        kind = self.window.session.spec.representations[moment.view.representation]
        if kind.shape[0] <= 3:
            return
        across = count_across(kind.shape)
        for index, name in enumerate(kind.plane_names):
            left = (GAP + index % across * (kind.shape[2] + GAP)) * scale
            top = (GAP + index // across * (kind.shape[1] + GAP)) * scale
            shown = fit(name, kind.shape[2] * scale - 4, colours.BRIGHT, SMALL)
            strip = (left, top, min(shown.get_width() + 4, kind.shape[2] * scale), LINE)
            scaled.fill(colours.SHADE, strip, pygame.BLEND_MULT)
            scaled.blit(shown, (left + 2, top + 1), (0, 0, strip[2], LINE))

    def _draw_presence(self, scaled: pygame.Surface) -> None:
        """The presence of capsules over the board: the largest of all parts in each place."""
        window = self.window
        presence, board = window.moment.presence, window.find_board()
        if presence is None or not window.shown["presence"]:
            return
        size = scaled.get_size()
        left, top = 0.0, 0.0
        if board is not None:
            scale = window.camera.scale
            left, top = board.left * scale, board.top * scale
            columns, rows = board.columns * board.tile, board.rows * board.row_pixels
            size = max(1, round(columns * scale)), max(1, round(rows * scale))
        strongest = presence.max(0)
        strongest = (strongest - strongest.min()) / max(1e-6, float(np.ptp(strongest)))
        layer = pygame.Surface(strongest.shape[::-1], pygame.SRCALPHA)
        layer.fill((*colours.PRESENCE, 255))
        pygame.surfarray.pixels_alpha(layer)[:] = (190 * strongest.T).astype(np.uint8)
        scaled.blit(pygame.transform.scale(layer, size), (left, top))

    def _draw_marks(self) -> None:
        window = self.window
        board = window.find_board()
        if board is None:
            return
        if window.shown["grid"]:
            for row in range(board.rows + 1):
                self._line(board.find_box(row, 0), board.find_box(row, board.columns))
            for column in range(board.columns + 1):
                self._line(board.find_box(0, column), board.find_box(board.rows, column))
        if not window.controls or window.view.representation:
            return
        control = window.controls[window.person]
        if window.view.seat != control.seat:
            return
        marks = control.list_marks(window.moment)
        cell = window.find_cell(window.pointer) if window.pointer else None
        if cell is not None:
            marks = [*marks, *control.mark_pointer(cell, window.moment)]
        for mark in marks:
            self._frame(board, mark)
        if window.drag_start is not None and cell is not None:
            rows, columns = (sorted(p) for p in zip(window.drag_start, cell, strict=True))
            first = board.find_box(rows[0], columns[0])
            last = board.find_box(rows[1] + 1, columns[1] + 1)
            box = pygame.Rect(*self._place(first), 0, 0)
            box.size = tuple(np.subtract(self._place(last), box.topleft).tolist())
            pygame.draw.rect(window.surface, colours.BRIGHT, box, 1)

    def _place(self, point: tuple[float, float]) -> tuple[int, int]:
        left, top = self.window.camera.corner()
        scale = self.window.camera.scale
        x, y = (math.floor(number + 1e-6) for number in point)  # 6.9999999 is meant as 7
        return left + x * scale, top + y * scale

    def _line(self, first: tuple[float, float], last: tuple[float, float]) -> None:
        pygame.draw.line(self.window.surface, colours.TRACK, self._place(first), self._place(last))

    def _frame(self, board: Any, mark: Mark) -> None:
        left, top = self._place(board.find_box(*mark.corner))
        row, column = mark.corner[0] + mark.size, mark.corner[1] + mark.size
        right, bottom = self._place(board.find_box(row, column))
        box = pygame.Rect(left, top, right - left, bottom - top)
        pygame.draw.rect(self.window.surface, colours.BACKGROUND, box.inflate(2, 2), 1)
        pygame.draw.rect(self.window.surface, pygame.Color(mark.colour), box, 2)

    def follow_frame(self) -> None:
        """Scroll until the keyboard's frame is in sight."""
        window, board = self.window, self.window.find_board()
        control = window.controls[window.person] if window.controls else None
        frame = getattr(control, "frame", NO_PLACE)
        if board is None or frame == NO_PLACE or window.camera.is_whole:
            return
        x, y = self._place(board.find_box(frame[0] + 0.5, frame[1] + 0.5))
        left, top, width, height = window.camera.area
        edge = 2 * board.tile * window.camera.scale
        is_near = left + edge < x < left + width - edge and top + edge < y < top + height - edge
        if not is_near:
            window.camera.centre_on(*board.find_box(frame[0] + 0.5, frame[1] + 0.5))

    def _draw_minimap(self) -> None:
        """The whole picture, small, with a frame around the shown part."""
        self._minimap = None
        camera, surface = self.window.camera, self.window.surface
        area = surface.get_clip()
        if camera.is_whole or self._picture is None or area.width < 2 * MINIMAP_PIXELS:
            return
        shrink = MINIMAP_PIXELS / max(camera.size)
        wide, high = (max(1, round(side * shrink)) for side in camera.size)
        if self._drawn.get("minimap") is not self._drawn["picture"]:
            self._drawn["minimap"] = self._drawn["picture"]
            self._drawn["small"] = pygame.transform.smoothscale(self._picture, (wide, high))
        left, top = area.right - wide - MARGIN, area.bottom - high - MARGIN
        minimap = self._minimap = (left, top, wide, high)
        surface.blit(self._drawn["small"], (left, top))
        pygame.draw.rect(surface, colours.DIM, minimap, 1)
        corner = camera.to_picture(*camera.area[:2])
        shown = [camera.area[2 + axis] / camera.scale * shrink for axis in range(2)]
        box = pygame.Rect(left + corner[0] * shrink, top + corner[1] * shrink, *shown)
        pygame.draw.rect(surface, colours.BRIGHT, box.clip(pygame.Rect(minimap)), 1)

    # --- around it --------------------------------------------------------------------------------

    def _draw_bar(self, width: int, height: int) -> None:
        """Buttons of the person's orders, and below them the message."""
        window, surface = self.window, self.window.surface
        self._buttons = []
        top = height - BAR_HEIGHT
        pygame.draw.rect(surface, colours.PANEL, (0, top, width, BAR_HEIGHT))
        if window.controls:
            control = window.controls[window.person]
            listed = control.list_buttons(window.moment)
            wide = min(BUTTON_WIDTH, (width - 4) // max(1, len(listed)))
            for place, button in enumerate(listed):
                box = (4 + place * wide, top + 3, wide - 4, 36)
                self._buttons.append((box, button))
                self._draw_button(box, button)
        surface.blit(fit(window.message, width - 20, colours.ACCENT), (10, top + 42))

    def _draw_button(self, box: Rect, button: Button) -> None:
        surface = self.window.surface
        ink = colours.INK if button.is_possible else colours.DIM
        pygame.draw.rect(surface, colours.TRACK, box)
        if button.is_chosen:
            pygame.draw.rect(surface, colours.ACCENT, box, 2)
        key, room = pygame.key.name(button.key).upper(), box[2] - 9
        surface.blit(fit(f"{key}  {button.label}", room, ink), (box[0] + 5, box[1] + 4))
        surface.blit(fit(button.price, room, colours.DIM, SMALL), (box[0] + 5, box[1] + 21))

    def _draw_panels(self) -> None:
        window, box = self.window, self._panels_box
        drawn = window.moment, int(time.monotonic() / PANEL_SECONDS), box.height, window.speed
        last = self._drawn.get("panels")
        if last is None or last[0] is not drawn[0] or last[1:] != drawn[1:]:
            self._drawn["panels"] = drawn
            inks = list_seat_colours(window.session, window.moment.view.seat)
            state = window.describe_panels(inks)
            self._panels_height = draw_panels(self._panels, state)
            high = max(box.height, self._panels_height)
            if self._panels.get_height() < high:
                self._panels = pygame.Surface((PANEL_WIDTH, high))
                draw_panels(self._panels, state)
        self.scroll_panels(0)  # they may need less than before
        window.surface.blit(self._panels, box, (0, self._panels_top, *box.size))
        if self._panels_height > box.height:
            shrink = box.height / self._panels_height
            bar = box.right - SCROLLBAR, self._panels_top * shrink, SCROLLBAR, box.height * shrink
            window.surface.fill(colours.TRACK, (bar[0], 0, SCROLLBAR, box.height))
            window.surface.fill(colours.DIM, bar)

    def scroll_panels(self, pixels: int) -> None:
        """Move the panels up by pixels, to their end at most."""
        most = max(0, self._panels_height - self._panels_box.height)
        self._panels_top = max(0, min(most, self._panels_top + pixels))

    def turn_panels(self) -> None:
        """Show what follows below the panels that are shown; after the last the first again."""
        if self._panels_top + self._panels_box.height >= self._panels_height:
            self._panels_top = 0
        else:
            self.scroll_panels(max(LINE, self._panels_box.height - 2 * LINE))

    def roll_wheel(self, notches: int) -> None:
        """The mouse wheel was turned, up above 0: it scrolls panels and zooms the game."""
        window = self.window
        if window.pointer is not None and self._panels_box.collidepoint(window.pointer):
            self.scroll_panels(-notches * WHEEL_LINES * LINE)
        else:
            window.camera.change_zoom(notches, *(window.pointer or window.camera.area[:2]))

    def _draw_menu(self) -> None:
        """All keys: of the game, and of the window."""
        window, surface = self.window, self.window.surface
        lines = [(hotkey.label, hotkey.text) for hotkey in HOTKEYS] + list(GESTURES)
        for control in window.list_active():
            lines += [("", ""), ("", f"player {control.seat}"), *control.lines]
        left, top, width, height = window.camera.area
        wide, high = min(width - 20, 560), min(height - 20, LINE * len(lines) + 24)
        box = pygame.Rect(left + (width - wide) // 2, top + (height - high) // 2, wide, high)
        layer = pygame.Surface((max(1, wide), max(1, high)), pygame.SRCALPHA)
        layer.fill((*colours.BACKGROUND, 236))
        for place, (keys, text) in enumerate(lines):
            y = 12 + place * LINE
            layer.blit(write(keys, colours.ACCENT), (16, y))
            layer.blit(write(text, colours.INK if keys else colours.DIM), (150, y))
        surface.blit(layer, box)
        pygame.draw.rect(surface, colours.DIM, box, 1)

    def click(self, place: tuple[int, int]) -> bool:
        """A left click on the minimap or a button; False elsewhere."""
        window = self.window
        if self._minimap is not None and pygame.Rect(self._minimap).collidepoint(place):
            shrink = MINIMAP_PIXELS / max(window.camera.size)
            left, top = self._minimap[:2]
            window.camera.centre_on((place[0] - left) / shrink, (place[1] - top) / shrink)
            return True
        for box, button in self._buttons:
            if pygame.Rect(box).collidepoint(place):
                window.press(button.key)
                return True
        return False
