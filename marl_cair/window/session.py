"""`Session`: one game at a time between persons and agents, with what the window shows of it."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import NO_WINNER, Agent, Game
from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.games.replays import Replay, ReplayWriter, write_replay
from marl_cair.league.agents.foreign import require_answers
from marl_cair.league.play.playing import map_seeds
from marl_cair.viewer.values import ACTION_VALUES
from marl_cair.window.numbers import Numbers, count_kills, read_numbers, read_world
from marl_cair.window.representations import draw_representation
from marl_cair.window.statistics import name_game, save_statistics

# Games whose ticks are shown one by one. Agents act as often as in their scenario; a person may
# act in every tick. The game is the same: an agent's step is an order and some ticks without one.
TICK_BY_TICK = ("deep_line_wars", "deep_rts")
# Games of which all persons use the keyboard at once. In others they pass keyboard and mouse on.
AT_ONCE = ("deep_maze", "flappy_bird", "flash")


@dataclass(frozen=True)
class View:
    """What is shown: the picture of a seat (None: of the spectator), or a representation's."""

    seat: int | None = None
    representation: str = ""  # "": the picture for people


@dataclass(frozen=True)
class Moment:
    """The game after a step; nothing in it changes later. P players, A actions."""

    step: int
    view: View
    picture: NDArray[np.uint8]  # [h, w, 3]
    mask: NDArray[np.bool_]  # [P, *action_shape, A]
    world: Any  # the game's World, a copy [1, ...]; None where it has no snapshots
    numbers: Numbers  # by name, [P]
    is_over: bool
    winner: int  # seat, or NO_WINNER
    eliminated: NDArray[np.bool_]  # [P]
    values: Mapping[int, NDArray[np.float32]]  # by seat of an agent with action values, [A]
    presence: NDArray[np.float32] | None  # [parts, h, w], of the viewed seat's capsules


class Note(NamedTuple):
    """The numbers of the players at a step."""

    step: int
    seconds: float  # since the game began
    numbers: Numbers


@dataclass
class History:
    """The game so far: actions [P, *action_shape], action values [P, A] and numbers."""

    actions: list[NDArray[np.int32]] = field(default_factory=list)  # of each step
    values: list[NDArray[np.float16]] = field(default_factory=list)  # too; none without networks
    notes: list[Note] = field(default_factory=list)  # at the start and after each decision


class Session:
    """Plays games of one scenario, one after another.

    Args:
        game, scenario: what is played, with the rated reward.
        agents: one for each seat; None is a person.
        seed: of the maps and the agents; the same seed and actions give the same games.
        record: the file of the first game's replay; later games get a number in its name. A game
            without a step leaves none.
        statistics: path of each game's statistics without suffix, see `statistics`; numbered too.

    Raises ValueError where the number of agents is not the number of seats.
    """

    def __init__(
        self,
        game: Game,
        scenario: Any,
        agents: Sequence[Agent | None],
        seed: int = 0,
        record: Path | None = None,
        statistics: Path | None = None,
    ) -> None:
        rated = dataclasses.replace(scenario, reward=game.rated_reward)
        self.steps_per_decision = 1
        if game.name in TICK_BY_TICK:
            self.steps_per_decision = rated.ticks_per_step
            rated = dataclasses.replace(rated, ticks_per_step=1)
        self.engine = BatchedEngine(game, rated)
        self.game, self.scenario, self.spec = game, rated, self.engine.spec
        if len(agents) != self.spec.num_players:
            raise ValueError(
                f"{game.name}: {len(agents)} players for {self.spec.num_players} seats: give one "
                "for each"
            )
        self.agents, self.seed = tuple(agents), seed
        self.persons = tuple(seat for seat, agent in enumerate(agents) if agent is None)
        self.names = tuple("person" if agent is None else agent.name for agent in agents)
        self.plays_at_once = game.name in AT_ONCE
        self.steps_per_second = self.spec.ticks_per_second / self.spec.ticks_per_step
        self.record, self.statistics = record, statistics
        self.number = -1
        self._writer: ReplayWriter | None = None
        self._is_unsaved = False  # there are steps without statistics
        self.start()

    def start(self) -> None:
        """Begin the next game, on the next map of the seed; end the one before."""
        self.close()
        self.number += 1
        self.map_seed = int(map_seeds(self.seed, np.array([self.number], np.int64))[0])
        self.engine.reset(np.array([self.map_seed], np.uint64))
        for seat, agent in enumerate(self.agents):
            if agent is not None:
                agent.seed(self.seed + 1_000 * self.number + seat)
        size = find_state_size(*(agent for agent in self.agents if agent is not None))
        self._states = np.zeros((self.spec.num_players, size), np.float32)
        self.history = History()
        shape = (self.spec.num_players, len(self.spec.action_group_names))
        self.action_counts: NDArray[np.int64] = np.zeros(shape, np.int64)
        self.returns = np.zeros(self.spec.num_players)
        self.kills: NDArray[np.int64] = np.zeros(self.spec.num_players, np.int64)
        self._values: dict[int, NDArray[np.float32]] = {}
        self._began = time.monotonic()
        self._note()
        if self.record is not None:
            path = name_game(self.record, self.number)
            self._writer = ReplayWriter(
                path, self.engine, map_seeds=[self.map_seed], players=[self.names]
            )

    def save_replay(self, path: Path) -> None:
        """Write the game so far as a replay. Raises OSError."""
        shape = (0, self.spec.num_players, *self.spec.action_shape)
        played, values = self.history.actions, self.history.values
        winner = int(self.engine.winner[0])
        replay = Replay(
            game=self.game.name,
            scenario=self.scenario,
            rules_version=self.game.version,
            map_seed=self.map_seed,
            players=self.names,
            actions=np.array(played) if played else np.zeros(shape, np.int32),
            winner=None if winner == NO_WINNER else winner,
            is_complete=True,
            values={ACTION_VALUES: np.array(values)} if values else None,
        )
        write_replay(path, replay)

    def close(self) -> None:
        """End the recording, and save the statistics of a game that has begun."""
        if self._writer is not None:
            self._record(self._writer.close)
            self._writer = None
            if self.record is not None and not self.history.actions:
                name_game(self.record, self.number).unlink(missing_ok=True)  # nothing was played
        if self.statistics is not None and self._is_unsaved:
            try:
                save_statistics(self, name_game(self.statistics, self.number))
            except OSError as error:  # the game continues
                warnings.warn(f"statistics are not saved: {error}", stacklevel=2)
        self._is_unsaved = False

    def _record(self, write: Callable[..., None], *values: Any) -> None:
        """Call the writer; where the disk fails the game continues without it."""
        try:
            write(*values)
        except OSError as error:
            warnings.warn(f"the rest of this game is not recorded: {error}", stacklevel=2)
            self._writer = None

    @property
    def is_over(self) -> bool:
        """Whether the game has been decided, or ran out of time."""
        return bool(self.engine.terminated[0] or self.engine.truncated[0])

    def advance(self, orders: Mapping[int, Any] | None = None) -> None:
        """One step: `orders` are the actions of persons by seat, others do nothing."""
        if self.is_over:
            return
        orders = orders or {}
        shape = (1, self.spec.num_players, *self.spec.action_shape)
        actions = np.full(shape, self.spec.noop_action, np.int32)
        if len(self.history.actions) % self.steps_per_decision == 0:
            self._ask_agents(actions)
        else:
            self.history.values += self.history.values[-1:]
        for seat, order in orders.items():
            actions[0, seat] = order
        self._count(actions[0], orders)
        before = self.copy_world()
        self.engine.step(actions)
        if self._writer is not None:
            found = self.history.values
            values = {ACTION_VALUES: found[-1][None]} if found else None
            self._record(self._writer.add, actions, values)
        if self.game.name == "deep_rts":
            self.kills += count_kills(before, self.copy_world())
        self.returns += self.engine.rewards[0]
        self.history.actions.append(actions[0])
        self._is_unsaved = True
        if self.is_over or len(self.history.actions) % self.steps_per_decision == 0:
            self._note()
        if self.is_over:
            self.close()

    def _note(self) -> None:
        seconds = time.monotonic() - self._began
        self.history.notes.append(Note(len(self.history.actions), seconds, self.read_numbers()))

    def _ask_agents(self, actions: NDArray[np.int32]) -> None:
        """Write the agents' actions to `actions` [1, P, *action_shape], and keep their values."""
        mask = self.engine.action_mask()
        seen: dict[str, NDArray[Any]] = {}
        for seat, agent in enumerate(self.agents):
            if agent is None or self.engine.eliminated[0, seat]:
                continue
            name = agent.representation
            if name not in seen:
                seen[name] = self.engine.observe(name)
            rows = seen[name][:, seat].copy(), mask[:, seat].copy()
            if hasattr(agent, "values") and not self.spec.action_shape:
                held = self._states[[seat], : getattr(agent, "state_size", 0)]
                self._values[seat] = agent.values(*rows, held)[0]
            chosen = call_agent(agent, self._states, ([seat],), *rows)
            require_answers(agent, chosen)
            actions[0, seat] = chosen[0]
        if self._values:
            table = np.full((self.spec.num_players, self.spec.num_actions), np.nan, np.float16)
            with np.errstate(over="ignore"):
                for seat, found in self._values.items():
                    table[seat] = np.nan if self.engine.eliminated[0, seat] else found
            self.history.values.append(table)

    def _count(self, actions: NDArray[np.int32], orders: Mapping[int, Any]) -> None:
        """Add the step's actions [P, *action_shape] to the counts of the players that acted."""
        decides = len(self.history.actions) % self.steps_per_decision == 0
        for seat, agent in enumerate(self.agents):
            is_asked = decides if agent is not None or self.steps_per_decision == 1 else False
            if self.engine.eliminated[0, seat] or not (is_asked or seat in orders):
                continue
            chosen = np.atleast_1d(actions[seat]).ravel()
            if self.spec.action_shape:  # at most places there is no unit
                chosen = chosen[chosen != self.spec.noop_action]
            groups = self.spec.action_groups[chosen]
            self.action_counts[seat] += np.bincount(groups, minlength=self.action_counts.shape[1])

    def read_numbers(self) -> Numbers:
        """Resources, scoreboard and score of each player."""
        return read_numbers(self.engine, self.returns, self.kills)

    def copy_world(self) -> Any:
        """The game's own arrays [1, ...] as they stand; None where it has no snapshots."""
        return read_world(self.engine) if self.game.has_snapshots else None

    def look(self, view: View, with_presence: bool = False) -> Moment:
        """The game as it stands, seen by `view`."""
        engine = self.engine
        if view.representation:
            seat = view.seat or 0
            kind = engine.representation(view.representation)
            picture = draw_representation(kind, engine.observe(view.representation)[0, seat])
        else:
            picture = engine.render(0, view.seat)
        return Moment(
            step=len(self.history.actions),
            view=view,
            picture=picture,
            mask=engine.action_mask()[0],
            world=self.copy_world(),
            numbers=self.read_numbers(),
            is_over=self.is_over,
            winner=int(engine.winner[0]) if self.is_over else NO_WINNER,
            eliminated=engine.eliminated[0].copy(),
            values=dict(self._values),
            presence=self._find_presence(view.seat) if with_presence else None,
        )

    def has_capsules(self, seat: int) -> bool:
        """Whether the player of a seat is a network with capsules."""
        return self._find_presence(seat) is not None

    def _find_presence(self, seat: int | None) -> NDArray[np.float32] | None:
        """Presences of the parts in what a seat's network sees; None without capsules."""
        agent: Any = self.agents[seat or 0]
        if not hasattr(agent, "find_presences"):
            return None
        found = agent.find_presences(self.engine.observe(agent.representation)[:, seat or 0])
        return None if found is None else found[0]

    def describe_end(self) -> str:
        """How the game has ended, in a few words."""
        winner = int(self.engine.winner[0])
        if winner == NO_WINNER:
            return "out of time" if self.engine.truncated[0] else "the game has ended"
        teams = self.spec.team_of_seat
        seats = np.flatnonzero(teams == teams[winner]).tolist()
        if len(self.persons) == 1:
            return "you have won" if self.persons[0] in seats else "you have lost"
        names = " and ".join(f"{self.names[seat]} (player {seat})" for seat in seats)
        return f"{names} won" if self.spec.num_teams > 1 else "solved"
