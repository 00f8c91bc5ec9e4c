"""What scenarios of all games take for numbers, switches, lists and maps."""

import re
from pathlib import Path

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.scenarios import Scenario as LineWars
from marl_cair.games.deep_maze.scenarios import Scenario as Maze
from marl_cair.games.deep_rts.maps.formats import MapError
from marl_cair.games.deep_rts.scenarios import Scenario as Rts
from marl_cair.games.flappy_bird.scenarios import Scenario as Flappy


@pytest.mark.parametrize(
    ("scenario", "field", "value"),
    [
        (LineWars, "rows", np.int64(9)),
        (LineWars, "shaping_discount", np.float32(0.5)),
        (Maze, "density", np.float64(1.0)),
        (Maze, "mask_walls", np.False_),
        (Flappy, "wind", np.float64(0.5)),
        (Flappy, "pipe_speed", np.int8(3)),
        (Rts, "num_players", np.uint8(2)),
        (Rts, "fog", np.True_),
    ],
)
def test_numpys_numbers_become_pythons_own(scenario, field, value):
    kept = getattr(scenario(**{field: value}), field)
    assert kept == value
    assert type(kept) is type(value.item())


@pytest.mark.parametrize("discount", ["a", None, True, float("nan")])
@pytest.mark.parametrize("scenario", [LineWars, Maze, Rts])
def test_a_discount_is_a_number(scenario, discount):
    message = f"shaping_discount is {discount!r}, it must be above 0 and at most 1"
    with pytest.raises(ValueError, match=re.escape(message)):
        scenario(shaping_discount=discount)


@pytest.mark.parametrize(
    ("scenario", "field", "value", "message"),
    [
        (Rts, "fog", "no", "deep_rts: fog is 'no', it must be True or False"),
        (Rts, "fog", 1, "deep_rts: fog is 1, it must be True or False"),
        (Rts, "army", 5, "deep_rts: army is 5, it must be () or the numbers of peasants"),
        (Rts, "army", ("a", 1, 1, 1), "deep_rts: army is ('a', 1, 1, 1), it must be () or the"),
        (Rts, "army", (1.5, 0, 0, 0), "deep_rts: army is (1.5, 0, 0, 0), it must be () or the"),
        (Rts, "army", "", "deep_rts: army is '', it must be () or the numbers"),
        (Rts, "teams", 5, "deep_rts: teams is 5, it must be () or the team of each seat"),
        (Rts, "teams", ("a", "b"), "deep_rts: teams is ('a', 'b'), it must be () or the team"),
        (Rts, "teams", (0, 128), "deep_rts: teams is (0, 128), it must be () or the team of"),
        (Rts, "map", 5, "deep_rts: map is 5, it must be the name of a map or the path of a map"),
        (Rts, "map", "", "deep_rts: map is '', it must be the name of a map or the path of a"),
        (Maze, "density", True, "deep_maze: density is True, it must be a number in 0..1"),
        (Flappy, "wind", None, "flappy_bird: wind is None, it must be in 0.0..3.0 pixels"),
    ],
)
def test_what_a_field_cannot_hold_is_named(scenario, field, value, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        scenario(**{field: value})


def test_lists_of_whole_numbers_become_tuples():
    made = Rts(army=[np.int64(1), 0, 0, 0], teams=np.array([1, 0]))
    assert (made.army, made.teams) == ((1, 0, 0, 0), (1, 0))
    assert hash(made) == hash(Rts(army=(1, 0, 0, 0), teams=(1, 0)))


def test_a_path_is_the_name_of_its_map():
    assert Rts(map=Path("maps/lake.txt")).map == str(Path("maps/lake.txt"))


@pytest.mark.parametrize("name", ["x.json", "x.txt", "15x15-2p-crossing+x.tmj"])
def test_a_map_file_that_is_not_there_is_named(name):
    file = name.rpartition("+")[2]
    message = re.escape(f"map {file}: the file cannot be read (") + ".*; give the path of one"
    with pytest.raises(MapError, match=message):
        make_engine("deep_rts", map=name)
