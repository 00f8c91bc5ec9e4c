"""Pictures: sizes, whose bird is which, and small grey ones that show what the large one shows."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation

import marl_cair
from marl_cair.games.compiled import is_compiling
from marl_cair.games.flappy_bird.art import BIRD_COLOURS, area_means, luminance, make_art
from marl_cair.games.flappy_bird.gray import GAUGE_BRIGHT_LUMA, GAUGE_DARK_LUMA
from marl_cair.games.flappy_bird.rendering import GAUGE_BRIGHT, GAUGE_DARK
from tests.games.flappy_bird.flight import FLAP, NOOP, Flight

SIDES = {"gray": 84, "gray_80": 80}


def fly_on(flight: Flight, num_decisions: int, seed: int = 0) -> None:
    """Flaps that keep the birds near the next gap, each in its own way."""
    luck = np.random.default_rng(seed)
    for _ in range(num_decisions):
        gap, players = flight.next_gap(), range(flight.engine.num_players)
        wants = [flight.y(player) > gap + 40 + 30 * luck.random() for player in players]
        flight.play(*(int(want) for want in wants))


def shrink(flight: Flight, name: str, player: int = 0) -> np.ndarray:
    """The area means of the large picture's luminance."""
    image = flight.seen("image", player).transpose(1, 2, 0)
    return area_means(luminance(image), SIDES[name]).astype(int)


@pytest.mark.plain_python
@pytest.mark.parametrize("name", SIDES)
@pytest.mark.parametrize("scenario", ["classic", "hard", "storm", "race-4-windy"])
def test_gray_shows_the_area_means_of_the_image(name, scenario):
    """To a rounding where one thing is in a cell, to a few levels where edges meet.

    Birds that cover each other have all their edges in the same few cells.
    """
    flight = Flight(scenario, seed=3)
    for turn in range(4 if is_compiling() else 1):
        fly_on(flight, 23, seed=turn)
        for player in range(flight.engine.num_players):
            apart = np.abs(flight.seen(name, player)[0].astype(int) - shrink(flight, name, player))
            assert apart.max() <= (24 if flight.engine.num_players == 1 else 80)
            assert apart.mean() < 0.25
            assert (apart > 4).mean() < 0.01


@pytest.mark.plain_python
def test_each_wind_has_its_own_picture_and_the_gauge_its_colours_in_grey():
    for colour, luma in ((GAUGE_DARK, GAUGE_DARK_LUMA), (GAUGE_BRIGHT, GAUGE_BRIGHT_LUMA)):
        assert luminance(colour[None])[0] == luma
    flight = Flight("windy")
    flight.wait(1)
    seen = set()
    for wind in (-150, 0, 70, 150):
        flight.world.wind[0] = wind
        flight.world.gust_ticks[0] = 5
        flight.hover()
        flight.play()
        seen.add(flight.seen("gray")[0, :18, :8].tobytes())
    assert len(seen) == 4


@pytest.mark.plain_python
@pytest.mark.parametrize(("scenario", "has_wind"), [("windy", True), ("classic", False)])
def test_a_gauge_of_the_wind_is_seen_only_where_there_may_be_any(scenario, has_wind):
    flight = Flight(scenario)
    flight.wait(5)
    corner = flight.seen("image")[:, :60, :24].transpose(1, 2, 0)
    for colour in (GAUGE_DARK, GAUGE_BRIGHT):
        assert (corner == colour).all(-1).any() == has_wind
    for name in SIDES:
        apart = np.abs(flight.seen(name)[0].astype(int) - shrink(flight, name))[:18, :8]
        assert apart.max() <= 8


@pytest.mark.plain_python
def test_own_bird_is_yellow_and_the_owner_of_yellow_has_its_colour():
    flight = Flight("race-4")
    flight.wait(1)
    flight.world.bird_y[:] = [3_000, 11_000, 19_000, 27_000]
    flight.play()

    def bird_colours(image: np.ndarray) -> list[int]:
        found = []
        for player in range(4):
            y = int(flight.y(player))
            box = image[y : y + 24, 57:91].reshape(-1, 3)
            counts = [(box == colour).all(1).sum() for colour in BIRD_COLOURS]
            found.append(int(np.argmax(counts)))
        return found

    assert bird_colours(flight.engine.render(0)) == [0, 1, 2, 3]
    assert bird_colours(flight.engine.render(0, 0)) == [0, 1, 2, 3]
    assert bird_colours(flight.seen("image", 2).transpose(1, 2, 0)) == [2, 1, 0, 3]


@pytest.mark.plain_python
def test_a_crashed_bird_is_seen_once_more_and_then_not():
    flight = Flight("race-4")
    flight.hover()
    flight.play()
    flight.world.bird_y[:] = [3_000, 11_000, 19_000, 39_000]
    flight.play()
    hit = flight.seen("image", 0)
    flight.world.bird_y[:3] = [3_000, 11_000, 19_000]
    flight.play()
    ground = hit[:, 404:, 54:98].astype(int), flight.seen("image", 0)[:, 404:, 54:98].astype(int)
    sky = make_art().ground
    assert (ground[0] != ground[1]).any()
    scroll = 3 * 4 % 24
    assert np.array_equal(ground[1], sky[:, :, 54 + scroll : 98 + scroll])


def test_pictures_have_ples_size_and_only_people_see_the_score():
    flight = Flight()
    flight.wait(1)
    seen, picture = flight.seen("image"), flight.engine.render(0)
    assert (picture.shape, seen.shape) == ((512, 288, 3), (3, 512, 288))
    flight.world.pipes_passed[0] = 7
    assert np.array_equal(flight.seen("image"), seen)
    assert not np.array_equal(flight.engine.render(0), picture)


@pytest.mark.plain_python
@pytest.mark.parametrize("options", [{}, {"ticks_per_step": 3}])
def test_the_stack_holds_the_last_four_steps_newest_last(options):
    flight = Flight("race-2", **options)
    past = [flight.engine.observe("gray")[0, :, 0]] * 4
    for step in range(8):
        stack = flight.engine.observe("gray_stack")[0]
        assert np.array_equal(stack, np.stack(past[-4:], 1)), step
        flight.play(NOOP, FLAP if step % 3 == 1 else NOOP)
        past.append(flight.engine.observe("gray")[0, :, 0])


@pytest.mark.plain_python
def test_the_stack_is_the_same_after_a_restore():
    flight, other = Flight(), Flight(seed=1)
    fly_on(flight, 10)
    other.engine.restore(flight.engine.snapshot())
    assert np.array_equal(other.seen("gray_stack"), flight.seen("gray_stack"))
    fly_on(flight, 2)
    fly_on(other, 2)
    assert np.array_equal(other.seen("gray_stack"), flight.seen("gray_stack"))


@pytest.mark.plain_python
def test_gymnasiums_frame_stack_gives_the_same_stack():
    stacked = FrameStackObservation(
        gymnasium.make("marl_cair/FlappyBird-classic-v0", representation="gray"), 4
    )
    own = gymnasium.make("marl_cair/FlappyBird-classic-v0", representation="gray_stack")
    first, _ = stacked.reset(seed=3)
    second, _ = own.reset(seed=3)
    luck = np.random.default_rng(0)
    for _ in range(30):
        assert np.array_equal(first[:, 0], second)
        action = int(luck.random() < 0.1)
        first, *ended, _ = stacked.step(action)
        second, *_ = own.step(action)
        if ended[1]:
            break


@pytest.mark.plain_python
def test_torchrls_frame_stack_gives_the_same_stack():
    from torchrl.envs import CatFrames, TransformedEnv  # torch is slow to load

    shown = {"representation": "gray", "extra_representations": ("gray_stack",)}
    base = marl_cair.make_torchrl_env("flappy_bird", num_worlds=2, seed=0, max_ticks=20, **shown)
    frames = CatFrames(4, dim=-3, in_keys=[("player", "observation")], reset_key="_reset")
    env = TransformedEnv(base, frames)
    state = env.reset()
    for step in range(30):
        seen = state["player"]
        assert np.array_equal(seen["observation"].numpy(), seen["gray_stack"].numpy()), step
        state["player", "action"] = base.action_spec["player", "action"].zero()
        _, state = env.step_and_maybe_reset(state)
