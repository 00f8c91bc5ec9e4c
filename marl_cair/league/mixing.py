"""Computes the mixture of a league's agents with the highest worst-case score."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.league.agents.load import load_agent, read_source
from marl_cair.league.agents.mixtures import SLACK, qualify_bot, require_data
from marl_cair.league.extend import find_source, load_played
from marl_cair.league.play.arena import Load, Rules
from marl_cair.league.ratings.equilibrium import find_safest_mixture
from marl_cair.league.ratings.games import count_points, find_shares, split_pairs
from marl_cair.league.report.report import name_agents, number_agents
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import STORE_FILE, LeagueStore, LeagueStoreError, StoredGames
from marl_cair.lookup import find_by_name

_LEAST = 0.02  # share of the largest weight; members with less are left out


@dataclass(frozen=True)
class SafestMixture:
    """A mixture of K of a league's agents, best first, and its scores in the league's games.

    The scores are biased upwards, as these games have chosen the mixture: rate it by new games.
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    weights: tuple[float, ...]
    worst: float  # the lowest score against an agent, a share of points
    against: str  # that agent
    single: str  # the single agent with the highest lowest score
    single_worst: float  # that score
    num_agents: int  # that the scores are against


def mix_league(
    folder: Path,
    names: Sequence[str] = (),
    slack: float = SLACK,
    load: Load = load_agent,
    among: Collection[str] = (),
) -> SafestMixture:
    """The most even mixture of the agents `names` of the league in `folder` (default: all networks)
    whose lowest score against any agent of the league is within `slack` of the highest possible.

    among: fingerprints of the agents that count, as members and as opponents; default: all that
    have played.

    Raises:
        LeagueStoreError: no league, one without games, agents that have not met, or the source of a
            member has another agent now.
        CheckpointError: a member cannot be loaded.
        UnknownNameError: the league has no agent of that name.
        ValueError: a slack that is not above 0, members with different representations, or one that
            is neither a checkpoint nor a bot.
        ArithmeticError: the solver found no weights.
    """
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        settings, stored, records = store.settings, store.read_games(), store.read_agents()
    rules = Rules.read(settings)
    played = set(stored.agents.ravel().tolist())
    agents = {
        number: record
        for number, record in records.items()
        if number in played and (not among or record.fingerprint in among)
    }
    if not agents:
        raise LeagueStoreError(f"{folder} holds no games yet: play them first (`marl-cair league`)")
    called = name_agents(agents)
    ids = list(called)
    rows = [ids.index(number) for number in _choose_members(folder, agents, called, names)]
    scores = _find_scores(folder, stored, called, rows)
    weights = find_safest_mixture(scores, slack)
    order = np.argsort(-weights, kind="stable")
    kept = order[weights[order] >= _LEAST * weights.max()]
    weights = weights[kept] / weights[kept].sum()
    chosen = [ids[rows[place]] for place in kept.tolist()]
    sources = [qualify_bot(find_source(folder, agents[one]), rules.game) for one in chosen]
    require_data(sources)
    members = [
        load_played(folder, rules, agents[number], source, load)
        for number, source in zip(chosen, sources, strict=True)
    ]
    MixedAgent(members, weights.tolist())  # raises if they cannot play as one agent
    against = weights @ scores[kept]
    single = int(scores.min(1).argmax())
    return SafestMixture(
        tuple(called[number] for number in chosen),
        tuple(sources),
        tuple(weights.tolist()),
        float(against.min()),
        called[ids[int(against.argmin())]],
        called[ids[rows[single]]],
        float(scores[single].min()),
        len(ids),
    )


def describe_mixture(found: SafestMixture) -> str:
    """Format members, weights and scores."""
    width = max(map(len, found.names))
    rows = zip(found.names, found.weights, strict=True)
    members = "".join(f"  {name:{width}}  {weight:6.1%}\n" for name, weight in rows)
    return (
        f"one of these, drawn before each game:\n{members}"
        f"In the league's games it scores {found.worst:.1%} or more against each of the "
        f"{found.num_agents} agents (the least against {found.against}); the best single agent, "
        f"{found.single}, scores {found.single_worst:.1%} or more. These games have chosen the "
        "mixture, so its score is biased upwards: rate it by new games.\n"
    )


def read_scores(
    folder: Path, fingerprints: Sequence[str], rows: Sequence[int]
) -> NDArray[np.float64]:
    """Scores of the agents at `rows` of N against all N in the league in `folder`: float64 [K, N],
    shares of points; 0.5 against themselves.

    Raises LeagueStoreError: no league, an agent that is not in it, or two that have not met.
    """
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        stored, records = store.read_games(), store.read_agents()
    ids = {record.fingerprint: number for number, record in records.items()}
    if missing := [one for one in fingerprints if one not in ids]:
        raise LeagueStoreError(f"{folder} has no agent of the fingerprint {missing[0]}")
    called = {ids[one]: records[ids[one]].name for one in fingerprints}
    return _find_scores(folder, stored, called, rows)


def _choose_members(
    folder: Path, agents: Mapping[int, AgentRecord], called: Mapping[int, str], names: Sequence[str]
) -> list[int]:
    """Ids of the agents that may be members."""
    if names:
        ids = {name: number for number, name in called.items()}
        return sorted({find_by_name("agent of the league", name, ids) for name in names})
    # If a checkpoint was trained further in place, only its newest agent is still there.
    newest = {read_source(record) or number: number for number, record in agents.items()}
    networks = sorted(number for number in newest.values() if agents[number].kind == "network")
    if not networks:
        raise LeagueStoreError(
            f"no network has played in {folder}: name the agents to mix, of "
            f"{', '.join(called.values())}"
        )
    return networks


def _find_scores(
    folder: Path, stored: StoredGames, called: Mapping[int, str], rows: Sequence[int]
) -> NDArray[np.float64]:
    """Scores of the agents at `rows` against all, float64 [K, N]; 0.5 against themselves."""
    ids, names = list(called), list(called.values())
    both = stored.select(np.asarray(np.isin(stored.agents, ids).all(axis=1), np.bool_))
    pairs = split_pairs(number_agents(both, ids).count_once())
    points, counts = count_points(len(ids), pairs)
    is_unmet = counts[rows] == 0
    is_unmet[np.arange(len(rows)), rows] = False
    if is_unmet.any():
        row, other = np.argwhere(is_unmet)[0].tolist()
        raise LeagueStoreError(
            f"{names[rows[row]]} and {names[other]} have not met in {folder}, so the score of a "
            "mixture is unknown: let all play all (marl-cair league), or name others"
        )
    return find_shares(points, counts)[rows]
