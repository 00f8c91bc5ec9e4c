"""The thesis's network: its published numbers of parameters, and that it learns."""

import pytest
import torch

from marl_cair.generative.networks.thesis import ThesisCCDN, to_frames, to_observation
from marl_cair.lookup import UnknownNameError


@pytest.mark.parametrize(
    ("form", "hidden", "parameters"),
    [
        ("published", 32, 13.1e6),  # the thesis's smallest and largest
        ("published", 512, 67.9e6),
        ("code", 32, 2.60e6),
        ("code", 512, 33.3e6),
    ],
)
def test_it_has_as_many_parameters_as_published(form, hidden, parameters):
    with torch.device("meta"):
        network = ThesisCCDN(num_actions=4, hidden=hidden, form=form)
    assert sum(one.numel() for one in network.parameters()) == pytest.approx(parameters, rel=0.005)


def test_both_forms_predict_a_frame_of_the_same_size():
    frames, action = torch.rand(1, 1, 84, 84), torch.tensor([2])
    for form in ("published", "code"):
        assert ThesisCCDN(4, 8, form)(frames, action).shape == (1, 1, 84, 84)


def test_an_unknown_form_is_refused():
    with pytest.raises(UnknownNameError, match="form of the thesis's CCDN 'coed'.*'code'"):
        ThesisCCDN(4, form="coed")


def test_frames_are_converted_back():
    picture = torch.arange(256, dtype=torch.uint8).view(1, 1, 16, 16)
    assert torch.equal(to_observation(to_frames(picture)), picture)
