"""Plays agents in the seats of many games on one engine, each with its own random stream.

Games come in blocks (one map seed), and blocks in chunks of a fixed size. Chunks are always played
whole: random draws and rounding in networks depend on the batch size, so that a chunk is the
smallest unit whose games depend only on the seed, the agents and the chunk's number.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER, Agent, Game
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.league.agents.foreign import FORFEIT
from marl_cair.league.play.standings import STILL_IN, rank_teams, share_points

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

CHUNKS_AT_ONCE = 16  # on one engine, for speed: its worlds are independent


class Places(NamedTuple):
    """Seats of an agent within a chunk, in the order of its observations; int64 [N] both."""

    game: NDArray[np.int64]  # of the chunk
    seat: NDArray[np.int64]


@dataclass(frozen=True)
class Chunk:
    """Seats of all agents in G games that are played together."""

    number: int  # of the chunk in its match
    blocks: NDArray[np.int64]  # [G], number of each game's block
    places: tuple[Places, ...]  # of each entry


class Seating(NamedTuple):
    """An agent, and the names that seed its draws, its own first."""

    agent: Agent
    names: tuple[str, ...]


class Ended(NamedTuple):
    """How G games of P seats and T teams ended."""

    winner: NDArray[np.int8]  # [G] seat, or NO_WINNER
    truncated: NDArray[np.bool_]  # [G]
    points: NDArray[np.float64]  # [G, T], see `standings.share_points`
    ranks: NDArray[np.float64]  # [G, T], see `standings.rank_teams`
    returns: NDArray[np.float64]  # [G, P] sums of rewards
    decisions: NDArray[np.int64]  # [G]
    trajectories: tuple[str, ...]  # hashes of the first board, all actions and the last board
    forfeited: NDArray[np.bool_]  # [G, T]
    reasons: tuple[str, ...]  # of a forfeit, "" without one


class Step(NamedTuple):
    """One step of G games; no array is changed later."""

    actions: NDArray[np.int32]  # [G, P]
    running: NDArray[np.bool_]  # [G], before the step; false for games with a forfeit in it
    out: NDArray[np.bool_]  # [G, P], before the step
    forfeits: dict[tuple[int, int], str]  # (game, seat) -> reason


def map_seeds(seed: int, blocks: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The engine's seeds uint64 [N] of blocks [N] of a match."""
    from marl_cair.games.randomness import episode_seeds

    return episode_seeds(seed, blocks, np.zeros(len(blocks), np.int64))


def line_up_seed(seed: int, fingerprints: Sequence[str]) -> int:
    """The seed, 64 bits, of a line-up's maps in a league: each line-up has maps of its own.

    If all line-ups shared maps, a map that favours an agent would do so in all its games: their
    results would be correlated, and less informative.
    """
    text = "\0".join((f"{seed} maps", *fingerprints))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")


def start_engine(
    game: Game, scenario: Any, map_seed: int, chunks: Sequence[Chunk]
) -> BatchedEngine:
    """An engine with the games of `chunks` at their start, with the rated reward."""
    blocks = np.concatenate([chunk.blocks for chunk in chunks])
    rated = dataclasses.replace(scenario, reward=game.rated_reward)
    from marl_cair.games.engine import BatchedEngine

    engine = BatchedEngine(game, rated, len(blocks))
    engine.reset(map_seeds(map_seed, blocks))
    return engine


def count_chunks(game: Game) -> int:
    """Chunks that one engine plays at once: the games do not depend on it."""
    return CHUNKS_AT_ONCE if game.has_snapshots else 1


def size_chunk(game: Game, size: int) -> int:
    """Games or blocks in a chunk: half of `size` if each game is a program that takes memory."""
    return size if game.has_snapshots else size // 2


def play_out(
    engine: BatchedEngine,
    chunks: Sequence[Chunk],
    seatings: Sequence[Seating],
    seed: int,
    watch: Callable[[Step], None] | None = None,
) -> Ended:
    """Play all games of `chunks` to their ends, on the engine of `start_engine`.

    A seat that forfeits ends its game: its team has lost, the other teams are left. `watch` is
    called after each step.
    """
    teams = engine.spec.team_of_seat
    shape = engine.num_worlds, engine.num_players
    digests = [hashlib.blake2b(digest_size=8) for _ in range(engine.num_worlds)]
    decisions = np.zeros(engine.num_worlds, np.int64)
    returns = np.zeros(shape)
    out_since = np.full(shape, STILL_IN)
    forfeits: dict[tuple[int, int], str] = {}
    _add_boards(digests, engine, np.ones(engine.num_worlds, np.bool_))
    for step in play(engine, chunks, seatings, seed):
        if watch is not None:
            watch(step)
        actions, running, out, given_up = step
        ended_now = [world for world, _ in given_up]
        is_counted = running.copy()
        is_counted[ended_now] = True  # games that end here by a forfeit
        newly_out = is_counted[:, None] & out & (out_since == STILL_IN)
        out_since[newly_out] = np.broadcast_to(decisions[:, None], shape)[newly_out]
        decisions += running
        returns[running] += engine.rewards[running]
        forfeits |= given_up
        for world in np.flatnonzero(running).tolist():
            digests[world].update(actions[world].tobytes())
    winner = engine.winner.copy()
    forfeited = np.zeros((engine.num_worlds, int(teams.max()) + 1), np.bool_)
    reasons = [""] * engine.num_worlds
    for world, seat in sorted(forfeits, key=lambda place: (teams[place[1]], place)):
        forfeited[world, teams[seat]] = True
        reasons[world] = reasons[world] or forfeits[world, seat]
        digests[world].update(f"forfeit {seat}".encode())
    is_whole = np.asarray(~forfeited.any(axis=1), np.bool_)
    # After a forfeit the engine steps a world until all others end: its last board is not used.
    _add_boards(digests, engine, is_whole)
    _end_forfeited(winner, out_since, forfeited, teams)
    return Ended(
        winner,
        engine.truncated & is_whole,
        share_points(winner, out_since != STILL_IN, teams),
        rank_teams(winner, out_since, teams),
        returns,
        decisions,
        tuple(digest.hexdigest() for digest in digests),
        forfeited,
        tuple(reasons),
    )


def play(
    engine: BatchedEngine, chunks: Sequence[Chunk], seatings: Sequence[Seating], seed: int
) -> Iterator[Step]:
    """Step until all games have ended; yields after each step.

    An agent acts for one chunk at a time, in the running games and the seats that are still in, in
    the order of its places. One member of a mixture plays all seats of a team in a game.
    """
    streams = [_start_streams(seating, seed, chunks) for seating in seatings]
    members = [
        [
            _draw_members(seating.agent, state, chunk.places[entry], engine.spec.team_of_seat)
            for state, chunk in zip(states, chunks, strict=True)
        ]
        for entry, (seating, states) in enumerate(zip(seatings, streams, strict=True))
    ]
    names = {seating.agent.representation for seating in seatings}
    starts = np.cumsum([0, *(len(chunk.blocks) for chunk in chunks)])
    stopped = np.zeros(engine.num_worlds, np.bool_)  # by a forfeit
    size = find_state_size(*(seating.agent for seating in seatings))
    recurrent = np.zeros((engine.num_worlds, engine.num_players, size), np.float32)
    while (running := ~(engine.terminated | engine.truncated | stopped)).any():
        masks = engine.action_mask()
        seen = {name: engine.observe(name) for name in names}
        out = engine.eliminated.copy()
        shape = (engine.num_worlds, engine.num_players, *engine.spec.action_shape)
        actions = np.full(shape, engine.spec.noop_action, np.int32)
        forfeits: dict[tuple[int, int], str] = {}
        for entry, ((agent, _), states) in enumerate(zip(seatings, streams, strict=True)):
            for place, (chunk, state) in enumerate(zip(chunks, states, strict=True)):
                games, seats = chunk.places[entry]
                worlds = starts[place] + games
                acts = running[worlds] & ~out[worlds, seats]
                if not acts.any():
                    continue
                at = worlds[acts], seats[acts]
                agent.load_state_dict(state)
                rows = seen[agent.representation][at], masks[at]
                act = None
                if isinstance(agent, MixedAgent):
                    act = partial(agent.act_as, members[entry][place][acts])
                chosen = call_agent(agent, recurrent, at, *rows, act)
                states[place] = agent.state_dict()
                if (gave_up := chosen == FORFEIT).any():
                    given_up = gave_up.reshape(len(chosen), -1).any(1)
                    reason = f"{agent.name} {getattr(agent, 'failure', 'gave up')}"
                    lost = np.stack(at, 1)[given_up].tolist()
                    forfeits |= dict.fromkeys(map(tuple, lost), reason)
                    chosen = np.where(gave_up, engine.spec.noop_action, chosen)
                actions[at] = chosen
        stopped[[world for world, _ in forfeits]] = True
        engine.step(actions)
        yield Step(actions, running & ~stopped, out, forfeits)


def _end_forfeited(
    winner: NDArray[np.int8],
    out_since: NDArray[np.int64],
    forfeited: NDArray[np.bool_],
    teams: NDArray[np.int64],
) -> None:
    """Change winner [G] and out_since [G, P] of games in which teams [G, T] have forfeited."""
    for world in np.flatnonzero(forfeited.any(1)).tolist():
        winner[world] = NO_WINNER
        left = find_remaining(out_since[world] == STILL_IN, forfeited[world], teams)
        if len(left) == 0:  # all remaining teams forfeit at once: a draw between them
            continue
        out_since[world, forfeited[world, teams]] = -1  # below seats that went out by the rules
        if len(left) == 1:
            winner[world] = np.flatnonzero(teams == left[0])[0]


def find_remaining(
    is_in: NDArray[np.bool_], forfeited: NDArray[np.bool_], teams: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The teams with a seat that is in [P] that have not forfeited [T]; teams [P] of the seats."""
    still_in = np.unique(teams[is_in])
    left: NDArray[np.int64] = still_in[~forfeited[still_in]]
    return left


def _add_boards(digests: Sequence[Any], engine: BatchedEngine, which: NDArray[np.bool_]) -> None:
    """Add the observations of all seats of the worlds `which` [G]."""
    boards = engine.observe(next(iter(engine.spec.representations)))
    for world in np.flatnonzero(which).tolist():
        digests[world].update(np.ascontiguousarray(boards[world]).tobytes())


def _start_streams(seating: Seating, seed: int, chunks: Sequence[Chunk]) -> list[dict[str, Any]]:
    """The state of an agent's random generator at the start of each chunk."""
    streams = []
    for chunk in chunks:
        text = "\0".join((str(seed), str(chunk.number), *seating.names))
        digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
        seating.agent.seed(int.from_bytes(digest, "big") >> 1)  # torch takes 63 bits
        streams.append(seating.agent.state_dict())
    return streams


def _draw_members(
    agent: Agent, state: dict[str, Any], places: Places, teams: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The member of a mixture that plays each of `places` [N]: int64 [N], drawn for each team and
    game in the order of the places, so that a match between two teams is the same from both sides.
    """
    if not isinstance(agent, MixedAgent):
        return np.zeros(len(places.game), np.int64)
    agent.load_state_dict(state)
    keys = places.game * (int(teams.max()) + 1) + teams[places.seat]
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    turn = np.argsort(np.argsort(first))
    return np.asarray(agent.draw(len(first))[turn[which]], np.int64)
