"""Plays matches between two agents: seat-balanced games on one batched engine, repeatable by seed.

The first agent plays one team (in a free-for-all one seat), the second all others. A block is one
map seed, played once with the first agent in each team: two games with two teams, four in a
free-for-all of four. See `playing` for batches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from marl_cair.games.game import NO_WINNER, Agent, Game
from marl_cair.games.replays import Replay
from marl_cair.league.play.blocks import (
    Design,
    Entrant,
    Plan,
    make_chunk,
    play_blocks,
    seat_line_up,
)
from marl_cair.league.play.playing import Seating, map_seeds, play, size_chunk, start_engine
from marl_cair.league.play.recording import Recording

BLOCKS_PER_CHUNK = 4


@dataclass(frozen=True)
class GameResult:
    """One game, seen from the first agent."""

    block: int
    first_seat: int  # the first seat of the first agent's team
    winner: int  # first seat of the winning team, or NO_WINNER for a draw or the time limit
    is_truncated: bool
    decisions: int
    fingerprint: str  # `PlayedGame.trajectory`
    score: float  # 1 win, 0 loss; of a draw its share, see `standings.share_points`
    forfeit: str = ""  # reason of a forfeit

    @property
    def is_won(self) -> bool:
        return self.winner == self.first_seat


@dataclass(frozen=True)
class MatchResult:
    """All games of a match, seen from the first agent."""

    results: tuple[GameResult, ...]
    num_teams: int = 2

    @property
    def games(self) -> int:
        return len(self.results)

    @property
    def wins(self) -> int:
        return sum(result.is_won for result in self.results)

    @property
    def draws(self) -> int:
        """Number of games without a winner in which the first agent was in to the end."""
        return sum(r.winner == NO_WINNER and r.score > 0.0 for r in self.results)

    @property
    def losses(self) -> int:
        return self.games - self.wins - self.draws

    @property
    def score(self) -> float:
        """Share of points: a win is 1, a draw is shared."""
        return sum(result.score for result in self.results) / len(self.results)

    @property
    def fair_share(self) -> float:
        """The expected score between equal agents: 1 / teams."""
        return 1.0 / self.num_teams

    def interval(self, wins_only: bool = False) -> tuple[float, float]:
        """95 % interval of the score (of the share of wins) by the bootstrap over map seeds."""
        from marl_cair.league.ratings.bootstrap import block_interval  # SciPy takes a second

        values = [float(r.is_won) if wins_only else r.score for r in self.results]
        return block_interval(np.array(values), np.array([result.block for result in self.results]))

    @property
    def distinct_games(self) -> int:
        """Number of games that differ in a board, an action or the agents' seats."""
        return len({(result.first_seat, result.fingerprint) for result in self.results})

    def without_repeats(self) -> MatchResult:
        """The first block if all others repeat it: neither the agents nor the maps vary, and more
        games add nothing. Else all games: where chance decides, equal ones count as often as they
        happen.
        """
        is_varied = self.distinct_games > self.num_teams or bool(self.forfeits)
        return self if is_varied else MatchResult(self.results[: self.num_teams], self.num_teams)

    @property
    def forfeits(self) -> tuple[str, ...]:
        """The reason of each forfeit."""
        return tuple(result.forfeit for result in self.results if result.forfeit)


def play_match(
    first: Agent,
    second: Agent,
    game: Game,
    scenario: Any,
    num_games: int,
    seed: int,
    identities: tuple[str, str] | None = None,
    record: Recording | None = None,
) -> MatchResult:
    """Play `num_games` games, equally many with `first` in each team, with the rated reward.

    A longer match begins with the games of a shorter one, and with two teams the match of `second`
    against `first` has the same games. `identities` and `record` as in `play_chunks`.

    Raises ValueError: num_games is no multiple of the number of teams, or there is only one team.
    """
    num_teams = require_rivals(game, scenario)
    if num_games < num_teams or num_games % num_teams:
        needed = "even and 2 or more" if num_teams == 2 else f"a multiple of {num_teams}"
        raise ValueError(
            f"num_games is {num_games}, it must be {needed}: every map seed is played once in each "
            f"{'seat' if num_teams == game.make_spec(scenario).num_players else 'team'}"
        )
    chunks = range(-(-num_games // (num_teams * size_chunk(game, BLOCKS_PER_CHUNK))))
    record = record and record.limit(num_games // num_teams)
    match = play_chunks(first, second, game, scenario, seed, chunks, identities, record)
    return MatchResult(match.results[:num_games], num_teams)


def play_chunks(
    first: Agent,
    second: Agent,
    game: Game,
    scenario: Any,
    seed: int,
    chunks: Sequence[int],
    identities: tuple[str, str] | None = None,
    record: Recording | None = None,
) -> MatchResult:
    """Play whole chunks; games do not depend on which chunks are played together.

    Chunk c holds the blocks c * BLOCKS_PER_CHUNK onwards (see `playing.size_chunk`). Block k has
    the map seed of (seed, k) for all pairs of agents. Each agent has its own random stream in each
    chunk, from the seed, the chunk and both identities, which default to the agents' names.
    `record`: where to record games.

    Raises ValueError if there is no chunk, or only one team.
    """
    num_teams = require_rivals(game, scenario)
    teams = game.make_spec(scenario).team_of_seat
    first_seats = np.unique(teams, return_index=True)[1]
    plan = Plan(_one_against_all(num_teams), size_chunk(game, BLOCKS_PER_CHUNK))
    seatings = _seat((first, second), identities)
    played = play_blocks(seatings, game, scenario, seed, chunks, plan, record=record)
    results = (
        GameResult(
            one.block,
            int(first_seats[one.number]),
            NO_WINNER if one.winner < 0 else int(first_seats[one.winner]),
            one.is_truncated,
            one.decisions,
            one.trajectory,
            one.points[one.number],
            one.reason,
        )
        for one in played
    )
    return MatchResult(tuple(results), num_teams)


def record_game(first: Agent, second: Agent, game: Game, scenario: Any, seed: int) -> Replay:
    """The first game of `play_match`, `first` in the first seat, which is not written to a file.

    Raises ValueError if there is only one team.
    """
    num_teams = require_rivals(game, scenario)
    teams = game.make_spec(scenario).team_of_seat
    plan = Plan(_one_against_all(num_teams), size_chunk(game, BLOCKS_PER_CHUNK))
    chunk = make_chunk(0, plan, teams)
    engine = start_engine(game, scenario, seed, (chunk,))
    steps = play(engine, (chunk,), _seat((first, second), None), seed)
    actions = [step.actions[0].copy() for step in steps if step.running[0]]
    winner = int(engine.winner[0])
    return Replay(
        game.name,
        engine.scenario,
        game.version,
        int(map_seeds(seed, chunk.blocks[:1])[0]),
        tuple(second.name if team else first.name for team in teams),
        np.array(actions, np.int32),
        None if winner == NO_WINNER else winner,
        is_complete=True,
    )


def require_rivals(game: Game, scenario: Any) -> int:
    """The number of teams. Raises ValueError if there is only one."""
    num_teams = game.make_spec(scenario).num_teams
    if num_teams == 1:
        raise ValueError(
            f"{game.name}: this scenario has one team, so there is no opponent; compare scores "
            "by `marl-cair match` (league.solo)"
        )
    return num_teams


def _one_against_all(num_teams: int) -> Design:
    """In game g of a block the first agent plays team g, the second all others."""
    entries = 1 - np.eye(num_teams, dtype=np.int64)
    return lambda block: entries


def _seat(agents: tuple[Agent, Agent], identities: tuple[str, str] | None) -> tuple[Seating, ...]:
    names = identities or (agents[0].name, agents[1].name)
    return seat_line_up([Entrant(n, n, agent) for n, agent in zip(names, agents, strict=True)])
