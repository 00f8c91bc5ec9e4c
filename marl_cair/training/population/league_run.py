"""Trains a league: main agents and exploiters that take turns and play one another."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from marl_cair.checkpoint import LEAGUE_TRAINING, LIVE_FOLDER, MIXTURE_FOLDER, PLAYERS, SHARED
from marl_cair.files import claim_output_folder, find_folder, write_atomically, write_json
from marl_cair.games import GAMES
from marl_cair.league.agents.load import find_distinct
from marl_cair.league.agents.mixtures import save_mixture
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.mixing import describe_mixture, mix_league
from marl_cair.ranges import COUNT, read_number
from marl_cair.self_play.shared_folder import MAIN, read_players, read_records
from marl_cair.stored import read_json
from marl_cair.training.population import league_slice
from marl_cair.training.population.league_settings import LeagueSettings, derive_seed
from marl_cair.training.population.league_slice import Budget, SliceResult, run_slice
from marl_cair.training.settings.config import GameSettings
from marl_cair.training.settings.config_file import write_settings

SETTINGS_FILE, PROGRESS_FILE, REPORT_FILE = "league.yaml", "progress.json", "report.txt"
MEMBERS, EVALUATION, MIXTURE = "members", "evaluation", MIXTURE_FOLDER
# Settings that may change when a league is continued.
FREE = ("out", "total_frames", "max_minutes", "final_games", "final_bots", "final_past")

Slice = Callable[[Path, Path, Budget, bool], SliceResult]


@dataclass(frozen=True)
class LeagueTraining:
    """The state of a league."""

    folder: Path
    slices: int  # done so far
    is_done: bool  # all learners have had their frames
    was_interrupted: bool
    text: str  # the report; empty before the end


def train_league(
    settings: LeagueSettings, show_progress: bool = True, play_slice: Slice | None = None
) -> LeagueTraining:
    """Train all learners to `total_frames`, turn by turn, evaluate them, write the report.

    The same call again resumes after an interrupt or a kill; the bits are those of a league that
    was never stopped. With more `total_frames` it continues: a last turn that was shorter than
    `slice_frames` is taken up again, but rates that fall over `total_frames` differ.

    play_slice: runs a slice; None: `run_slice` here. It needs no more than its arguments, so it may
    run in another process or on another machine that sees the folders. Code that the learners'
    files name may run if `settings` names it too.

    Raises:
        OutputFolderError: the folder holds something else, or a league of other settings.
        As `run_slice`, and as `league.league.run_league`.
    """
    folder = Path(settings.out)
    fixed = {k: v for k, v in dataclasses.asdict(settings).items() if k not in FREE}
    with claim_output_folder(folder, LEAGUE_TRAINING, fixed, resume=True):
        write_settings(settings, folder / SETTINGS_FILE)
        _make_members(settings, folder)
        own = partial(run_slice, allow_code=frozenset(settings.list_sources()))
        stopped = _take_turns(settings, folder, play_slice or own, show_progress)
        done = read_progress(folder)
        if stopped is not None:
            return LeagueTraining(folder, done, False, stopped.was_interrupted, "")
        report = _write_report(settings, folder, show_progress)
        return LeagueTraining(folder, done, True, False, report)


def _make_members(settings: LeagueSettings, folder: Path) -> None:
    mains = tuple(name for name, role in settings.learners if role == MAIN)
    for place, (name, role) in enumerate(settings.learners):
        own, seed = settings.role(role), derive_seed(settings.seed, place, 0)
        record = league_slice.MemberRecord(
            name, role, mains, own.reset_chance, own.begins_as_main, settings.seed, place
        )
        config = settings.learner_config(role, seed=seed)
        league_slice.make_member(folder / MEMBERS / name, record, config)


def _take_turns(
    settings: LeagueSettings, folder: Path, play_slice: Slice, show_progress: bool
) -> SliceResult | None:
    """Run slice after slice; returns the one that was cut short, None if all are done."""
    learners = [name for name, _ in settings.learners]
    num_slices = -(-settings.total_frames // settings.slice_frames) * len(learners)
    begun, minutes, shared = time.monotonic(), settings.max_minutes, folder / SHARED
    first, cut = read_progress(folder), read_progress(folder, "cut")
    if settings.total_frames > cut > 0:  # the last turn ended sooner than its slice, for all
        first = cut // settings.slice_frames * len(learners)
    with tqdm(total=num_slices, initial=first, unit=" slices", disable=not show_progress) as bar:
        for number in range(first, num_slices):
            turn, place = divmod(number, len(learners))
            name = learners[place]
            left = None if minutes is None else minutes - (time.monotonic() - begun) / 60
            if left is not None and left <= 0:
                return SliceResult(0, 0, False, False, {})
            goal = min((turn + 1) * settings.slice_frames, settings.total_frames)
            bar.set_description(name)
            budget = Budget(goal, settings.total_frames, left)
            result = play_slice(folder / MEMBERS / name, shared, budget, False)
            if not result.is_done or result.was_interrupted:
                return result
            cut = goal if goal % settings.slice_frames else 0
            write_json(folder / PROGRESS_FILE, {"slices": number + 1, "cut": cut})
            if show_progress:
                tqdm.write(_describe_slice(name, result, shared))
            bar.update()
    return None


def _describe_slice(name: str, result: SliceResult, shared: Path) -> str:
    rates = [
        f"{key.partition('/')[2]} {value:.0%}"
        for key, value in result.last_row.items()
        if key.startswith("collect_win_rate/")
    ]
    text = f"{name}: {result.frames:,} steps, generation {result.generation}"
    return f"{text}, {len(read_players(shared))} players frozen; wins {', '.join(rates) or '-'}"


def read_progress(folder: Path, name: str = "slices") -> int:
    """Number of finished slices; "cut": steps of a last turn shorter than a slice, or 0.

    Raises ValueError for a damaged file.
    """
    path = folder / PROGRESS_FILE
    if not path.is_file():
        return 0
    try:
        return int(read_number({"cut": 0, **read_json(path)}, name, COUNT))
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path} cannot be read ({error!r}): delete it, slices that are done are not repeated"
        ) from error


def _write_report(settings: LeagueSettings, folder: Path, show_progress: bool) -> str:
    """Rate the learners' newest policies in games of `marl-cair league`, and write the report."""
    text = _describe_learners(settings, folder) + _describe_records(folder / SHARED)
    if settings.final_games:
        about = settings.learner_config(MAIN).game
        agents = _find_agents(settings, folder, about)
        # A league that was continued has a folder for each end: other agents took part before.
        out = folder / EVALUATION / f"{read_progress(folder):05d}"
        config = LeagueConfig(
            agents=tuple(agents.values()),
            game=about.name,
            scenario=about.scenario,
            scenario_options=about.options,
            games_per_pair=settings.final_games,
            seed=settings.seed,
            out=str(out),
        )
        result = run_league(config, show_progress=show_progress)
        text += f"\nThe learners as they are now, {out}:\n\n{result.text}\n"
        write_atomically(folder / REPORT_FILE, text)
        # The folder may hold games of other agents, which took part with other settings.
        mixed = mix_league(out, among=set(agents))
        save_mixture(folder / MIXTURE, mixed.sources, mixed.weights)
        text += f"\nThe league as one agent, {folder / MIXTURE}: {describe_mixture(mixed)}"
    write_atomically(folder / REPORT_FILE, text)
    return text


def _find_agents(settings: LeagueSettings, folder: Path, about: GameSettings) -> dict[str, str]:
    """Agents in the evaluation by fingerprint, each once: the learners' newest policies, the
    players that they froze last, and bots. Some learners still are the agent that they began as.
    """
    players = read_players(folder / SHARED)
    sources: list[str] = []
    for name, _ in settings.learners:
        own = [player.name for player in players if player.owner == name]
        newest = reversed(own[max(0, len(own) - settings.final_past) :])
        paths = [Path(LIVE_FOLDER) / name, *(Path(PLAYERS) / one for one in newest)]
        found = (folder / SHARED / path for path in paths)
        sources += [str(path) for path in found if find_folder(path).is_dir()]
    sources += settings.final_bots
    return find_distinct(sources, GAMES[about.name], about.played_scenario)


def _describe_learners(settings: LeagueSettings, folder: Path) -> str:
    players = read_players(folder / SHARED)
    text = f"{len(players)} frozen players in {folder / SHARED / PLAYERS}:\n"
    for name, role in settings.learners:
        generation = league_slice.read_member(folder / MEMBERS / name).generation
        frozen = sum(player.owner == name for player in players)
        text += f"  {name} ({role}): {frozen} players, generation {generation}\n"
    return text


def _describe_records(shared: Path) -> str:
    """The learners' own games in training: exploration included, newer games count more."""
    text = "\nWon in training, with exploration, newer games counting more (games in all):\n"
    for owner, record in read_records(shared).items():
        against: dict[str, Any] = record["against"]
        rates = [
            f"{name} {points / games:.0%} ({count})"
            for name, (points, games, count) in against.items()
            if games > 0.5
        ]
        text += f"  {owner} against {', '.join(rates) or 'no opponent yet'}\n"
    return text
