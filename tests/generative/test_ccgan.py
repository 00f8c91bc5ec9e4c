"""The adversarial variant: its discriminator learns, and it saves and resumes as the others do."""

import copy
import dataclasses

import pytest
import torch

from marl_cair.generative import GENERATORS
from marl_cair.generative.ccgan import CCGANGenerator
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.settings import AdversarialSettings
from tests.generative.conftest import SMALL
from tests.generative.plane_game import SPEC
from tests.generative.test_generator import draw_batches, same_bits


def make(rows, num_updates, weight=0.1):
    config = dataclasses.replace(SMALL, adversarial=AdversarialSettings(weight, channels=8))
    generator = CCGANGenerator(config, SPEC)
    generator.observe(rows)
    losses = [generator.update(batch) for batch in draw_batches(rows, num_updates)]
    return generator, losses


def judge(generator, rows):
    """Mean scores of real and of generated transitions."""
    network, others = generator.network, torch.zeros(len(rows), 0, dtype=torch.int64)
    before = rows["observation"][:, : SPEC.num_spatial].float() / 255.0
    seen = before, before[:, network.moving]
    kinds = network.actions.kinds[rows["action"]]
    with torch.no_grad():
        boards = generator._sample_boards(network, rows, others)
        return [float(generator.discriminator(*seen, board, kinds).mean()) for board in boards]


def test_it_is_made_by_its_name():
    assert isinstance(GENERATORS.make("ccgan", SMALL, SPEC), CCGANGenerator)


def test_the_discriminator_learns_to_tell_real_boards_from_those_of_an_untrained_network(real_rows):
    generator, _ = make(real_rows, 0)
    untrained = copy.deepcopy(generator.network.state_dict())
    for batch in draw_batches(real_rows, 60):
        generator.update(batch)
        generator.network.load_state_dict(untrained)
    fake, real = judge(generator, real_rows[:256])
    assert real > fake + 0.5


def test_it_learns_and_the_likelihood_stays_the_main_loss(real_rows):
    _, losses = make(real_rows, 60)
    assert losses[-1]["cells"] < 0.6 * losses[0]["cells"]
    assert abs(losses[-1]["adversarial"]) < 1.0
    assert all(torch.isfinite(torch.tensor(list(one.values()))).all() for one in losses)


def test_the_adversarial_gradient_reaches_the_network(real_rows):
    generator, _ = make(real_rows, 1)
    rows = draw_batches(real_rows, 1)[0]
    fake, real = generator._sample_boards(
        generator.network, rows, torch.zeros(len(rows), 0, dtype=torch.int64)
    )
    assert not real.requires_grad
    values = rows["observation"].float().unique() / 255.0  # of cells or their neighbours
    assert set(fake.unique().tolist()) <= set(values.tolist()) | {0.0, 1.0}
    fake.sum().backward()
    assert generator.network.choose.weight.grad.abs().sum() > 0


def test_a_resumed_one_continues_with_the_same_bits(real_rows):
    whole, _ = make(real_rows, 4)
    resumed = CCGANGenerator(whole.config, SPEC)
    resumed.load_state_dict(copy.deepcopy(whole.state_dict()))
    for generator in (whole, resumed):
        for batch in draw_batches(real_rows, 2, seed=9):
            generator.update(batch)
    assert same_bits(whole.state_dict(), resumed.state_dict())


def test_it_can_begin_with_the_weights_of_a_ccdn(real_rows):
    plain = CCDNGenerator(SMALL, SPEC)
    generator, _ = make(real_rows, 2)
    generator.import_knowledge(plain.export_knowledge())
    assert torch.equal(generator.network.choose.weight, plain.network.choose.weight)


def test_settings_out_of_range_are_refused():
    for name, value in (("weight", -1.0), ("channels", 0), ("learning_rate", 0.0)):
        with pytest.raises(ValueError, match=f"adversarial.{name} is {value}"):
            AdversarialSettings(**{name: value})
