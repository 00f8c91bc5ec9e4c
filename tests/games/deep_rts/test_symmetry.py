"""No seat is better: seats that a symmetry of the map exchanges play the same game."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.maps.maps import compose_frames, load_map
from marl_cair.games.engine import BatchedEngine
from tests.games.deep_rts.boards import symmetries
from tests.games.deep_rts.skirmish import draw_action, play_random

NAMES = ("planes", "classic", "vector")
MELEE = {"army": (1, 5, 4, 2), "goal": "score"}
RICH = {"preset": "original", "goal": "score"}  # buildings rise at once
SOLDIERS = {"army": (0, 6, 4, 2), "goal": "score"}
GRID, FOG, CLASSIC = {"actions": "grid"}, {"fog": True}, {"actions": "classic"}


def fair_symmetries(game_map):
    """The symmetries under which seats see the board as the seats do that they are moved to."""
    return [
        (frame, seats)
        for frame, seats in symmetries(game_map)
        if frame != 0
        and all(
            own == compose_frames(frame, game_map.frames[seats[seat]])
            for seat, own in enumerate(game_map.frames)
        )
    ]


def orbits_of(game_map) -> list[list[int]]:
    """Groups of seats that fair symmetries exchange."""
    orbit = list(range(len(game_map.spawns)))
    for _, seats in fair_symmetries(game_map):
        for seat, other in enumerate(seats):
            low = min(orbit[seat], orbit[other])
            orbit[seat] = orbit[other] = low
    return [[s for s in range(len(orbit)) if orbit[s] == o] for o in sorted(set(orbit))]


def assert_equal_views(engine: BatchedEngine, orbits: list[list[int]], when: str) -> None:
    for name in NAMES:
        seen = engine.observe(name)[0]
        for first, *others in orbits:
            for seat in others:
                message = f"{name} of seats {first}, {seat} at {when}"
                np.testing.assert_array_equal(seen[seat], seen[first], message)


def play_alike(engine: BatchedEngine, game_map, num_steps: int, seed: int) -> None:
    """Seats of one orbit choose the same actions of their own views; their views stay equal."""
    orbits = orbits_of(game_map)
    assert len(orbits) < len(game_map.spawns)

    def draw(engine: BatchedEngine, luck: np.random.Generator) -> np.ndarray:
        mask = engine.action_mask()[0]
        actions = np.zeros((1, len(game_map.spawns), *engine.spec.action_shape), np.int32)
        for orbit in orbits:
            assert (mask[orbit] == mask[orbit[0]]).all()
            actions[0, orbit] = draw_action(mask[orbit[0]], engine.spec.action_groups, luck)
        return actions

    engine.reset(seed)
    assert_equal_views(engine, orbits, "the start")
    for step in play_random(engine, num_steps, seed, draw):
        assert_equal_views(engine, orbits, f"step {step}")
        assert engine.winner[0] == -1


def play_twins(engine: BatchedEngine, seats, num_steps: int, seed: int) -> None:
    """Two worlds of one seed: seat seats[k] of world 1 does what seat k of world 0 does."""
    luck = np.random.default_rng(seed)
    seats = np.array(seats)
    actions = np.zeros((2, len(seats), *engine.spec.action_shape), np.int32)
    engine.reset(np.array([seed, seed], np.uint64))
    for step in range(num_steps):
        mask = engine.action_mask()
        np.testing.assert_array_equal(mask[1, seats], mask[0])
        for seat in range(len(seats)):
            actions[0, seat] = draw_action(mask[0, seat], engine.spec.action_groups, luck)
        actions[1, seats] = actions[0]
        engine.step(actions)
        assert engine.illegal_actions.sum() == 0
        for name in NAMES:
            seen = engine.observe(name)
            np.testing.assert_array_equal(seen[1, seats], seen[0], f"{name} at {step}")
        np.testing.assert_array_equal(engine.rewards[1, seats], engine.rewards[0])
        winner, twin = engine.winner.tolist()
        assert twin == (seats[winner] if winner >= 0 else winner)
        if engine.terminated[0] or engine.truncated[0]:
            engine.reset(np.array([seed, seed], np.uint64) + np.uint64(step + 1))


@pytest.mark.parametrize(
    "options",
    [{}, FOG, CLASSIC, GRID, GRID | RICH, MELEE, SOLDIERS | FOG, MELEE | FOG | GRID],
    ids=str,
)
@pytest.mark.parametrize("name", ["10x10-2p-clearing", "15x15-2p-crossing", "21x21-2p-fords"])
def test_two_seats_that_do_the_same_stay_equal(name, options):
    engine = make_engine("deep_rts", map=name, **options)
    play_alike(engine, load_map(name), 60, seed=0)


@pytest.mark.parametrize("options", [{}, MELEE, SOLDIERS | FOG, RICH | GRID], ids=str)
@pytest.mark.parametrize("seed", [2, 3], ids=["turns", "mirrors"])
def test_four_seats_that_do_the_same_stay_equal(seed, options):
    engine = make_engine("deep_rts", map=f"generated-16x16-4p-{seed}", num_players=4, **options)
    play_alike(engine, engine.scenario.maps[0], 50, len(options))


@pytest.mark.parametrize(
    "options",
    [{}, FOG, CLASSIC, GRID, MELEE | {"reward": "shaped"}, MELEE | FOG | GRID, SOLDIERS],
    ids=str,
)
@pytest.mark.parametrize("name", ["10x10-2p-clearing", "21x21-2p-fords"])
def test_game_with_swapped_seats_is_the_swapped_game(name, options):
    engine = make_engine("deep_rts", num_worlds=2, map=name, **options)
    for _, seats in fair_symmetries(load_map(name)):
        play_twins(engine, seats, 60, seed=1)


@pytest.mark.parametrize("options", [RICH, MELEE, SOLDIERS | CLASSIC, RICH | GRID], ids=str)
@pytest.mark.parametrize(("map_seed", "frames"), [(2, {3, 5, 6}), (1, {1, 2, 3})])
def test_four_players_in_swapped_seats_play_the_swapped_game(map_seed, frames, options):
    name = f"generated-14x14-4p-{map_seed}"
    engine = make_engine("deep_rts", num_worlds=2, map=name, num_players=4, **options)
    found = dict(fair_symmetries(engine.scenario.maps[0]))
    assert found.keys() == frames
    for seed, seats in enumerate(found.values()):
        play_twins(engine, seats, 40, seed)


@pytest.mark.parametrize("seed", range(2))
def test_long_game_stays_mirrored(seed):
    """2,000 ticks in which both seats do the same."""
    engine = make_engine("deep_rts", map="10x10-2p-clearing", **RICH)
    play_alike(engine, load_map("10x10-2p-clearing"), 200, seed)
