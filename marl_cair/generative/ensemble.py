"""`Ensemble`: independently seeded networks that learn from different batches, and predict rows."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from marl_cair.generative.networks.ccdn import CCDN
from marl_cair.generative.networks.frame_network import FrameCCDN
from marl_cair.generative.networks.outcome import RareCorrection
from marl_cair.generative.networks.steps import StepTable
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights
from marl_cair.ranges import COUNT, read_number

SEED_STRIDE = 1_000_003  # distance of the members' seeds, also for neighbouring generator seeds
WARMUP_UPDATES = 30  # of each member
MIN_AVERAGE_SHARE = 0.005  # of the newest weights in the average
CHUNK_ROWS = 16  # boards at a time: the arrays of all cells then fit the cache


class Predictions(NamedTuple):
    """Predictions of M members for N transitions with given next states."""

    log_prob: Tensor  # [M, N], of the next state: all scalars and all cells
    worst_log_prob: Tensor  # [M, N], of the least likely scalar or cell
    uniform_log_prob: Tensor  # [M, N], of all scalars
    reward: Tensor  # [M, N], expected reward
    reward_is_zero: Tensor  # [M, N], probability of the bin at 0
    terminal: Tensor  # [M, N], probability of the end
    mask: Tensor  # [M, N, A], logits of legal next actions


class Ensemble:
    """M networks with their optimisers; `train` improves one of them, in turn."""

    def __init__(self, spec: GeneratorSpec, config: GeneratorConfig) -> None:
        self.config = config
        self.spec = spec
        # A new kind of observation is a network with the same methods.
        network_class: type[CCDN | FrameCCDN] = FrameCCDN if spec.num_frames > 1 else CCDN
        self.members: list[Any] = []
        for member in range(config.num_members):
            # torch's layers draw their initial weights from the global generator.
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(config.seed + SEED_STRIDE * (member + 1))
                self.members.append(network_class(spec, config.size))
        self.optimizers = [
            torch.optim.Adam(network.group_parameters(config), fused=True)
            for network in self.members
        ]
        # Predictions come from moving averages of the weights. In Deep RTS 1v1 these explain 0.79,
        # 0.65, 0.92 of the rewards' variance at 41, 61, 82 thousand steps, the members themselves
        # 0.75, 0.56, 0.82.
        self.averages = copy.deepcopy(self.members)
        self.steps = StepTable(len(spec.moving_planes), config.size.steps)
        self.num_updates = 0

    def count_steps(self, rows: TensorDict) -> None:
        """Count the steps of values in new real transitions."""
        networks = self.averages + self.members
        networks[0].record_transitions(networks, self.steps, rows)

    def train(
        self, rows: TensorDict, correction: RareCorrection, generator: torch.Generator
    ) -> dict[str, float]:
        """One optimiser step of the next member in turn; returns its losses in nats per row."""
        member = self.num_updates % len(self.members)
        network, optimizer = self.members[member], self.optimizers[member]
        stride = self.config.quiet_stride
        offset = int(torch.randint(stride, (), generator=generator))
        network.outcome.reward_std.fill_(correction.reward_variance**0.5)
        losses = network.compute_losses(rows, correction, stride, offset)
        total = torch.stack(list(losses.values())).sum()
        optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(total)
        norm = nn.utils.clip_grad_norm_(network.parameters(), self.config.max_grad_norm)
        # Full steps from the start leave some members with a trunk of dead channels.
        warm = min(1.0, (self.num_updates // len(self.members) + 1) / WARMUP_UPDATES)
        for group in optimizer.param_groups:
            group["lr"] = warm * group["peak"]
        # One bad batch must not turn all weights into NaN.
        if bool(torch.isfinite(norm)):
            optimizer.step()
        self._average(member)
        self.num_updates += 1
        return {
            **{name: float(loss.detach()) for name, loss in losses.items()},
            "total": float(total.detach()),
            "grad_norm": float(norm),
        }

    @torch.no_grad()
    def _average(self, member: int) -> None:
        """Move the average towards the member; it spans about an eighth of all its updates."""
        share = max(MIN_AVERAGE_SHARE, 9.0 / (self.num_updates // len(self.members) + 9.0))
        average, network = self.averages[member], self.members[member]
        torch._foreach_lerp_(list(average.parameters()), list(network.parameters()), share)
        average.outcome.reward_std.copy_(network.outcome.reward_std)

    @torch.no_grad()
    def propose(
        self, observation: Tensor, action: Tensor, generator: torch.Generator | None
    ) -> Tensor:
        """Next observations uint8 [N, C, H, W]; row n is decoded by member n modulo M.

        Sampled, or the likeliest if `generator` is None.
        """
        following = torch.empty_like(observation)
        for member, network in enumerate(self.averages):
            places = torch.arange(observation.shape[0])[member :: len(self.members)]
            for part in torch.split(places, CHUNK_ROWS):
                if part.numel():
                    following[part] = network.decode(observation[part], action[part], generator)
        return following

    @torch.no_grad()
    def predict(self, rows: TensorDict) -> Predictions:
        """All members' predictions for `rows` [N], given their next observations."""
        chunks = list(rows.split(CHUNK_ROWS)) if rows.shape[0] else [rows]
        predicted = []
        for network in self.averages:
            parts = [network.predict(chunk) for chunk in chunks]
            predicted.append([torch.cat(part) for part in zip(*parts, strict=True)])
        return Predictions(*(torch.stack(part) for part in zip(*predicted, strict=True)))

    def state_dict(self) -> dict[str, Any]:
        return {
            "members": [network.state_dict() for network in self.members],
            "averages": [network.state_dict() for network in self.averages],
            "steps": self.steps.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
            "num_updates": self.num_updates,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`; learning rates stay those of this ensemble.

        Raises ValueError if the state has another number of members, or is damaged.
        """
        if len(state["members"]) != len(self.members):
            raise ValueError(
                f"the saved generator has {len(state['members'])} members, this one "
                f"{len(self.members)}: resume with num_members of the saved run"
            )
        for name, networks in (("members", self.members), ("averages", self.averages)):
            for network, saved in zip(networks, state[name], strict=True):
                restore_weights(network, saved, f"generator.{name}")
        self.steps.restore(state["steps"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"], strict=True):
            peaks = [group["peak"] for group in optimizer.param_groups]
            restore_optimizer(optimizer, saved, "generator.optimizers")
            for group, peak in zip(optimizer.param_groups, peaks, strict=True):
                group["peak"] = peak
        self.num_updates = read_number(state, "num_updates", COUNT)
