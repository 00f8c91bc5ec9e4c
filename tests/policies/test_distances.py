"""Distances over the board: exact, with gradients of sums of costs, and learned in a network."""

import heapq

import pytest
import torch
from torch import Tensor

from marl_cair.policies.distances import (
    FARTHEST,
    DistanceMaps,
    _Propagation,
    compare_neighbours,
    find_costs,
    measure_nearness,
)
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

WALL_COST = 20.0
MAZE = """
G#...
.#.#.
...#S
"""


def read_maze(text: str) -> tuple[Tensor, Tensor]:
    """Planes wall, goal, self, and a cost of 0.1 a step where there is no wall."""
    rows = text.split()
    planes = torch.tensor([[[float(c == kind) for c in row] for row in rows] for kind in "#GS"])
    return planes.unsqueeze(0), (0.1 + WALL_COST * planes[0])[None, None]


def walk_dijkstra(goal: int, cost: Tensor) -> list[float]:
    """The cheapest way from each cell to `goal`, each cell paying as it is left."""
    height, width = cost.shape
    found = [float("inf")] * cost.numel()
    queue = [(0.0, goal)]
    while queue:
        spent, cell = heapq.heappop(queue)
        if spent >= found[cell]:
            continue
        found[cell] = spent
        row, column = divmod(cell, width)
        for r, c in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            if 0 <= r < height and 0 <= c < width:
                heapq.heappush(queue, (spent + float(cost[r, c]), r * width + c))
    return found


def test_nearness_of_a_goal_counts_the_steps_of_the_path():
    planes, cost = read_maze(MAZE)
    nearness = measure_nearness(planes, cost)[0, 1]
    assert nearness[2, 4].item() == pytest.approx(-1.0)  # ten steps
    assert nearness[0, 0].item() == 0.0


def test_the_next_step_is_the_neighbour_that_is_nearer():
    planes, cost = read_maze(MAZE)
    ways = compare_neighbours(measure_nearness(planes, cost), cost)[0, :, 1]
    below, above, right, left = ways[:, 2, 4].tolist()
    assert above == pytest.approx(1.0, abs=1e-5)
    assert (below, right, left) == (-1.0, -1.0, -1.0)


def test_nearness_is_that_of_dijkstra_on_random_boards():
    generator = torch.Generator().manual_seed(1)
    cost = 0.01 + torch.rand(3, 1, 11, 7, generator=generator) * 0.2
    planes = torch.zeros(3, 1, 11, 7)
    goals = [5, 40, 76]
    for row, goal in enumerate(goals):
        planes[row].view(-1)[goal] = 1.0
    nearness = measure_nearness(planes, cost)
    for row, goal in enumerate(goals):
        wanted = -torch.tensor(walk_dijkstra(goal, cost[row, 0])).clamp(max=FARTHEST)
        torch.testing.assert_close(nearness[row].view(-1), wanted)


def test_a_constant_plane_is_near_by_its_value():
    planes = torch.stack([torch.zeros(5, 5), torch.full((5, 5), 0.5), torch.ones(5, 5)])[None]
    nearness = measure_nearness(planes, torch.full((1, 1, 5, 5), 0.1))
    assert nearness[0, :, 2, 2].tolist() == [-FARTHEST, -FARTHEST / 2, 0.0]


def test_gradients_are_those_of_finite_differences():
    generator = torch.Generator().manual_seed(0)
    source = torch.randn(3, 2, 5, 6, dtype=torch.double, generator=generator, requires_grad=True)
    cost = torch.rand(3, 2, 5, 6, dtype=torch.double, generator=generator) + 0.1
    assert torch.autograd.gradcheck(_Propagation.apply, (source, cost.requires_grad_()))


def test_values_do_not_depend_on_the_rest_of_the_batch():
    maps = DistanceMaps((3, 9, 9), 16, ())
    planes = (torch.rand(70, 3, 9, 9, generator=torch.Generator().manual_seed(2)) > 0.7).float()
    planes[1, 2] = 0.0
    with torch.no_grad():
        together, alone = maps(planes)[0][1:2], maps(planes[1:2])[0]
    torch.testing.assert_close(together, alone, rtol=0, atol=0)


@pytest.mark.parametrize("body", ["conv", "capsule"])
def test_every_weight_of_a_network_with_distances_gets_a_gradient(body):
    network = make_q_network(QNetworkConfig(body=body, distances=True), (3, 9, 9), 5, seed=0)
    generator = torch.Generator().manual_seed(0)
    planes = torch.randint(0, 2, (8, 3, 9, 9), dtype=torch.uint8, generator=generator) * 255
    network(planes).square().sum().backward()
    assert all(weight.grad is not None for weight in network.parameters())
    assert network.distances.log_cost.weight.grad.abs().min() > 0


def test_obstacles_are_walked_around_before_anything_is_learned():
    planes, _ = read_maze(MAZE)
    maps = DistanceMaps((3, 3, 5), 16, obstacle_planes=(0,))
    with torch.no_grad():
        cost = find_costs(planes, maps.log_cost, maps.usual_cost)
        nearness = measure_nearness(planes, cost)
    assert nearness[0, 1, 2, 4].item() == pytest.approx(
        -10 / 8
    )  # ten steps of 1 / (rows + columns)


def test_wrong_obstacles_and_vectors_are_refused():
    config = QNetworkConfig(distances=True, obstacle_planes=(3,))
    with pytest.raises(ValueError, match=r"obstacle_planes holds plane 3, .* the planes 0\.\.2"):
        make_q_network(config, (3, 9, 9), 5, seed=0)
    with pytest.raises(ValueError, match="'distances' needs planes"):
        make_q_network(QNetworkConfig(body="mlp", distances=True), (6,), 5, seed=0)


def test_the_configuration_survives_a_checkpoint():
    config = QNetworkConfig(distances=True, obstacle_planes=(0, 2))
    assert QNetworkConfig.from_dict({**config.to_dict(), "obstacle_planes": [0, 2]}) == config
