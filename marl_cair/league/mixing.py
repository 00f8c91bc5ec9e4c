"""The safest mixture of agents that have played a league: what the league as a whole comes to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.mixed_agent import MixedAgent
from marl_cair.league.agents import load_agent
from marl_cair.league.arena import Load, Rules
from marl_cair.league.equilibrium import find_safest_mixture
from marl_cair.league.extend import find_sources
from marl_cair.league.payoffs import count_points, find_shares, split_pairs
from marl_cair.league.reporting import number_agents
from marl_cair.league.store import STORE_FILE, AgentRecord, LeagueStore, LeagueStoreError
from marl_cair.lookup import find_by_name

SLACK = 0.02  # of a score, that evenness may cost
_LEAST = 0.005  # smaller weights are left out


@dataclass(frozen=True)
class SafestMixture:
    """A mixture of agents of a league, best first, and what it scores on the league's games.

    Attributes:
        names, sources, weights: of its K members.
        worst, against: its least score (a share of points) against an agent of the league, and who
            that is. The games that chose the mixture are too kind to it: rate it by new ones.
        single, single_worst: who has the highest least score alone, and that score.
        num_agents: that it is measured against.
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    weights: tuple[float, ...]
    worst: float
    against: str
    single: str
    single_worst: float
    num_agents: int


def mix_league(
    folder: Path, names: Sequence[str] = (), slack: float = SLACK, load: Load = load_agent
) -> SafestMixture:
    """Of the agents `names` of the league in `folder` (default: all its networks), the most even
    mixture whose least score against any agent of the league is within `slack` of the highest.

    Raises:
        LeagueStoreError: no league, one without games, agents that have not met, or one that is
            another by now.
        UnknownNameError: the league has no agent of that name.
        ValueError: a slack that is not above 0, or members that look at different representations.
    """
    store = LeagueStore(folder / STORE_FILE)
    try:
        settings, stored, records = store.settings, store.read_games(), store.read_agents()
    finally:
        store.close()
    ids = sorted(set(stored.agents.ravel().tolist()))
    rows = _choose_rows(folder, [records[number] for number in ids], names)
    games = number_agents(stored, ids).count_once()
    points, counts = count_points(len(ids), split_pairs(games))
    own = np.eye(len(ids), dtype=np.bool_)
    if len(
        unmet := np.argwhere((counts == 0) & ~own & np.isin(np.arange(len(ids)), rows)[:, None])
    ):
        one, other = (records[ids[number]].name for number in unmet[0])
        raise LeagueStoreError(
            f"{one} and {other} have not met in {folder}, so nobody knows what a mixture scores: "
            "let all play all (marl-cair league), or name others"
        )
    scores = find_shares(points, counts)[rows]
    weights = find_safest_mixture(scores, slack)
    kept = [int(place) for place in np.argsort(-weights) if weights[place] >= _LEAST]
    weights = weights[kept] / weights[kept].sum()
    chosen, rules = [ids[rows[place]] for place in kept], Rules.read(settings)
    sources = find_sources(folder, rules, [records[number] for number in chosen], load)
    # Raises where they cannot play as one agent.
    MixedAgent(
        [load(one, game=rules.game.name, scenario=rules.scenario) for one in sources], weights
    )
    against = weights @ scores[kept]
    single = int(scores.min(1).argmax())
    return SafestMixture(
        tuple(records[number].name for number in chosen),
        tuple(sources),
        tuple(weights.tolist()),
        float(against.min()),
        records[ids[int(against.argmin())]].name,
        records[ids[rows[single]]].name,
        float(scores[single].min()),
        len(ids),
    )


def describe_mixture(found: SafestMixture) -> str:
    """Members, weights, and what it scores, in words."""
    width = max(map(len, found.names))
    rows = zip(found.names, found.weights, strict=True)
    members = "".join(f"  {name:{width}}  {weight:6.1%}\n" for name, weight in rows)
    return (
        f"one of these, drawn before each game:\n{members}"
        f"In the league's games it scores {found.worst:.1%} or more against each of the "
        f"{found.num_agents} agents (the least against {found.against}); alone {found.single} "
        f"has the most, {found.single_worst:.1%}. Games that chose it are too kind to it: rate "
        "it by new ones.\n"
    )


def _choose_rows(
    folder: Path, records: Sequence[AgentRecord], names: Sequence[str]
) -> NDArray[np.int64]:
    """Places of the agents that may be members."""
    places = {record.name: place for place, record in enumerate(records)}
    if names:
        found = [find_by_name("agent of the league", name, places) for name in names]
        return np.unique(np.array(found, np.int64))
    networks = [place for place, record in enumerate(records) if record.kind == "network"]
    if not networks:
        raise LeagueStoreError(
            f"no network has played in {folder}: name the agents that are to be mixed, of "
            f"{', '.join(places) or 'a league that has games'}"
        )
    return np.array(networks, np.int64)
