"""Settings of the Q-learning update."""

from __future__ import annotations

from dataclasses import dataclass

from marl_cair.lookup import find_by_name
from marl_cair.replay import MOST_STEPS
from marl_cair.training.settings.checks import require

TARGET_UPDATES = ("soft", "hard")
LOSSES = ("smooth_l1", "l2")


@dataclass(frozen=True)
class LearnerSettings:
    """The Q-learning update."""

    batch_size: int = 128  # transitions, generated ones included
    frames_per_update: int = 64  # frames collected for each update
    learning_rate: float = 5e-4  # of Adam
    learning_rate_end: float | None = None  # at total_frames, in a straight line; None: the same
    gamma: float = 0.99  # discount per decision
    n_steps: int = 8  # decisions whose rewards are summed before the target network is asked
    double: bool = True  # the online network chooses the action that the target network values
    loss: str = "smooth_l1"  # of the TD error: smooth_l1 or l2
    target: str = "soft"  # how the target network follows: soft (each update), hard (copies)
    target_tau: float = 0.01  # share of the online weights taken over at each update (soft)
    target_every_updates: int = 500  # updates between two copies (hard)
    average_decay: float = 0.995  # of the averaged weights at each update; 0: the newest weights
    max_grad_norm: float = 10.0  # longer gradients are shortened to it
    autocast: bool = False  # bodies of networks learn in bfloat16: quicker on GPUs, CPUs with AMX
    reward_scale: float = 1.0  # rewards are multiplied by it before they are stored

    def learning_rate_at(self, done: float) -> float:
        """Linear from start to end over the share `done` of the run, 0..1."""
        end = self.learning_rate if self.learning_rate_end is None else self.learning_rate_end
        return interpolate(self.learning_rate, end, done)

    def __post_init__(self) -> None:
        for name in ("batch_size", "frames_per_update", "n_steps", "target_every_updates"):
            require(getattr(self, name) >= 1, f"learner.{name}", getattr(self, name), "1 or more")
        require(self.n_steps <= MOST_STEPS, "learner.n_steps", self.n_steps, f"1..{MOST_STEPS}")
        for name in ("learning_rate", "max_grad_norm", "reward_scale"):
            require(getattr(self, name) > 0, f"learner.{name}", getattr(self, name), "above 0")
        end = self.learning_rate_end
        require(end is None or end >= 0, "learner.learning_rate_end", end, "0 or more")
        require(0 <= self.gamma <= 1, "learner.gamma", self.gamma, "in 0..1")
        require(
            0 < self.target_tau <= 1, "learner.target_tau", self.target_tau, "above 0, at most 1"
        )
        decay = self.average_decay
        require(0 <= decay < 1, "learner.average_decay", decay, "0 or more, below 1")
        find_by_name("learner.target", self.target, dict.fromkeys(TARGET_UPDATES))
        find_by_name("learner.loss", self.loss, dict.fromkeys(LOSSES))


def interpolate(start: float, end: float, done: float) -> float:
    """In a straight line from `start` to `end`, which is kept where `done` is above 1."""
    return start + min(1.0, done) * (end - start)
