"""Maps of several sizes in one batch."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.maps.maps import MapError, load_map
from marl_cair.games.deep_rts.maps.padding import pad_maps
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.deep_rts.state import MAP_INDEX
from marl_cair.games.deep_rts.tables import WALL
from tests.games.deep_rts.skirmish import draw_actions

SMALL, LARGE = "15x15-2p-crossing", "21x21-2p-fords"


def test_a_smaller_map_stands_in_the_middle_of_walls():
    small, large = load_map(SMALL), load_map(LARGE)
    padded, kept = pad_maps([small, large])
    assert kept is large
    assert padded.tiles.shape == (21, 21)
    np.testing.assert_array_equal(padded.tiles[3:18, 3:18], small.tiles)
    around = np.ones((21, 21), bool)
    around[3:18, 3:18] = False
    assert (padded.tiles[around] == WALL).all()
    assert padded.spawns == tuple((row + 3, column + 3) for row, column in small.spawns)
    assert padded.frames == small.frames


def test_a_map_that_cannot_stand_in_the_middle_is_refused():
    with pytest.raises(MapError, match="15x15-2p-crossing has 15x15 .* middle of 15x30|30x30"):
        Scenario(map=f"{SMALL}+generated-30x30-2p-1").maps  # noqa: B018  # reading it loads them


def test_a_mixture_with_too_few_spawns_is_refused():
    scenario = Scenario(map=f"{LARGE}+15x15-1p-embers")
    with pytest.raises(ValueError, match="15x15-1p-embers has 1 spawns"):
        scenario.maps  # noqa: B018


def test_worlds_of_one_batch_are_on_maps_of_several_sizes_and_play():
    engine = make_engine("deep_rts", map=f"{SMALL}+{LARGE}", num_worlds=8)
    engine.reset(np.arange(8, dtype=np.uint64))
    drawn = engine._worlds.clock[:, MAP_INDEX]
    assert set(drawn.tolist()) == {0, 1}
    walls = engine.observe("planes")[:, :, 2]  # tiles have planes but for grass, so lava is 1
    assert (walls[drawn == 0, :, 0] == 255).all()
    luck = np.random.default_rng(0)
    for _ in range(20):
        engine.step(draw_actions(engine, luck))
        anew = engine.observe("planes", worlds=list(range(8)))
        np.testing.assert_array_equal(engine.observe_in_place("planes"), anew)
    assert not engine.illegal_actions.any()
