"""Every combination of body, memory, head, loss and exploration learns, or is refused."""

import itertools

import pytest
from tensordict import TensorDict

from marl_cair.policies import HEADS, MEMORIES, NETWORKS, NO_MEMORY
from marl_cair.policies.config import NAF, NO_CELL
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training import trainer
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.newest_steps import DoubleValues, make_rows
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import CollectorSettings, GameSettings
from marl_cair.training.settings.exploration import EXPLORATIONS, ExplorationSettings
from marl_cair.training.settings.learner import LOSSES, LearnerSettings
from tests.training.runs import small

NUM_ROWS, NUM_UPDATES, RATE = 32, 25, 5e-3
NUM_SLOW_UPDATES, RATE_OF_NAF = 200, 3e-3  # NAF's hill is flat at first; noisy errors vary
# For `naf`, as the test game's actions point at no cells: the best action is far from the worst.
CELLS, KINDS = (NO_CELL, 27, 0, 63), (1, 1, 0, 2)
CHOICES = NETWORKS, (NO_MEMORY, *MEMORIES), HEADS, LOSSES, EXPLORATIONS
# What a refusal says, and the combinations that it is for.
REFUSALS = (
    (
        "values of 'thesis_capsule' are lengths of its capsules",
        lambda body, memory, head, loss, kind: (body == "thesis_capsule") != (head == "length"),
    ),
    (
        "body 'thesis_capsule' has capsules for features",
        lambda body, memory, head, loss, kind: (
            body == "thesis_capsule" and (memory != NO_MEMORY or kind == "noisy")
        ),
    ),
    (
        "quantiles need this loss, and this loss needs quantiles",
        lambda body, memory, head, loss, kind: (head == "quantile") != (loss == "quantile"),
    ),
    (
        "this loss reads single transitions",
        lambda body, memory, head, loss, kind: memory != NO_MEMORY and loss == "quantile",
    ),
    (
        "policy.head is 'naf', but representation 'vector' (4,) does not show the 8 x 8 cells",
        lambda body, memory, head, loss, kind: body == "mlp" and head == NAF,
    ),
)


def make(folder, body, memory, head, loss, kind):
    """A run on the test game; raises ValueError for a combination that is refused."""
    is_thesis, has_memory = body == "thesis_capsule", memory != NO_MEMORY
    policy = QNetworkConfig(
        body=body,
        memory=memory,
        head=head,
        hidden_width=None if is_thesis else 16,
        memory_width=8 if has_memory else None,
        norm="layer" if loss == "pqn" and not is_thesis else "none",
        num_quantiles=4 if head == "quantile" else None,
        noisy=kind == "noisy",
        action_cells=CELLS if head == NAF else (),
        action_kinds=KINDS if head == NAF else (),
    )
    seen = "vector" if body == "mlp" else "planes"
    return small(
        folder,
        "duel",
        {"idle": 1.0},  # so that the own action decides the reward
        policy=policy,
        game=GameSettings("last_standing", "duel", representation=seen, reward="sparse"),
        learner=LearnerSettings(
            algorithm=loss,
            batch_size=NUM_ROWS,
            n_steps=1,
            gamma=0.5,
            learning_rate=RATE_OF_NAF if head == NAF else RATE,
        ),
        collector=CollectorSettings(num_worlds=4, steps_per_batch=NUM_ROWS // 4),
        exploration=ExplorationSettings(kind),
    )


def find_reasons(combination):
    return [reason for reason, holds in REFUSALS if holds(*combination)]


ALL = list(itertools.product(*CHOICES))
LEARNING = [combination for combination in ALL if not find_reasons(combination)]


def find_pairs(combination):
    return set(itertools.combinations(enumerate(combination), 2))


def cover_pairs(combinations):
    """Some of them, in which each pair of choices that fit occurs."""
    left, chosen = set().union(*map(find_pairs, combinations)), []
    while left:
        chosen.append(max(combinations, key=lambda one: len(find_pairs(one) & left)))
        left -= find_pairs(chosen[-1])
    return chosen


QUICK = cover_pairs(LEARNING)


@pytest.mark.usefixtures("test_game")
def test_all_others_are_refused_with_the_reason(tmp_path):
    for combination in ALL:
        reasons = find_reasons(combination)
        if not reasons:
            make(tmp_path, *combination)
            continue
        with pytest.raises(ValueError, match="set|use|take") as refused:
            TrainingRun(make(tmp_path, *combination))
        assert any(reason in str(refused.value) for reason in reasons), combination


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize(
    "combination",
    [
        pytest.param(one, id="-".join(one), marks=() if one in QUICK else pytest.mark.slow)
        for one in LEARNING
    ],
)
def test_the_td_error_falls(tmp_path, combination):
    run = TrainingRun(make(tmp_path / "run", *combination))
    try:
        batch = collect(run)
        is_slow = NAF in combination or "noisy" in combination
        num_updates = NUM_SLOW_UPDATES if is_slow else NUM_UPDATES
        num_averaged = num_updates // 8
        updates = [run.learner.update(batch.clone()) for _ in range(num_updates)]
        errors = [float(one["td_error/real"]) for one in updates]
        first, last = (sum(part) for part in (errors[:num_averaged], errors[-num_averaged:]))
        assert last < 0.8 * first, errors
    finally:
        run.close()


def collect(run) -> TensorDict:
    """A batch of the game's steps, as the loss reads them."""
    if not run.learner.loss.LEARNS_FROM_REPLAY:
        return make_rows(
            next(iter(run.collector)), DoubleValues(run.actor, run.newest), run.config.learner
        )
    steps = trainer.iterate(run, Timers())
    while run.replay.real.num_sampleable < NUM_ROWS:
        next(steps)
    return run.replay.sample()
