"""CCDN: the conditional convolution-deconvolution network, with a copy gate at every cell.

    s, own and others' actions ── board trunk, FiLM ┬─ sources: copy, neighbour, empty ── base
                                                    ├─ edits: where the base is wrong
                                                    └─ differences of edited values ── next board
                                  s and next board ── next scalars
                                        s and s' ── reward, end, next action mask

The thesis multiplies a state stream and an action stream, reduced to one vector. Here the product
is taken at every cell, without a bottleneck, and the next state is predicted directly: planes of
one event (`boards.find_layers`) take over the values of one cell, and few values are edited.
Pictures have another network (`frames.FrameCCDN`).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.boards import find_layers
from marl_cair.generative.networks.decoding import decode_board
from marl_cair.generative.networks.gradients import apply_curves, score_board
from marl_cair.generative.networks.outcome import Outcome, OutcomeHeads, OutcomeInput, pool
from marl_cair.generative.networks.trunk import ActionReader, Trunk
from marl_cair.generative.networks.values import NUM_VALUES, ValueHead
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

COPY_BIAS = 3.0  # logit of "keeps its value" before training: almost every value does
CHANGE_GAIN = 5.0  # a change is one unit, a sum a dozen
NARROW = 8  # channels of the read-out that keeps positions
_VIEWS = ((), (2,), (3,), (2, 3))  # in which another player's view may be mirrored


class Encoding(NamedTuple):
    """Features of a state and the actions of all players."""

    seen: Tensor  # [N, F, H, W], of the state alone, above 0
    board: Tensor  # [N, F, H, W]
    context: Tensor  # [N, D]
    planes: Tensor  # uint8 [N, P, H, W], the moving planes now
    scalars: Tensor  # uint8 [N, U] now


class Choices(NamedTuple):
    """Logits of the next board: L layers with K sources each, then P planes that may be edited."""

    of_cells: Tensor  # [N, L * K + P, H, W]
    of_boards: Tensor  # [N, L * K + P], added on the whole board


class Sequel(NamedTuple):
    """Features of the next board, and of what happened on it."""

    seen: Tensor  # [N, F, H, W], of the next board alone, above 0
    pooled: Tensor  # [N, 3 F], of both boards
    context: Tensor  # [N, D]


class CCDN(nn.Module):
    """A distribution over (next state, reward, end, mask) for planes uint8 [N, C, H, W].

    Actions are int64 [N], those of the other seats [N, O], -1 where unknown.
    """

    moving: Tensor
    cells: Tensor
    layer_of: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        self.spec, self.size = spec, size
        self.layers = find_layers(spec)
        num_moving, layers = len(spec.moving_planes), enumerate(self.layers)
        layer_of = {plane: number for number, layer in layers for plane in layer}
        for name, numbers in (
            ("moving", spec.moving_planes),
            ("cells", (*spec.cells, NO_CELL)),
            ("layer_of", [layer_of[plane] for plane in range(num_moving)]),
        ):
            self.register_buffer(name, torch.tensor(numbers), persistent=False)
        self.num_choices = len(self.layers) * (len(size.shifts) + 2)
        self._make_trunk()
        outputs, hidden = self.num_choices + num_moving, size.hidden
        self.choose = nn.Conv2d(size.channels, outputs, 1)
        # The kind of a purchase is known for the whole board, its place for each cell: the sum of
        # both logits means "this kind, here" without a channel for each pair.
        self.choose_all = nn.Linear(hidden, outputs)
        self.of_cell = nn.Linear(size.channels, hidden)
        # Units that are gone have scored, or fell: what happened is known best from both boards.
        num_known = 3 * size.channels + hidden
        self.compare = nn.Linear(num_known, hidden)
        self.edit_scalars = nn.Linear(hidden, spec.num_uniform) if spec.num_uniform else None
        self.value = ValueHead(num_moving + spec.num_uniform, hidden)
        num_known += spec.num_uniform * (3 + size.table_width)
        self.outcome = OutcomeHeads(spec, size, num_known)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._begin_with_copies()

    def _make_trunk(self) -> None:
        spec, size = self.spec, self.size
        channels, hidden, uniform = size.channels, size.hidden, spec.num_uniform
        self.actions = ActionReader(spec, size)
        self.tables = nn.Embedding(max(1, uniform) * NUM_VALUES, size.table_width)
        self.enter = nn.Linear(self.actions.num_features + uniform * (1 + size.table_width), hidden)
        self.trunk = Trunk(size)
        # What a value means is learned for each plane: health, progress, count.
        values = (torch.arange(NUM_VALUES) / 255.0).sqrt()  # a wounded unit stays visible
        self.curve = nn.Parameter(values.repeat(spec.num_spatial)[:, None])
        rows, columns = spec.num_rows, spec.num_columns
        self.see = nn.Conv2d(spec.num_spatial, channels, 3, padding=1)
        names_cells = any(cell != NO_CELL for cell in spec.cells)
        marks = names_cells * (1 + len(_VIEWS) * (spec.num_others > 0))
        self.mark = nn.Conv2d(marks, channels, 3, padding=1, bias=False) if marks else None
        # Encodes the board's edges and spawn columns.
        self.position = nn.Parameter(torch.zeros(channels, rows, columns))
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
        """Features [N, F, H, W] of a board alone, before the rectifier."""
        planes = observation[:, : self.spec.num_spatial]
        board = apply_curves(planes, self.curve[:, 0])
        seen: Tensor = self.see(board.contiguous(memory_format=torch.channels_last))
        return seen + self.position

    def encode(self, observation: Tensor, action: Tensor, others: Tensor) -> Encoding:
        """Encode states and actions."""
        scalars = observation[:, self.spec.num_spatial :, 0, 0]
        words = [self.actions(action, others), *self._read(scalars)]
        means = functional.relu(self.enter(torch.cat(words, 1)))
        seen = self.look(observation)
        board = seen
        if self.mark is not None:
            board = board + self.mark(self._mark_targets(action, others))
        board = self.trunk(board, means)
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
            named = self.cells[actions]  # the last one, -1, is of unknown actions
            plane = torch.zeros(len(actions), rows * columns, device=actions.device)
            plane.scatter_add_(1, named.clamp_min(0), (named != NO_CELL).float())
            return plane.view(-1, 1, rows, columns)

        marks = [mark(action[:, None])]
        if self.spec.num_others:
            theirs = mark(others)
            marks += [theirs.flip(axes) for axes in _VIEWS]
        return torch.cat(marks, 1).contiguous(memory_format=torch.channels_last)

    def find_choices(self, encoding: Encoding) -> Choices:
        """Logits of sources and edits of a board."""
        return Choices(self.choose(encoding.board), self.choose_all(encoding.context))

    def follow(self, encoding: Encoding, following: Tensor) -> Sequel:
        """Features of the board of the observations `following`."""
        seen = functional.relu(self.look(following))
        largest, total = pool(seen)
        change = (total - pool(encoding.seen)[1]) * CHANGE_GAIN
        pooled = torch.cat([largest, total, change], 1)
        context = functional.relu(self.compare(torch.cat([pooled, encoding.context], 1)))
        context = context + encoding.context
        return Sequel(seen, pooled, context)

    def find_differences(
        self, context: Tensor, edited: Tensor, base: Tensor, board: Tensor | None = None
    ) -> Tensor:
        """Logits [M, 256] of the differences to `base` of the M values `edited`: bool [N, P, H, W]
        with the features `board` of the cells, or [N, U] of scalars.
        """
        image, plane, *cell = edited.nonzero().T
        features = context[image]
        if board is None:
            plane = plane + len(self.moving)
        else:
            row, column = cell
            features = features + self.of_cell(board[image, :, row, column])
        logits: Tensor = self.value(features, plane, base[edited].long())
        return logits

    def predict_outcome(
        self, encoding: Encoding, sequel: Sequel, rows: TensorDict, following: Tensor
    ) -> Outcome:
        """Reward, end and next mask of the transitions from `rows` to `following`."""
        num_spatial = self.spec.num_spatial
        later = following[:, num_spatial:, 0, 0]
        change = (later.float() - encoding.scalars.float()) * (8.0 / 255.0)
        scalars = [*self._read(later), change, change.sign()]
        seen = OutcomeInput(
            sequel.seen,
            torch.cat([sequel.pooled, sequel.context, *scalars], 1),
            (rows["observation"][:, :num_spatial], following[:, :num_spatial]),
            rows["action_mask"],
        )
        outcome: Outcome = self.outcome(seen)
        return outcome

    def compute_losses(
        self, rows: TensorDict, others: Tensor, weights: Tensor, end_log_odds: float
    ) -> dict[str, Tensor]:
        """Mean losses of `rows` by head: negative log likelihoods in nats per row.

        weights: [N], true density of the rows over that in the batch; end_log_odds: see
        `OutcomeHeads.compute_losses`.
        """
        observation, following = rows["observation"], rows["next", "observation"]
        encoding = self.encode(observation, rows["action"], others)
        choices = self.find_choices(encoding)
        cells = self._find_board_loss(encoding, choices, following[:, self.moving])
        losses = {"cells": (cells * weights).mean()}
        # Half of the rows show the board as it is predicted: its errors must not mislead the rest.
        following = following.clone()
        half = Choices(*(part[::2] for part in choices))
        of_half = Encoding(*(part[::2] for part in encoding))
        following[::2, self.moving] = self._draw_board(of_half, half, None)[0]
        sequel = self.follow(encoding, following)
        if self.edit_scalars is not None:
            changes, now = self.edit_scalars(sequel.context), encoding.scalars
            then = following[:, self.spec.num_spatial :, 0, 0]
            changed = now != then
            nll = self._find_difference_nll(sequel.context, changed, now, then)
            nll = nll + functional.binary_cross_entropy_with_logits(
                changes, changed.float(), reduction="none"
            ).sum(1)
            losses["scalars"] = (nll * weights).mean()
        outcome = self.predict_outcome(encoding, sequel, rows, following)
        real = slice(1, None, 2)
        return losses | self.outcome.compute_losses(outcome, rows, end_log_odds, real)

    def _find_board_loss(self, encoding: Encoding, choices: Choices, later: Tensor) -> Tensor:
        """Loss [N] of the predicted board, of which `later` is true, uint8 [N, P, H, W]."""
        logits = choices.of_cells + choices.of_boards[..., None, None]
        shifts = self.size.shifts
        nll, base, edited = score_board(logits, encoding.planes, later, self.layer_of, shifts)
        known = encoding.context, edited, base, later, encoding.board
        return nll + self._find_difference_nll(*known)

    def _find_difference_nll(
        self,
        context: Tensor,
        edited: Tensor,
        base: Tensor,
        later: Tensor,
        board: Tensor | None = None,
    ) -> Tensor:
        """Negative log likelihood [N] of by how much `later` differs from `base`."""
        nll = base.new_zeros(len(base), dtype=torch.float32)
        if not bool(edited.any()):
            return nll
        found = self.find_differences(context, edited, base, board)
        wanted = (later[edited].long() - base[edited].long()) % NUM_VALUES
        each = functional.cross_entropy(found, wanted, reduction="none")
        return nll.index_add(0, edited.nonzero()[:, 0], each)

    @torch.no_grad()
    def decode(
        self, rows: TensorDict, others: Tensor, generator: torch.Generator | None
    ) -> tuple[Tensor, Tensor, Outcome]:
        """Next observations of `rows`, sampled, or the likeliest if `generator` is None; the log
        probabilities [N] of the likeliest; and the outcome. `generator` is on the CPU.
        """
        observation = rows["observation"]
        encoding = self.encode(observation, rows["action"], others)
        following = observation.clone()
        choices = self.find_choices(encoding)
        following[:, self.moving], surety = self._draw_board(encoding, choices, generator)
        sequel = self.follow(encoding, following)
        if self.edit_scalars is not None:
            logits = self.edit_scalars(sequel.context)
            edited = logits > 0.0
            if generator is not None:
                edited = torch.rand(logits.shape, generator=generator).to(logits) < logits.sigmoid()
            surety += functional.logsigmoid(logits.abs()).sum(1)
            scalars = self._edit(sequel.context, edited, encoding.scalars, surety, generator)
            following[:, self.spec.num_spatial :] = scalars[:, :, None, None]
        return following, surety, self.predict_outcome(encoding, sequel, rows, following)

    @torch.no_grad()
    def judge(self, rows: TensorDict, others: Tensor) -> Outcome:
        """The outcome of real transitions, from their own next states."""
        following = rows["next", "observation"]
        encoding = self.encode(rows["observation"], rows["action"], others)
        return self.predict_outcome(encoding, self.follow(encoding, following), rows, following)

    @torch.no_grad()
    def _draw_board(
        self, encoding: Encoding, choices: Choices, generator: torch.Generator | None
    ) -> tuple[Tensor, Tensor]:
        """The next board, uint8 [N, P, H, W], and the log probability [N] of the likeliest one."""
        drawn = None
        if generator is not None:
            shape = len(encoding.planes), len(self.layers), 1 + encoding.planes[0, 0].numel()
            drawn = torch.rand(shape, generator=generator)
        base, edited, surety = decode_board(
            choices.of_cells.detach(),
            choices.of_boards.detach(),
            encoding.planes,
            self.layer_of,
            self.size.shifts,
            drawn,
        )
        known = encoding.context, edited, base, surety, generator, encoding.board
        return self._edit(*known), surety

    def _edit(
        self,
        context: Tensor,
        edited: Tensor,
        base: Tensor,
        surety: Tensor,
        generator: torch.Generator | None,
        board: Tensor | None = None,
    ) -> Tensor:
        """`base` with edited values; adds the likeliest ones' log probabilities to `surety` [N]."""
        if not bool(edited.any()):
            return base
        log_prob = self.find_differences(context, edited, base, board).log_softmax(1)
        top, difference = log_prob.max(1)
        surety.index_add_(0, edited.nonzero()[:, 0], top)
        if generator is not None:
            difference = torch.multinomial(log_prob.exp().cpu(), 1, generator=generator)[:, 0]
        values = base.clone()
        values[edited] = ((base[edited].long() + difference.to(base.device)) % NUM_VALUES).to(
            torch.uint8
        )
        return values
