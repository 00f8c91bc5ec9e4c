"""Colours of the window; those of players are the ones that a game's pictures use."""

from __future__ import annotations

from marl_cair.viewer import colours
from marl_cair.window.session import Session

Colour = tuple[int, int, int]

BACKGROUND, PANEL, TRACK = (22, 24, 32), (36, 39, 50), (58, 62, 74)
INK, DIM, BRIGHT = (238, 240, 246), (150, 156, 172), (94, 252, 242)
GOOD, ACCENT = (86, 180, 233), (250, 204, 72)
PRESENCE = (214, 51, 108)
SHADE = (64, 68, 84)  # multiplies colours below a name


def list_seat_colours(session: Session, viewer: int | None) -> list[Colour]:
    """The colour of each seat [P] in the picture of a viewer (None: the spectator)."""
    spec = session.spec
    return colours.list_seat_colours(session.game.name, session.scenario, spec.team_of_seat, viewer)
