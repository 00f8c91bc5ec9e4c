"""BatchedEngine: owns the arrays of B worlds and is the only place that mutates them."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.checks import engine as checks
from marl_cair.games.checks.state import StateLimits, check_arrays, check_outcome, check_worlds
from marl_cair.games.compiled import calling, is_compiling, settled
from marl_cair.games.game import NO_WINNER, Game, GameSpec, Representation
from marl_cair.lookup import find_by_name


class Outcome(NamedTuple):
    """The results of the last step; the arrays are written in place."""

    rewards: NDArray[np.float32]  # [B, P]
    terminated: NDArray[np.bool_]  # [B]
    truncated: NDArray[np.bool_]  # [B]
    winner: NDArray[np.int8]  # [B] seat, or NO_WINNER
    eliminated: NDArray[np.bool_]  # [B, P] seats that are out, while others may play on


class NoSnapshotError(RuntimeError):
    """The game's state cannot be copied or saved; names what was asked for."""


class Snapshot(NamedTuple):
    """An exact copy of N worlds: restore it into any slots of an engine of the same scenario."""

    scenario: Any  # of the engine that it was taken from
    world: tuple[NDArray[Any], ...]  # the game's state arrays, each [N, ...]
    outcome: Outcome  # arrays [N, ...]


class BatchedEngine:
    """B worlds of one scenario that advance together.

    Args:
        game: the rules.
        scenario: a scenario of that game (`game.scenario(...)`).
        num_worlds: B, at least 1.
        num_threads: the batch is split into so many slices; the results do not depend on it.

    Attributes:
        rewards: float32 [B, P], of the last step. All these arrays are written in place.
        terminated: bool [B], whether the game has been decided.
        truncated: bool [B], whether it ran out of time.
        winner: int8 [B], the winning seat; NO_WINNER for none or a draw.
        eliminated: bool [B, P], seats that are out: only the no-op is legal for them.
        illegal_actions: int32 [B, P], illegal actions of each seat since its world's reset.

    Raises:
        ValueError: num_worlds or num_threads is no whole number, or below 1.
    """

    def __init__(
        self, game: Game, scenario: Any, num_worlds: int = 1, num_threads: int = 1
    ) -> None:
        num_worlds = checks.check_count(game.name, "num_worlds", num_worlds)
        num_threads = checks.check_count(game.name, "num_threads", num_threads)
        self.game, self.scenario = game, scenario
        self.spec: GameSpec = game.make_spec(scenario)
        self.num_worlds, self.num_players = num_worlds, self.spec.num_players
        self.num_actions = self.spec.num_actions
        self.num_threads = min(num_threads, num_worlds)
        self._rules = game.make_rules(scenario)
        self._worlds = game.allocate(scenario, num_worlds)
        seats = (num_worlds, self.num_players)
        self._outcome = Outcome(
            rewards=np.zeros(seats, np.float32),
            terminated=np.zeros(num_worlds, np.bool_),
            truncated=np.zeros(num_worlds, np.bool_),
            winner=np.full(num_worlds, NO_WINNER, np.int8),
            eliminated=np.zeros(seats, np.bool_),
        )
        self.rewards, self.terminated, self.truncated = self._outcome[:3]
        self.winner, self.eliminated = self._outcome[3:]
        self.illegal_actions: NDArray[np.int32] = self._worlds.illegal
        self._pool = ThreadPoolExecutor(self.num_threads) if self.num_threads > 1 else None
        self._has_started = False
        self._kernels: dict[tuple[Callable[..., None], str], Callable[..., None]] = {}
        self._in_place: dict[str, tuple[tuple[Any, ...], NDArray[Any]]] = {}
        if not game.has_snapshots:
            weakref.finalize(self, self._rules.close)

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, here or in another process, has rules, threads and machine code of its own."""
        held = self.snapshot() if self._has_started and self.game.has_snapshots else None
        return _copy_engine, (self.game, self.scenario, self.num_worlds, self.num_threads, held)

    @cached_property
    def _limits(self) -> StateLimits | None:
        make = self.game.state_limits
        return None if make is None else make(self.scenario)

    def reset(self, seeds: NDArray[np.uint64] | int, mask: NDArray[np.bool_] | None = None) -> None:
        """Restart the worlds of `mask` bool [B] (default all) from `seeds` uint64 [B].

        An int seeds world 0 of a batch of one (0 is a seed like any other).

        Raises:
            ValueError: wrong shape or dtype, or the first reset leaves worlds out.
        """
        seeds = checks.check_seeds(self.game.name, seeds, self.num_worlds)
        mask = self.check_reset(mask)
        self._run(self.game.reset, self._worlds, self._rules, seeds, mask)
        rows = np.flatnonzero(mask)  # few games end at a time: cheaper than the mask
        for name, values in self._outcome._asdict().items():
            values[rows] = NO_WINNER if name == "winner" else 0
        self._has_started = True

    def check_reset(
        self, mask: NDArray[np.bool_] | None, name: str = "the reset mask"
    ) -> NDArray[np.bool_]:
        """The worlds of a reset, bool [B]; raises as `reset`, and calls the mask `name`."""
        chosen = checks.check_mask(self.game.name, name, mask, self.num_worlds)
        if not self._has_started:
            checks.check_start(self.game.name, int(chosen.sum()), self.num_worlds)
        return chosen

    def step(self, actions: NDArray[Any]) -> None:
        """One step of every seat: integer actions [B, P, *action_shape].

        A finished world ignores it. An illegal action within 0..A-1 is a no-op that is counted.

        Raises:
            ValueError: wrong shape, not integers, or an action outside 0..A-1 (names world, player
                and the place within the action shape).
            RuntimeError: before the first reset.
        """
        if not self._has_started:
            raise RuntimeError(f"{self.game.name}: step before reset; call reset(seeds) first")
        actions = checks.check_actions(self.game.name, actions, self.num_worlds, self.spec)
        self._run(self.game.step, self._worlds, self._rules, actions, self._outcome)

    def observe(
        self,
        representation: str,
        out: NDArray[Any] | None = None,
        worlds: NDArray[np.int64] | list[int] | None = None,
    ) -> NDArray[Any]:
        """Every seat's own view, [B, P, *shape] of the representation; written to `out` if given.
        Of the worlds [N] alone where these are given: [N, P, *shape].

        Raises:
            UnknownNameError: no such representation.
            ValueError: `out` has another shape or dtype, or a world does not exist.
        """
        chosen = self.representation(representation)
        seen = self._select(worlds)
        shape = (len(seen[0]), self.num_players, *chosen.shape)
        if out is None:
            out = np.empty(shape, chosen.dtype)
        checks.check_out(self.game.name, "observe", out, shape, chosen.dtype)
        if chosen.make_memory is None:
            self._run(chosen.observe, seen, self._rules, out, kind=representation)
        elif worlds is None:
            # Updating the engine's own array and copying it is faster than writing everything.
            np.copyto(out, self.observe_in_place(representation))
        else:
            memory = chosen.make_memory(len(seen[0]))
            self._run(chosen.observe, seen, self._rules, memory, out, kind=representation)
        return out

    def observe_in_place(self, representation: str) -> NDArray[Any]:
        """`observe` into an array of the engine's own: a read-only view, overwritten by the next
        observation of all worlds. Raises UnknownNameError.

        Games that remember what the array holds write only what has changed: many times faster on
        large boards.
        """
        chosen = self.representation(representation)
        if representation not in self._in_place:
            out = np.empty((self.num_worlds, self.num_players, *chosen.shape), chosen.dtype)
            memory = () if chosen.make_memory is None else (chosen.make_memory(self.num_worlds),)
            view = out.view()
            view.flags.writeable = False
            self._in_place[representation] = (*memory, out), view
        written, view = self._in_place[representation]
        self._run(chosen.observe, self._worlds, self._rules, *written, kind=representation)
        return view

    def action_mask(
        self,
        out: NDArray[np.bool_] | None = None,
        worlds: NDArray[np.int64] | list[int] | None = None,
    ) -> NDArray[np.bool_]:
        """Legal actions bool [B, P, *action_shape, A], written to `out` if given.

        The no-op is always legal. `worlds` and errors as in `observe`.
        """
        seen = self._select(worlds)
        shape = (len(seen[0]), self.num_players, *self.spec.action_shape, self.num_actions)
        if out is None:
            out = np.empty(shape, np.bool_)
        checks.check_out(self.game.name, "action_mask", out, shape, np.bool_)
        self._run(self.game.legal_actions, seen, self._rules, out)
        return out

    def _select(self, worlds: NDArray[np.int64] | list[int] | None) -> Any:
        """The state arrays, of all worlds or copies of the given ones."""
        if worlds is None:
            return self._worlds
        rows = self._check_worlds(worlds)
        return type(self._worlds)._make(field[rows] for field in self._worlds)

    def representation(self, name: str) -> Representation:
        """The representation's description. Raises UnknownNameError with the nearest names."""
        kind = f"{self.game.name} representation"
        return find_by_name(kind, name, self.spec.representations)

    def snapshot(self, worlds: NDArray[np.int64] | list[int] | None = None) -> Snapshot:
        """An exact copy of the given worlds (default all): for search, branching, checkpoints.

        Raises NoSnapshotError if the game has none (`Game.has_snapshots`).
        """
        self._require_snapshots("a snapshot was asked for")
        rows = self._check_worlds(worlds)
        return Snapshot(
            self.scenario,
            tuple(field[rows] for field in self._worlds),
            Outcome._make(field[rows] for field in self._outcome),
        )

    def restore(
        self, snapshot: Snapshot, worlds: NDArray[np.int64] | list[int] | None = None
    ) -> None:
        """Put a snapshot's worlds into the given slots (default all).

        Raises:
            NoSnapshotError: the game has none (`Game.has_snapshots`).
            ValueError: the snapshot is of another scenario, or of another number of worlds, or
                the engine begins with it and it is not for all worlds; or it holds what no game of
                the scenario can hold (names field, world, value and range).
        """
        self._require_snapshots("a snapshot was to be restored")
        rows = self._check_worlds(worlds)
        if not self._has_started:
            checks.check_start(self.game.name, len(set(rows.tolist())), self.num_worlds)
        if snapshot.scenario != self.scenario:
            raise ValueError(
                f"{self.game.name}: the snapshot is of {snapshot.scenario}, this engine plays "
                f"{self.scenario}; restore into the same scenario"
            )
        names = (*self._worlds._fields, *self._outcome._fields)
        fields = (*self._worlds, *self._outcome)
        values = (*snapshot.world, *snapshot.outcome)
        check_arrays(self.game.name, names, fields, values, len(rows))
        check_outcome(self.game.name, snapshot.outcome, self.num_players)
        if self._limits is not None:
            check_worlds(self.game.name, self._worlds._make(snapshot.world), self._limits)
        for field, saved in zip(fields, values, strict=True):
            field[rows] = saved
        self._has_started = True

    def state_bytes(self, world: int) -> bytes:
        """All state arrays of one world and its outcome, in their order, for hashes.

        Raises NoSnapshotError as `snapshot`.
        """
        self._require_snapshots("the bytes of a state were asked for")
        return b"".join(field[world].tobytes() for field in (*self._worlds, *self._outcome))

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """All worlds as plain arrays by name (copies). Raises NoSnapshotError as `snapshot`."""
        self._require_snapshots("a state was to be saved")
        state = {f"world.{name}": value.copy() for name, value in self._worlds._asdict().items()}
        reported = self._outcome._asdict().items()
        return state | {f"outcome.{name}": value.copy() for name, value in reported}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from `state_dict` of an engine with the same scenario and number of worlds.

        Raises:
            ValueError: a field is missing, of another shape, or holds what no game can hold.
        """
        names = [f"world.{name}" for name in self._worlds._fields]
        count = len(names)
        names += [f"outcome.{name}" for name in Outcome._fields]
        if missing := sorted(set(names) - set(state)):
            raise ValueError(f"{self.game.name}: the engine state has no {', '.join(missing)}")
        arrays = [np.asarray(state[name]) for name in names]
        world, outcome = tuple(arrays[:count]), Outcome._make(arrays[count:])
        self.restore(Snapshot(self.scenario, world, outcome))

    def _require_snapshots(self, what: str) -> None:
        if not self.game.has_snapshots:
            raise NoSnapshotError(
                f"{self.game.name}: {what}, but its games run outside of this process and "
                "cannot be copied or saved: reset and play again with the same seeds and actions"
            )

    def close(self) -> None:
        """Free what the game holds outside of this process, as browsers; others hold nothing. A
        later reset may begin again.
        """
        if not self.game.has_snapshots:
            self._rules.close()

    def public_state(self, world: int) -> NDArray[np.float32]:
        """All state of one world as a flat float32 vector [S], the same for all seats, but for what
        the game hides (`Game.hidden_fields`).
        """
        hidden, worlds = self.game.hidden_fields, self._worlds._asdict()
        shown = [field[world].ravel() for name, field in worlds.items() if name not in hidden]
        return np.concatenate(shown).astype(np.float32)

    def info(self, dtype: Any = None) -> dict[str, NDArray[Any]]:
        """Numbers of each seat beside what it observes, by name, fresh arrays [B, P]."""
        numbers = {} if self.game.info is None else self.game.info(self._worlds)
        return {name: np.array(values, dtype) for name, values in numbers.items()}

    def map_names(self) -> tuple[str, ...]:
        """The name of each world's map [B]; "" throughout where the game has no maps by name."""
        if self.game.map_names is None:
            return ("",) * self.num_worlds
        return self.game.map_names(self._worlds, self.scenario)

    def render(self, world: int = 0, player: int | None = None) -> NDArray[np.uint8]:
        """What a person sees of one world, uint8 [height, width, 3]; `player` gives a seat's view.

        Raises:
            ValueError: no such world or player.
        """
        for name, value, limit in (
            ("world", world, self.num_worlds),
            ("player", player or 0, self.num_players),
        ):
            if not 0 <= value < limit:
                raise ValueError(
                    f"{self.game.name}: {name} {value} does not exist, allowed are 0..{limit - 1}"
                )
        with calling(self.game.name):
            return self.game.draw(self._worlds, self._rules, world, player)

    def _run(
        self, kernel: Callable[..., None], worlds: Any, *arguments: Any, kind: str = ""
    ) -> None:
        """Run a kernel over `worlds`, in slices on the threads when there are any.

        kind: separates calls of one kernel whose arguments differ in type.
        """
        key = kernel, kind
        if key not in self._kernels:
            with calling(self.game.name):
                self._kernels[key] = settled(kernel, worlds, *arguments, 0, 0)
        kernel, count = self._kernels[key], len(worlds[0])
        if not is_compiling():
            # Plain Python wraps counters as compiled code does, but warns about it.
            with np.errstate(over="ignore"):
                kernel(worlds, *arguments, 0, count)
        elif self._pool is None:
            kernel(worlds, *arguments, 0, count)
        else:
            edges = np.linspace(0, count, self.num_threads + 1).astype(int).tolist()
            submit = self._pool.submit
            tasks = [submit(kernel, worlds, *arguments, *ends) for ends in pairwise(edges)]
            for task in tasks:
                task.result()

    def _check_worlds(self, worlds: NDArray[np.int64] | list[int] | None) -> NDArray[np.int64]:
        rows = np.asarray(range(self.num_worlds) if worlds is None else worlds)
        is_list = rows.ndim == 1 and (rows.dtype.kind in "iu" or not rows.size)
        if not is_list or (rows.size and not 0 <= rows.min() <= rows.max() < self.num_worlds):
            raise ValueError(
                f"{self.game.name}: worlds {rows.tolist()} must be a list of indices in "
                f"0..{self.num_worlds - 1}"
            )
        return rows.astype(np.int64)


def _copy_engine(
    game: Game, scenario: Any, num_worlds: int, num_threads: int, held: Snapshot | None
) -> BatchedEngine:
    engine = BatchedEngine(game, scenario, num_worlds, num_threads)
    if held is not None:
        engine.restore(held)
    return engine
