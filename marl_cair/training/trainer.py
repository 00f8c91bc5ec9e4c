"""The training loop: collect, store, learn, generate, snapshot, evaluate, save."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

import torch
from tensordict import TensorDict, TensorDictBase
from tqdm import tqdm

from marl_cair.checkpoint import LATEST_FOLDER, save_tensors
from marl_cair.games.players.weak_bot import split_name
from marl_cair.interrupts import interrupts_noted
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.arena import Load, torch_threads
from marl_cair.outside import OutsideCodeError, find_line
from marl_cair.policies.saved_weights import require_finite
from marl_cair.self_play.shared_folder import LeagueSeat
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.collecting.rollout import make_rollout
from marl_cair.training.due import count_due, is_due
from marl_cair.training.evaluation import evaluate
from marl_cair.training.generating.use import (
    begin_offline,
    observe_steps,
    show_replay,
    use_generator,
)
from marl_cair.training.learner import DivergedError
from marl_cair.training.newest_steps import DoubleValues, iterate_batches, make_rows
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings import config_file
from marl_cair.training.settings.config import ENDLESS_FRAMES, GAMES_FOLDER, TrainConfig
from marl_cair.training.settings.learner import LOSSES

DIVERGED_FILE = "diverged_batch.pt"
LOG_EVERY_FRAMES = 10_000


@dataclass(frozen=True)
class TrainResult:
    """The state of a run."""

    folder: Path
    frames: int
    updates: int
    was_interrupted: bool
    last_row: dict[str, float]
    is_over: bool = False  # in a league: the learner has frozen a player and is reset
    reached_score: bool = False  # `stop_score` has ended it
    processor_seconds: float = 0.0  # of collecting and learning, over all sittings


def train(
    config: TrainConfig,
    resume: bool = False,
    show_progress: bool = True,
    seat: LeagueSeat | None = None,
    until_frames: int | None = None,
    load: Load = load_agent,
    watch: Callable[[TrainingRun], bool] = lambda run: True,
    resume_with: str = "",
) -> TrainResult:
    """Train until `config.total_frames` steps, `config.max_minutes`, `config.stop_score`, or an
    interrupt; in a league, at `seat`, also until the learner is to be reset.

    `until_frames` ends this call sooner; schedules, such as that of the learning rate, are still
    spread over `config.total_frames`.

    An interrupt (`interrupts.SIGNALS`) ends the current iteration, saves everything and returns; a
    second one stops at once. `watch` gets the run before the first iteration and after each;
    training ends where it returns False. The configuration is written to the run's folder, from
    which a later call can resume. `load` gets the agents of `config.opponent`: by default, code
    among them runs in this process, without a time limit.

    `resume_with` is the command line that resumes the run. With it an error gets a note that says
    what is saved; a run with code from outside is saved first if the steps of its round are
    stored: resumed, it leaves out what else was due in that round.

    Raises: as `TrainingRun`.
    """
    with (
        torch_threads(config.torch_threads),
        torch.random.fork_rng(devices=[]),
        closing(TrainingRun(config, resume, seat, load)) as run,
    ):
        run.log.prints = show_progress
        if resume and resume_with and run.saved_frames is None:
            run.log.note(0, "resume", "no state was saved before: the run begins at frame 0")
        result = _train(run, show_progress, until_frames, watch, resume_with)
        _note_if_untrained(run)
        return result


def _train(
    run: TrainingRun,
    show_progress: bool,
    until_frames: int | None,
    watch: Callable[[TrainingRun], bool],
    resume_with: str,
) -> TrainResult:
    config = run.config
    if run.spec.num_teams == 1:
        text = f"{config.game.scenario} has no rivals, so opponent.* is not used"
        run.log.note(run.frames, "opponents", text)
    timers, whole, is_last = Timers(), config.total_frames, False
    goal = whole if until_frames is None else min(whole, until_frames)
    deadline = time.monotonic() + 60 * (config.max_minutes or math.inf)
    bar = tqdm(
        total=goal if goal < ENDLESS_FRAMES else None,
        initial=run.frames,
        unit=" frames",
        disable=not show_progress,
        unit_scale=True,
        smoothing=0.05,
    )
    last_row: dict[str, float] = {}
    with bar, interrupts_noted(tqdm.write) as interrupted:
        steps = iterate(run, timers)
        goes_on = watch(run)
        while goes_on and run.frames < goal and not (run.book.is_over or _has_reached_score(run)):
            if interrupted.is_set() or is_last or time.monotonic() > deadline:
                break
            before = run.frames
            try:
                next(steps)
                goes_on = watch(run)
                is_last = run.frames >= whole or time.monotonic() > deadline
                if row := _report(run, before, timers, is_last):
                    last_row = row
                    bar.set_postfix_str(_summarise(row))
                bar.update(run.frames - before)
                if is_due(before, run.frames, config.checkpoint.every_frames):
                    with timers.measure("save"):
                        run.save_agent()
                        run.save_state()
            except Exception as error:
                if resume_with:
                    error.add_note(_save_after(error, run, before, resume_with))
                raise
        # Else the frames since the last row would be missing; what is measured is in the state too.
        if run.frames > run.log.frames and not interrupted.is_set():
            last_row = _write_row(run, {}, timers)
        run.save_agent()
        run.save_state()
    is_over = run.book.is_over
    if is_over or run.frames >= goal:  # not within a slice
        run.book.publish(run.rated_network, run.describe_agent())
    ends = interrupted.is_set(), last_row, is_over, _has_reached_score(run), run.processor_seconds
    return TrainResult(run.folder, run.frames, run.learner.updates, *ends)


def _note_if_untrained(run: TrainingRun) -> None:
    if run.frames and not run.learner.updates and not run.is_offline:
        least, held = run.config.replay.min_transitions, len(run.replay.real)
        text = f"nothing was learned: replay holds {held:,} transitions, learning starts at"
        run.log.note(run.frames, "learning", f"{text} {least:,} (replay.min_transitions)")


def _save_after(error: Exception, run: TrainingRun, before: int, command: str) -> str:
    """Save a run with code from outside whose round failed, if its steps were stored: else its
    games are ahead of its replay. Returns what is saved, in words.
    """
    has_code = config_file.names_code(run.config)
    is_diverged, failed = isinstance(error, DivergedError), ""
    if has_code and run.frames > before and not is_diverged:
        try:
            run.learner.require_finite()
            require_finite(run.rated_network.state_dict(), "")
            run.save_state()
            run.save_agent()
        except Exception as fault:  # noqa: BLE001  # it must not hide the error
            failed = f" (saving more now failed: {fault})"
    where = f"frame {run.frames:,}"
    if has_code and not isinstance(error, OutsideCodeError):  # which names the place
        where += find_line(error)
    is_begun = run.saved_frames is not None
    state = f"the state of frame {run.saved_frames:,} is saved" if is_begun else "no state is saved"
    then = f"; {command} {'goes on from it' if is_begun else 'begins again'}"
    if is_diverged and not has_code:
        then = ""  # the same would follow
    return f"{where}: {state}{failed}{then}"


def iterate(run: TrainingRun, timers: Timers) -> Iterator[None]:
    """Collect, store, learn, generate and keep snapshots once per `next`."""
    if run.is_offline:
        yield from _iterate_offline(run, timers)
    if run.frames == 0 and run.config.demonstration.replays is not None:
        show_replay(run)
    batches, snapshot_every = iter(run.collector), run.config.opponent.snapshot_every_frames
    while True:
        before, start = run.frames, time.process_time()
        with timers.measure("collect"):
            data = next(batches)
        _store(run, data, timers)
        with timers.measure("learn"):
            _learn(run, before, data)
        if _has_enough(run):
            with timers.measure("generate"):
                use_generator(run, before)
        if is_due(before, run.frames, snapshot_every) or run.book.beats_the_best(run.frames):
            run.add_snapshot()
        run.processor_seconds += time.process_time() - start
        yield


def _iterate_offline(run: TrainingRun, timers: Timers) -> Iterator[None]:
    """Learn and generate once per `next`, as `iterate` does; nothing is played."""
    settings = run.config.collector
    start = time.process_time()
    with timers.measure("generate"):
        begin_offline(run)
    run.processor_seconds += time.process_time() - start
    while True:
        before, start = run.frames, time.process_time()
        run.frames += settings.num_worlds * settings.steps_per_batch
        with timers.measure("learn"):
            _learn_from_replay(run, before)
        with timers.measure("generate"):
            use_generator(run, before)
        run.processor_seconds += time.process_time() - start
        yield


def _store(run: TrainingRun, data: TensorDictBase, timers: Timers) -> None:
    """Store the learner's steps; pass those whose next state is known now to the generator: the
    newest of each stream waits for the next batch.
    """
    with timers.measure("store"):
        if run.generator or run.learner.loss.LEARNS_FROM_REPLAY:
            num_others = run.transition_spec.num_others
            rollout = make_rollout(data, run.config.learner.reward_scale, num_others)
            waiting = run.replay.real.storage.open_slots()
            slots = run.replay.real.extend_rollout(rollout)
        if run.average_policy:
            run.average_policy.remember(data)
    run.frames += data.numel()
    if run.generator:
        with timers.measure("generate"):
            kept = waiting[~torch.isin(waiting, slots)]  # the others were overwritten
            observe_steps(run, torch.cat([kept, slots]))


def _learn(run: TrainingRun, before: int, data: TensorDictBase) -> None:
    if run.average_policy:
        num_updates = count_due(before, run.frames, run.config.nfsp.frames_per_update)
        for values in run.average_policy.learn(num_updates):
            if not math.isfinite(float(values["average/loss"])):
                raise DivergedError(f"frame {run.frames}: the average policy's loss is no number")
            run.means.add(values)
    settings, done = run.config.learner, run.frames / run.config.total_frames
    if not run.learner.loss.LEARNS_FROM_REPLAY:
        double = DoubleValues(run.actor, run.newest)
        rows = make_rows(data, double, settings)
        generated = run.replay.sample_generated
        batches = iterate_batches(rows, settings, double, generated, run.shuffling)
        for batch in batches if len(rows) else ():
            _update(run, batch, done)
        return
    if _has_enough(run):
        _learn_from_replay(run, before)


def _learn_from_replay(run: TrainingRun, before: int) -> None:
    done = run.frames / run.config.total_frames
    if not run.replay.can_sample:
        return
    for _ in range(count_due(before, run.frames, run.config.learner.frames_per_update)):
        batch = run.replay.sample()
        _update(run, batch, done)
        run.replay.note_errors(batch, done)


def _update(run: TrainingRun, batch: TensorDict, done: float) -> None:
    """One update. Raises DivergedError, with the batch saved to the run's folder."""
    try:
        run.means.add(run.learner.update(batch, done))
    except DivergedError as error:
        path = run.folder / DIVERGED_FILE
        with suppress(OSError):  # a full disk must not hide the error
            save_tensors(batch.flatten_keys(".").to_dict(), path)
        latest = run.folder / LATEST_FOLDER
        more = f"; initial_agent={latest} continues from the last saved agent"
        own = run.config.learner.algorithm
        other = f", or with another {own}" if LOSSES.is_outside(own) else ""
        raise DivergedError(
            f"training has diverged at frame {run.frames}: {error}; the batch is in {path}. Start "
            "in another folder with a smaller learner.learning_rate or learner.max_grad_norm"
            f"{other}{more if latest.is_dir() else ''}"
        ) from error


def _has_enough(run: TrainingRun) -> bool:
    """Whether learning can start; a full replay suffices, though its newest steps start no
    transition yet.
    """
    real, settings = run.replay.real, run.config.replay
    is_full = len(real) >= settings.capacity_transitions and real.num_sampleable > 0
    return is_full or real.num_sampleable >= settings.min_transitions


def _report(run: TrainingRun, before: int, timers: Timers, is_last: bool) -> dict[str, float]:
    """Evaluate when due and at the end, and write a row of the log; empty between rows."""
    row: dict[str, float] = {}
    every = run.config.evaluation.every_frames
    if is_due(before, run.frames, every) or (is_last and run.frames >= every):
        with timers.measure("evaluate"):
            row |= _evaluate(run)
    if not row and not is_due(before, run.frames, LOG_EVERY_FRAMES):
        return {}
    return _write_row(run, row, timers)


def _write_row(run: TrainingRun, row: dict[str, float], timers: Timers) -> dict[str, float]:
    """Add all measurements since the last row, and log them."""
    row |= run.statistics.report(run.book.name, run.spec.action_group_names)
    row |= run.book.report(run.frames)
    row |= run.means.report() | timers.report(run.frames - run.log.frames)
    row |= {"epsilon": run.router.epsilon, "updates": float(run.learner.updates)}
    row["processor_seconds"] = run.processor_seconds
    row["replay/transitions"] = float(len(run.replay.real))
    if run.generator is not None:
        row["generator/failures"] = float(run.generator_failures)
    row["replay/generated"] = float(len(run.replay.generated))
    run.log.write(run.frames, row)
    return row


def _evaluate(run: TrainingRun) -> dict[str, float]:
    record = run.folder / GAMES_FOLDER if run.config.evaluation.record else None
    scores, row = evaluate(run.rated, run.game, run.config, run.evaluation_seed, record)
    run.save_agent()
    if scores:
        score = sum(scores) / len(scores)
        run.note_score(score)
        if _may_stop(run, score):
            # Again in other games: the best of many evaluations is partly luck.
            fresh, _ = evaluate(run.rated, run.game, run.config, run.evaluation_seed + run.frames)
            run.confirmed_score = row["confirmed_score"] = sum(fresh) / len(fresh)
    return row


def _has_reached_score(run: TrainingRun) -> bool:
    goal = run.config.stop_score
    return goal is not None and run.confirmed_score >= goal


def _may_stop(run: TrainingRun, score: float) -> bool:
    """Whether a score ends the run; not while exploration falls, as early scores vary widely."""
    goal, is_exploring = run.config.stop_score, run.frames < run.config.exploration.anneal_frames
    return goal is not None and score >= goal and (run.is_offline or not is_exploring)


def _summarise(row: dict[str, float]) -> str:
    shown = [f"loss {row['loss/all']:.4f}"] if "loss/all" in row else []
    training: list[str] = []
    for name, value in row.items():
        kind, _, player = name.partition("/")
        is_weak = split_name(player)[1] < 1  # there may be dozens
        if kind in ("win_rate", "collect_win_rate") and "/" not in player and not is_weak:
            (shown if kind == "win_rate" else training).append(f"{player} {value:.0%}")
        if kind == "return" and "/" not in player:
            shown.append(f"return of {player} {value:.3g}")
    played = [f"in training: {', '.join(training)}"] if training else []
    return "; ".join([", ".join(shown), *played] if shown else played)
