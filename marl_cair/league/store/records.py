"""Records of agents and games in a league file, as plain data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AgentRecord:
    """A row of the table `agent`; see `league.store.schema`."""

    fingerprint: str
    name: str
    kind: str
    evaluation_policy: str
    rules_version: str
    configuration: str  # JSON


@dataclass(frozen=True)
class PlayedGame:
    """One finished game of a line-up; each tuple has a value for each of the T teams."""

    block: int  # number of the block within the line-up
    number: int  # number of the game within the block
    map_seed: int  # the engine's
    entries: tuple[int, ...]  # the entry of the line-up that has played the team
    points: tuple[float, ...]  # in sum 1; a draw is shared by the teams that were left
    ranks: tuple[float, ...]  # 1 is the best; equal teams share the mean
    winner: int  # the winning team, or NO_WINNER
    is_truncated: bool  # whether the time limit has ended the game
    decisions: int  # steps of each seat that was in to the end
    trajectory: str  # hash of all actions, the first and the last board
    forfeited: tuple[bool, ...]  # whether the team has crashed or played an illegal action
    reason: str  # of the forfeit; "" without one
