"""Adds agents to a league; all its settings are read from its file."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from marl_cair.games.game import Agent
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.league.agents.load import find_fingerprint, load_agent, read_source
from marl_cair.league.league import LeagueConfig
from marl_cair.league.play.adaptive import count_meetings
from marl_cair.league.play.arena import Load, Rules
from marl_cair.league.store.records import AgentRecord
from marl_cair.league.store.store import STORE_FILE, LeagueStore, LeagueStoreError


def plan_extension(
    folder: Path,
    agents: Sequence[str],
    games_per_pair: int | None = None,
    workers: int = 1,
    load: Load = load_agent,
    allow_code: AllowCode = False,
) -> LeagueConfig:
    """What `run_league` is to play so that `agents` meet all that have played in `folder`.

    games_per_pair: None: as many as pairs of the league have met in, on the median. allow_code:
    which code that the league file names may run; see `allowed_code`.

    Raises:
        CodeNotAllowedError: the league has agents that are code, and they are not allowed.
        LeagueStoreError: no league, one without games, or one of whose agents is not known where it
            comes from, or is another by now.
        CheckpointError, ForeignAgentError, UnknownNameError: one of them cannot be loaded.
    """
    store = LeagueStore(folder / STORE_FILE)
    try:
        settings, stored, records = store.settings, store.read_games(), store.read_agents()
    finally:
        store.close()
    played = sorted(set(stored.agents.ravel().tolist()))
    if not played:
        raise LeagueStoreError(
            f"{folder} holds no games yet: play them first (`marl-cair league AGENT AGENT ... "
            f"--out {folder}`)"
        )
    rules = Rules.read(settings)
    game, scenario = rules.game, rules.scenario
    ladder = [find_source(folder, records[number]) for number in played]
    require_allowed(ladder, allow_code, folder / STORE_FILE)
    for number, source in zip(played, ladder, strict=True):
        load_played(folder, rules, records[number], source, load)
    if games_per_pair is None:
        size = stored.agents.shape[1]
        met = count_meetings(len(played), np.sort(np.searchsorted(played, stored.agents), axis=1))
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


def list_fingerprints(folder: Path) -> set[str]:
    """Of all agents of the league in `folder`. Raises LeagueStoreError where there is none."""
    store = LeagueStore(folder / STORE_FILE)
    try:
        return {record.fingerprint for record in store.read_agents().values()}
    finally:
        store.close()


def load_played(
    folder: Path, rules: Rules, record: AgentRecord, source: str, load: Load = load_agent
) -> Agent:
    """The agent from `source` that has played in the league in `folder`.

    Raises:
        LeagueStoreError: what is there is another agent by now.
        CheckpointError, ForeignAgentError, UnknownNameError: it cannot be loaded.
    """
    agent = load(source, game=rules.game.name, scenario=rules.scenario)
    if find_fingerprint(agent, rules.game) != record.fingerprint:
        raise LeagueStoreError(
            f"{source} is no longer the agent that has played in {folder} as {record.name}: "
            "bring that one back; or name all agents that are to be rated (`marl-cair league AGENT "
            f"AGENT ... --out {folder}`), which takes what is there now as another agent"
        )
    return agent


def find_source(folder: Path, record: AgentRecord) -> str:
    """Where an agent of the league in `folder` is from. Raises LeagueStoreError where that is not
    known.
    """
    if not (source := read_source(record)):
        raise LeagueStoreError(
            f"{folder} does not say where {record.name} is from, as it was played by an older "
            "marl_cair: give the command that played it once more, with the new agents in it"
        )
    return source
