"""One recorded game, hashes of states, and the game played again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import GameSpec
from marl_cair.games.registry import GAMES
from marl_cair.games.replays.layout import HASH_BYTES
from marl_cair.stored import DamagedFileError

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine


class ReplayError(DamagedFileError):
    """A file that is no replay, a damaged one, or one that this program cannot play again."""


@dataclass(frozen=True, eq=False)
class Replay:
    """One recorded game.

    Attributes:
        game, scenario, rules_version, map_seed: what was played; `scenario` is the dataclass.
        players: names [P], by seat.
        actions: int32 [T, P, *action_shape].
        winner: the first seat of the winning team; None for none, a draw, or an unknown one.
        is_complete: False if the recording was cut off: all steps up to there are in `actions`.
        values: float16 [T, P, ...] by name, kept for viewers; None where there are none.
        hashes: of the state after so many steps; see `hash_state`.
        extra: plain data of the program that recorded it.
    """

    game: str
    scenario: Any
    rules_version: str
    map_seed: int
    players: tuple[str, ...]
    actions: NDArray[np.int32]
    winner: int | None
    is_complete: bool
    values: Mapping[str, NDArray[np.float16]] | None = None
    hashes: Mapping[int, bytes] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def spec(self) -> GameSpec:
        """Of the scenario."""
        return GAMES[self.game].make_spec(self.scenario)


def hash_state(engine: BatchedEngine, world: int = 0) -> bytes:
    """The first HASH_BYTES of SHA-256 of all state arrays of one world and its outcome, in their
    order. Of games without snapshots: of the outcome alone.
    """
    if engine.game.has_snapshots:
        state = engine.state_bytes(world)
    else:
        reported = engine.rewards, engine.terminated, engine.truncated, engine.winner
        state = b"".join(values[world].tobytes() for values in reported)
    return hashlib.sha256(state).digest()[:HASH_BYTES]


def replay_steps(replay: Replay) -> Iterator[BatchedEngine]:
    """Play the game again: yields one engine of one world at its start and after each step, T + 1
    times.

    Raises ReplayError where the state differs from the recorded one.
    """
    from marl_cair.games.engine import BatchedEngine  # numba only from here on

    engine = BatchedEngine(GAMES[replay.game], replay.scenario)
    try:
        engine.reset(np.array([replay.map_seed], np.uint64))
        for step in range(len(replay.actions) + 1):
            if step:
                engine.step(replay.actions[step - 1][None])
            if replay.hashes.get(step, b"") not in (b"", hash_state(engine)):
                raise ReplayError(
                    f"the {replay.game} game differs from the recorded one at step {step}: its "
                    "map file, or another file that the scenario names, has changed, or the "
                    "replay was edited"
                )
            yield engine
    finally:
        engine.close()
