"""Adds agents to a league, with the settings in its file."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from marl_cair.games.game import Agent
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.league.agents.load import find_fingerprint, load_agent, read_source
from marl_cair.league.league import LeagueConfig
from marl_cair.league.play.adaptive import count_meetings
from marl_cair.league.play.arena import Load, Rules
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import STORE_FILE, LeagueStore, LeagueStoreError


def plan_extension(
    folder: Path,
    agents: Sequence[str],
    games_per_pair: int | None = None,
    workers: int = 1,
    load: Load = load_agent,
    allow_code: AllowCode = False,
) -> LeagueConfig:
    """The configuration for `run_league` in which `agents` meet all other agents of the league in
    `folder`.

    games_per_pair: default: the median over the pairs of the league. allow_code: code in the league
    file that may run; see `allowed_code`.

    Raises:
        CodeNotAllowedError: the league has agents that are code, and they are not allowed.
        LeagueStoreError: no league, one without games, or the source of an agent is unknown or has
            another agent now.
        CheckpointError, ForeignAgentError, UnknownNameError: an agent cannot be loaded.
    """
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        settings, stored, records = store.settings, store.read_games(), store.read_agents()
    played = sorted(set(stored.agents.ravel().tolist()))
    if not played:
        raise LeagueStoreError(
            f"{folder} holds no games yet: play them first (`marl-cair league AGENT AGENT ... "
            f"--out {folder}`)"
        )
    rules = Rules.read(settings)
    game, scenario = rules.game, rules.scenario
    # An agent that has begun already plays on.
    added = [load(source, game=game.name, scenario=scenario) for source in agents]
    fingerprints = {find_fingerprint(agent, game) for agent in added}
    played = [number for number in played if records[number].fingerprint not in fingerprints]
    if not played:
        raise LeagueStoreError(
            f"all agents of {folder} are given, so there is none to meet: `marl-cair league AGENT "
            f"AGENT ... --out {folder}` gives them more games"
        )
    ladder = [find_source(folder, records[number]) for number in played]
    require_allowed(ladder, allow_code, folder / STORE_FILE)
    for number, source in zip(played, ladder, strict=True):
        load_played(folder, rules, records[number], source, load)
    if games_per_pair is None:
        size = stored.agents.shape[1]
        both = stored.agents[np.isin(stored.agents, played).all(axis=1)]
        met = count_meetings(len(played), np.sort(np.searchsorted(played, both), axis=1))
        counts = met[np.triu_indices(len(played), 1)]
        median = int(np.median(counts[counts > 0])) if counts.any() else 0
        games_per_pair = max(size, median // size * size)
    return LeagueConfig(
        agents=tuple(agents),
        game=game.name,
        scenario=game.default_scenario,
        scenario_options=dataclasses.asdict(scenario),
        games_per_pair=games_per_pair,
        seed=rules.seed,
        out=str(folder),
        ladder=tuple(ladder),
        seating=rules.seating,
        workers=workers,
    )


def load_played(
    folder: Path, rules: Rules, record: AgentRecord, source: str, load: Load = load_agent
) -> Agent:
    """Load an agent of the league in `folder` from its source.

    Raises:
        LeagueStoreError: another agent is there now.
        CheckpointError, ForeignAgentError, UnknownNameError: it cannot be loaded.
    """
    agent = load(source, game=rules.game.name, scenario=rules.scenario)
    if find_fingerprint(agent, rules.game) != record.fingerprint:
        raise LeagueStoreError(
            f"{source} is no longer the agent that has played in {folder} as {record.name}: bring "
            "that agent back; or name all agents to rate (`marl-cair league AGENT AGENT ... --out "
            f"{folder}`), which adds the one that is there now as another agent"
        )
    return agent


def find_source(folder: Path, record: AgentRecord) -> str:
    """The source of an agent of the league in `folder`. Raises LeagueStoreError if unknown."""
    if not (source := read_source(record)):
        raise LeagueStoreError(
            f"{folder} does not say where {record.name} is from, as an older marl_cair has played "
            "it: give the command that played it again, with the new agents in it"
        )
    return source
