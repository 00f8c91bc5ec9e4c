"""Rates the stored games of a league and writes its report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from marl_cair.files import locked_folder
from marl_cair.league.agents.allowed_code import AllowCode
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.arena import Load
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.rate import Ladder, Rating, describe_method
from marl_cair.league.report.background import read_background
from marl_cair.league.report.files import write_report
from marl_cair.league.report.replays import FOLDER as REPLAYS
from marl_cair.league.report.replays import ReplayRenderer, choose_games
from marl_cair.league.report.sections import make_report
from marl_cair.league.report.table import make_table
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import STORE_FILE, LeagueStore, StoredGames


@dataclass(frozen=True)
class LeagueResult:
    """Ratings and report of a league."""

    ratings: tuple[Rating, ...]  # best first
    text: str  # ladder, matrix, other tables and sentences
    folder: Path
    ending: str = ""  # how games ended that were played until a target was reached


def number_agents(stored: StoredGames, ids: Sequence[int]) -> Games:
    """The games with agents by their places in `ids`, and games on one map seed as one block.

    In older leagues all line-ups had the same map seeds: a map that favours an agent does so in all
    its games there. Raises KeyError for an agent that is not in `ids`.
    """
    if missing := set(stored.agents.ravel().tolist()) - set(ids):
        raise KeyError(f"agents {sorted(missing)} have played and are not among {list(ids)}")
    order = np.argsort(ids)
    places = np.searchsorted(ids, stored.agents, sorter=order)
    blocks = np.unique(stored.map_seeds, return_inverse=True)[1].ravel()
    return Games(order[places], stored.points, stored.ranks, blocks, stored.is_repeat)


def name_agents(agents: Mapping[int, AgentRecord]) -> dict[int, str]:
    """Names by id, in the order of fingerprints. Agents with the same name, such as two runs of one
    name, get their ids beside it; a bot keeps its name if no other bot has it.
    """
    in_order = sorted(agents.items(), key=lambda item: item[1].fingerprint)
    names = {number: agent.name for number, agent in in_order}
    bots = Counter(agent.name for agent in agents.values() if agent.kind == "bot")
    plain = {n for n, one in agents.items() if one.kind == "bot" and bots[one.name] == 1}
    while len(set(names.values())) < len(names):  # again where another is called "name (id)"
        count = Counter(names.values())
        names = {
            number: f"{name} ({number})" if count[name] > 1 and number not in plain else name
            for number, name in names.items()
        }
    return names


@dataclass(frozen=True)
class ReportOptions:
    """Options of a report.

    Attributes:
        replays: whether to show a few games.
        load: loads their agents, as `load_agent`.
        allow_code: which code of the league file may run for that; see `allowed_code`.
        show_progress: on the terminal.
        alpha_rank: whether to compute it.
        zero: the agent that is rated 0, see `ratings.rate`.
    """

    replays: bool = True
    load: Load = load_agent
    allow_code: AllowCode = False
    show_progress: bool = False
    alpha_rank: bool = False
    zero: str = ""


def rate_and_report(
    store: LeagueStore,
    stored: StoredGames,
    names: Mapping[int, str],
    folder: Path,
    options: ReportOptions,
) -> LeagueResult:
    """Rate stored games of the agents `names` (by id), store the ratings, write the report.

    names: in the order of fingerprints, so that no number depends on the names.
    Where no games compare all agents, the report says so and has everything but the ladder.

    Raises:
        ValueError: alpha-Rank without OpenSpiel, or `options.zero` is none of the agents.
    """
    called = list(names.values())
    if options.zero and options.zero not in called:
        raise ValueError(
            f"--zero is {options.zero!r}, the league has no such agent: give one of "
            f"{', '.join(sorted(called))}"
        )
    games, seed = number_agents(stored, list(names)), int(store.settings["seed"])
    table = make_table(
        called, games, _count_forfeits(stored, names), seed, options.alpha_rank, options.zero
    )
    if table.ladder is not None:
        _store_ratings(store, table.ladder, names, games, seed)
    replays, why_none = [], "Replays were left out (--no-replays)."
    if options.replays:
        renderer = ReplayRenderer(
            store, stored, names, folder / REPLAYS, options.load, options.allow_code
        )
        choices = choose_games(stored, names, table.ratings)
        shown = tqdm(choices, "replays", unit=" games", disable=not options.show_progress)
        replays = [renderer.render(choice) for choice in shown]
        why_none = "" if replays else "There is no finished game to show."
    background = read_background(store, stored, names, games, replays, why_none)
    text = write_report(folder, make_report(table, background))
    return LeagueResult(table.ratings, text, folder)


def _count_forfeits(stored: StoredGames, names: Mapping[int, str]) -> list[tuple[str, str, int]]:
    """Agents, reasons, and how many games each agent has forfeited for each reason.

    A game has one reason, that of the first team.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for n in np.flatnonzero(stored.has_forfeited.any(axis=1)).tolist():
        lost = stored.agents[n][stored.has_forfeited[n]].tolist()
        called = [names[agent] for agent in dict.fromkeys(lost)]
        for name in called:
            is_first = name == called[0]
            why = stored.reasons[n] if is_first else f"in the same step as {called[0]}"
            counts[name, why] += 1
    return [(*about, count) for about, count in sorted(counts.items())]


def _store_ratings(
    store: LeagueStore, ladder: Ladder, names: Mapping[int, str], games: Games, seed: int
) -> None:
    id_of = {name: number for number, name in names.items()}
    rows = [
        (
            id_of[r.name],
            *(r.elo, r.low, r.high, r.bound, r.group, r.probability_first, r.games, r.score),
        )
        for r in ladder.ratings
    ]
    digest, num_games = games.digest(list(names.values())), int((~games.is_repeat).sum())
    method = describe_method(seed) | {"zero": ladder.zero}
    store.add_ratings(method, digest, num_games, rows)


def report_stored(
    folder: Path, with_alpha_rank: bool = False, with_replays: bool = True, zero: str = ""
) -> LeagueResult:
    """Rate all stored games of the league in `folder` and write its report. It plays only the few
    games that the report shows, and runs no foreign code. zero: the agent that is rated 0.

    Raises:
        LeagueStoreError: no league file, or one that cannot be read.
        OutputFolderError: another process plays that league, or writes its report.
        ValueError: as `rate_and_report`.
    """
    with closing(LeagueStore(folder / STORE_FILE)) as store, locked_folder(folder):
        stored = store.read_games()
        played = set(stored.agents.ravel().tolist())
        agents = {n: one for n, one in store.read_agents().items() if n in played or not played}
        options = ReportOptions(with_replays, alpha_rank=with_alpha_rank, zero=zero)
        return rate_and_report(store, stored, name_agents(agents), folder, options)
