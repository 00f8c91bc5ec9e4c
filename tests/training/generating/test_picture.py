"""The picture of predictions: one column for each transition; differences are in the last row."""

import numpy as np
import torch
from PIL import Image

from marl_cair.games import GAMES
from marl_cair.training.generating.picture import draw_predictions


def draw(path, scenario, representation, change):
    """Draw two empty transitions; `change` differs in the prediction of the second."""
    game = GAMES["deep_line_wars"] if scenario else GAMES["flappy_bird"]
    spec = game.make_spec(game.scenario(scenario))
    seen = spec.representations[representation]
    empty = torch.zeros((2, *seen.shape), dtype=torch.uint8)
    predicted = empty.clone()
    predicted[(1, *change)] = 255
    static = spec.static_planes if representation == "planes" else ()
    draw_predictions(path, seen, static, empty, empty, predicted)
    return np.asarray(Image.open(path))


def test_a_wrong_cell_is_white_in_the_last_row_alone(tmp_path):
    picture = draw(tmp_path / "a.png", "10x15", "planes", (5, 3, 4))
    margin = picture.shape[1] - 2 * (15 * 9 + 6)
    assert 12 < margin < 100  # the names of the rows
    names = [picture[row * 96 : row * 96 + 96, :margin] for row in range(4)]
    assert all(name.max() > 250 for name in names)
    assert len({name.tobytes() for name in names}) == 4
    picture = picture[:, margin:]
    assert picture.shape == (4 * (10 * 9 + 6), 2 * (15 * 9 + 6), 3)
    differs = picture[3 * 96 + 6 :].max(-1)
    rows, columns = np.nonzero(differs == 255)
    assert (rows.min(), rows.max() + 1) == (3 * 9, 4 * 9)
    assert (columns.min(), columns.max() + 1) == (141 + 6 + 4 * 9, 141 + 6 + 5 * 9)


def test_of_stacked_frames_the_newest_is_drawn(tmp_path):
    newest = draw(tmp_path / "a.png", None, "gray_stack", (3, 10, 20))
    older = draw(tmp_path / "b.png", None, "gray_stack", (0, 10, 20))
    assert newest[2 * 174 + 6 :, -342:][:168].max() == 255
    assert older[2 * 174 + 6 :, -342:][:168].max() == 64  # the lines between pictures
