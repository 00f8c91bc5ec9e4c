"""Trains one learner of a league for a slice of its frames; it needs only two folders.

A learner's folder holds `member.json` (its role and how often it was reset), and one training run
for each generation, `000`, `001`, ...; only the newest has a state to resume from.
"""

from __future__ import annotations

import dataclasses
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from marl_cair.checkpoint import LIVE_FOLDER, CheckpointError
from marl_cair.files import write_json
from marl_cair.league.agents.allowed_code import AllowCode
from marl_cair.self_play.shared_folder import LeagueSeat
from marl_cair.stored import read_json
from marl_cair.training.generating.generators import take_over_generator
from marl_cair.training.initial_network import begin_as, can_begin_as
from marl_cair.training.population.league_settings import derive_seed
from marl_cair.training.run import RESUME_FOLDER
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.config_file import CONFIG_FILE, load_config, save_config
from marl_cair.training.trainer import train

MEMBER_FILE = "member.json"


@dataclass(frozen=True)
class MemberRecord:
    """The contents of `member.json`."""

    name: str
    role: str
    mains: tuple[str, ...]  # names of all main agents
    reset_chance: float  # that the learner is reset once it has frozen a player
    begins_as_main: bool  # it then has a main agent's network, and not a new one
    league_seed: int  # seeds derive from it, place and generation
    place: int  # in the order of turns
    generation: int = 0  # number of resets
    frames_before: int = 0  # steps of all earlier generations


_LEAST_MINUTES = 0.01  # of a generation, where no time is left


@dataclass(frozen=True)
class Budget:
    """The end of a slice. Steps are the learner's in all, so a slice that is run again trains only
    what is missing.
    """

    frames: int  # steps at the end of the slice
    total_frames: int  # steps at the end of the league, over which a learning rate falls
    max_minutes: float | None = None  # the slice is cut short after it; None: no limit


@dataclass(frozen=True)
class SliceResult:
    """The state of the learner after a slice."""

    frames: int  # steps of all its generations
    generation: int
    is_done: bool  # whether the budget's frames are reached
    was_interrupted: bool
    last_row: dict[str, float]


def run_slice(
    member: Path,
    shared: Path,
    budget: Budget,
    show_progress: bool = True,
    allow_code: AllowCode = False,
) -> SliceResult:
    """Train the learner in `member` against the league in `shared` until `budget.frames`.

    After a kill at any moment, the same call resumes from the learner's last state and gives the
    same bits as without the kill, as long as no other learner has trained in between.

    allow_code: which code that the learner's `config.yaml` names may run; see
    `league.agents.allowed_code`.

    Raises:
        CodeNotAllowedError: it names agents that are code, and they are not allowed.
        CheckpointError: `member` holds no learner, or a damaged one.
        As `TrainingRun`.
    """
    last_row: dict[str, float] = {}
    begun = time.monotonic()
    while True:
        spent = (time.monotonic() - begun) / 60.0
        record = read_member(member)
        goal = budget.frames - record.frames_before
        if goal <= 0:
            return SliceResult(record.frames_before, record.generation, True, False, last_row)
        config = dataclasses.replace(
            _begin(member, shared, record, allow_code),
            out=str(member / f"{record.generation:03d}"),
            seed=derive_seed(record.league_seed, record.place, record.generation),
            total_frames=budget.total_frames - record.frames_before,
            max_minutes=budget.max_minutes and max(budget.max_minutes - spent, _LEAST_MINUTES),
        )
        about = record.name, record.role, record.generation, tuple(record.mains)
        seat = LeagueSeat(shared, *about, record.reset_chance, record.frames_before)
        result = train(config, True, show_progress, seat=seat, until_frames=goal)
        last_row = result.last_row or last_row
        frames, cut = record.frames_before + result.frames, result.was_interrupted
        if result.is_over:
            following = record.generation + 1
            new = dataclasses.replace(record, generation=following, frames_before=frames)
            save_member(member, new)
            # Only now: until the record has the next generation, the state says that this is over.
            shutil.rmtree(Path(config.out) / RESUME_FOLDER, ignore_errors=True)
        if not result.is_over or cut:
            return SliceResult(frames, record.generation, frames >= budget.frames, cut, last_row)


def _begin(member: Path, shared: Path, record: MemberRecord, allow_code: AllowCode) -> TrainConfig:
    """The settings of the learner's generation; its first network is decided once."""
    config, run = load_config(member, allow_code), member / f"{record.generation:03d}"
    main = str(shared / LIVE_FOLDER / record.mains[record.generation % len(record.mains)])
    if (run / CONFIG_FILE).is_file():
        begins_as_main = load_config(run, allow_code).initial_agent != config.initial_agent
    else:
        begins_as_main = record.begins_as_main and can_begin_as(main)
    if record.generation > 0:
        config = take_over_generator(config, member / f"{record.generation - 1:03d}")
    return begin_as(main, config) if begins_as_main else config


def make_member(member: Path, record: MemberRecord, config: TrainConfig) -> None:
    """Prepare a learner's folder; an existing one is left as it is."""
    if not (member / MEMBER_FILE).is_file():
        member.mkdir(parents=True, exist_ok=True)
        save_config(dataclasses.replace(config, out=str(member)))
        save_member(member, record)


def save_member(member: Path, record: MemberRecord) -> None:
    """Write `member.json`, whole or not at all."""
    write_json(member / MEMBER_FILE, dataclasses.asdict(record))


def read_member(member: Path) -> MemberRecord:
    """The record of the learner in `member`. Raises CheckpointError if it cannot be read."""
    path = member / MEMBER_FILE
    try:
        return MemberRecord(**read_json(path))
    except (OSError, ValueError, TypeError) as error:
        raise CheckpointError(
            f"{path} cannot be read as a learner of a league ({error!r}): bring the file back, or "
            "start a new league"
        ) from error
