"""CCDN v2: the conditional convolution deconvolution network, as a distribution over transitions.

    s, a ── board trunk with FiLM from the action ── places ── economy chain: p(scalars' | s, a)
                 └── FiLM from scalars' ── cells: p(planes' | s, a, scalars')
                          └── pooled, both boards, scalars' ── reward, end, next action mask

The thesis multiplies a state stream and an action stream, squeezed through one vector; here the
product is taken at every cell, nothing is squeezed, and what does not change is copied. The economy
does not read the pooled trunk but sums of what stands near what (`readout.NearReadout`).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.cells import (
    CellDistribution,
    build_distribution,
    count_outputs,
    decode_cells,
    gather_candidates,
)
from marl_cair.generative.networks.economy import EconomyChain, ScalarTables, apply_changes
from marl_cair.generative.networks.open_cells import OpenCells
from marl_cair.generative.networks.outcome import Outcome, OutcomeHeads, OutcomeInput, RewardBins
from marl_cair.generative.networks.readout import SUM_UNIT, NearReadout, flatten_board
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

READOUT_CHANNELS = 8
COPY_BIAS = 3.0  # logit of "keeps its value" before training: almost every cell does


class Encoding(NamedTuple):
    """A state and an action as the network sees them."""

    board: Tensor  # [N, H, W, F]
    context: Tensor  # [N, D]
    outlook: Tensor  # [N, E], what the economy depends on, without the pooled trunk's large sums
    things: Tensor  # float32 [N, H * W, S], the spatial planes now, 0..1
    planes: Tensor  # uint8 [N, P, H, W], the moving planes now
    scalars: Tensor  # uint8 [N, U] now


class NextState(NamedTuple):
    """A next state as the heads of the outcome see it."""

    observation: Tensor  # uint8 [N, C, H, W]
    changes: Tensor  # int64 [N, U]
    board: Tensor  # [N, H, W, F], the trunk after the economy is known


class CCDN(nn.Module):
    """One member of the generator: a distribution over (next state, reward, end, mask)."""

    kinds: Tensor
    cells: Tensor
    moving: Tensor
    event_of_plane: Tensor
    step_results: Tensor  # uint8 [P, K + 1, 256]

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        self.spec = spec
        self.size = size
        channels, hidden, uniform = size.channels, size.hidden, spec.num_uniform
        self.register_buffer("kinds", torch.tensor(spec.kinds), persistent=False)
        self.register_buffer("cells", torch.tensor(spec.cells), persistent=False)
        self.register_buffer("moving", torch.tensor(spec.moving_planes), persistent=False)
        self.register_buffer("event_of_plane", _number_events(spec), persistent=False)
        self.names_cells = any(cell != NO_CELL for cell in spec.cells)
        # Action stream: what is done, and with what means.
        self.action_embedding = nn.Embedding(spec.num_kinds, size.action_embedding)
        self.tables = ScalarTables(uniform, size.table_width)
        self.enter = nn.Linear(size.action_embedding + uniform * (1 + size.table_width), hidden)
        self.film_action = nn.Linear(hidden, 4 * channels)
        # State stream. The position bias lets it know the board's edges and spawn columns.
        self.conv1 = nn.Conv2d(spec.num_spatial + self.names_cells, channels, 3, padding=1)
        self.position = nn.Parameter(torch.zeros(spec.num_rows, spec.num_columns, channels))
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)
        self.conv3 = nn.Conv2d(channels, channels, 3, padding=1)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        # Pooling forgets where things are; this read-out does not (what stands before the base).
        self.narrow = nn.Linear(channels, READOUT_CHANNELS)
        self.readout = nn.Linear(READOUT_CHANNELS * spec.num_rows * spec.num_columns, hidden)
        # Heads.
        num_context = 2 * channels + 2 * hidden
        self.near = NearReadout(spec.num_spatial, size.near_factors)
        num_outlook = 2 * hidden + self.near.num_sums
        self.economy = EconomyChain(num_outlook, uniform, size.economy_hidden)
        self.film_economy = nn.Linear(size.economy_hidden, 2 * channels)
        steps = torch.arange(256, dtype=torch.uint8).repeat(
            len(spec.moving_planes), size.steps + 1, 1
        )
        self.register_buffer("step_results", steps)  # of `StepTable`, which the ensemble counts
        self.outputs_per_cell = count_outputs(len(size.shifts), size.steps)
        self.cell_head = nn.Linear(channels, len(spec.moving_planes) * self.outputs_per_cell)
        # What was bought is known for the whole board, where it appears only for each place: added
        # as logits, the two make "this kind, here" without a channel for each pair.
        self.plane_head = nn.Linear(
            num_context + size.economy_hidden, len(spec.moving_planes) * self.outputs_per_cell
        )
        self.outcome = OutcomeHeads(spec, size, num_context + 2 * channels)
        self.bins = RewardBins(spec.reward_range, size.reward_bins)
        self._lean_to_copying()

    def _lean_to_copying(self) -> None:
        with torch.no_grad():
            self.cell_head.weight.mul_(0.3)
            self.plane_head.weight.mul_(0.1)
            self.plane_head.bias.zero_()
            bias = self.cell_head.bias.view(self.outputs_per_cell, -1)
            bias.zero_()
            bias[0] = COPY_BIAS
            bias[-1] = COPY_BIAS  # log scale: wide before it knows better

    def encode(self, observation: Tensor, action: Tensor) -> Encoding:
        """Encode observations uint8 [N, C, H, W] and actions int64 [N]."""
        spatial, scalars = self.split(observation)
        kind = self.action_embedding(self.kinds[action])
        numbers = scalars.float() / 255.0
        means = self.enter(torch.cat([kind, numbers, self.tables(scalars.long())], -1))
        means = functional.relu(means)
        film = self.film_action(means)[:, None, None].chunk(4, -1)
        things = flatten_board(spatial)
        seen = things.sqrt()  # a wounded unit stays visible
        seen = seen.view(-1, self.spec.num_rows, self.spec.num_columns, seen.shape[-1])
        if self.names_cells:
            seen = torch.cat([seen, self._mark_target(action)], -1)
        first = functional.relu(_convolve(self.conv1, seen) + self.position)
        mixed = first * (1.0 + film[0]) + film[1]
        second = functional.relu(mixed + _convolve(self.conv2, mixed))
        board = second * (1.0 + film[2]) + film[3]
        places = functional.relu(self.readout(functional.relu(self.narrow(board)).flatten(1)))
        context = torch.cat([_pool(board), places, means], -1)
        outlook = torch.cat([places, means, self.near(spatial)], -1)
        return Encoding(board, context, outlook, things, spatial[:, self.moving], scalars)

    def split(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Spatial planes [N, S, H, W] and scalars [N, U] of an observation."""
        count = self.spec.num_spatial
        return observation[:, :count], observation[:, count:, 0, 0]

    def _mark_target(self, action: Tensor) -> Tensor:
        cells = self.cells[action]
        target = torch.zeros(action.shape[0], self.spec.num_rows * self.spec.num_columns)
        target.scatter_(1, cells.clamp_min(0)[:, None], (cells != NO_CELL).float()[:, None])
        return target.view(-1, self.spec.num_rows, self.spec.num_columns, 1)

    def reveal_economy(self, encoding: Encoding, changes: Tensor) -> Tensor:
        """The trunk's last layer [N, H, W, F], given the changes of the uniform planes."""
        known = self.economy.embed_changes(changes).sum(1)
        scale, shift = self.film_economy(known)[:, None, None].chunk(2, -1)
        mixed = encoding.board * (1.0 + scale) + shift
        return functional.relu(mixed + _convolve(self.conv3, mixed))

    def find_cells(
        self, encoding: Encoding, changes: Tensor, board: Tensor, places: Tensor
    ) -> CellDistribution:
        """Distributions of all moving planes at `places`, over [M, P] flattened.

        places: int64 [M], into the N * H * W places of the boards.
        """
        planes, rows, columns = encoding.planes.shape[1:]
        area = rows * columns
        image, place = places // area, places % area
        outputs = self.cell_head(board.flatten(0, 2).index_select(0, places))
        outputs = outputs + self._judge_planes(encoding, changes).index_select(0, image)
        outputs = outputs.view(places.numel(), self.outputs_per_cell, planes).transpose(0, 1)
        flat = (image[:, None] * planes + torch.arange(planes)) * area + place[:, None]
        candidates = gather_candidates(
            encoding.planes, self.size.shifts, self.step_results, flat.flatten()
        )
        return build_distribution(outputs.reshape(self.outputs_per_cell, -1), candidates)

    @torch.no_grad()
    def open_cells(self, encoding: Encoding, changes: Tensor, board: Tensor) -> OpenCells:
        """All cells of all moving planes, for who asks for single values and for few of them."""
        head = self.cell_head
        return OpenCells(
            torch.addmm(head.bias[:, None], head.weight, board.flatten(0, 2).T),
            self._judge_planes(encoding, changes),
            encoding.planes.contiguous(),
            self.size.shifts,
            self.step_results,
        )

    def _judge_planes(self, encoding: Encoding, changes: Tensor) -> Tensor:
        known = self.economy.embed_changes(changes).sum(1)
        judged: Tensor = self.plane_head(torch.cat([encoding.context, known], -1))
        return judged

    def judge(self, encoding: Encoding, state: NextState, action_mask: Tensor) -> Outcome:
        """Reward, end and next mask of the transition to `state`."""
        planes, scalars = self.split(state.observation)
        features = torch.cat([encoding.context, _pool(state.board)], -1)
        seen = OutcomeInput(
            features, scalars, state.changes, state.board, encoding.things, planes, action_mask
        )
        outcome: Outcome = self.outcome(seen)
        return outcome

    @torch.no_grad()
    def decode(
        self, observation: Tensor, action: Tensor, generator: torch.Generator | None
    ) -> Tensor:
        """Next observations uint8 [N, C, H, W]: sampled, or the likeliest without a generator."""
        encoding = self.encode(observation, action)
        changes = self.economy.decode(encoding.outlook, encoding.scalars, generator)
        board = self.reveal_economy(encoding, changes)
        planes = self._decode_planes(self.open_cells(encoding, changes, board), generator)
        following = observation.clone()
        following[:, self.moving] = planes
        scalars = apply_changes(encoding.scalars, changes)
        following[:, self.spec.num_spatial :] = scalars[:, :, None, None]
        return following

    def _decode_planes(self, cells: OpenCells, generator: torch.Generator | None) -> Tensor:
        own = cells.planes
        stays = cells.find_masses(own)
        offsets = None
        if generator is not None:
            offsets = torch.rand(own.shape[:2], generator=generator)[:, self.event_of_plane]
        decoded = decode_cells(
            own.flatten().float(),
            stays.masses.flatten(),
            cells.select,
            stays.is_lone,
            offsets,
            generator,
        )
        return decoded.view_as(own)


def _pool(board: Tensor) -> Tensor:
    # A mean would hide one thing among hundreds of cells; it is counted instead.
    return torch.cat([board.amax((1, 2)), board.sum((1, 2)) * SUM_UNIT], -1)


def _convolve(layer: nn.Conv2d, board: Tensor) -> Tensor:
    """Convolve [N, H, W, F]; permuted, that is the memory format that is fastest on CPUs."""
    convolved: Tensor = layer(board.permute(0, 3, 1, 2))
    return convolved.permute(0, 2, 3, 1)


def _number_events(spec: GeneratorSpec) -> Tensor:
    """For each moving plane the plane whose random offset it shares: its own or its group's."""
    place = {plane: index for index, plane in enumerate(spec.moving_planes)}
    events = list(range(len(place)))
    for group in spec.event_plane_groups:
        members = [place[plane] for plane in group if plane in place]
        for member in members:
            events[member] = members[0]
    return torch.tensor(events)
