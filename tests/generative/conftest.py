"""Data and trained generators that the generator tests share."""

import pytest
import torch

from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.settings import GateConfig, GeneratorConfig, NetworkSize
from tests.generative.plane_game import SPEC, play_randomly

SMALL = GeneratorConfig(
    heldout_capacity=800,
    size=NetworkSize(channels=12, depth=2, hidden=48),
    gate=GateConfig(evaluation_rows=400),
)
NUM_UPDATES = 450  # 350 open the gate


def train(rows, shown, num_updates, config: GeneratorConfig = SMALL):
    """A generator that observed `shown` and learned from `rows`."""
    generator = CCDNGenerator(config, SPEC)
    generator.observe(shown)
    draws = torch.Generator().manual_seed(1)
    for _ in range(num_updates):
        generator.update(rows[torch.randint(rows.shape[0], (64,), generator=draws)])
    return generator


@pytest.fixture(scope="session")
def real_rows():
    return play_randomly(num_worlds=64, num_steps=120, seed=0)


@pytest.fixture(scope="session")
def trained(real_rows):
    """Trained and evaluated; tests must not train it on."""
    generator = train(real_rows, real_rows, NUM_UPDATES)
    generator.evaluate()
    return generator
