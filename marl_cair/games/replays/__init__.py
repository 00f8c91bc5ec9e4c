"""Recorded games: seed, scenario and actions in a file, from which the game is played again."""

from marl_cair.games.replays.layout import REPLAY_SUFFIX
from marl_cair.games.replays.reader import count_games, read_replay, read_replays
from marl_cair.games.replays.replay import Replay, ReplayError, hash_state, replay_steps
from marl_cair.games.replays.writer import ReplayWriter, write_replay

__all__ = [
    "REPLAY_SUFFIX",
    "Replay",
    "ReplayError",
    "ReplayWriter",
    "count_games",
    "hash_state",
    "read_replay",
    "read_replays",
    "replay_steps",
    "write_replay",
]
