"""Colours of the players as a game's own pictures draw them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.drawing import SPECTATOR, read_colours

# After Okabe and Ito (2008): colour-blind people can distinguish them.
_OTHER_COLOURS = read_colours("0072b2 d55e00 009e73 cc79a7 e69f00 56b4e9 f0e442 6e6e76")


def list_seat_colours(
    game: str, scenario: Any, team_of_seat: NDArray[np.int64], viewer: int | None
) -> list[tuple[int, int, int]]:
    """The colour of each seat [P], RGB, in the picture of a viewer, None for the spectator."""
    seats, seen = range(len(team_of_seat)), SPECTATOR if viewer is None else viewer
    if game == "deep_rts":
        from marl_cair.games.deep_rts.art import scene, sprites

        find = _plain(scene.colour_of)
        chosen = [sprites.PLAYER_COLOURS[find(team_of_seat, seen, seat)] for seat in seats]
    elif game == "deep_line_wars":
        from marl_cair.games.deep_line_wars.rendering import SIDE_COLOURS

        chosen = [SIDE_COLOURS[int(seat != max(0, seen))] for seat in seats]
    elif game == "deep_maze":
        from marl_cair.games.deep_maze.rendering import HUNTER_COLOUR, PLAYER_COLOURS

        rows = [(seat - max(0, seen)) % HUNTER_COLOUR for seat in seats]
        if scenario.is_chase:
            rows[0] = HUNTER_COLOUR
        chosen = [PLAYER_COLOURS[row] for row in rows]
    elif game == "flappy_bird":
        from marl_cair.games.flappy_bird.art import BIRD_COLOURS
        from marl_cair.games.flappy_bird.rendering import colour_of

        find = _plain(colour_of)
        chosen = [BIRD_COLOURS[find(seat, seen) % len(BIRD_COLOURS)] for seat in seats]
    else:
        chosen = [_OTHER_COLOURS[seat % len(_OTHER_COLOURS)] for seat in seats]
    return [(int(c[0]), int(c[1]), int(c[2])) for c in chosen]


def _plain(function: Any) -> Any:
    """The Python function of a compiled rule: compiling it for one call would take longer."""
    return getattr(function, "py_func", function)
