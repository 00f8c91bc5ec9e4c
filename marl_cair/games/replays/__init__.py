"""Recorded games: seed, scenario and actions in a file, from which the game is played again."""

from marl_cair.games.replays.layout import REPLAY_SUFFIX
from marl_cair.games.replays.reader import read_replay
from marl_cair.games.replays.replay import Replay, ReplayError, hash_state, replay_steps
from marl_cair.games.replays.writer import (
    FLUSH_SECONDS,
    ReplayWriter,
    describe_engine,
    write_replay,
)

__all__ = [
    "FLUSH_SECONDS",
    "REPLAY_SUFFIX",
    "Replay",
    "ReplayError",
    "ReplayWriter",
    "describe_engine",
    "hash_state",
    "read_replay",
    "replay_steps",
    "write_replay",
]
