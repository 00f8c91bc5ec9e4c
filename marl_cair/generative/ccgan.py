"""`CCGANGenerator`: the CCDN with an adversarial loss from a conditional discriminator.

The thesis tried it and failed. The discriminator judges (state, action, next board): the values
that each cell takes over, and which cells are edited, sampled with straight-through
gradients (Gumbel-softmax, Jang et al. 2017). Its layers have spectral normalisation, its losses
are hinges (Miyato et al. 2018); the action enters by projection (Miyato and Koyama 2018). The
likelihood stays the main loss: its weight is 1, that of the adversarial one is small.
"""

from __future__ import annotations

from typing import Any, cast

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from marl_cair.generative.generator import TRAINING, CCDNGenerator
from marl_cair.generative.networks.boards import is_picture, stack_sources
from marl_cair.generative.networks.ccdn import CCDN
from marl_cair.generative.networks.gradients import score_board
from marl_cair.generative.rare import Correction
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights


class Discriminator(nn.Module):
    """Boards before and after, and kinds of actions -> scores [N], higher for real ones."""

    def __init__(self, spec: GeneratorSpec, channels: int) -> None:
        super().__init__()
        planes, moving = spec.num_spatial, len(spec.moving_planes)
        self.convs = nn.ModuleList(
            spectral_norm(nn.Conv2d(width, channels, 3, padding=1))
            for width in (planes + 3 * moving, channels, channels)
        )
        self.score = spectral_norm(nn.Linear(channels, 1))
        self.of_kind = spectral_norm(nn.Embedding(spec.num_kinds, channels))

    def forward(self, before: Tensor, now: Tensor, later: Tensor, kind: Tensor) -> Tensor:
        """before: [N, S, H, W] of 0..1; now: its moving planes; later: these after the step [N, P,
        H, W], then where they are edited, [N, 2 P, H, W] together; kind: int64 [N].
        """
        values, edited = later.chunk(2, 1)
        board = torch.cat([before, values, values - now, edited], 1)
        for conv in self.convs:
            board = functional.leaky_relu(conv(board), 0.1)
        pooled = board.flatten(2).sum(2) * 0.1  # a mean would hide one unit among hundreds
        score: Tensor = self.score(pooled)[:, 0] + (self.of_kind(kind) * pooled).sum(1)
        return score


class CCGANGenerator(CCDNGenerator):
    """A CCDN that also learns to deceive a discriminator; gate and use are those of `ccdn`."""

    def __init__(self, config: GeneratorConfig, spec: GeneratorSpec) -> None:
        if is_picture(spec):
            raise ValueError(
                "generator.name is ccgan, which judges boards, but these rows are pictures: use "
                "ccdn, or representation=planes"
            )
        super().__init__(config, spec)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed + 1)
            self.discriminator = Discriminator(spec, config.adversarial.channels)
        rate = config.adversarial.learning_rate
        self._judge = torch.optim.Adam(self.discriminator.parameters(), rate, betas=(0.0, 0.9))

    def _compute_losses(
        self, rows: TensorDict, others: Tensor, correction: Correction
    ) -> dict[str, Tensor]:
        """Losses of the network; first one step of the discriminator on the same rows."""
        losses = super()._compute_losses(rows, others, correction)
        network, spec = cast(CCDN, self.network), self.spec
        before = rows["observation"][:, : spec.num_spatial].float() / 255.0
        seen = before, before[:, network.moving], network.actions.kinds[rows["action"]]
        fake, real = self._sample_boards(network, rows, others)
        judge = self.discriminator
        hinge = functional.relu(1.0 - judge(*seen[:2], real, seen[2])).mean()
        hinge = hinge + functional.relu(1.0 + judge(*seen[:2], fake.detach(), seen[2])).mean()
        self._judge.zero_grad(set_to_none=True)
        torch.autograd.backward(hinge)
        if bool(torch.isfinite(hinge)):
            self._judge.step()
        judge.requires_grad_(False)
        deceived = -judge(*seen[:2], fake, seen[2]).mean()
        judge.requires_grad_(True)
        return {**losses, "adversarial": self.config.adversarial.weight * deceived}

    def _sample_boards(
        self, network: CCDN, rows: TensorDict, others: Tensor
    ) -> tuple[Tensor, Tensor]:
        """A sampled next board and the real one, as `Discriminator` reads them."""
        planes, layers = rows["observation"][:, network.moving], network.layer_of
        encoding = network.encode(rows["observation"], rows["action"], others)
        choices = network.find_choices(encoding)
        logits = choices.of_cells + choices.of_boards[..., None, None]
        num, shifts = network.num_choices, network.size.shifts
        rows_columns = logits.shape[2:]
        sources = logits[:, :num].reshape(len(rows), len(network.layers), -1, *rows_columns)
        edits = logits[:, num:]
        chosen = self._draw(sources, 2)[:, layers].transpose(1, 2)
        values = stack_sources(planes.float() / 255.0, shifts)
        on_off = torch.stack([edits, torch.zeros_like(edits)], 1)
        fake = torch.cat([(chosen * values).sum(1), self._draw(on_off, 1)[:, 0]], 1)
        later = rows["next", "observation"][:, network.moving]
        _, base, edited = score_board(logits.detach(), planes, later, layers, shifts)
        return fake, torch.cat([base.float() / 255.0, edited.float()], 1)

    def _draw(self, logits: Tensor, axis: int) -> Tensor:
        """A one-hot sample along `axis`, with the gradient of a softmax."""
        uniform = torch.rand(logits.shape, generator=self._generators[TRAINING]).to(logits.device)
        noise = -(-uniform.clamp_min(1e-20).log()).clamp_min(1e-20).log()
        soft = (logits + noise).softmax(axis)
        hard = torch.zeros_like(soft).scatter_(axis, soft.argmax(axis, keepdim=True), 1.0)
        drawn: Tensor = hard + (soft - soft.detach())
        return drawn

    def _export_network(self) -> dict[str, Any]:
        return {
            **super()._export_network(),
            "discriminator": self.discriminator.state_dict(),
            "judge": self._judge.state_dict(),
        }

    def _import_network(self, state: dict[str, Any]) -> None:
        super()._import_network(state)
        if "discriminator" in state:  # missing in weights of a `ccdn`
            restore_weights(self.discriminator, state["discriminator"], "generator.discriminator")
            restore_optimizer(self._judge, state["judge"], "generator.judge")
