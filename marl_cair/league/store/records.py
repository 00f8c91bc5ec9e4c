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
    """One finished game of a line-up; each tuple has a value for each of the T teams.

    Attributes:
        block: number of the block within the line-up.
        number: number of the game within the block.
        map_seed: the engine's.
        entries: the entry of the line-up that has played the team.
        points: of the team, in sum 1; a draw is shared by the teams that were left.
        ranks: of the team, 1 is the best; equal teams share the mean.
        winner: the winning team, or NO_WINNER.
        is_truncated: whether the time limit has ended the game.
        decisions: steps of each seat that was in to the end.
        trajectory: hash of all actions, the first and the last board.
        forfeited: whether the team has crashed or played an illegal action.
        reason: of the forfeit; "" without one.
    """

    block: int
    number: int
    map_seed: int
    entries: tuple[int, ...]
    points: tuple[float, ...]
    ranks: tuple[float, ...]
    winner: int
    is_truncated: bool
    decisions: int
    trajectory: str
    forfeited: tuple[bool, ...]
    reason: str
