"""Settings of the networks' updates: Q-learning, and neural fictitious self-play."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from marl_cair.lookup import LazyTable, check_name
from marl_cair.policies.config import QUANTILE
from marl_cair.replay import MOST_STEPS
from marl_cair.training.settings.checks import (
    Allowed,
    Count,
    NonNegative,
    Positive,
    Share,
    ShareAboveZero,
    ShareBelowOne,
    check_fields,
    require,
)

Steps = Annotated[int, Allowed(lambda n: 1 <= n <= MOST_STEPS, f"1..{MOST_STEPS}")]
TARGET_UPDATES = ("soft", "hard")
HUBER, _SQUARED = ERRORS = ("smooth_l1", "l2")
OPTIMIZERS = ("adam", "radam", "rmsprop", "sgd")
DQN = "dqn"
_OF_TARGETS = ("double", "target", "target_tau", "target_every_updates")
OF_REPLAY = ("batch_size", "frames_per_update", *_OF_TARGETS)
OF_NEWEST_STEPS = ("q_lambda", "traces", "action_gap", "epochs", "minibatches")
AVERAGED, NEWEST = BEHAVIOURS = ("averaged", "newest")
WATKINS, PENG = TRACES = ("watkins", "peng")
LOSSES: LazyTable[Any] = LazyTable(
    {
        DQN: "marl_cair.training.losses:DqnLoss",
        "pqn": "marl_cair.training.losses:PqnLoss",
        QUANTILE: "marl_cair.training.losses:QuantileLoss",
    },
    group="marl_cair.losses",
    base="marl_cair.training.losses:Loss",
    flags=("LEARNS_FROM_REPLAY", "HAS_TARGET_NETWORK", "READS_SEQUENCES", "TAKES_ACTION_SHAPES"),
)
AVERAGE, GREEDY = PLAYED = ("average", "greedy")


@dataclass(frozen=True)
class LearnerSettings:
    """The Q-learning update."""

    algorithm: str = DQN  # from a replay buffer: dqn, quantile; from the newest steps: pqn
    batch_size: Count = 128  # transitions, generated ones included (dqn)
    frames_per_update: Count = 64  # frames collected for each update (dqn)
    q_lambda: Share = 0.9  # share of longer returns in a target, per step (pqn)
    traces: str = WATKINS  # longer returns end before a random action (watkins) or not (peng)
    action_gap: ShareBelowOne = 0.0  # share of the gap to the best value, off targets (pqn)
    epochs: Count = 2  # times that each collected batch is learned from (pqn)
    minibatches: Count = 4  # updates of an epoch (pqn)
    optimizer: str = "adam"  # adam, radam, rmsprop or sgd
    optimizer_epsilon: Positive = 1e-8  # of adam, radam, rmsprop: damps steps of small gradients
    learning_rate: Positive = 5e-4  # of the optimizer
    learning_rate_end: NonNegative | None = None  # at total_frames, falling linearly; None: same
    gamma: Share = 0.99  # discount per step
    n_steps: Steps = 8  # whose rewards come before the target's value (dqn; generated rows)
    double: bool = True  # the online network chooses the action that the target network values
    loss: str = HUBER  # of the TD error: smooth_l1 or l2
    target: str = "soft"  # how the target network follows: soft (each update), hard (copies)
    target_tau: ShareAboveZero = 0.01  # share of the online weights taken at each update (soft)
    target_every_updates: Count = 500  # updates between two copies (hard)
    average_decay: ShareBelowOne = 0.995  # of the averaged weights per update; 0: newest weights
    behaviour: str = AVERAGED  # weights that collect: averaged, as rated, or newest
    max_grad_norm: Positive = 10.0  # longer gradients are scaled down to it
    autocast: bool = False  # bodies of networks learn in bfloat16: quicker where processors have it
    reward_scale: Positive = 1.0  # rewards are multiplied by it before they are stored

    def __post_init__(self) -> None:
        check_fields(self, "learner.")
        check_name("learner.target", self.target, TARGET_UPDATES)
        check_name("learner.loss", self.loss, ERRORS)
        check_name("learner.algorithm", self.algorithm, LOSSES)
        check_name("learner.optimizer", self.optimizer, OPTIMIZERS)
        allowed = f"{HUBER} with learner.algorithm={QUANTILE}: squared errors estimate no quantiles"
        require(
            self.algorithm != QUANTILE or self.loss == HUBER, "learner.loss", self.loss, allowed
        )
        for name in OF_NEWEST_STEPS if self.algorithm in (DQN, QUANTILE) else ():
            value, default = getattr(self, name), getattr(LearnerSettings, name)
            allowed = f"{default} with learner.algorithm={self.algorithm}: it is of pqn alone"
            require(value == default, f"learner.{name}", value, allowed)
        check_name("learner.traces", self.traces, TRACES)
        check_name("learner.behaviour", self.behaviour, BEHAVIOURS)

    @property
    def learns_from_replay(self) -> bool:
        """Whether updates sample transitions from the replay buffer."""
        return bool(LOSSES[self.algorithm].LEARNS_FROM_REPLAY)

    def learning_rate_at(self, done: float) -> float:
        """Linear from start to end over the share `done` of the run, 0..1."""
        end = self.learning_rate if self.learning_rate_end is None else self.learning_rate_end
        return interpolate(self.learning_rate, end, done)


@dataclass(frozen=True)
class NfspSettings:
    """Neural fictitious self-play (Heinrich and Silver 2016): a second network learns the average
    over time of the Q-network's actions.

    In games of hidden or simultaneous moves every greedy policy has a best response that beats it;
    the average policy approaches an equilibrium. The paper uses `opponent.mixture={latest: 1}`.
    """

    enabled: bool = False  # whether there is an average policy
    eta: ShareAboveZero = 0.1  # share of games, for each team, that the Q-network plays
    played: str = AVERAGE  # what is rated, kept and frozen for the pool: average, or greedy (Q)
    capacity_rows: int = 100_000  # of the reservoir: an even sample of all decisions of Q
    min_rows: Count = 1_000  # rows; the average policy begins to learn with these
    batch_size: Count = 128  # rows of its own update
    frames_per_update: Count = 64  # frames collected for each of its updates
    learning_rate: Positive = 1e-3  # of its Adam

    def __post_init__(self) -> None:
        check_fields(self, "nfsp.")
        check_name("nfsp.played", self.played, PLAYED)
        rows, least = self.capacity_rows, self.min_rows
        require(rows >= least, "nfsp.capacity_rows", rows, f"{least} (nfsp.min_rows) or more")


def interpolate(start: float, end: float, done: float) -> float:
    """Linear from `start` to `end`, which is kept where `done` is above 1."""
    return start + min(1.0, done) * (end - start)
