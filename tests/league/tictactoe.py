"""PettingZoo's tic-tac-toe as a game of the engine, and players that know the value of each move.

Each world has an environment of its own, which is stepped for real. The seat on turn has the moves
of PettingZoo's mask and no other action, not even the no-op; the other seat has only the no-op. An
illegal action leaves the board as it is, and is counted. The value of a move is 1 win, 0 draw or
-1 loss for the player on turn if both play on without a mistake.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from pettingzoo.classic.tictactoe import tictactoe  # needs pygame

from marl_cair import games
from marl_cair.games.game import NO_WINNER, Game, Representation
from tests.games.plain_games import draw_nothing, make_plain_spec

NO_SEAT = -1  # on turn
NO_MOVE = -1
CELLS = 9
WAIT = CELLS  # the no-op


@dataclass(frozen=True)
class Scenario:
    """`opening`: moves that the world's seed draws before the first step, an even number."""

    opening: int = 0
    reward: str = "sparse"
    shaping_discount: float = 0.99
    ticks_per_step: int = 1


class Table:
    """An environment after some moves."""

    def __init__(self) -> None:
        self.env, self.played = tictactoe.raw_env(), None

    def __reduce__(self) -> tuple[Any, ...]:
        """PettingZoo's environments are copied without their boards."""
        return Table, ()

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
    """B worlds."""

    table: np.ndarray  # object [B]
    moves: np.ndarray  # int8 [B, 9] cells in the order of play, then NO_MOVE
    tick: np.ndarray  # int32 [B]
    illegal: np.ndarray  # int32 [B, 2]


class Rules(NamedTuple):
    opening: int


def find_seat(env: Any) -> int:
    """The seat on turn."""
    if any(env.terminations.values()):
        return NO_SEAT
    return env.possible_agents.index(env.agent_selection)


def find_moves(env: Any) -> list[int]:
    """Legal moves of the seat on turn."""
    return np.flatnonzero(env.observe(env.agent_selection)["action_mask"]).tolist()


def observe_seat(env: Any, seat: int) -> np.ndarray:
    """Own cells, then the other's: [18]."""
    seen = env.observe(env.possible_agents[seat])["observation"]
    return seen.transpose(2, 0, 1).ravel()


def _env_of(worlds: World, b: int) -> Any:
    moves = worlds.moves[b]
    return worlds.table[b].stand_at(tuple(moves[moves != NO_MOVE].tolist()))


def _draw_opening(table: Table, length: int, rng: np.random.Generator) -> tuple[int, ...]:
    """Moves after which the game is not over."""
    while True:
        moves: tuple[int, ...] = ()
        while find_seat(env := table.stand_at(moves)) != NO_SEAT:
            if len(moves) == length:
                return moves
            moves += (int(rng.choice(find_moves(env))),)


def allocate(scenario, num_worlds):
    tables = np.empty(num_worlds, np.object_)
    tables[:] = [Table() for _ in range(num_worlds)]
    moves = np.full((num_worlds, CELLS), NO_MOVE, np.int8)
    return World(tables, moves, np.zeros(num_worlds, np.int32), np.zeros((num_worlds, 2), np.int32))


def reset(worlds, rules, seeds, mask, first, last):
    for b in np.flatnonzero(mask[first:last]) + first:
        rng = np.random.default_rng(int(seeds[b]))
        worlds.moves[b] = NO_MOVE
        worlds.moves[b, : rules.opening] = _draw_opening(worlds.table[b], rules.opening, rng)
        worlds.tick[b], worlds.illegal[b] = 0, 0


def step(worlds, rules, actions, outcome, first, last):
    for b in range(first, last):
        outcome.rewards[b] = 0.0
        env = _env_of(worlds, b)
        seat = find_seat(env)
        if seat == NO_SEAT or outcome.truncated[b]:
            continue
        worlds.tick[b] += 1
        worlds.illegal[b, 1 - seat] += actions[b, 1 - seat] != WAIT
        if int(actions[b, seat]) not in find_moves(env):
            worlds.illegal[b, seat] += 1
        else:
            worlds.moves[b, np.argmax(worlds.moves[b] == NO_MOVE)] = actions[b, seat]
            env = _env_of(worlds, b)
        outcome.terminated[b] = find_seat(env) == NO_SEAT
        outcome.truncated[b] = not outcome.terminated[b] and worlds.tick[b] >= CELLS
        if outcome.terminated[b]:
            outcome.rewards[b] = [env.rewards[agent] for agent in env.possible_agents]
            is_won = outcome.rewards[b].any()
            outcome.winner[b] = outcome.rewards[b].argmax() if is_won else NO_WINNER


def legal_actions(worlds, rules, out, first, last):
    for b in range(first, last):
        out[b] = np.arange(CELLS + 1) == WAIT
        env = _env_of(worlds, b)
        if (seat := find_seat(env)) != NO_SEAT:
            out[b, seat] = False
            out[b, seat, find_moves(env)] = True


def observe(worlds, rules, out, first, last):
    for b in range(first, last):
        env = _env_of(worlds, b)
        out[b] = [observe_seat(env, seat) for seat in (0, 1)]


def make_spec(scenario):
    names = tuple(f"{whose}_{cell}" for whose in ("own", "other") for cell in range(CELLS))
    shown = Representation("vector", (2 * CELLS,), np.float32, 1.0, names, observe)
    return make_plain_spec(
        (*(f"move_{move}" for move in range(CELLS)), "wait"),
        shown,
        action_groups=np.repeat(np.arange(2, dtype=np.int16), (CELLS, 1)),
        action_group_names=("move", "wait"),
        noop_action=WAIT,
        max_ticks=CELLS,
    )


def register(monkeypatch):
    """Make the game known by its name while a test runs."""
    monkeypatch.setitem(games.GAMES.modules, GAME.name, SimpleNamespace(GAME=GAME))


# --- players -----------------------------------------------------------------------------------


def solve() -> dict[bytes, dict[int, int]]:
    """The value of each move on each reachable board, by the observation of the seat on turn."""
    table, values = Table(), {}

    def find_value(moves: tuple[int, ...]) -> int:
        env = table.stand_at(moves)
        seat = len(moves) % 2
        if find_seat(env) == NO_SEAT:
            return int(env.rewards[env.possible_agents[seat]])
        board = observe_seat(env, seat).astype(np.bool_).tobytes()
        if board not in values:
            legal = find_moves(env)
            values[board] = {move: -find_value((*moves, move)) for move in legal}
        return max(values[board].values())

    find_value(())
    return values


VALUES = solve()


def choose_by(pick):
    """The moves whose value `pick` (max or min) returns."""

    def choose(cells, moves):
        values = VALUES[cells.tobytes()]
        return [move for move in moves if values[move] == pick(values.values())]

    return choose


PERFECT, GIVEAWAY = choose_by(max), choose_by(min)


def choose_sleepily(cells, moves):
    """Perfect until it has two marks."""
    return PERFECT(cells, moves) if cells[:CELLS].sum() < 2 else moves


def choose_any(cells, moves):
    return moves


class Player:
    """Draws one of the moves of `choose`; waits when it is not on turn."""

    representation = "vector"

    def __init__(self, name, choose):
        self.name, self.choose = name, choose
        self.rng = np.random.default_rng(0)

    def seed(self, seed):
        self.rng = np.random.default_rng(seed)

    def act(self, observation, action_mask):
        return np.array([self._act(*row) for row in zip(observation, action_mask, strict=True)])

    def _act(self, cells, legal):
        moves = np.flatnonzero(legal).tolist()
        return WAIT if moves == [WAIT] else self.rng.choice(self.choose(cells > 0, moves))

    def state_dict(self):
        return {"state": json.dumps(self.rng.bit_generator.state)}

    def load_state_dict(self, state):
        self.rng.bit_generator.state = json.loads(state["state"])


CHOICES = {
    "perfect": PERFECT,
    "twin": PERFECT,
    "sleepy": choose_sleepily,
    "giveaway": GIVEAWAY,
    "random": choose_any,
}
GAME = Game(
    name="tictactoe",
    title="tictactoe",
    version="1",
    summary="PettingZoo's.",
    player_range=(2, 2),
    scenarios={"whole": Scenario(), "opened": Scenario(opening=4)},
    default_scenario="whole",
    make_rules=lambda scenario: Rules(scenario.opening),
    make_spec=make_spec,
    allocate=allocate,
    reset=reset,
    step=step,
    legal_actions=legal_actions,
    draw=draw_nothing,
    rewards={"sparse": "+1 win, -1 loss"},
    bots={
        name: lambda scenario, spec, name=name, choose=choose: Player(name, choose)
        for name, choose in CHOICES.items()
    },
    hidden_fields=("table",),
    gymnasium_prefix="Tictactoe",
)
