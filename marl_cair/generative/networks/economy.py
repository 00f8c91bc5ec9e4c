"""Joint distribution of the next values of the uniform planes (health, gold, time...).

Each scalar is 0..255, and its change is a class: next = (now + class) mod 256. The planes are
predicted one after the other, each given the changes before it (a neural autoregressive estimator,
Larochelle and Murray 2011), so that the changes of a sample are consistent.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

NUM_VALUES = 256
NUM_DIFFERENCES = 2 * NUM_VALUES - 1
STAY_BIAS = 3.0  # logit of "no change" before training


class ScalarTables(nn.Module):
    """An embedding table per uniform plane: values int64 [N, U] in 0..255 -> [N, U * width].

    Represents exact thresholds (prices, health 0) and wraps (time to the next income).
    """

    def __init__(self, num_uniform: int, width: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(num_uniform * NUM_VALUES, width) * 0.3)
        self.register_buffer("start", torch.arange(num_uniform) * NUM_VALUES, persistent=False)

    start: Tensor

    def forward(self, values: Tensor) -> Tensor:
        return functional.embedding(values + self.start, self.weight).flatten(1)


class EconomyChain(nn.Module):
    """Context [N, D] -> distribution of the changes [N, U] of the uniform planes, in order."""

    start: Tensor
    is_seen: Tensor  # bool [U, 511], the differences -255..255 seen in real transitions

    def __init__(self, context: int, num_uniform: int, hidden: int) -> None:
        super().__init__()
        self.num_uniform = num_uniform
        # Before the first transition no difference is excluded.
        self.register_buffer("is_seen", torch.ones(num_uniform, NUM_DIFFERENCES).bool())
        self.hidden = hidden
        # Not nn.Linear, which warns if a game has no uniform plane.
        self.enter = nn.Parameter(torch.randn(num_uniform * hidden, context) * context**-0.5)
        self.enter_bias = nn.Parameter(torch.zeros(num_uniform * hidden))
        # Each plane has an embedding of its own value: a clock's step depends on it.
        self.own_value = nn.Parameter(torch.randn(num_uniform * NUM_VALUES, hidden) * 0.1)
        self.change_weight = nn.Parameter(torch.randn(num_uniform * NUM_VALUES, hidden) * 0.1)
        self.leave = nn.Parameter(torch.randn(num_uniform, hidden, NUM_VALUES) * hidden**-0.5 * 0.3)
        bias = torch.zeros(num_uniform, 1, NUM_VALUES)
        bias[..., 0] = STAY_BIAS
        self.leave_bias = nn.Parameter(bias)
        self.register_buffer("start", torch.arange(num_uniform) * NUM_VALUES, persistent=False)

    def embed_changes(self, changes: Tensor) -> Tensor:
        """Embed changes int64 [N, U] in 0..255 -> [N, U, hidden]."""
        return functional.embedding(changes + self.start, self.change_weight)

    def record_differences(self, now: Tensor, later: Tensor) -> None:
        """Record the differences between real scalars uint8 [N, U] and the next ones."""
        if bool(self.is_seen.all()):
            self.is_seen.zero_()
            self.is_seen[:, NUM_VALUES - 1] = True  # no difference
        differences = later.long() - now.long() + NUM_VALUES - 1
        self.is_seen.T[differences, torch.arange(self.num_uniform)] = True

    def _find_possible(self, now: Tensor) -> Tensor:
        """Which changes of scalars uint8 [N, U] are differences seen before: bool [U, N, 256]. A
        change of -10 is possible for 100 gold; for 5 gold it would add 246.
        """
        values = now.T.long()[..., None]
        after = (values + torch.arange(NUM_VALUES)) % NUM_VALUES
        differences = (after - values + NUM_VALUES - 1).flatten(1)
        return self.is_seen.gather(1, differences).view(after.shape)

    def _start(self, context: Tensor, now: Tensor) -> Tensor:
        states = functional.linear(context, self.enter, self.enter_bias)
        states = states.view(context.shape[0], self.num_uniform, self.hidden)
        return states + functional.embedding(now.long() + self.start, self.own_value)

    def find_log_prob(self, context: Tensor, now: Tensor, changes: Tensor) -> Tensor:
        """Log probabilities [N, U] of the changes, each given the true ones of earlier planes."""
        if not self.num_uniform:
            return context.new_zeros(context.shape[0], 0)
        known = self.embed_changes(changes)
        before = known.cumsum(1) - known
        hidden = functional.relu(self._start(context, now) + before).transpose(0, 1)
        logits = torch.baddbmm(self.leave_bias, hidden, self.leave)
        nll = functional.cross_entropy(logits.flatten(0, 1), changes.T.flatten(), reduction="none")
        return -nll.view(self.num_uniform, -1).T

    def decode(self, context: Tensor, now: Tensor, generator: torch.Generator | None) -> Tensor:
        """Changes int64 [N, U]: sampled, or the likeliest if `generator` is None.

        Differences that no real transition had (`record_differences`) are left out.
        """
        states = self._start(context, now)
        impossible = ~self._find_possible(now)
        known = context.new_zeros(context.shape[0], self.hidden)
        changes = context.new_zeros(context.shape[0], self.num_uniform, dtype=torch.int64)
        for plane in range(self.num_uniform):
            hidden = functional.relu(states[:, plane] + known)
            logits = hidden @ self.leave[plane] + self.leave_bias[plane]
            logits = logits.masked_fill(impossible[plane], -torch.inf)
            if generator is None:
                change = logits.argmax(-1)
            else:
                change = torch.multinomial(logits.softmax(-1), 1, generator=generator).squeeze(-1)
            known = known + self.change_weight[self.start[plane] + change]
            changes[:, plane] = change
        return changes


def find_changes(now: Tensor, later: Tensor) -> Tensor:
    """Classes int64 [N, U] of the changes between uint8 scalars [N, U]."""
    return (later.long() - now.long()) % NUM_VALUES


def apply_changes(now: Tensor, changes: Tensor) -> Tensor:
    """Scalars uint8 [N, U] after the changes."""
    return ((now.long() + changes) % NUM_VALUES).to(torch.uint8)
