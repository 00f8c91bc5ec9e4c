"""`train_league`: main agents and exploiters that train against one another, in turns."""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
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
from marl_cair.training.population.league_settings import LeagueSettings, derive_seed
from marl_cair.training.population.league_slice import (
    Budget,
    MemberRecord,
    SliceResult,
    make_member,
    read_member,
    run_slice,
)
from marl_cair.training.settings.config_file import write_settings

SETTINGS_FILE, PROGRESS_FILE, REPORT_FILE = "league.yaml", "progress.json", "report.txt"
MEMBERS, EVALUATION, MIXTURE = "members", "evaluation", MIXTURE_FOLDER
# What the same league may be continued with.
FREE = ("out", "total_frames", "max_minutes", "final_games", "final_bots", "final_past")

Slice = Callable[[Path, Path, Budget, bool], SliceResult]


@dataclass(frozen=True)
class LeagueTraining:
    """Where a league stands."""

    folder: Path
    slices: int  # done so far
    is_done: bool  # all learners have had their frames
    was_interrupted: bool
    text: str  # the report; empty before the end


def train_league(
    settings: LeagueSettings, show_progress: bool = True, play_slice: Slice | None = None
) -> LeagueTraining:
    """Train all learners to `total_frames`, turn by turn, evaluate them, write the report.

    The same call again goes on where an interrupt or a kill stopped it, and with more
    `total_frames` from where it had ended; the bits are those of a league that was never stopped.

    play_slice: how a slice is run; None: `run_slice` here. That needs no more than its arguments,
    so that it may run in another process or on another machine that sees the folders. Code of the
    learners' files may run where `settings` names it too.

    Raises:
        OutputFolderError: the folder holds something else, or a league of other settings.
        As `run_slice`, and as `league.league.run_league`.
    """
    folder = Path(settings.out)
    fixed = {k: v for k, v in dataclasses.asdict(settings).items() if k not in FREE}
    with claim_output_folder(folder, LEAGUE_TRAINING, fixed, resume=True):
        write_settings(settings, folder / SETTINGS_FILE)
        _make_members(settings, folder)
        own = functools.partial(run_slice, allow_code=frozenset(settings.list_sources()))
        stopped = _take_turns(settings, folder, play_slice or own, show_progress)
        done = read_progress(folder)
        if stopped is not None:
            return LeagueTraining(folder, done, False, stopped.was_interrupted, "")
        report = _write_report(settings, folder, show_progress)
        return LeagueTraining(folder, done, True, False, report)


def _make_members(settings: LeagueSettings, folder: Path) -> None:
    mains = tuple(name for name, role in settings.learners if role == MAIN)
    for place, (name, role) in enumerate(settings.learners):
        own = settings.role(role)
        record = MemberRecord(
            name, role, mains, own.reset_chance, own.begins_as_main, settings.seed, place
        )
        seed = derive_seed(settings.seed, place, 0)
        make_member(folder / MEMBERS / name, record, settings.learner_config(role, seed=seed))


def _take_turns(
    settings: LeagueSettings, folder: Path, play_slice: Slice, show_progress: bool
) -> SliceResult | None:
    """Slice after slice; returns the one that was cut short, None where all are done."""
    learners = [name for name, _ in settings.learners]
    rounds = -(-settings.total_frames // settings.slice_frames)
    begun, minutes = time.monotonic(), settings.max_minutes
    first = read_progress(folder)
    bar = tqdm(
        total=rounds * len(learners), initial=first, unit=" slices", disable=not show_progress
    )
    with bar:
        for number in range(first, rounds * len(learners)):
            turn, place = divmod(number, len(learners))
            name = learners[place]
            left = None if minutes is None else minutes - (time.monotonic() - begun) / 60
            if left is not None and left <= 0:
                return SliceResult(0, 0, False, False, {})
            goal = min((turn + 1) * settings.slice_frames, settings.total_frames)
            bar.set_description(name)
            member, shared = folder / MEMBERS / name, folder / SHARED
            budget = Budget(goal, settings.total_frames, left)
            result = play_slice(member, shared, budget, False)
            if not result.is_done or result.was_interrupted:
                return result
            write_json(folder / PROGRESS_FILE, {"slices": number + 1})
            if show_progress:
                tqdm.write(_tell_slice(name, result, shared))
            bar.update()
    return None


def _tell_slice(name: str, result: SliceResult, shared: Path) -> str:
    rates = [
        f"{key.partition('/')[2]} {value:.0%}"
        for key, value in result.last_row.items()
        if key.startswith("collect_win_rate/")
    ]
    told = f"{name}: {result.frames:,} decisions, generation {result.generation}"
    return f"{told}, {len(read_players(shared))} players frozen; wins {', '.join(rates) or '-'}"


def read_progress(folder: Path) -> int:
    """How many slices are done. Raises ValueError for a damaged file."""
    path = folder / PROGRESS_FILE
    if not path.is_file():
        return 0
    try:
        return int(read_number(read_json(path), "slices", COUNT))
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path} cannot be read ({error!r}): delete it, slices that are done are not repeated"
        ) from error


def _write_report(settings: LeagueSettings, folder: Path, show_progress: bool) -> str:
    """Rate the learners as they are now, by the games of `marl-cair league`, and tell the rest."""
    text = _describe_learners(settings, folder) + _describe_records(folder / SHARED)
    if settings.final_games:
        config = settings.learner_config(MAIN)
        agents = _find_agents(settings, folder)
        # Others took part before the league was continued: they stay in the folder of then.
        out = folder / EVALUATION / f"{read_progress(folder):05d}"
        result = run_league(
            LeagueConfig(
                agents=tuple(agents.values()),
                game=config.game.name,
                scenario=config.game.scenario,
                scenario_options=config.game.options,
                games_per_pair=settings.final_games,
                seed=settings.seed,
                out=str(out),
            ),
            show_progress=show_progress,
        )
        text += f"\nThe learners as they are now, {out}:\n\n{result.text}\n"
        write_atomically(folder / REPORT_FILE, text)
        # The folder may hold games of others, who took part with other settings.
        mixed = mix_league(out, among=set(agents))
        save_mixture(folder / MIXTURE, mixed.sources, mixed.weights)
        text += f"\nThe league as one agent, {folder / MIXTURE}: {describe_mixture(mixed)}"
    write_atomically(folder / REPORT_FILE, text)
    return text


def _find_agents(settings: LeagueSettings, folder: Path) -> dict[str, str]:
    """Who takes part in the evaluation, by fingerprint: the learners as they are now, what they
    froze last, and bots. Each agent once: some learners are still what they began as.
    """
    about = settings.learner_config(MAIN).game
    game, scenario = GAMES[about.name], GAMES[about.name].scenario(about.scenario, **about.options)
    players = read_players(folder / SHARED)
    sources: list[str] = []
    for name, _ in settings.learners:
        own = [player.name for player in players if player.owner == name]
        newest = reversed(own[max(0, len(own) - settings.final_past) :])
        paths = (
            folder / SHARED / LIVE_FOLDER / name,
            *(folder / SHARED / PLAYERS / n for n in newest),
        )
        sources += [str(path) for path in paths if find_folder(path).is_dir()]
    return find_distinct((*sources, *settings.final_bots), game, scenario)


def _describe_learners(settings: LeagueSettings, folder: Path) -> str:
    players = read_players(folder / SHARED)
    lines = [f"{len(players)} frozen players in {folder / SHARED / PLAYERS}:"]
    for name, role in settings.learners:
        record = read_member(folder / MEMBERS / name)
        frozen = sum(player.owner == name for player in players)
        lines.append(f"  {name} ({role}): {frozen} players, generation {record.generation}")
    return "\n".join(lines) + "\n"


def _describe_records(shared: Path) -> str:
    """The learners' own games while they trained: exploration included, newer ones count more."""
    lines = ["\nWon in training, with exploration, newer games counting more (games in all):"]
    for owner, record in read_records(shared).items():
        against: dict[str, Any] = record["against"]
        told = [
            f"{name} {points / games:.0%} ({count})"
            for name, (points, games, count) in against.items()
            if games > 0.5
        ]
        lines.append(f"  {owner} against {', '.join(told) or 'nobody yet'}")
    return "\n".join(lines) + "\n"
