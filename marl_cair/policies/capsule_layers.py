"""Capsule layers, each usable alone: of dynamic routing (Sabour et al. 2017), and of `capsule`."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

MIN_SQUARED = 1e-30  # of a length: the gradient of `squash` is 0 at 0, not NaN
MIN_PRESENCE = 1e-6  # avoids a division by 0 in cells without parts
ROUTING_CHUNK_ROWS = 128  # 256 rows at once cost 2.5 times as much: new pages at every allocation
ROUTING_VOTES = 1 << 20  # at once; an einsum over all copies them, for 2 to 4 times the time
FIRST_VOTES = 0.1  # standard deviation of the weights of `DenseCapsules` before learning
# Of the margin loss: least length of the true class, largest of others, weight of others.
PRESENT, ABSENT, ABSENT_WEIGHT = 0.9, 0.1, 0.5


class PrimaryCapsules(nn.Module):
    """Planes float32 [N, C, H, W] -> squashed poses [N, I, D], I = T * H' * W' capsules.

    One convolution without padding gives T types of capsules of D numbers in each cell; capsule
    (t, y, x) is number (t * H' + y) * W' + x (Sabour et al. 2017, section 4).

    Attributes:
        num_types: T.
        pose_size: D.
    """

    def __init__(
        self, num_planes: int, num_types: int, pose_size: int, kernel: int = 9, stride: int = 2
    ) -> None:
        super().__init__()
        self.num_types, self.pose_size = num_types, pose_size
        self.convolution = nn.Conv2d(num_planes, num_types * pose_size, kernel, stride)

    def forward(self, planes: Tensor) -> Tensor:
        poses = self.convolution(planes).unflatten(1, (self.num_types, self.pose_size))
        return squash(poses.permute(0, 1, 3, 4, 2).flatten(1, 3))


class DenseCapsules(nn.Module):
    """Capsules float32 [N, I, D] -> squashed capsules [N, K, O], by dynamic routing.

    Procedure 1 of Sabour et al. 2017: capsule i votes W_ik u_i for capsule k; s_k sums the votes by
    weights c_ik, the softmax over k of the agreement of votes and outputs so far, 0 in pass one.
    No gradient flows through the weights. No bias, no learnt priors of the routing: the layer has
    I * D * K * O weights. All votes, N * I * K * O numbers, come from one batched product.
    """

    def __init__(
        self, num_inputs: int, input_size: int, num_outputs: int, output_size: int, passes: int = 3
    ) -> None:
        super().__init__()
        self.num_outputs, self.num_passes = num_outputs, passes
        self.weight = nn.Parameter(torch.empty(num_inputs, input_size, num_outputs * output_size))
        with torch.no_grad():
            self.weight.normal_(0.0, FIRST_VOTES)

    def forward(self, capsules: Tensor) -> Tensor:
        votes = self.vote(capsules)
        return squash(sum_routed(votes, self.find_weights(votes)))

    def vote(self, capsules: Tensor) -> Tensor:
        """Capsules [N, I, D] -> votes [I, N, K, O]."""
        votes = torch.bmm(capsules.transpose(0, 1), self.weight)
        return votes.view(*votes.shape[:2], self.num_outputs, -1)

    @torch.no_grad()
    def find_weights(self, votes: Tensor) -> Tensor:
        """Return how much of each vote [I, N, K, O] counts, [I, N, K]; over K the sum is 1."""
        agreement = torch.zeros_like(votes[..., 0])
        for _ in range(self.num_passes - 1):
            outputs = squash(sum_routed(votes, agreement.softmax(-1)))
            for part, agreed in zip(*split_votes(votes, agreement), strict=True):
                agreed.add_((part * outputs).sum(-1))
        return agreement.softmax(-1)


def sum_routed(votes: Tensor, weights: Tensor) -> Tensor:
    """Votes [I, N, K, O], weights [I, N, K] -> weighted sums [N, K, O]."""
    total = votes.new_zeros(votes.shape[1:])
    for part, weight in zip(*split_votes(votes, weights), strict=True):
        total = total + (part * weight.unsqueeze(-1)).sum(0)
    return total


def split_votes(votes: Tensor, weights: Tensor) -> tuple[tuple[Tensor, ...], tuple[Tensor, ...]]:
    """Votes [I, N, K, O] and weights [I, N, K] in parts of some inputs: ROUTING_VOTES numbers are
    in the processor's cache when they are read again.
    """
    # A graph for other programs is of any batch size.
    is_graph = torch.compiler.is_exporting()
    size = len(votes) if is_graph else max(1, ROUTING_VOTES // max(1, votes[0].numel()))
    return torch.split(votes, size), torch.split(weights, size)


class CapsuleDecoder(nn.Module):
    """Capsules [N, K, O] and classes int64 [N] -> images [N, *image_shape] in (0, 1).

    Three dense layers see the pose of the capsule of the given class; all other capsules are set to
    0 (Sabour et al. 2017, section 4.1). To learn, give the true class; to draw what the network
    believes, its prediction. Raises ValueError unless there is one class in 0..K-1 for each row.
    """

    def __init__(
        self,
        num_capsules: int,
        pose_size: int,
        image_shape: Sequence[int],
        hidden_widths: tuple[int, int] = (512, 1024),
    ) -> None:
        super().__init__()
        first, second = hidden_widths
        self.layers = nn.Sequential(
            nn.Linear(num_capsules * pose_size, first),
            nn.ReLU(),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, math.prod(image_shape)),
            nn.Sigmoid(),
            nn.Unflatten(1, tuple(image_shape)),
        )

    def forward(self, capsules: Tensor, classes: Tensor) -> Tensor:
        shown = _mark(classes, capsules.shape[:2])
        images: Tensor = self.layers((capsules * shown.unsqueeze(2)).flatten(1))
        return images


def margin_loss(lengths: Tensor, classes: Tensor) -> Tensor:
    """Mean over rows of the margin loss (Sabour et al. 2017, equation 4), a scalar.

    The length of the true class's capsule should be at least 0.9, each other's at most 0.1:
    max(0, 0.9 - |v_k|)^2 for the true class, 0.5 max(0, |v_k| - 0.1)^2 for each other.

    lengths: of the capsules, float [N, K]; classes: int64 [N]. Raises ValueError unless there is
    one class in 0..K-1 for each row.
    """
    is_true = _mark(classes, lengths.shape)
    missing = (PRESENT - lengths).clamp_min(0.0).square()
    wrong = ABSENT_WEIGHT * (lengths - ABSENT).clamp_min(0.0).square()
    return torch.where(is_true, missing, wrong).sum(1).mean()


def _mark(classes: Tensor, shape: Sequence[int]) -> Tensor:
    """Return a bool tensor [N, K], True at each row's class."""
    num_rows, num_classes = shape
    if classes.shape != (num_rows,) or classes.dtype != torch.int64:
        raise ValueError(
            f"classes are {classes.dtype} of shape {list(classes.shape)}, but must be torch.int64 "
            f"of shape [{num_rows}], one for each row"
        )
    if num_rows and not 0 <= int(classes.min()) <= int(classes.max()) < num_classes:
        raise ValueError(
            f"classes are from {int(classes.min())} to {int(classes.max())}, but there are "
            f"{num_classes} capsules: number them from 0 to {num_classes - 1}"
        )
    return functional.one_hot(classes, num_classes).bool()


class PartCapsules(nn.Module):
    """Planes [N, C, H, W] -> poses [N, D, T, H', W'] and presences [N, T, H', W'] in (0, 1).

    Presence is a separate output: the length of a pose is free.
    """

    def __init__(self, num_planes: int, num_types: int, pose_size: int) -> None:
        super().__init__()
        self.num_types, self.pose_size = num_types, pose_size
        self.convolution = nn.Conv2d(num_planes, num_types * (pose_size + 1), 3, 2, 1)

    def forward(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        parts = self.convolution(planes).contiguous()
        parts = parts.unflatten(1, (self.pose_size + 1, self.num_types))
        return parts[:, 1:], parts[:, 0].sigmoid()


class GridPooling(nn.Module):
    """Means of parts, weighted by presence, over a fixed grid of G x G cells, whatever H' and W'.

    u_g = a_g * sum_p w_gp a_p y_p / sum_p w_gp a_p, where w_gp is the share of grid cell g that
    position p covers: maps larger than the grid are averaged, smaller ones spread. a_g is the
    presence-weighted mean of the presences: near 1 if a few positions of a large cell hold a part.
    The sums are a matrix product: gradients are deterministic on every device.
    """

    shares: Tensor

    def __init__(self, num_rows: int, num_columns: int, grid_side: int) -> None:
        super().__init__()
        rows, columns = overlap_shares(num_rows, grid_side), overlap_shares(num_columns, grid_side)
        self.register_buffer("shares", torch.kron(rows, columns).T.contiguous(), persistent=False)

    def forward(self, poses: Tensor, presences: Tensor) -> tuple[Tensor, Tensor]:
        """Poses [N, D, T, H', W'], presences [N, T, H', W'] -> [N, D, T, G*G], [N, T, G*G]."""
        presences = presences.flatten(-2)
        total = (presences @ self.shares).clamp_min(MIN_PRESENCE)
        presence = (presences.square() @ self.shares) / total
        weighted = (poses.flatten(-2) * presences.unsqueeze(1)) @ self.shares
        return weighted * (presence / total).unsqueeze(1), presence


class EntityRouting(nn.Module):
    """Routes I parts to K entities by agreement (Sabour et al. 2017), without building the votes.

    Each part has a matrix for each entity; an entity is the weighted sum of its parts' votes. The
    weights come from detached votes and sum to K over the entities for each part: a part's signal
    does not depend on the number of entities. The votes W u are never formed: s_k = [c_k * u] W_k
    and agreement = u . (W_k^T v_k) give the same numbers and are 2 to 3 times as fast from 32 rows
    on. Entities are not squashed.

    Measured: with 200 parts the agreements are small and the weights stay near 1 (standard
    deviation 0.002 after 600 updates of a regression on boards); one pass learned as well.
    """

    def __init__(self, num_parts: int, part_size: int, num_entities: int, entity_size: int) -> None:
        super().__init__()
        self.num_entities = num_entities
        self.weight = nn.Parameter(torch.empty(num_entities, part_size * num_parts, entity_size))
        with torch.no_grad():
            self.weight.normal_(0.0, 1.0 / math.sqrt(num_parts * part_size))

    def forward(self, parts: Tensor, num_passes: int) -> Tensor:
        """Parts [N, D, I] -> entities [N, K, O]."""
        # A graph for other programs holds no chunks: their number is that of one batch size.
        is_graph = torch.compiler.is_exporting()
        chunks = (parts,) if is_graph else torch.split(parts, ROUTING_CHUNK_ROWS)
        entities = [
            self.sum_votes(chunk, self.find_weights(chunk.detach(), num_passes)) for chunk in chunks
        ]
        return torch.cat(entities, dim=1).transpose(0, 1)

    @torch.no_grad()
    def find_weights(self, parts: Tensor, num_passes: int) -> Tensor:
        """Return how much of each part goes to each entity, [K, N, I]; pass one gives all ones."""
        num_rows, _, num_parts = parts.shape
        agreement = parts.new_zeros(self.num_entities, num_rows, num_parts)
        weights = torch.ones_like(agreement)
        for pass_index in range(num_passes - 1):
            # Pass one needs no weighting, which is a third of the cost of routing.
            entities = self.sum_votes(parts, None if pass_index == 0 else weights)
            wanted = torch.bmm(squash(entities), self.weight.transpose(1, 2))
            agreement += wanted.view(self.num_entities, *parts.shape).mul_(parts).sum(2)
            weights = self.num_entities * agreement.softmax(0)
        return weights

    def sum_votes(self, parts: Tensor, weights: Tensor | None) -> Tensor:
        """Parts [N, D, I], weights [K, N, I] (None: all one) -> entities [K, N, O]."""
        if weights is None:
            return torch.matmul(parts.flatten(1), self.weight)
        return torch.bmm((weights.unsqueeze(2) * parts).flatten(2), self.weight)


def squash(vectors: Tensor) -> Tensor:
    """Shrink vectors [..., O] to lengths |s|^2 / (1 + |s|^2) below 1, keeping their direction."""
    squared = vectors.square().sum(-1, keepdim=True)
    return vectors * (squared.clamp_min(MIN_SQUARED).sqrt() / (1.0 + squared))


def measure_presence(vectors: Tensor) -> Tensor:
    """Return |s|^2 / (1 + |s|^2) in [0, 1) for vectors [..., O], with a finite gradient at 0."""
    squared = vectors.square().sum(-1)
    return squared / (1.0 + squared)


def overlap_shares(num_positions: int, num_cells: int) -> Tensor:
    """Share of each of `num_cells` equal cells that a position covers, float32 [cells, positions].

    Each row sums to 1. Both divide the same length, in any ratio:

        positions  |   0   |   1   |   2   |     cell 0: 2/3 position 0, 1/3 position 1
        cells      |     0     |     1     |     cell 1: 1/3 position 1, 2/3 position 2
    """
    positions = torch.arange(num_positions, dtype=torch.float64) / num_positions
    cells = torch.arange(num_cells, dtype=torch.float64).unsqueeze(1) / num_cells
    ends = torch.minimum(positions + 1.0 / num_positions, cells + 1.0 / num_cells)
    overlap = (ends - torch.maximum(positions, cells)).clamp_min(0.0)
    return (overlap * num_cells).to(torch.float32)
