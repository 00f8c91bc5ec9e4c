"""CCDN v2: the conditional convolution deconvolution network, as a distribution over transitions.

    s, a ── board trunk with FiLM from the action ── places ── economy chain: p(scalars' | s, a)
                 └── FiLM from scalars' ── cells: p(planes' | s, a, scalars')
                          └── pooled, both boards, scalars' ── reward, end, next action mask

The thesis multiplies a state stream and an action stream, reduced to one vector. Here the product
is taken at every cell, without a bottleneck, and cells that do not change are copied. The economy
reads sums over neighbouring planes (`readout.NearReadout`), not the pooled trunk.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks import cells as mixture
from marl_cair.generative.networks import economy, outcome, readout
from marl_cair.generative.networks.board_cells import BoardCells
from marl_cair.generative.networks.steps import StepTable
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

READOUT_CHANNELS = 8
COPY_BIAS = 3.0  # logit of "keeps its value" before training: almost every cell does
COUNTED_STRIDE = 8  # steps on the board are counted in one of so many rows


class Encoding(NamedTuple):
    """Features of a state and an action."""

    board: Tensor  # [N, H, W, F]
    context: Tensor  # [N, D]
    economy_context: Tensor  # [N, E], without the pooled trunk's large sums
    spatial: Tensor  # float32 [N, H * W, S], the spatial planes now, 0..1
    planes: Tensor  # uint8 [N, P, H, W], the moving planes now
    scalars: Tensor  # uint8 [N, U] now


class NextState(NamedTuple):
    """A next state, as input of the outcome heads."""

    observation: Tensor  # uint8 [N, C, H, W]
    changes: Tensor  # int64 [N, U]
    board: Tensor  # [N, H, W, F], the trunk given the next economy


class CCDN(nn.Module):
    """One ensemble member for boards: a distribution over (next state, reward, end, mask)."""

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
        # Action stream: the action and the economy.
        self.action_embedding = nn.Embedding(spec.num_kinds, size.action_embedding)
        self.tables = economy.ScalarTables(uniform, size.table_width)
        self.enter = nn.Linear(size.action_embedding + uniform * (1 + size.table_width), hidden)
        self.film_action = nn.Linear(hidden, 4 * channels)
        # State stream. The position bias encodes the board's edges and spawn columns.
        self.conv1 = nn.Conv2d(spec.num_spatial + self.names_cells, channels, 3, padding=1)
        self.position = nn.Parameter(torch.zeros(spec.num_rows, spec.num_columns, channels))
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)
        self.conv3 = nn.Conv2d(channels, channels, 3, padding=1)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        # Pooling loses positions; this read-out keeps them (units in front of the base).
        self.narrow = nn.Linear(channels, READOUT_CHANNELS)
        self.readout = nn.Linear(READOUT_CHANNELS * spec.num_rows * spec.num_columns, hidden)
        # Heads.
        num_context = 2 * channels + 2 * hidden
        self.near = readout.NearReadout(spec.num_spatial, size.near_factors)
        num_outlook = 2 * hidden + self.near.num_sums
        self.economy = economy.EconomyChain(num_outlook, uniform, size.economy_hidden)
        self.film_economy = nn.Linear(size.economy_hidden, 2 * channels)
        steps = torch.arange(256, dtype=torch.uint8).repeat(
            len(spec.moving_planes), size.steps + 1, 1
        )
        self.register_buffer("step_results", steps)  # of the ensemble's `StepTable`
        self.outputs_per_cell = mixture.count_outputs(len(size.shifts), size.steps)
        self.cell_head = nn.Linear(channels, len(spec.moving_planes) * self.outputs_per_cell)
        # The kind of a purchase is known for the whole board, its place for each cell: the sum of
        # both logits means "this kind, here" without a channel for each pair.
        self.plane_head = nn.Linear(
            num_context + size.economy_hidden, len(spec.moving_planes) * self.outputs_per_cell
        )
        self.outcome = outcome.OutcomeHeads(spec, size, num_context + 2 * channels)
        self.bins = outcome.RewardBins(spec.reward_range, size.reward_bins)
        with torch.no_grad():  # initially every cell is copied
            self.cell_head.weight.mul_(0.3)
            self.plane_head.weight.mul_(0.1)
            self.plane_head.bias.zero_()
            bias = self.cell_head.bias.view(self.outputs_per_cell, -1)
            bias.zero_()
            bias[0] = COPY_BIAS
            bias[-1] = COPY_BIAS  # log scale: wide

    def encode(self, observation: Tensor, action: Tensor) -> Encoding:
        """Encode observations uint8 [N, C, H, W] and actions int64 [N]."""
        spatial, scalars = self.split(observation)
        kind = self.action_embedding(self.kinds[action])
        numbers = scalars.float() / 255.0
        entered = self.enter(torch.cat([kind, numbers, self.tables(scalars.long())], -1))
        means = functional.relu(entered)
        film = self.film_action(means)[:, None, None].chunk(4, -1)
        flat = readout.flatten_board(spatial)
        seen = flat.sqrt()  # a wounded unit stays visible
        seen = seen.view(-1, self.spec.num_rows, self.spec.num_columns, seen.shape[-1])
        if self.names_cells:
            seen = torch.cat([seen, self._mark_target(action)], -1)
        first = functional.relu(_convolve(self.conv1, seen) + self.position)
        mixed = first * (1.0 + film[0]) + film[1]
        second = functional.relu(mixed + _convolve(self.conv2, mixed))
        board = second * (1.0 + film[2]) + film[3]
        places = functional.relu(self.readout(functional.relu(self.narrow(board)).flatten(1)))
        context = torch.cat([_pool(board), places, means], -1)
        economy_context = torch.cat([places, means, self.near(spatial)], -1)
        return Encoding(board, context, economy_context, flat, spatial[:, self.moving], scalars)

    def split(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Spatial planes [N, S, H, W] and scalars [N, U] of an observation."""
        count = self.spec.num_spatial
        return observation[:, :count], observation[:, count:, 0, 0]

    def _mark_target(self, action: Tensor) -> Tensor:
        cells = self.cells[action]
        target = torch.zeros(action.shape[0], self.spec.num_rows * self.spec.num_columns)
        target.scatter_(1, cells.clamp_min(0)[:, None], (cells != NO_CELL).float()[:, None])
        return target.view(-1, self.spec.num_rows, self.spec.num_columns, 1)

    def condition_on_changes(self, encoding: Encoding, changes: Tensor) -> Tensor:
        """The trunk's last layer [N, H, W, F], given the changes of the uniform planes [N, U]."""
        known = self.economy.embed_changes(changes).sum(1)
        scale, shift = self.film_economy(known)[:, None, None].chunk(2, -1)
        mixed = encoding.board * (1.0 + scale) + shift
        return functional.relu(mixed + _convolve(self.conv3, mixed))

    def find_cells(
        self, encoding: Encoding, changes: Tensor, board: Tensor, places: Tensor
    ) -> mixture.CellDistribution:
        """Distributions of all moving planes at `places`, over [M, P] flattened.

        places: int64 [M], into the N * H * W places of the boards.
        """
        planes, rows, columns = encoding.planes.shape[1:]
        area = rows * columns
        image, place = places // area, places % area
        outputs = self.cell_head(board.flatten(0, 2).index_select(0, places))
        outputs = outputs + self._compute_plane_logits(encoding, changes).index_select(0, image)
        outputs = outputs.view(places.numel(), self.outputs_per_cell, planes).transpose(0, 1)
        flat = (image[:, None] * planes + torch.arange(planes)) * area + place[:, None]
        candidates = mixture.gather_candidates(
            encoding.planes, self.size.shifts, self.step_results, flat.flatten()
        )
        return mixture.build_distribution(outputs.reshape(self.outputs_per_cell, -1), candidates)

    @torch.no_grad()
    def find_board_cells(self, encoding: Encoding, changes: Tensor, board: Tensor) -> BoardCells:
        """Distributions of all cells of all moving planes, for inference."""
        head = self.cell_head
        return BoardCells(
            torch.addmm(head.bias[:, None], head.weight, board.flatten(0, 2).T),
            self._compute_plane_logits(encoding, changes),
            encoding.planes.contiguous(),
            self.size.shifts,
            self.step_results,
        )

    def _compute_plane_logits(self, encoding: Encoding, changes: Tensor) -> Tensor:
        known = self.economy.embed_changes(changes).sum(1)
        logits: Tensor = self.plane_head(torch.cat([encoding.context, known], -1))
        return logits

    def predict_outcome(
        self, encoding: Encoding, state: NextState, action_mask: Tensor
    ) -> outcome.Outcome:
        """Reward, end and next mask of the transition to `state`."""
        planes, scalars = self.split(state.observation)
        features = torch.cat([encoding.context, _pool(state.board)], -1)
        seen = outcome.OutcomeInput(
            features, scalars, state.changes, state.board, encoding.spatial, planes, action_mask
        )
        predicted: outcome.Outcome = self.outcome(seen)
        return predicted

    @torch.no_grad()
    def decode(
        self, observation: Tensor, action: Tensor, generator: torch.Generator | None
    ) -> Tensor:
        """Next observations uint8 [N, C, H, W]: sampled, or the likeliest without a generator."""
        encoding = self.encode(observation, action)
        changes = self.economy.decode(encoding.economy_context, encoding.scalars, generator)
        board = self.condition_on_changes(encoding, changes)
        cells = self.find_board_cells(encoding, changes, board)
        following = observation.clone()
        following[:, self.moving] = self._decode_planes(cells, generator)
        scalars = economy.apply_changes(encoding.scalars, changes)
        following[:, self.spec.num_spatial :] = scalars[:, :, None, None]
        return following

    def _decode_planes(self, cells: BoardCells, generator: torch.Generator | None) -> Tensor:
        own = cells.planes
        masses, is_empty = cells.find_masses(own)
        offsets = None
        if generator is not None:
            offsets = torch.rand(own.shape[:2], generator=generator)[:, self.event_of_plane]
        decoded = mixture.decode_cells(
            own.flatten().float(), masses.flatten(), cells.select, is_empty, offsets, generator
        )
        return decoded.view_as(own)

    def compute_losses(
        self, rows: TensorDict, correction: outcome.RareCorrection, stride: int, offset: int
    ) -> dict[str, Tensor]:
        """Mean negative log likelihoods of `rows` by head, in nats per row.

        stride, offset: of the cells where no plane changed, every `stride`-th from `offset` on is
        used, with weight `stride`: an unbiased estimate at a fraction of the cost.
        """
        encoding, state, scalar_log_prob = self._encode_transitions(rows)
        cells = self._estimate_cell_nll(encoding, state, stride, offset)
        predicted = self.predict_outcome(encoding, state, rows["action_mask"])
        return {
            "economy": (-scalar_log_prob.sum(-1) * correction.row_weights).mean(),
            "cells": (cells * correction.row_weights).mean(),
            **predicted.compute_losses(self.bins, rows, correction),
        }

    def predict(self, rows: TensorDict) -> tuple[Tensor, ...]:
        """Predictions for `rows` [N] with given next states, in the order of `Predictions`."""
        encoding, state, scalar_log_prob = self._encode_transitions(rows)
        cells = self.find_board_cells(encoding, state.changes, state.board)
        masses, _ = cells.find_masses(state.observation[:, self.moving])
        log_probs = torch.cat([scalar_log_prob, mixture.floor_and_log(masses).flatten(1)], -1)
        predicted = self.predict_outcome(encoding, state, rows["action_mask"])
        of_state = log_probs.sum(-1), log_probs.amin(-1), scalar_log_prob.sum(-1)
        return (*of_state, *predicted.predict(self.bins))

    def _encode_transitions(self, rows: TensorDict) -> tuple[Encoding, NextState, Tensor]:
        """State and action, next state, and log probabilities [N, U] of the scalars."""
        following = rows["next", "observation"]
        encoding = self.encode(rows["observation"], rows["action"])
        changes = economy.find_changes(encoding.scalars, self.split(following)[1])
        log_prob = self.economy.find_log_prob(encoding.economy_context, encoding.scalars, changes)
        board = self.condition_on_changes(encoding, changes)
        return encoding, NextState(following, changes, board), log_prob

    def _estimate_cell_nll(
        self, encoding: Encoding, state: NextState, stride: int, offset: int
    ) -> Tensor:
        """Negative log likelihood [N] of the moving planes of `state`, estimated."""
        later = state.observation[:, self.moving]
        changed = (later != encoding.planes).any(1).flatten()
        quiet = torch.arange(min(offset, changed.numel()), changed.numel(), stride)
        quiet = quiet[~changed[quiet]]
        busy = changed.nonzero().squeeze(-1)
        places = torch.cat([busy, quiet])
        num, planes = later.shape[:2]
        area = changed.numel() // num
        image, place = places // area, places % area
        values = later.flatten(2)[image, :, place].flatten().float()
        cells = self.find_cells(encoding, state.changes, state.board, places)
        log_prob = mixture.find_log_prob(cells, values)
        weights = torch.ones(places.numel())
        weights[busy.numel() :] = float(stride)
        nll = -log_prob.view(-1, planes).sum(-1) * weights
        return torch.zeros(num).index_add(0, image, nll)

    def group_parameters(self, config: GeneratorConfig) -> list[dict[str, Any]]:
        """Parameter groups for Adam, with "peak" learning rates."""
        # The cells' heads read the embedded changes as well.
        of_economy = [
            parameter
            for parameter in (*self.near.parameters(), *self.economy.parameters())
            if parameter is not self.economy.change_weight
        ]
        chosen = {id(parameter) for parameter in of_economy}
        others = [parameter for parameter in self.parameters() if id(parameter) not in chosen]
        rates = (others, config.learning_rate), (of_economy, config.economy_learning_rate)
        return [{"params": group, "lr": rate, "peak": rate} for group, rate in rates]

    @staticmethod
    def record_transitions(members: Sequence[CCDN], steps: StepTable, rows: TensorDict) -> None:
        """Count the steps and differences of values in new real transitions, for all members."""
        now, later = rows["observation"], rows["next", "observation"]
        first = members[0]
        moving, counted = first.moving, slice(None, None, COUNTED_STRIDE)
        steps.count(now[counted][:, moving], later[counted][:, moving], first.size.shifts)
        first.economy.record_differences(*(first.split(planes)[1] for planes in (now, later)))
        for network in members:
            network.step_results.copy_(steps.results)
            network.economy.is_seen.copy_(first.economy.is_seen)


def _pool(board: Tensor) -> Tensor:
    # A mean would hide one unit among hundreds of cells: sums count it.
    return torch.cat([board.amax((1, 2)), board.sum((1, 2)) * readout.SUM_UNIT], -1)


def _convolve(layer: nn.Conv2d, board: Tensor) -> Tensor:
    """Convolve [N, H, W, F] in the channels-last memory format, which is fastest on CPUs."""
    convolved: Tensor = layer(board.permute(0, 3, 1, 2))
    return convolved.permute(0, 2, 3, 1)


def _number_events(spec: GeneratorSpec) -> Tensor:
    """For each moving plane the index of the plane whose random offset it shares, by group."""
    place = {plane: index for index, plane in enumerate(spec.moving_planes)}
    events = list(range(len(place)))
    for group in spec.event_plane_groups:
        members = [place[plane] for plane in group if plane in place]
        for member in members:
            events[member] = members[0]
    return torch.tensor(events)
