"""Scenarios refuse what cannot be played, and say what can."""

from __future__ import annotations

import pytest

from marl_cair.games import make_engine
from marl_cair.games.flappy_bird.playable import SURELY_PLAYABLE, is_playable, search_course
from marl_cair.games.flappy_bird.scenarios import SCENARIOS, Scenario
from marl_cair.games.flappy_bird.tables import MAX_GAP, gap_tops
from marl_cair.lookup import UnknownNameError

pytestmark = pytest.mark.plain_python


def test_classic_has_ples_numbers():
    classic = SCENARIOS["classic"]
    numbers = (classic.num_players, classic.pipe_gap, classic.pipe_speed, classic.wind)
    assert numbers == (1, 100, 4.0, 0.0)
    assert gap_tops(100) == (25, 192)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_players": 0}, r"num_players is 0, it must be a whole number in 1\.\.8"),
        ({"num_players": 9}, r"num_players is 9, it must be a whole number in 1\.\.8"),
        ({"num_players": True}, r"num_players is True, it must be a whole number"),
        ({"pipe_gap": -5}, r"pipe_gap is -5, it must be a whole number in 25\.\.300"),
        ({"pipe_gap": 24}, r"pipe_gap is 24, it must be a whole number in 25\.\.300"),
        ({"pipe_gap": 301}, r"pipe_gap is 301, it must be a whole number in 25\.\.300"),
        ({"pipe_gap": 100.0}, r"pipe_gap is 100\.0, it must be a whole number"),
        ({"pipe_gap": 60}, r"pipe_gap 60, pipe_speed 4\.0 and wind 0\.0 cannot be played: .*"),
        ({"pipe_speed": 7.0}, r".*pipe_speed 7\.0 .* take a larger gap, slower pipes or less wind"),
        ({"pipe_gap": 90, "wind": 3.0}, r".*wind 3\.0 cannot be played"),
        ({"pipe_speed": 0.9}, r"pipe_speed is 0\.9, it must be in 1\.0\.\.12\.0 pixels per tick"),
        ({"pipe_speed": 4.05}, r"pipe_speed is 4\.05, .* with at most one decimal"),
        ({"pipe_speed": "4"}, r"pipe_speed is '4', it must be in 1\.0\.\.12\.0"),
        ({"wind": -1.0}, r"wind is -1\.0, it must be in 0\.0\.\.3\.0"),
        ({"wind": float("nan")}, r"wind is nan, it must be in"),
        ({"max_ticks": 0}, r"max_ticks is 0, it must be a whole number in 1\.\."),
        ({"ticks_per_step": 0}, r"ticks_per_step is 0"),
        ({"ticks_per_step": 6}, r".*cannot be played at ticks_per_step 6: .* less wind or fewer t"),
    ],
)
def test_settings_that_cannot_be_played_are_refused_with_their_range(options, message):
    with pytest.raises(ValueError, match=rf"flappy_bird: {message}"):
        Scenario(**options)


def test_unknown_rewards_and_options_name_the_nearest():
    with pytest.raises(UnknownNameError, match="classic"):
        Scenario(reward="clasic")
    with pytest.raises(UnknownNameError, match="pipe_gap"):
        make_engine("flappy_bird", pipe_gab=120)


def test_whole_numbers_will_do_for_speeds():
    assert Scenario(pipe_speed=4).speed_hundredths == 400
    assert Scenario(pipe_speed=4.1).speed_hundredths == 410


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "wind", "gap"), SURELY_PLAYABLE)
def test_scenarios_taken_for_playable_are(speed, wind, gap):
    """At the narrowest and at wider gaps, at that speed and slower, in that wind and less."""
    assert search_course(gap, speed, wind)
    for wider in range(gap, MAX_GAP + 1, 29):
        for slower in (speed, speed - 130, 100):
            for calmer in {0, wind // 2, wind}:
                assert search_course(wider, slower, calmer), (wider, slower, calmer)


@pytest.mark.parametrize(("ticks_per_step", "gap"), [(1, 62), (2, 71), (3, 82), (6, 104)])
def test_the_narrowest_gap_is_found(ticks_per_step, gap):
    assert is_playable(gap, 400, 0, ticks_per_step)
    assert not is_playable(gap - 1, 400, 0, ticks_per_step)
