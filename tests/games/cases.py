"""What the games offer, as the cases of tests that hold for every game, and seeded play on them."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from marl_cair.games import GAMES, make_engine
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import GameSpec

# Of games with many scenarios those that show all kinds of play; `make test-all` takes the others.
QUICK_SCENARIOS = {
    "deep_line_wars": ("11x11", "30x11"),
    "deep_rts": (
        "1v1-15x15",
        "FFA-3-15x15",
        "FFA-6-31x31-fog",
        "Teams-2v2-15x15-fog",
        "Economy-15x15",
        "LavaMaze-31x31",
    ),
    "deep_maze": (
        "7x7-full_deterministic",
        "9x9-sequence",
        "9x9-timed_line_of_sight",
        "15x15-race-3p-square",
        "15x15-chase-3p-line_of_sight",
    ),
    "flappy_bird": ("classic", "race-4-windy"),
}
# Games of browsers are slow, and have no snapshots: tests/games/flash plays them.
IN_PROCESS = [name for name in GAMES if GAMES[name].has_snapshots]
ILLEGAL_SHARE = 0.05  # of chosen actions is not looked up in the mask
GOLDEN_RATIO = 0.6180339887498949  # its multiples spread evenly over 0..1


class Case(NamedTuple):
    """A scenario of a game with one of its action spaces."""

    game: str
    scenario: str
    options: tuple[tuple[str, Any], ...] = ()

    def __str__(self) -> str:
        return "-".join([self.game, self.scenario, *(str(value) for _, value in self.options)])

    def engine(self, num_worlds: int = 1, num_threads: int = 1, **more: Any) -> BatchedEngine:
        options = dict(self.options) | more
        return make_engine(self.game, self.scenario, num_worlds, num_threads, **options)


def _action_spaces(game: str) -> Mapping[str, Any]:
    """The game's action spaces by name; one without a name where there is no choice."""
    scenarios = import_module(f"marl_cair.games.{game}.scenarios")
    return getattr(scenarios, "ACTION_SPACES", {})


def _list_scenarios() -> Iterator[Case]:
    for name in IN_PROCESS:
        game = GAMES[name]
        for scenario in game.scenarios:
            for actions in _action_spaces(name):
                yield Case(name, scenario, (("actions", actions),))
            if not _action_spaces(name):
                yield Case(name, scenario)


def _list_representations() -> Iterator[tuple[str, str]]:
    for name in IN_PROCESS:
        game = GAMES[name]
        for representation in game.make_spec(game.scenario()).representations:
            yield name, representation


def _is_quick(case: Case) -> bool:
    """Of each game: the default scenario in all action spaces, and others that are like none."""
    default = GAMES[case.game].default_scenario
    quick = QUICK_SCENARIOS.get(case.game)
    is_plain = all(value == _default_option(case.game, name) for name, value in case.options)
    return quick is None or case.scenario == default or (is_plain and case.scenario in quick)


def _default_option(game: str, name: str) -> Any:
    return getattr(GAMES[game].scenario(), name)


SCENARIOS = list(_list_scenarios())
QUICK_CASES = [case for case in SCENARIOS if _is_quick(case)]
CASES = [
    pytest.param(case, marks=() if case in QUICK_CASES else pytest.mark.slow, id=str(case))
    for case in SCENARIOS
]
DEFAULT_CASES = [case for case in SCENARIOS if case.scenario == GAMES[case.game].default_scenario]
REPRESENTATIONS = list(_list_representations())


def ticks_of(game: str, num_decisions: int, scenario: str | None = None) -> int:
    """Ticks that so many decisions last."""
    chosen = GAMES[game]
    return num_decisions * chosen.make_spec(chosen.scenario(scenario)).ticks_per_step


class Luck(NamedTuple):
    """Numbers in 0..1 from which players choose: the same whatever the batch around them is."""

    numbers: NDArray[np.float64]  # [T decisions, B, P, 2]

    @classmethod
    def draw(cls, num_decisions: int, num_worlds: int, num_players: int, seed: int = 0) -> Luck:
        shape = (num_decisions, num_worlds, num_players, 2)
        return cls(np.random.default_rng(seed).random(shape))

    def of_worlds(self, worlds: list[int]) -> Luck:
        return Luck(self.numbers[:, worlds])


def choose_action(spec: GameSpec, mask: NDArray[np.bool_], which: float, where: float) -> Any:
    """A legal kind of action, then one of that kind; a few actions are not looked up.

    With an action shape, one such choice at each place where there is one.
    """
    if mask.ndim > 1:
        chosen = np.full(mask.shape[:-1], spec.noop_action)
        for number, place in enumerate(np.argwhere(mask.sum(axis=-1) > 1)):
            numbers = (which + number * GOLDEN_RATIO) % 1, (where + number * GOLDEN_RATIO) % 1
            chosen[tuple(place)] = choose_action(spec, mask[tuple(place)], *numbers)
        return chosen
    if which < ILLEGAL_SHARE:
        return int(where * spec.num_actions)
    kinds = np.unique(spec.action_groups[mask])
    kind = kinds[int((which - ILLEGAL_SHARE) / (1 - ILLEGAL_SHARE) * len(kinds))]
    candidates = np.flatnonzero(mask & (spec.action_groups == kind))
    return int(candidates[int(where * len(candidates))])


def choose_actions(engine: BatchedEngine, numbers: NDArray[np.float64]) -> NDArray[np.int32]:
    """Actions [B, P, *action_shape] from numbers in 0..1 [B, P, 2]."""
    masks = engine.action_mask()
    chosen = [
        [
            choose_action(engine.spec, masks[world, player], *numbers[world, player])
            for player in range(engine.num_players)
        ]
        for world in range(engine.num_worlds)
    ]
    return np.array(chosen, np.int32)


def show_world(engine: BatchedEngine, world: int, representations: tuple[str, ...]) -> bytes:
    """All that can be known of one world: its state, outcome, masks and observations."""
    parts = [value[world].tobytes() for value in engine.state_dict().values()]
    parts.append(engine.action_mask()[world].tobytes())
    parts += [engine.observe(name)[world].tobytes() for name in representations]
    return b"".join(parts)


def play(
    engine: BatchedEngine,
    luck: Luck,
    representations: tuple[str, ...] = ("planes", "vector"),
) -> list[str]:
    """Play on with `luck` from where the engine stands; a digest of the whole way of each world."""
    digests = [hashlib.sha256() for _ in range(engine.num_worlds)]
    for numbers in luck.numbers:
        for world, digest in enumerate(digests):
            digest.update(show_world(engine, world, representations))
        engine.step(choose_actions(engine, numbers))
    for world, digest in enumerate(digests):
        digest.update(show_world(engine, world, representations))
    return [digest.hexdigest() for digest in digests]


class FirstLegalAgent:
    """Plays a legal action that depends only on the row it sees, so it is the same in a batch."""

    name = "first legal"
    representation = "planes"

    def seed(self, seed: int) -> None:
        """There is nothing to seed."""

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        actions = np.zeros(action_mask.shape[:-1], np.int64)
        for place in np.ndindex(*actions.shape):
            legal = np.flatnonzero(action_mask[place])
            actions[place] = legal[int(observation[place[0]].sum(dtype=np.int64)) % len(legal)]
        return actions

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """There is nothing to load."""


def replace_kernels(engine: BatchedEngine, **kernels: Any) -> BatchedEngine:
    """An engine with the same scenario on a game with other functions."""
    game = dataclasses.replace(engine.game, **kernels)
    return BatchedEngine(game, engine.scenario, engine.num_worlds, engine.num_threads)
