"""Records of agents and games in a league file, as plain data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AgentRecord:
    """What a league file says of an agent, as text; see `league.store.schema`."""

    fingerprint: str
    name: str
    kind: str
    evaluation_policy: str
    rules_version: str
    configuration: str  # JSON


@dataclass(frozen=True)
class PlayedGame:
    """One finished game of a line-up; a tuple holds a value for each of its T teams.

    Attributes:
        block: number of the block within the line-up's.
        number: of the game within the block.
        map_seed: the engine's.
        entries: which entry of the line-up has played the team.
        points: of the team, in sum 1: a draw is shared by who is left.
        ranks: of the team, 1 is the best; equal teams share the mean.
        winner: the team that has won, or NO_WINNER.
        is_truncated: whether the time limit has ended the game.
        decisions: of each seat that was in to the end.
        trajectory: of all actions, first and last boards: games that are the same have equal ones.
        forfeited: whether the team has crashed or played an illegal action.
        reason: of the forfeit, "" where there is none.
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
