"""Q-networks of every body and head: shapes, gradients, seeds, errors, and that they learn."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from marl_cair.policies import HEADS
from marl_cair.policies.body import standardise_changes
from marl_cair.policies.conv import ConvLayer, choose_layers
from marl_cair.policies.heads import DuelingHead
from marl_cair.policies.q_network import CapsuleSizes, QNetwork, QNetworkConfig, make_q_network

PLANE_BODIES = ["conv", "capsule"]
LINE_WARS_SHAPE, LINE_WARS_ACTIONS = (28, 10, 15), 185


def make(body: str, shape=(3, 10, 15), num_actions=4, seed=0, **settings_) -> QNetwork:
    return make_q_network(QNetworkConfig(body=body, **settings_), shape, num_actions, seed)


def random_bytes(*shape: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(0, 256, shape, dtype=torch.uint8, generator=generator)


@pytest.mark.parametrize("head", ["dueling", "plain"])
@pytest.mark.parametrize("body", PLANE_BODIES)
@settings(max_examples=12, deadline=None)
@given(
    planes=st.integers(1, 5),
    rows=st.integers(8, 128),
    columns=st.integers(8, 128),
    num_actions=st.integers(2, 300),
    num_rows=st.integers(0, 3),
)
def test_any_board_and_any_number_of_actions_give_finite_values(
    body, head, planes, rows, columns, num_actions, num_rows
):
    network = make(body, (planes, rows, columns), num_actions, head=head)
    with torch.no_grad():
        values = network(random_bytes(num_rows, planes, rows, columns))
    assert values.shape == (num_rows, num_actions)
    assert values.dtype == torch.float32
    assert values.isfinite().all()


@pytest.mark.parametrize("body", PLANE_BODIES)
@pytest.mark.parametrize("shape", [(1, 8, 8), (1, 8, 128), (1, 84, 84), (3, 600, 800)])
def test_extreme_boards_and_large_images_work_with_bounded_weights(body, shape):
    network = make(body, shape)
    with torch.no_grad():
        assert network(random_bytes(1, *shape)).shape == (1, 4)
    assert sum(weight.numel() for weight in network.parameters()) < 2_000_000


@pytest.mark.parametrize("body", [*PLANE_BODIES, "mlp"])
def test_leading_axes_are_kept_and_do_not_change_the_values(body):
    shape = (6,) if body == "mlp" else (3, 10, 15)
    network = make(body, shape)
    observation = random_bytes(6, *shape)
    flat = network(observation)
    torch.testing.assert_close(network(observation.view(2, 3, *shape)), flat.view(2, 3, 4))
    assert network(observation[0]).shape == (4,)
    torch.testing.assert_close(network(observation[0]), flat[0])


@pytest.mark.parametrize("body", PLANE_BODIES)
def test_bytes_are_scaled_to_one_and_floats_are_taken_as_they_are(body):
    network = make(body)
    observation = random_bytes(2, 3, 10, 15)
    torch.testing.assert_close(network(observation), network(observation.float() / 255))
    assert torch.equal(network(observation.double()), network(observation.float()))
    assert not torch.allclose(network(observation), network(observation.float()))


@pytest.mark.parametrize("head", ["dueling", "plain"])
@pytest.mark.parametrize("body", [*PLANE_BODIES, "mlp"])
def test_the_gradient_of_a_random_loss_reaches_every_parameter(body, head):
    shape = (12,) if body == "mlp" else (3, 10, 15)
    network = make(body, shape, 7, head=head)
    values = network(random_bytes(8, *shape))
    (values * torch.randn(8, 7, generator=torch.Generator().manual_seed(1))).sum().backward()
    for name, weight in network.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.isfinite().all(), name
        assert weight.grad.abs().max() > 0, name


@pytest.mark.parametrize("body", PLANE_BODIES)
def test_equal_seeds_give_equal_bits_and_leave_the_global_generator_alone(body):
    torch.manual_seed(5)
    before = torch.get_rng_state()
    first, again, other = make(body, seed=3), make(body, seed=3), make(body, seed=4)
    assert torch.equal(torch.get_rng_state(), before)
    observation = random_bytes(4, 3, 10, 15)
    assert torch.equal(first(observation), again(observation))
    assert not torch.equal(first(observation), other(observation))
    without = make(body, seed=None)
    torch.set_rng_state(before)
    assert torch.equal(without(observation), make(body, seed=None)(observation))


@pytest.mark.parametrize("body", PLANE_BODIES)
def test_training_steps_reproduce_bits(body):
    def train() -> Tensor:
        network = make(body, LINE_WARS_SHAPE, LINE_WARS_ACTIONS)
        optimizer = torch.optim.Adam(network.parameters())
        for step in range(3):
            optimizer.zero_grad()
            network(random_bytes(32, *LINE_WARS_SHAPE, seed=step)).square().mean().backward()
            optimizer.step()
        return torch.cat([weight.detach().flatten() for weight in network.parameters()])

    assert torch.equal(train(), train())


@pytest.mark.parametrize("body", ["conv", "capsule"])
def test_values_of_images_do_not_depend_on_brightness_those_of_boards_do(body):
    generator = torch.Generator().manual_seed(0)
    for side, is_alike in ((64, True), (32, False)):
        network = make_q_network(QNetworkConfig(body=body), (2, side, side), 3, seed=0)
        image = torch.rand(4, 2, side, side, generator=generator)
        values, darker = network(image), network(0.3 * image + 0.1)
        assert torch.allclose(values, darker, atol=1e-4) == is_alike
    nothing = torch.zeros(1, 2, 64, 64, dtype=torch.uint8)
    network = make_q_network(QNetworkConfig(body=body), (2, 64, 64), 3, seed=0)
    assert torch.isfinite(network(nothing)).all()


def test_changes_between_frames_are_standardised():
    generator = torch.Generator().manual_seed(0)
    frames = torch.rand(5, 1, 64, 64, generator=generator).repeat(1, 4, 1, 1)
    frames[:, 2, 7, 9] += 0.01  # shown in the last frame but one alone
    planes = standardise_changes(frames)
    assert torch.allclose(planes.mean((2, 3))[:, 0], torch.zeros(5), atol=1e-5)
    assert torch.allclose(planes.std((2, 3))[:, 0], torch.ones(5), atol=1e-3)
    assert (planes[:, 1, 7, 9] < -5).all()
    assert (planes[:, 2, 7, 9] > 5).all()
    assert (planes[:, 3] == 0).all()


@pytest.mark.parametrize("body", ["conv", "capsule"])
def test_frame_differences_are_of_stacked_images_alone(body):
    config = QNetworkConfig(body=body, frame_differences=True)
    network = make_q_network(config, (4, 84, 84), 2, seed=0)
    stacks = random_bytes(3, 4, 84, 84)
    assert not torch.allclose(network(stacks), network(255 - stacks), atol=1e-3)
    assert torch.allclose(network(stacks), network(stacks.float() / 510 + 0.2), atol=1e-3)
    for shape in ((1, 84, 84), (4, 32, 32), (12,)):
        with pytest.raises(ValueError, match="frame_differences is True, but the observation"):
            make_q_network(config, shape, 2, seed=0)
    with pytest.raises(ValueError, match="set one to False"):
        QNetworkConfig(body=body, frame_differences=True, distances=True)


def test_vectors_are_scaled_by_their_bounds():
    low, high = (-64.0, 0.0, 0.0), (512.0, 1.0, 4.0)
    plain = make_q_network(QNetworkConfig(body="mlp"), (3,), 2, seed=0)
    config = QNetworkConfig(body="mlp").with_bounds(low, high)
    scaled = make_q_network(config, (3,), 2, seed=0)
    seen = torch.tensor([low, high, (224.0, 0.5, 3.0)])
    wanted = torch.tensor([[-1.0] * 3, [1.0] * 3, [0.0, 0.0, 0.5]])
    assert torch.equal(scaled(seen), plain(wanted))
    assert config.with_bounds((0.0,), (1.0,)) is config  # a user's own bounds stay
    assert QNetworkConfig().with_bounds(0, 255) == QNetworkConfig()
    assert QNetworkConfig.from_dict(config.to_dict()) == config


def test_bounds_that_fit_no_vector_are_refused():
    for low, high in (((0.0,), ()), ((0.0, 1.0), (1.0, 1.0)), ((0.0,), (float("nan"),))):
        with pytest.raises(ValueError, match="must have equal lengths, and each low"):
            QNetworkConfig(vector_low=low, vector_high=high)
    config = QNetworkConfig(body="mlp", vector_low=(0.0,), vector_high=(1.0,))
    with pytest.raises(ValueError, match=r"vector_low has 1 entries, .* shape is \(3,\)"):
        make_q_network(config, (3,), 2, seed=0)


def test_conv_has_the_expected_weights_in_line_wars():
    network = make("conv", LINE_WARS_SHAPE, LINE_WARS_ACTIONS)
    assert sum(weight.numel() for weight in network.parameters()) == 766_938


def test_conv_reads_images_as_mnih_et_al_and_bounds_its_last_map():
    layers, num_cells = choose_layers((4, 84, 84))
    assert layers == (ConvLayer(32, 8, 4, 0), ConvLayer(64, 4, 2, 0), ConvLayer(64, 3, 1, 0))
    assert num_cells == 7 * 7
    assert [layer.stride for layer in choose_layers((28, 10, 15))[0]] == [1, 2, 1]
    assert choose_layers((28, 10, 15))[1] == 5 * 8
    assert [layer.stride for layer in choose_layers((13, 25, 25))[0]] == [2, 2, 1]
    assert all(
        choose_layers((3, rows, columns))[1] <= 100
        for rows in range(8, 200, 3)
        for columns in range(8, 200, 3)
    )


@pytest.mark.parametrize("body", PLANE_BODIES)
def test_a_large_board_is_no_image(body):
    assert [layer.stride for layer in choose_layers((13, 65, 65))[0]] == [2, 2, 1, 2]
    network = make(body, (13, 65, 65), 5, distances=True)
    seen = []
    network.distances.register_forward_pre_hook(lambda module, given: seen.append(given[0]))
    network(torch.randint(0, 2, (2, 13, 65, 65), dtype=torch.uint8) * 255)
    assert seen[0].unique().tolist() == [0.0, 1.0]


@pytest.mark.parametrize("body", PLANE_BODIES)
@pytest.mark.parametrize("num_actions", [4, 300])
def test_initial_values_differ_by_action_however_many_there_are(body, num_actions):
    # The thesis's capsules fall from 6.5e-3 at 4 actions to 2e-6 at 300.
    values = make(body, (5, 10, 15), num_actions)(random_bytes(16, 5, 10, 15))
    assert values.std(-1).mean() > 0.01
    assert (values > 0).any()
    assert (values < 0).any()


def learn(network: QNetwork, draw, num_updates: int, rate: float) -> None:
    """Regress targets of batches from `draw()`."""
    optimizer = torch.optim.Adam(network.parameters(), lr=rate)
    for _ in range(num_updates):
        observation, target = draw()
        optimizer.zero_grad()
        (network(observation) - target).square().mean().backward()
        optimizer.step()


@pytest.mark.parametrize("body", PLANE_BODIES)
def test_values_are_signed_and_unbounded(body):
    network = make(body)
    observation = random_bytes(4, 3, 10, 15)
    learn(network, lambda: (observation, torch.tensor([-50.0, 50.0, 20.0, -20.0])), 80, 1e-2)
    values = network(observation).mean(0)
    assert values[0] < -30
    assert values[1] > 30


def draw_offsets(num_rows: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Two marks on a board; each of 4 actions is worth one signed distance between them."""
    cells = torch.tensor([10, 15])
    places = (torch.rand(num_rows, 2, 2, generator=generator) * cells).long()
    planes = torch.zeros(num_rows, 3, 10, 15)
    row = torch.arange(num_rows)
    for mark in range(2):
        planes[row, mark, places[:, mark, 0], places[:, mark, 1]] = 1.0
    offsets = (places[:, 0] - places[:, 1]) / (cells / 2)
    return planes, torch.cat([offsets, -offsets], dim=1)


def draw_products(num_rows: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    vector = torch.rand(num_rows, 6, generator=generator)
    return vector, vector[:, :3] * vector[:, 3:]


@pytest.mark.parametrize(
    ("body", "head", "draw", "num_updates"),
    [
        *((body, "dueling", draw_offsets, 120) for body in PLANE_BODIES),
        pytest.param("capsule", "plain", draw_offsets, 120, marks=pytest.mark.slow),
        ("mlp", "dueling", draw_products, 300),
    ],
)
def test_bodies_learn(body, head, draw, num_updates):
    shape, num_actions, rate = ((6,), 3, 3e-3) if body == "mlp" else ((3, 10, 15), 4, 1e-3)
    network = make(body, shape, num_actions, head=head)
    generator = torch.Generator().manual_seed(1)
    learn(network, lambda: draw(64, generator), num_updates, rate)
    observation, target = draw(256, torch.Generator().manual_seed(2))
    with torch.no_grad():
        unexplained = (network(observation) - target).square().mean() / target.var()
    assert unexplained < 0.1


def test_dueling_values_are_state_value_plus_centred_advantage():
    for embedding_size in (0, 5):
        head = DuelingHead(8, 6, embedding_size)
        features = torch.randn(3, 8)
        values = head(features)
        torch.testing.assert_close(values.mean(-1, keepdim=True), head.state_value(features))


def test_an_action_embedding_limits_the_rank_and_serves_any_body():
    network = make("conv", num_actions=40, action_embedding=2)
    values = network(random_bytes(64, 3, 10, 15))
    centred = values - values.mean(-1, keepdim=True)
    assert torch.linalg.matrix_rank(centred, rtol=1e-4) <= 3  # 2, and 1 for the biases
    assert network.head.advantage[1].weight.shape == (40, 2)


def test_a_configuration_survives_plain_data():
    config = QNetworkConfig(body="capsule", hidden_width=64, capsule=CapsuleSizes(grid_side=3))
    assert QNetworkConfig.from_dict(config.to_dict()) == config
    assert QNetworkConfig.from_dict({}) == QNetworkConfig()


def test_none_means_the_numbers_of_the_body():
    assert QNetworkConfig(body="conv").resolve_hidden_width() == 256
    assert QNetworkConfig(body="capsule").resolve_hidden_width() == 128
    assert QNetworkConfig(body="capsule").resolve_action_embedding() == 0
    older = QNetworkConfig(body="capsule", action_embedding=None)
    assert older.resolve_action_embedding() == 32
    assert QNetworkConfig(body="capsule", head="plain").resolve_action_embedding() == 0
    assert QNetworkConfig(body="capsule", action_embedding=0).resolve_action_embedding() == 0


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"body": "convv"}, "unknown network 'convv': nearest are 'conv'"),
        ({"head": "duel"}, "unknown head 'duel': nearest are 'dueling'"),
        ({"hidden_width": 0}, "hidden_width is 0, but must be an integer of at least 1"),
        ({"hidden_width": 1.5}, "hidden_width is 1.5, but must be an integer"),
        ({"distances": "no"}, "distances is 'no', it must be True or False"),
        ({"action_embedding": -1}, "action_embedding is -1, but must be an integer of at least 0"),
        ({"head": "plain", "action_embedding": 4}, "head 'plain' has none: set it to 0 or None"),
        ({"obstacle_planes": [0]}, "but distances is False"),
        ({"cell_values": True, "action_cells": (3, -7)}, r"action_cells\[1\] is -7, but must be"),
        ({"cell_values": True, "action_kinds": (0.5,)}, r"action_kinds\[0\] is 0\.5, but must"),
        ({"action_cells": (0,), "action_kinds": (0,)}, "are given, but cell_values is False"),
        ({"capsule": {"grid_side": 0}}, "capsule.grid_side is 0, but must be an integer"),
        ({"hiden_width": 3}, "unknown network setting 'hiden_width'"),
        ({"capsule": {"gridside": 3}}, "unknown capsule size 'gridside'"),
        ({"capsule": 5}, "capsule is 5, it must be sizes by name"),
    ],
)
def test_invalid_settings_are_refused(settings_, message):
    with pytest.raises(ValueError, match=message):
        QNetworkConfig.from_dict(settings_)


@pytest.mark.parametrize(
    ("body", "shape", "message"),
    [
        *((body, (20,), f"body '{body}' needs planes .* body='mlp'") for body in PLANE_BODIES),
        *(
            (body, shape, "H, W >= 8, but the observation shape is")
            for body in PLANE_BODIES
            for shape in ((3, 7, 15), (10, 15), (2, 3, 10, 15))
        ),
        ("mlp", (3, 10, 15), "needs a vector .* use body='conv' or body='capsule'"),
    ],
)
def test_unsupported_shapes_are_refused(body, shape, message):
    with pytest.raises(ValueError, match=message):
        make(body, shape)


def test_wrong_observations_and_a_network_without_actions_are_refused():
    network = make("conv")
    with pytest.raises(ValueError, match=r"shape \(2, 3, 10, 14\), but this network reads"):
        network(random_bytes(2, 3, 10, 14))
    with pytest.raises(TypeError, match=r"dtype torch.int64, but must be torch.uint8"):
        network(torch.zeros(2, 3, 10, 15, dtype=torch.int64))


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("num_actions", [0, 1])
def test_a_game_without_a_choice_is_refused(head, num_actions):
    body = "thesis_capsule" if head == "length" else "conv"
    message = f"num_actions is {num_actions}, but a network needs at least 2 actions"
    with pytest.raises(ValueError, match=message):
        make(body, num_actions=num_actions, head=head)
