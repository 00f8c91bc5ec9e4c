"""Board games of PettingZoo for two in turn, as games of the engine; their rules stay PettingZoo's.

Each world has an environment of its own, which is stepped for real. The seat on turn has the moves
that PettingZoo's mask allows and no other action, not even the no-op: these games know no passing.
The other seat has the no-op alone. An illegal action leaves the board as it is, and is counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair import games
from marl_cair.games.game import NO_WINNER, Game, Representation
from tests.games.plain_games import draw_nothing, make_plain_spec

NOBODY = -1  # on turn
NO_MOVE = -1


@dataclass(frozen=True)
class Scenario:
    """`opening`: moves that the world's seed draws before the first decision, an even number."""

    opening: int = 0
    reward: str = "sparse"
    shaping_discount: float = 0.99
    ticks_per_step: int = 1


class Table:
    """An environment, put where some moves lead: worlds that share one are told apart by these."""

    def __init__(self, make_env: Callable[[], Any]) -> None:
        self.make_env, self.env, self.played = make_env, make_env(), None

    def __reduce__(self) -> tuple[Any, ...]:
        """PettingZoo's environments are copied without their boards."""
        return Table, (self.make_env,)

    def stand_at(self, moves: tuple[int, ...]) -> Any:
        """The environment after `moves`, from the start or from where it is."""
        if self.played is None or moves[: len(self.played)] != self.played:
            self.env.reset()
            self.played = ()
        for move in moves[len(self.played) :]:
            self.env.step(move)
        self.played = moves
        return self.env


class World(NamedTuple):
    """B worlds of boards with N cells."""

    table: NDArray[np.object_]  # [B]
    moves: NDArray[np.int8]  # [B, N] columns or cells in the order of play, then NO_MOVE
    tick: NDArray[np.int32]  # [B]
    illegal: NDArray[np.int32]  # [B, 2]


class Rules(NamedTuple):
    num_cells: int
    num_moves: int
    opening: int


def find_seat(env: Any) -> int:
    """Who is on turn."""
    if any(env.terminations.values()):
        return NOBODY
    return env.possible_agents.index(env.agent_selection)


def find_moves(env: Any) -> list[int]:
    """What who is on turn may do."""
    return np.flatnonzero(env.observe(env.agent_selection)["action_mask"]).tolist()


def look(env: Any, seat: int) -> NDArray[np.int8]:
    """Own cells, then the other's, by rows: [2 N]."""
    seen = env.observe(env.possible_agents[seat])["observation"]
    return seen.transpose(2, 0, 1).ravel()


def _env_of(worlds: World, b: int) -> Any:
    moves = worlds.moves[b]
    return worlds.table[b].stand_at(tuple(moves[moves != NO_MOVE].tolist()))


def _draw_opening(table: Table, length: int, luck: np.random.Generator) -> tuple[int, ...]:
    """Moves after which the game goes on."""
    while True:
        moves: tuple[int, ...] = ()
        while find_seat(env := table.stand_at(moves)) != NOBODY:
            if len(moves) == length:
                return moves
            moves += (int(luck.choice(find_moves(env))),)


def allocate(make_env, num_cells, scenario, num_worlds):
    tables = np.empty(num_worlds, np.object_)
    tables[:] = [Table(make_env) for _ in range(num_worlds)]
    return World(
        tables,
        np.full((num_worlds, num_cells), NO_MOVE, np.int8),
        np.zeros(num_worlds, np.int32),
        np.zeros((num_worlds, 2), np.int32),
    )


def reset(worlds, rules, seeds, mask, first, last):
    for b in np.flatnonzero(mask[first:last]) + first:
        luck = np.random.default_rng(int(seeds[b]))
        worlds.moves[b] = NO_MOVE
        worlds.moves[b, : rules.opening] = _draw_opening(worlds.table[b], rules.opening, luck)
        worlds.tick[b], worlds.illegal[b] = 0, 0


def step(worlds, rules, actions, outcome, first, last):
    for b in range(first, last):
        outcome.rewards[b] = 0.0
        env = _env_of(worlds, b)
        seat = find_seat(env)
        if seat == NOBODY or outcome.truncated[b]:
            continue
        worlds.tick[b] += 1
        worlds.illegal[b, 1 - seat] += actions[b, 1 - seat] != rules.num_moves
        if int(actions[b, seat]) not in find_moves(env):
            worlds.illegal[b, seat] += 1
        else:
            worlds.moves[b, np.argmax(worlds.moves[b] == NO_MOVE)] = actions[b, seat]
            env = _env_of(worlds, b)
        outcome.terminated[b] = find_seat(env) == NOBODY
        outcome.truncated[b] = not outcome.terminated[b] and worlds.tick[b] >= rules.num_cells
        if outcome.terminated[b]:
            outcome.rewards[b] = [env.rewards[agent] for agent in env.possible_agents]
            is_won = outcome.rewards[b].any()
            outcome.winner[b] = outcome.rewards[b].argmax() if is_won else NO_WINNER


def legal_actions(worlds, rules, out, first, last):
    for b in range(first, last):
        out[b] = np.arange(rules.num_moves + 1) == rules.num_moves
        env = _env_of(worlds, b)
        if (seat := find_seat(env)) != NOBODY:
            out[b, seat] = False
            out[b, seat, find_moves(env)] = True


def observe(worlds, rules, out, first, last):
    for b in range(first, last):
        env = _env_of(worlds, b)
        out[b] = [look(env, seat) for seat in (0, 1)]


def make_spec(num_cells, num_moves, scenario):
    names = tuple(f"{whose}_{cell}" for whose in ("own", "other") for cell in range(num_cells))
    shown = Representation("vector", (2 * num_cells,), np.float32, 1.0, names, observe)
    return make_plain_spec(
        (*(f"move_{move}" for move in range(num_moves)), "wait"),
        shown,
        action_groups=np.repeat(np.arange(2, dtype=np.int16), (num_moves, 1)),
        action_group_names=("move", "wait"),
        noop_action=num_moves,
        max_ticks=num_cells,
    )


def make_game(
    name: str,
    make_env: Callable[[], Any],
    scenarios: Mapping[str, Scenario],
    bots: Mapping[str, Callable[..., Any]],
) -> Game:
    """The game of PettingZoo's raw environment: illegal moves never reach it."""
    env = make_env()
    env.reset()
    agent = env.possible_agents[0]
    num_cells = env.observation_space(agent)["observation"].shape
    num_cells, num_moves = num_cells[0] * num_cells[1], int(env.action_space(agent).n)
    return Game(
        name=name,
        title=name,
        version="1",
        summary="PettingZoo's.",
        player_range=(2, 2),
        scenarios=scenarios,
        default_scenario=next(iter(scenarios)),
        make_rules=lambda scenario: Rules(num_cells, num_moves, scenario.opening),
        make_spec=partial(make_spec, num_cells, num_moves),
        allocate=partial(allocate, make_env, num_cells),
        reset=reset,
        step=step,
        legal_actions=legal_actions,
        draw=draw_nothing,
        rewards={"sparse": "+1 win, -1 loss"},
        bots=bots,
        hidden_fields=("table",),
        gymnasium_prefix=name.title().replace("_", ""),
    )


def register(monkeypatch, game):
    """Make the game known by its name while a test runs."""
    monkeypatch.setitem(games.GAMES.modules, game.name, SimpleNamespace(GAME=game))
