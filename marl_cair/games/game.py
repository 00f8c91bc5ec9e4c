"""The contract of a game: functions over arrays, and the dataclasses that describe it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.checks.scenario import change_scenario
from marl_cair.games.players.random_player import RANDOM, RandomPlayer
from marl_cair.games.players.weak_bot import BotTable
from marl_cair.games.registry import GAMES, find_game
from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.games.checks.state import StateLimits

NO_WINNER = -1
NO_CELL = -1
LEAST_FPS = 10  # of pictures, one for each step

Shape = tuple[int, ...]


class Agent(Protocol):
    """Anything that plays seats: a scripted bot, a network, a pool of them.

    A recurrent agent has an attribute `state_size`, S above 0, and remembers nothing itself. It is
    called as `act(observation, action_mask, state)` and returns (actions, next state): both states
    are float32 [N, S], one for each row, 0 when a game begins. Callers keep them: see
    `games.players.recurrent`.
    """

    name: str
    representation: str

    def seed(self, seed: int) -> None:
        """Restart the agent's random generator."""

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        """One action for each of N rows: observation [N, ...], action_mask bool [N, A] -> [N].

        With an `action_shape`: action_mask [N, *action_shape, A] -> [N, *action_shape].
        """

    def state_dict(self) -> dict[str, Any]:
        """The random generator's state as plain data."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state that `state_dict` returned."""


@dataclass(frozen=True)
class Representation:
    """One kind of observation. Arrays are [*shape] per seat, channels first.

    Attributes:
        name: the same in every game (planes, classic, image, gray, vector, ...).
        shape: [C, H, W], or [V] of a vector.
        dtype: uint8 or float32.
        high: the largest value, or of a vector one for each entry.
        plane_names: one per channel (or per entry of a vector).
        num_uniform: the last `num_uniform` planes hold one value over the whole board each.
        observe: kernel (worlds, rules, out [B, P, *shape], first, last) that writes `out`; with a
            memory (worlds, rules, memory, out, first, last), and it writes what has changed.
        make_memory: num_worlds -> arrays [B, ...] that describe what an `out` holds.
        low: the smallest value, or of a vector one for each entry.
        num_frames: above 1 the channels are the pictures of the last steps, the newest last.
    """

    name: str
    shape: Shape
    dtype: type[np.uint8 | np.float32]
    high: float | tuple[float, ...]
    plane_names: tuple[str, ...]
    observe: Callable[..., None]
    num_uniform: int = 0
    make_memory: Callable[[int], Any] | None = None
    low: float | tuple[float, ...] = 0
    num_frames: int = 1

    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """The smallest and the largest values, both of the observation's shape and dtype."""
        low, high = (
            np.broadcast_to(np.asarray(bound, self.dtype), self.shape)
            for bound in (self.low, self.high)
        )
        return low, high


@dataclass(frozen=True)
class GameSpec:
    """What a scenario of a game offers to agents; immutable.

    Attributes:
        num_players: P seats.
        action_names: A names.
        action_groups: int16 [A], the kind of each action (all cells of one tower are one kind).
        action_group_names: names of the kinds.
        action_cells: int32 [A], the board cell (row * columns + column, own view) that an action
            points at, or NO_CELL.
        noop_action: index of the action that is always legal and does nothing.
        representations: by name.
        static_planes: planes of `planes` that never change within a game.
        exclusive_planes: groups of planes of which at most one is nonzero in each cell.
        event_planes: groups of planes in which one event (a unit and its progress) shows at a cell.
        resources: names of what players own.
        ticks_per_step: ticks of the game in one step.
        max_ticks: the time limit.
        reward_bound: no reward is larger than this in absolute value.
        pays: what the rated reward of the scenario pays, in a few words.
        action_shape: () where a seat chooses one action per step. Else it chooses one of the A
            actions at each place of this shape: actions are [B, P, *action_shape], masks
            [B, P, *action_shape, A].
        teams: the team of each seat, P numbers; () = each seat for itself. A game's `winner` is
            the first seat of the team that has won.
        ticks_per_second: ticks of a second, at which pictures of the game are shown.
    """

    num_players: int
    action_names: tuple[str, ...]
    action_groups: NDArray[np.int16]
    action_group_names: tuple[str, ...]
    action_cells: NDArray[np.int32]
    noop_action: int
    representations: Mapping[str, Representation]
    static_planes: tuple[int, ...]
    exclusive_planes: tuple[tuple[int, ...], ...]
    event_planes: tuple[tuple[int, ...], ...]
    resources: tuple[str, ...]
    ticks_per_step: int
    max_ticks: int
    reward_bound: float
    pays: str
    action_shape: Shape = ()
    teams: tuple[int, ...] = ()
    ticks_per_second: float = 10.0

    def __deepcopy__(self, memo: object) -> Self:
        """Itself: it is immutable."""
        return self

    @property
    def render_fps(self) -> int:
        """Steps, each a picture, in a second; at least 10: slower games are shown faster."""
        return max(LEAST_FPS, round(self.ticks_per_second / self.ticks_per_step))

    @property
    def num_actions(self) -> int:
        return len(self.action_names)

    @property
    def team_of_seat(self) -> NDArray[np.int64]:
        """The team of each seat, int64 [P]: 0, 1, ... in the order of their first seats."""
        teams = self.teams or tuple(range(self.num_players))
        numbers = {team: number for number, team in enumerate(dict.fromkeys(teams))}
        return np.array([numbers[team] for team in teams], np.int64)

    @property
    def num_teams(self) -> int:
        """Teams that play against each other; 1 where all seats play together, or there is one."""
        return len(set(self.teams)) or self.num_players


@dataclass(frozen=True)
class Game:
    """One game: named functions over the arrays of B worlds. B worlds, P players, A actions.

    Kernels work on the worlds first..last-1 and touch no others, so that a batch can be split.
    """

    name: str
    title: str
    version: str  # changes when the behaviour changes, not for speed; checkpoints carry it
    summary: str
    player_range: tuple[int, int]  # fewest and most seats; a scenario's spec says how many
    scenarios: Mapping[str, Any]  # name -> frozen dataclass of settings
    default_scenario: str
    make_rules: Callable[[Any], Any]  # scenario -> constants as a named tuple of arrays
    make_spec: Callable[[Any], GameSpec]
    allocate: Callable[[Any, int], Any]  # (scenario, B) -> World
    reset: Callable[..., None]  # (worlds, rules, seeds, mask, first, last)
    step: Callable[..., None]  # (worlds, rules, actions, outcome, first, last)
    legal_actions: Callable[..., None]  # (worlds, rules, out [B, P, *action_shape, A], first, last)
    draw: Callable[..., NDArray[np.uint8]]  # (worlds, rules, world, player or None) -> RGB
    bots: Mapping[str, Callable[[Any, GameSpec], Agent]]  # without `random`: `RandomPlayer` is it
    rewards: Mapping[str, str]  # by name, what each pays; the first rates play
    hidden_fields: tuple[str, ...]  # of World, that no state shows: random words, scratch
    gymnasium_prefix: str  # "DeepLineWars" of "marl_cair/DeepLineWars-10x15-v0"
    # World -> further numbers of each seat, by name [B, P]: environments give them as `infos`.
    info: Callable[[Any], Mapping[str, NDArray[Any]]] | None = None
    # (World, scenario) -> the name of each world's map [B], where a scenario may have several.
    map_names: Callable[[Any, Any], tuple[str, ...]] | None = None
    # Options of a scenario whose actions have another number of axes: rules are compiled for each.
    other_shapes: tuple[Mapping[str, Any], ...] = ()
    # scenario -> the values that its worlds may hold: states from files are checked against them.
    # Without it only shapes and types are checked, and a damaged file may crash.
    state_limits: Callable[[Any], StateLimits] | None = None
    # Older versions whose agents can play: observations and actions still mean the same.
    agents_of: tuple[str, ...] = ()
    # False: the game runs outside of the arrays (in a browser, on a server), so that its state can
    # be neither copied nor saved. Engines then have few worlds, and the rules a method `close`.
    has_snapshots: bool = True

    def __post_init__(self) -> None:
        bots = {RANDOM: RandomPlayer} if RANDOM not in self.bots else {}
        object.__setattr__(self, "bots", BotTable({**self.bots, **bots}))

    def __deepcopy__(self, memo: object) -> Self:
        """Itself: it is immutable."""
        return self

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """By its name where GAMES has it: another process has its own."""
        if self.name in GAMES and GAMES[self.name] is self:
            return find_game, (self.name,)
        return super().__reduce_ex__(protocol)

    @property
    def rated_reward(self) -> str:
        """The reward that evaluations, matches and leagues use, whatever trained an agent."""
        return next(iter(self.rewards))

    def scenario(self, name: str | None = None, **options: Any) -> Any:
        """The named scenario, changed by `options` (fields of the scenario's dataclass).

        Raises:
            UnknownNameError: no such scenario or option; names the nearest.
            ValueError: an option's value is not allowed.
        """
        name = name or self.default_scenario
        chosen = find_by_name(f"{self.name} scenario", name, self.scenarios)
        return change_scenario(self.name, chosen, options)

    def bot(self, name: str, scenario: Any) -> Agent:
        """A scripted opponent for `scenario`; "rusher@0.3" makes 30 % of its decisions.

        Raises UnknownNameError with the nearest names.
        """
        factory = find_by_name(f"{self.name} bot", name, self.bots)
        return factory(scenario, self.make_spec(scenario))
