"""Colours of the window; those of players are the ones that a game's pictures use."""

from __future__ import annotations

from typing import Any

from marl_cair.window.session import Session

Colour = tuple[int, int, int]

BACKGROUND, PANEL, TRACK = (22, 24, 32), (36, 39, 50), (58, 62, 74)
INK, DIM, BRIGHT = (238, 240, 246), (150, 156, 172), (94, 252, 242)
GOOD, BAD, ACCENT = (86, 180, 233), (230, 159, 0), (250, 204, 72)
PRESENCE = (214, 51, 108)


def list_seat_colours(session: Session, viewer: int | None) -> list[Colour]:
    """The colour of each seat [P] in the picture of a viewer (None: the spectator)."""
    seats = range(session.spec.num_players)
    seen = -1 if viewer is None else viewer
    name = session.game.name
    if name == "deep_rts":
        from marl_cair.games.deep_rts.art import scene, sprites

        find = _plain(scene.colour_of)
        teams = session.spec.team_of_seat
        chosen = [sprites.PLAYER_COLOURS[find(teams, seen, seat)] for seat in seats]
    elif name == "deep_line_wars":
        from marl_cair.games.deep_line_wars.rendering import SIDE_COLOURS

        chosen = [SIDE_COLOURS[int(seat != max(0, seen))] for seat in seats]
    elif name == "deep_maze":
        from marl_cair.games.deep_maze import rendering

        hunter = session.scenario.is_chase
        last = rendering.HUNTER_COLOUR
        rows = [last if hunter and s == 0 else (s - max(0, seen)) % last for s in seats]
        chosen = [rendering.PLAYER_COLOURS[row] for row in rows]
    else:
        from marl_cair.games.flappy_bird.art import BIRD_COLOURS
        from marl_cair.games.flappy_bird.rendering import colour_of

        find = _plain(colour_of)
        chosen = [BIRD_COLOURS[find(seat, seen) % len(BIRD_COLOURS)] for seat in seats]
    return [(int(c[0]), int(c[1]), int(c[2])) for c in chosen]


def _plain(function: Any) -> Any:
    """The Python function of a compiled rule: compiling it for one call would take longer."""
    return getattr(function, "py_func", function)
