"""Trains, evaluates and uses the generator of a run; its failures never stop the training.

A failure is an exception of the generator, or a number of it that is not finite or far too large.
The generator is then switched off: all its rows are dropped, batches are all real, and a new one
takes its place, with its first weights, which is trained from the next evaluation on.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.files import write_atomically
from marl_cair.generative.generator import Generator
from marl_cair.generative.rollouts import Rollouts, imagine_sequences
from marl_cair.policies.actor import PolicyActor, masked_argmax
from marl_cair.replay.dataset import load_dataset
from marl_cair.replay.transition import NEXT_OBSERVATION
from marl_cair.training.collecting.filling import complete_rows
from marl_cair.training.due import count_due, is_due
from marl_cair.training.generating.generators import UNCHECKED
from marl_cair.training.generating.picture import NUM_DRAWN, PICTURE_FILE, draw_predictions
from marl_cair.training.run import TrainingRun

MOST_RETRIES = 3  # then the generator stays off
MOST_LOSS = 1e6  # per row: a frame of 84 x 84 that changes wholly costs 150,000
FAILURE_FILE = "generator_failure.txt"  # in a run's folder: the last failure
OBSERVED_ROWS = 1_024  # at a time


class GeneratorFailedError(ValueError):
    """The generator has made a number that is not finite, or far too large."""


def observe_steps(run: TrainingRun, slots: Tensor) -> None:
    """Pass the real steps in `slots` of the replay, if their next state is known, to the generator,
    if there is one and it is on.
    """
    with _attempt(run, "observing real transitions"):
        if run.generator is not None and run.generator_is_on:
            run.generator.observe(run.replay.real.read_steps(slots))


def use_generator(run: TrainingRun, before: int) -> None:
    """Train the generator; at intervals evaluate it on held-out rows, and refill if it passes.

    before: the steps of the run before this round.
    """
    settings, generator = run.config.generator, run.generator
    is_evaluated = is_due(before, run.frames, settings.evaluate_every_frames)
    if generator is None:
        return
    if not run.generator_is_on and is_evaluated and run.generator_failures <= MOST_RETRIES:
        _begin_again(run)
    if not run.generator_is_on:
        return
    every = settings.frames_per_update
    if run.gate_is_open:
        every = max(every, settings.open_frames_per_update)
    with _attempt(run, "its update"):
        for _ in range(count_due(before, run.frames, every)):
            _learn(run, generator)
    num_refills = count_due(before, run.frames, settings.refill_every_frames)
    if is_evaluated and run.generator_is_on:
        with _attempt(run, "its evaluation"):
            _evaluate(run, generator)
        num_refills = max(num_refills, not len(run.replay.generated))
    run.replay.generated_open = run.may_use_generated
    if num_refills and run.may_use_generated:
        with _attempt(run, "generating"):
            num_rows = num_refills * settings.rows_per_refill
            _refill(run, generator, min(num_rows, run.replay.generated.capacity))


def begin_offline(run: TrainingRun) -> None:
    """Train the generator on the data set that fills replay, evaluate it, and generate as many
    transitions as are kept, before the learner's first update. A run that was saved without its
    replay generates them again.
    """
    generator, settings = run.generator, run.config.generator
    if generator is None:
        return
    is_new = run.frames == 0
    if is_new:
        _begin_again(run)
    if is_new and run.generator_is_on:
        with _attempt(run, "its update"):
            for _ in range(run.config.offline.generator_updates):
                _learn(run, generator)
    if is_new and run.generator_is_on:
        with _attempt(run, "its evaluation"):
            _evaluate(run, generator)
    run.replay.generated_open = run.may_use_generated
    if run.may_use_generated and (is_new or not run.config.checkpoint.include_replay):
        with _attempt(run, "generating"):
            for _ in range(math.ceil(run.replay.generated.capacity / settings.rows_per_refill)):
                _refill(run, generator, settings.rows_per_refill)


@contextmanager
def _attempt(run: TrainingRun, what: str) -> Iterator[None]:
    """Switch the generator off where the block fails."""
    try:
        yield
    except OSError:
        raise  # a full disk is not the generator's failure
    except Exception as error:  # noqa: BLE001  # it may be from outside
        _switch_off(run, what, error)


def _switch_off(run: TrainingRun, what: str, error: Exception) -> None:
    run.generator_failures += 1
    run.generator_is_on = run.gate_is_open = run.replay.generated_open = False
    run.replay.generated.clear()
    run.make_generator()  # the next one: a state with weights that are not finite cannot be loaded
    write_atomically(run.folder / FAILURE_FILE, "".join(traceback.format_exception(error)))
    then = "a new one is tried at the next evaluation"
    if run.generator_failures > MOST_RETRIES:
        then = f"it stays off after {run.generator_failures} failures"
    run.log.note(
        run.frames,
        "gate",
        f"the generator is off, batches are all real: {what} has failed ({error}); {then}. All of "
        f"the failure: {run.folder / FAILURE_FILE}",
    )
    run.means.add({"gate/passed": 0.0})


def _begin_again(run: TrainingRun) -> None:
    """Switch the new generator on, and show it all of replay: it has seen nothing yet."""
    run.generator_is_on = True
    show_replay(run)
    if run.is_offline and run.generator is not None and run.generator_is_on:
        with _attempt(run, "observing held-out transitions"):
            _hold_out(run, run.generator)


def show_replay(run: TrainingRun) -> None:
    """Pass all real steps of the replay to the generator, if there is one and it is on."""
    for slots in torch.split(run.replay.real.storage.step_slots(), OBSERVED_ROWS):
        observe_steps(run, slots)


def _hold_out(run: TrainingRun, generator: Generator) -> None:
    rows = load_dataset(run.config.offline.dataset or "").heldout
    for places in torch.split(torch.arange(len(rows)), OBSERVED_ROWS):
        generator.hold_out(complete_rows(rows, places, run.config.learner.reward_scale))


def _learn(run: TrainingRun, generator: Generator) -> None:
    losses = generator.update(run.replay.real.sample_steps(run.config.generator.batch_size))
    _require_finite("loss", losses, MOST_LOSS)
    run.means.add({f"generator/{name}": value for name, value in losses.items()})


def _require_finite(what: str, numbers: Mapping[str, float], most: float = math.inf) -> None:
    for name, value in numbers.items():
        if name != UNCHECKED and not (math.isfinite(value) and abs(value) <= most):
            raise GeneratorFailedError(f"the {what} {name!r} is {value}")


def _evaluate(run: TrainingRun, generator: Generator) -> None:
    report = generator.evaluate()
    _require_finite("metric", report.metrics)
    was_open, run.gate_is_open = run.gate_is_open, report.passed
    if not (report.passed or run.is_offline):
        run.replay.generated.clear()  # else they are used again, older still, when it opens again
    values = {f"gate/{name}": value for name, value in report.metrics.items()}
    run.means.add({"gate/passed": float(report.passed), **values})
    reasons = "; ".join(report.reasons)
    without = "nothing is learned" if run.replay.fraction == 1.0 else "batches are all real"
    text = "open" if report.passed else f"shut, {without}: {reasons}"
    if not (was_open and report.passed):
        run.log.note(run.frames, "gate", f"the generator's gate is {text}")
    if report.passed and len(run.seen.shape) == 3:
        slots = run.replay.real.storage.step_slots()
        places = torch.linspace(0, len(slots) - 1, NUM_DRAWN).long()
        rows = run.replay.real.read_steps(slots[places])
        predicted, _ = generator.predict(rows)
        boards = rows["observation"], rows[NEXT_OBSERVATION], predicted[NEXT_OBSERVATION]
        draw_predictions(run.folder / PICTURE_FILE, run.seen, run.spec.static_planes, *boards)


def _refill(run: TrainingRun, generator: Generator, num_rows: int) -> None:
    """Generate up to `num_rows` transitions, or steps of sequences."""
    is_recurrent = run.transition_spec.state_size > 0
    made = (_imagine if is_recurrent else _continue)(run, generator, num_rows)
    if len(made):
        _require_finite_rows(made)
        run.replay.generated.extend(made)
    num_made = made["learned"].sum() if is_recurrent else len(made)
    run.means.add({"generator/generated_rows": float(num_made)})


def _imagine(run: TrainingRun, generator: Generator, num_rows: int) -> TensorDict:
    """Sequences for networks with memory, of about `num_rows` steps, or one."""
    steps, device = run.config.replay.sequence_steps, run.device
    network = run.learner.average

    def unroll(observations: Tensor, state: Tensor, starts: Tensor) -> tuple[Tensor, Tensor]:
        moved = observations.to(device), state.to(device), starts.to(device)
        values, states = network.unroll(*moved)
        return values.cpu(), states.cpu()

    made = imagine_sequences(
        generator,
        unroll,
        run.replay.real.sample_uniformly(max(1, num_rows // steps)),
        min(run.config.generator.branch_steps or steps, steps),
    )
    if len(made):
        run.means.add({"generator/steps": made["learned"].sum(1).float().mean()})
    return made


def _continue(run: TrainingRun, generator: Generator, num_rows: int) -> TensorDict:
    """Transitions that continue real ones, or roll-outs from them."""
    settings, learned = run.config.generator, run.config.learner
    actor = PolicyActor(run.learner.average, "learner", run.config.game.representation)
    num_generated = min(settings.rollout_steps, learned.n_steps)
    rollouts = Rollouts(
        generator,
        lambda observation, mask: masked_argmax(actor.compute_values(observation), mask),
        num_real=learned.n_steps - num_generated,
        num_generated=num_generated,
        gamma=learned.gamma,
    )
    if settings.branch_steps:
        made = rollouts.branch(run.replay.real, num_rows, settings.branch_steps)
    else:
        made = rollouts.generate(run.replay.real, num_rows)
    if len(made):
        run.means.add({"generator/steps": made["steps_to_next_obs"].float().mean()})
    return made


def _require_finite_rows(rows: TensorDict) -> None:
    """A single reward or entry that is not finite would stop the learner."""
    for key in rows.keys(True, True):
        values = rows[key]
        if values.is_floating_point() and not bool(values.isfinite().all()):
            raise GeneratorFailedError(f"generated transitions hold {key!r} that is not finite")
