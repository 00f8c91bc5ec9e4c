"""Saved weights and optimisers are put back, checked."""

import pytest
import torch

from marl_cair.policies.saved_weights import restore_optimizer


def make(learning_rate, width=3):
    layer = torch.nn.Linear(width, 2)
    optimizer = torch.optim.Adam(layer.parameters(), lr=learning_rate)
    layer(torch.ones(1, width)).sum().backward()
    optimizer.step()
    return optimizer


def test_moments_are_those_of_the_file_and_the_learning_rate_that_of_the_settings():
    saved, own = make(0.1), make(0.02)
    saved.step()
    state = saved.state_dict()
    restore_optimizer(own, state, "one")
    assert own.param_groups[0]["lr"] == 0.02
    assert state["param_groups"][0]["lr"] == 0.1
    for number, moments in own.state_dict()["state"].items():
        assert float(moments["step"]) == 2.0
        assert torch.equal(moments["exp_avg"], state["state"][number]["exp_avg"])


def test_an_optimiser_of_other_weights_is_refused():
    with pytest.raises(ValueError, match="one"):
        restore_optimizer(make(0.1), make(0.1, width=5).state_dict(), "one")
