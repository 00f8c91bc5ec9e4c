"""Losses, samplers and generators from outside: tried on zeros before the run's folder exists."""

import pytest
import torch

from docs.extending.generator import MemoryGenerator
from marl_cair.outside import OutsideCodeError
from marl_cair.policies.config import QNetworkConfig
from marl_cair.policies.q_network import make_q_network
from marl_cair.replay.sampler import Sampler, UniformSampler, draw_uniformly
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.losses import DqnLoss, Loss, LossResult, PqnLoss
from marl_cair.training.outside_trials import try_loss
from marl_cair.training.settings.config import GeneratorSettings
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.settings.replay import ReplaySettings
from tests.training.runs import small, train

HERE = "tests.training.test_outside_trials"
SEEN = []  # keys, dtypes and shapes of a row, of each batch of the losses below


def note(batch):
    rows = batch.ndim
    SEEN.append(
        {key: (value.dtype, value.shape[rows:]) for key, value in batch.items(True, True)}
        | {"axes": rows}
    )


class Replayed(DqnLoss):
    """Notes its batches."""

    def __call__(self, network, target, batch):
        note(batch)
        return super().__call__(network, target, batch)


class Newest(PqnLoss):
    """Notes its batches."""

    def __call__(self, network, target, batch):
        note(batch)
        return super().__call__(network, target, batch)


class OneArgument(DqnLoss):
    """Has another signature."""

    def __call__(self, network):
        return 1


class One(DqnLoss):
    """Returns a number."""

    def __call__(self, network, target, batch):
        return 1


class Rows(DqnLoss):
    """Returns the loss of each row."""

    def __call__(self, network, target, batch):
        result = super().__call__(network, target, batch)
        return result._replace(loss=result.td_error)


class Chosen(DqnLoss):
    """Returns the value of one action."""

    def __call__(self, network, target, batch):
        result = super().__call__(network, target, batch)
        return result._replace(values=result.values[:, 0])


class Endless(DqnLoss):
    """Divides by zero."""

    def __call__(self, network, target, batch):
        result = super().__call__(network, target, batch)
        return result._replace(loss=result.loss / 0)


class Detached(DqnLoss):
    """Has no gradient."""

    def __call__(self, network, target, batch):
        with torch.no_grad():
            return super().__call__(network, target, batch)


class Unmade(DqnLoss):
    """Takes no settings."""

    def __init__(self):
        pass


class NoFlags(Loss):
    """Does not say what it learns from."""

    def __call__(self, network, target, batch):
        return LossResult(*torch.zeros(3))


class WordyFlag(DqnLoss):
    """Says it in words."""

    HAS_TARGET_NETWORK = "no"


class Fewer(Sampler):
    """Draws too few slots."""

    def sample(self, storage, batch_size):
        return draw_uniformly(storage, batch_size // 2, self.generator), {}


class Floats(Sampler):
    """Draws slots that are no integers."""

    def sample(self, storage, batch_size):
        return torch.zeros(batch_size), {}


class NoSize(Sampler):
    """Has another signature."""

    def sample(self, storage):
        return torch.zeros(1, dtype=torch.int64), {}


class Lost(Sampler):
    """Draws a slot that the replay does not have."""

    def sample(self, storage, batch_size):
        return torch.full((batch_size,), 10**6), {}


class Everywhere(Sampler):
    """Draws any entry, also the few that start nothing."""

    def sample(self, storage, batch_size):
        return torch.randint(len(storage), (batch_size,), generator=self.generator), {}


class Stubborn(UniformSampler):
    """Cannot take errors."""

    def update(self, index, td_error):
        raise LookupError("no such slot")


class Silent(MemoryGenerator):
    """Returns no losses."""

    def update(self, batch):
        return None


class Sure(MemoryGenerator):
    """Accepts with a number."""

    def predict(self, starts):
        return super().predict(starts)[0], 1.0


class Objects(MemoryGenerator):
    """Has a state that no file holds."""

    def state_dict(self):
        return {**super().state_dict(), "object": self}


def make(folder, kind, memory="none"):
    policy = QNetworkConfig(hidden_width=8, memory=memory, norm="layer")
    learner = LearnerSettings(f"{HERE}:{kind}", batch_size=16, n_steps=4)
    return small(folder, "duel", policy=policy, learner=learner)


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("memory", ["none", "lstm"])
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Fewer", r"is int64 .* expected int64"),
        ("Floats", r"slots of the replay sampler .*:Floats is float32 .* expected int64"),
        ("NoSize", "replay.sampler=.*NoSize failed on a replay of zeros: TypeError: .*takes 2"),
        ("Lost", "Lost failed on a replay of zeros: IndexError"),
        ("Everywhere", "IndexError: replay sampler .*:Everywhere: slot [0-9]+ starts no"),
        ("Stubborn", r"LookupError: no such slot \(.*test_outside_trials.py, line \d+\)"),
    ],
)
def test_a_wrong_sampler_is_refused_before_the_folder_exists(tmp_path, kind, message, memory):
    replay = ReplaySettings(
        sampler=f"{HERE}:{kind}", capacity_transitions=2_000, min_transitions=64
    )
    policy = QNetworkConfig(hidden_width=8, memory=memory)
    with pytest.raises(OutsideCodeError, match=message):
        train(small(tmp_path / "run", "duel", policy=policy, replay=replay))
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Silent", "update gave None, it must return losses by name"),
        ("Sure", r"predict gave 1.0, it must return transitions, and bool \[N\]"),
        ("Objects", "Objects failed on transitions of zeros: .*plain data"),
    ],
)
def test_a_wrong_generator_is_refused_before_the_folder_exists(tmp_path, kind, message):
    generator = GeneratorSettings(name=f"{HERE}:{kind}")
    with pytest.raises(OutsideCodeError, match=message):
        train(small(tmp_path / "run", "duel", generator=generator, synthetic_fraction=0.2))
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            "OneArgument",
            r"OneArgument failed on a batch of zeros of shape \[2\]: TypeError: .*takes 2",
        ),
        ("One", "One returned 1, it must be a LossResult"),
        ("Rows", r"returned loss of torch.float32 and shape \[2\] .* torch.float32 of shape \[\]"),
        ("Chosen", r"returned values of torch.float32 and shape \[2\] for"),
        ("Endless", "returned loss that is not finite"),
        ("Detached", "Detached returned a loss without gradient"),
        ("Unmade", "Unmade failed when it was made: TypeError"),
        ("NoFlags", "NoFlags has LEARNS_FROM_REPLAY 'not set': set it to True or False"),
        ("WordyFlag", "WordyFlag has HAS_TARGET_NETWORK 'no': set it to True or False"),
        ("SEEN", "must be a subclass of marl_cair.training.losses.Loss"),
    ],
)
def test_a_wrong_loss_is_refused_before_the_folder_exists(tmp_path, kind, message):
    with pytest.raises(OutsideCodeError, match=message):
        train(make(tmp_path / "run", kind))
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("memory", ["none", "lstm"])
@pytest.mark.parametrize("kind", ["Replayed", "Newest"])
def test_the_batch_of_zeros_is_like_those_of_the_run(tmp_path, kind, memory):
    SEEN.clear()
    result = train(make(tmp_path / "run", kind, memory))
    assert result.updates > 0
    assert len(SEEN) == 1 + result.updates
    first, *later = SEEN
    assert all(one == first for one in later), (first, later[0])


def test_a_loss_of_actions_at_each_cell_is_called_with_their_masks():
    SEEN.clear()
    config = QNetworkConfig(hidden_width=8).with_actions([], [], (8, 9))
    network = make_q_network(config, (3, 8, 9), 5, seed=0)
    try_loss(LearnerSettings(f"{HERE}:Newest"), network, TransitionSpec((3, 8, 9), 5))
    assert SEEN[0]["action"] == (torch.int64, (8, 9))
    assert SEEN[0]["action_mask"] == (torch.bool, (8, 9, 5))
