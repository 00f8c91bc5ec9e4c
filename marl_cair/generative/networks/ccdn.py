"""CCDN: the conditional convolution-deconvolution network, with a copy gate at every cell.

    s, own and others' actions ── board trunk, FiLM ┬─ sources: copy, neighbour, empty ── base
                                                    ├─ edits: where the base is wrong
                                                    └─ differences of edited values ── s'
                                        s and s' ── reward, end, next action mask

The thesis multiplies a state stream and an action stream, reduced to one vector. Here the product
is taken at every cell, without a bottleneck, and the next state is predicted directly: planes of
one event (`boards.find_layers`) take over the values of one cell, and few values are edited. Frames
are read in patches of pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.boards import choose_patch, find_layers, stack_sources
from marl_cair.generative.networks.decoding import apply_curves, decode_board
from marl_cair.generative.networks.outcome import Outcome, OutcomeHeads, OutcomeInput, pool
from marl_cair.generative.networks.values import NUM_VALUES, ValueHead
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

COPY_BIAS = 3.0  # logit of "keeps its value" before training: almost every value does
NARROW = 8  # channels of the read-out that keeps positions
_VIEWS = ((), (2,), (3,), (2, 3))  # in which another player's view may be mirrored


class Encoding(NamedTuple):
    """Features of a state and the actions of all players."""

    seen: Tensor  # [N, F, H, W], of the state alone
    board: Tensor  # [N, F, H, W]
    context: Tensor  # [N, D]
    planes: Tensor  # uint8 [N, P, H, W], the moving planes now
    scalars: Tensor  # uint8 [N, U] now


class Choices(NamedTuple):
    """Logits of the next state: L layers with K sources each, then P planes that may be edited."""

    of_cells: Tensor  # [N, L * K + P, H, W]
    of_boards: Tensor  # [N, L * K + P], added on the whole board
    scalars: Tensor  # [N, U], whether the scalar changes


class CCDN(nn.Module):
    """A distribution over (next state, reward, end, mask) for planes uint8 [N, C, H, W].

    Actions are int64 [N], those of the other seats [N, O], -1 where unknown.
    """

    moving: Tensor
    kinds: Tensor
    cells: Tensor
    layer_of: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        self.spec, self.size = spec, size
        self.layers = find_layers(spec)
        self.patch = choose_patch(spec.num_rows, spec.num_columns)
        num_moving, layers = len(spec.moving_planes), enumerate(self.layers)
        layer_of = {plane: number for number, layer in layers for plane in layer}
        for name, numbers in (
            ("moving", spec.moving_planes),
            ("kinds", spec.kinds),
            ("cells", (*spec.cells, NO_CELL)),  # the last one is of unknown actions
            ("layer_of", [layer_of[plane] for plane in range(num_moving)]),
        ):
            self.register_buffer(name, torch.tensor(numbers), persistent=False)
        self.num_choices = len(self.layers) * (len(size.shifts) + 2)
        self._make_trunk()
        outputs, hidden = self.num_choices + num_moving, size.hidden
        self.choose = nn.Conv2d(size.channels, outputs * self.patch**2, 1)
        # The kind of a purchase is known for the whole board, its place for each cell: the sum of
        # both logits means "this kind, here" without a channel for each pair.
        self.choose_all = nn.Linear(hidden, outputs)
        self.edit_scalars = nn.Linear(hidden, spec.num_uniform) if spec.num_uniform else None
        self.of_cell = nn.Linear(size.channels, hidden)
        self.of_pixel = nn.Embedding(self.patch**2, hidden)
        self.value = ValueHead(num_moving + spec.num_uniform, hidden)
        self.outcome = OutcomeHeads(spec, size, spec.num_uniform * (3 + size.table_width))
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._begin_with_copies()

    def _make_trunk(self) -> None:
        spec, size = self.spec, self.size
        channels, hidden, uniform = size.channels, size.hidden, spec.num_uniform
        embedded = size.action_embedding
        self.act = nn.Embedding(spec.num_kinds, embedded)
        self.others = nn.Embedding(spec.num_actions + 1, embedded)
        self.tables = nn.Embedding(max(1, uniform) * NUM_VALUES, size.table_width)
        self.enter = nn.Linear(2 * embedded + uniform * (1 + size.table_width), hidden)
        self.film = nn.Linear(hidden, 4 * channels)
        # What a value means is learned for each plane: health, progress, count.
        values = (torch.arange(NUM_VALUES) / 255.0).sqrt()  # a wounded unit stays visible
        self.curve = nn.Parameter(values.repeat(spec.num_spatial)[:, None])
        rows, columns = spec.num_rows // self.patch, spec.num_columns // self.patch
        self.see = nn.Conv2d(spec.num_spatial * self.patch**2, channels, 3, padding=1)
        names_cells = self.patch == 1 and any(cell != NO_CELL for cell in spec.cells)
        marks = names_cells * (1 + len(_VIEWS) * (spec.num_others > 0))
        self.mark = nn.Conv2d(marks, channels, 3, padding=1, bias=False) if marks else None
        # Encodes the board's edges and spawn columns.
        self.position = nn.Parameter(torch.zeros(channels, rows, columns))
        self.convs = nn.ModuleList(
            nn.Conv2d(channels, channels, 3, padding=1) for _ in range(size.depth)
        )
        # Pooling loses positions; this read-out keeps them (units in front of the base).
        self.narrow = nn.Conv2d(channels, NARROW, 1)
        self.places = nn.Linear(NARROW * rows * columns, hidden)
        self.gather = nn.Linear(2 * channels + 2 * hidden, hidden)

    @torch.no_grad()
    def _begin_with_copies(self) -> None:
        bias = torch.zeros(len(self.choose_all.bias))
        bias[: self.num_choices : len(self.size.shifts) + 2] = COPY_BIAS
        bias[self.num_choices :] = -COPY_BIAS
        self.choose.weight.mul_(0.3)
        self.choose_all.weight.mul_(0.1)
        self.choose_all.bias.copy_(bias)
        if self.edit_scalars is not None:
            self.edit_scalars.bias.fill_(-COPY_BIAS)

    def look(self, observation: Tensor) -> Tensor:
        """Features [N, F, H, W] of an observation alone."""
        planes = observation[:, : self.spec.num_spatial]
        if torch.is_grad_enabled():
            first = torch.arange(self.spec.num_spatial, dtype=torch.int32, device=planes.device)
            places = planes.permute(0, 2, 3, 1).to(torch.int32) + first * NUM_VALUES
            board = functional.embedding(places, self.curve).squeeze(-1).permute(0, 3, 1, 2)
        else:
            board = apply_curves(planes, self.curve[:, 0])
        if self.patch > 1:
            board = functional.pixel_unshuffle(board, self.patch)
        seen: Tensor = self.see(board.contiguous(memory_format=torch.channels_last))
        return seen

    def encode(self, observation: Tensor, action: Tensor, others: Tensor) -> Encoding:
        """Encode states and actions."""
        scalars = observation[:, self.spec.num_spatial :, 0, 0]
        others = torch.where(others < 0, self.spec.num_actions, others)
        words = [self.act(self.kinds[action]), self.others(others).sum(1), *self._read(scalars)]
        means = functional.relu(self.enter(torch.cat(words, 1)))
        film = self.film(means)[..., None, None].chunk(4, 1)
        seen = self.look(observation)
        board = seen + self.position
        if self.mark is not None:
            board = board + self.mark(self._mark_targets(action, others))
        board = functional.relu(board) * (1.0 + film[0]) + film[1]
        for conv in self.convs[:-1]:
            board = functional.relu(board + conv(board))
        board = board * (1.0 + film[2]) + film[3]
        board = functional.relu(board + self.convs[-1](board))
        places = functional.relu(self.places(functional.relu(self.narrow(board)).flatten(1)))
        context = functional.relu(self.gather(torch.cat([*pool(board), places, means], 1)))
        return Encoding(functional.relu(seen), board, context, observation[:, self.moving], scalars)

    def _read(self, scalars: Tensor) -> list[Tensor]:
        """Numbers and table entries of scalars uint8 [N, U]: exact prices, clocks, health 0."""
        if not self.spec.num_uniform:
            return []
        first = torch.arange(scalars.shape[1], device=scalars.device) * NUM_VALUES
        return [scalars.float() / 255.0, self.tables(scalars.long() + first).flatten(1)]

    def _mark_targets(self, action: Tensor, others: Tensor) -> Tensor:
        """Planes [N, marks, H, W] of the cells that actions name. Other players name cells of
        their own view, which may be mirrored: these are marked in all four ways.
        """
        rows, columns = self.spec.num_rows, self.spec.num_columns

        def mark(actions: Tensor) -> Tensor:
            named = self.cells[actions]
            plane = torch.zeros(len(actions), rows * columns, device=actions.device)
            plane.scatter_add_(1, named.clamp_min(0), (named != NO_CELL).float())
            return plane.view(-1, 1, rows, columns)

        marks = [mark(action[:, None])]
        if self.spec.num_others:
            theirs = mark(others)
            marks += [theirs.flip(axes) for axes in _VIEWS]
        return torch.cat(marks, 1).contiguous(memory_format=torch.channels_last)

    def find_choices(self, encoding: Encoding) -> Choices:
        """Logits of sources, edits and changed scalars."""
        of_cells = self.choose(encoding.board)
        if self.patch > 1:
            of_cells = functional.pixel_shuffle(of_cells, self.patch)
        scalars = encoding.context.new_zeros(len(of_cells), 0)
        if self.edit_scalars is not None:
            scalars = self.edit_scalars(encoding.context)
        return Choices(of_cells, self.choose_all(encoding.context), scalars)

    def _split_choices(self, choices: Choices) -> tuple[Tensor, Tensor]:
        """Logits of the sources [N, L, K, H, W] and of the edits [N, P, H, W]."""
        logits = choices.of_cells + choices.of_boards[..., None, None]
        num, _, rows, columns = logits.shape
        shape = num, len(self.layers), -1, rows, columns
        sources = logits[:, : self.num_choices].reshape(shape)
        return sources, logits[:, self.num_choices :]

    def find_differences(self, encoding: Encoding, edited: Tensor, base: Tensor) -> Tensor:
        """Logits [M, 256] of the differences to `base` of the M cells `edited`, bool [N, P, H, W].

        Scalars, bool [N, U], have no cell.
        """
        image, plane, *cell = edited.nonzero().T
        features = encoding.context[image]
        if cell:
            row, column = cell
            board = encoding.board[image, :, row // self.patch, column // self.patch]
            pixel = row % self.patch * self.patch + column % self.patch
            features = features + self.of_cell(board) + self.of_pixel(pixel)
        else:
            plane = plane + len(self.moving)
        logits: Tensor = self.value(features, plane, base[edited].long())
        return logits

    def predict_outcome(
        self, encoding: Encoding, observation: Tensor, following: Tensor, action_mask: Tensor
    ) -> Outcome:
        """Reward, end and next mask of the transition to `following`."""
        num_spatial = self.spec.num_spatial
        later = following[:, num_spatial:, 0, 0]
        change = (later.float() - encoding.scalars.float()) * (8.0 / 255.0)
        scalars = [*self._read(later), change, change.sign()]
        seen = OutcomeInput(
            encoding.seen,
            functional.relu(self.look(following)),
            encoding.context,
            torch.cat(scalars, 1),
            (observation[:, :num_spatial], following[:, :num_spatial]),
            action_mask,
        )
        outcome: Outcome = self.outcome(seen)
        return outcome

    def compute_losses(
        self, rows: TensorDict, others: Tensor, weights: Tensor, end_log_odds: float
    ) -> dict[str, Tensor]:
        """Mean negative log likelihoods of `rows` by head, in nats per row.

        weights: [N], true density of the rows over that in the batch; end_log_odds: see
        `OutcomeHeads.compute_losses`.
        """
        observation, following = rows["observation"], rows["next", "observation"]
        encoding = self.encode(observation, rows["action"], others)
        choices = self.find_choices(encoding)
        sources, edits = self._split_choices(choices)
        later = following[:, self.moving]
        nll, base = self._explain(sources, encoding.planes, later)
        cells = nll + self._find_edit_nll(encoding, edits, base, later)
        losses = {"cells": (cells * weights).mean()}
        if self.spec.num_uniform:
            then = following[:, self.spec.num_spatial :, 0, 0]
            nll = self._find_edit_nll(encoding, choices.scalars, encoding.scalars, then)
            losses["scalars"] = (nll * weights).mean()
        outcome = self.predict_outcome(encoding, observation, following, rows["action_mask"])
        return losses | self.outcome.compute_losses(outcome, rows, end_log_odds)

    def _explain(self, logits: Tensor, planes: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """Negative log likelihood [N] of the sources that explain the most planes of each layer,
        and the base [N, P, H, W] from the likeliest of these.
        """
        sources = stack_sources(planes, self.size.shifts)
        match = sources == later[:, None]
        explained = torch.stack(
            [match[:, :, layer].sum(2, dtype=torch.uint8) for layer in self.layers], 1
        )
        best = explained == explained.amax(2, keepdim=True)
        kept = logits.masked_fill(~best, -torch.inf)
        nll = _sum_rows(logits.logsumexp(2) - kept.logsumexp(2))
        return nll, self._take(sources, kept.detach().argmax(2))

    def _take(self, sources: Tensor, chosen: Tensor) -> Tensor:
        """Values [N, P, H, W] of the sources [N, L, H, W] that were chosen for the layers."""
        return sources.gather(1, chosen[:, self.layer_of][:, None]).squeeze(1)

    def _find_edit_nll(
        self, encoding: Encoding, logits: Tensor, base: Tensor, later: Tensor
    ) -> Tensor:
        """Negative log likelihood [N] of where `later` differs from `base`, and by how much."""
        edited = base != later
        nll = _sum_rows(
            functional.binary_cross_entropy_with_logits(logits, edited.float(), reduction="none")
        )
        if not bool(edited.any()):
            return nll
        found = self.find_differences(encoding, edited, base)
        wanted = (later[edited].long() - base[edited].long()) % NUM_VALUES
        each = functional.cross_entropy(found, wanted, reduction="none")
        return nll.index_add(0, edited.nonzero()[:, 0], each)

    @torch.no_grad()
    def decode(
        self, observation: Tensor, action: Tensor, others: Tensor, generator: torch.Generator | None
    ) -> tuple[Tensor, Tensor, Encoding]:
        """Next observations, sampled, or the likeliest if `generator` is None; the log
        probabilities [N] of the likeliest; and the encoding. On a CPU.
        """
        encoding = self.encode(observation, action, others)
        choices = self.find_choices(encoding)
        offsets = None
        if generator is not None:
            offsets = torch.rand(len(observation), len(self.layers), generator=generator)
        base, edited, surety = decode_board(
            choices.of_cells,
            choices.of_boards,
            encoding.planes,
            self.layer_of,
            self.size.shifts,
            offsets,
        )
        following = observation.clone()
        following[:, self.moving] = self._edit(encoding, edited, base, surety, generator)
        if self.spec.num_uniform:
            logits = choices.scalars
            edited = logits > 0.0
            if generator is not None:
                edited = torch.rand(logits.shape, generator=generator) < logits.sigmoid()
            surety += functional.logsigmoid(logits.abs()).sum(1)
            scalars = self._edit(encoding, edited, encoding.scalars, surety, generator)
            following[:, self.spec.num_spatial :] = scalars[:, :, None, None]
        return following, surety, encoding

    def _edit(
        self,
        encoding: Encoding,
        edited: Tensor,
        base: Tensor,
        surety: Tensor,
        generator: torch.Generator | None,
    ) -> Tensor:
        """`base` with edited values; adds the likeliest ones' log probabilities to `surety` [N]."""
        if not bool(edited.any()):
            return base
        log_prob = self.find_differences(encoding, edited, base).log_softmax(1)
        top, difference = log_prob.max(1)
        surety.index_add_(0, edited.nonzero()[:, 0], top)
        if generator is not None:
            difference = torch.multinomial(log_prob.exp(), 1, generator=generator)[:, 0]
        values = base.clone()
        values[edited] = ((base[edited].long() + difference) % NUM_VALUES).to(torch.uint8)
        return values


def _sum_rows(values: Tensor) -> Tensor:
    """Sums [N] of [N, ...]."""
    return values.flatten(1).sum(1)
