"""`run_slice`: one learner of a league trains for a while; it shares nothing but two folders.

A learner's folder holds `member.json` (who it is, and how often it has begun anew), and one
training run for each generation, `000`, `001`, ...; only the newest has a state to go on from.
"""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass
from pathlib import Path

from marl_cair.checkpoint import LIVE_FOLDER, CheckpointError
from marl_cair.files import write_json
from marl_cair.league.agents.allowed_code import AllowCode
from marl_cair.self_play.shared_folder import LeagueSeat
from marl_cair.stored import read_json
from marl_cair.training.generators import take_over_generator
from marl_cair.training.initial_network import begin_as, can_begin_as
from marl_cair.training.population.league_settings import derive_seed
from marl_cair.training.run import RESUME_FOLDER
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.config_file import CONFIG_FILE, load_config, save_config
from marl_cair.training.trainer import train

MEMBER_FILE = "member.json"


@dataclass(frozen=True)
class MemberRecord:
    """What `member.json` says.

    Attributes:
        name, role: of the learner.
        mains: the names of all main agents.
        reset_chance: that it begins anew once it has frozen a player.
        begins_as_main: whether it then has a main agent's network, and not a new one.
        league_seed, place: seeds derive from them; place is in the order of turns.
        generation: how often it has begun anew.
        frames_before: decisions of all generations before.
    """

    name: str
    role: str
    mains: tuple[str, ...]
    reset_chance: float
    begins_as_main: bool
    league_seed: int
    place: int
    generation: int = 0
    frames_before: int = 0


@dataclass(frozen=True)
class Budget:
    """How far a slice goes.

    Attributes:
        frames: decisions of the learner in all when it ends, so that a slice that is run once more
            after it was cut short does what was left, and one that was done trains no further.
        total_frames: decisions of the learner in all when the league ends, over which a learning
            rate that falls is spread.
        max_minutes: after which it is cut short; None: no limit.
    """

    frames: int
    total_frames: int
    max_minutes: float | None = None


@dataclass(frozen=True)
class SliceResult:
    """Where the learner stands."""

    frames: int  # decisions of all its generations
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

    Killed at any moment, the same call again goes on from the learner's last state, and gives the
    same bits as if nothing had happened, as long as no other learner has trained in between.

    allow_code: which code that the learner's `config.yaml` names may run; see
    `league.agents.allowed_code`.

    Raises:
        CodeNotAllowedError: it names agents that are code, and they are not allowed.
        CheckpointError: `member` holds no learner, or a damaged one.
        As `TrainingRun`.
    """
    last_row: dict[str, float] = {}
    while True:
        record = read_member(member)
        goal = budget.frames - record.frames_before
        if goal <= 0:
            return SliceResult(record.frames_before, record.generation, True, False, last_row)
        config = dataclasses.replace(
            _begin(member, shared, record, allow_code),
            out=str(member / f"{record.generation:03d}"),
            seed=derive_seed(record.league_seed, record.place, record.generation),
            total_frames=budget.total_frames - record.frames_before,
            max_minutes=budget.max_minutes,
        )
        seat = LeagueSeat(
            shared,
            record.name,
            record.role,
            record.generation,
            tuple(record.mains),
            record.reset_chance,
            record.frames_before,
        )
        result = train(config, True, show_progress, seat=seat, until_frames=goal)
        last_row = result.last_row or last_row
        frames = record.frames_before + result.frames
        if result.is_over:
            _begin_anew(member, record, frames)
        if not result.is_over or result.was_interrupted:
            return SliceResult(
                frames,
                record.generation,
                frames >= budget.frames,
                result.was_interrupted,
                last_row,
            )


def _begin(member: Path, shared: Path, record: MemberRecord, allow_code: AllowCode) -> TrainConfig:
    """The settings of the learner's generation; what it begins with is decided once."""
    config, run = load_config(member, allow_code), member / f"{record.generation:03d}"
    main = str(shared / LIVE_FOLDER / record.mains[record.generation % len(record.mains)])
    if (run / CONFIG_FILE).is_file():
        begins_as_main = load_config(run, allow_code).initial_agent != config.initial_agent
    else:
        begins_as_main = record.begins_as_main and can_begin_as(main)
    if record.generation > 0:
        config = take_over_generator(config, member / f"{record.generation - 1:03d}")
    return begin_as(main, config) if begins_as_main else config


def _begin_anew(member: Path, record: MemberRecord, frames: int) -> None:
    following = record.generation + 1
    save_member(member, dataclasses.replace(record, generation=following, frames_before=frames))
    # Only now: until the record names the next generation, the state says that this one is over.
    shutil.rmtree(member / f"{record.generation:03d}" / RESUME_FOLDER, ignore_errors=True)


def make_member(member: Path, record: MemberRecord, config: TrainConfig) -> None:
    """Prepare a learner's folder; one that is there stays as it is."""
    if not (member / MEMBER_FILE).is_file():
        member.mkdir(parents=True, exist_ok=True)
        save_config(dataclasses.replace(config, out=str(member)))
        save_member(member, record)


def save_member(member: Path, record: MemberRecord) -> None:
    """Write `member.json`, whole or not at all."""
    write_json(member / MEMBER_FILE, dataclasses.asdict(record))


def read_member(member: Path) -> MemberRecord:
    """Who the learner in `member` is. Raises CheckpointError where that cannot be read."""
    path = member / MEMBER_FILE
    try:
        return MemberRecord(**read_json(path))
    except (OSError, ValueError, TypeError) as error:
        raise CheckpointError(
            f"{path} cannot be read as a learner of a league ({error!r}): bring the file back, or "
            "start a new league"
        ) from error
