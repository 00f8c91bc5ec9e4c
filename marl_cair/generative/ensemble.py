"""Independently seeded networks that learn from different batches, and what they think of a row."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from marl_cair.generative.families import Member, choose_family
from marl_cair.generative.loss import RareCorrection
from marl_cair.generative.networks.steps import StepTable
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights
from marl_cair.ranges import COUNT, read_number

SEED_STRIDE = 1_000_003  # members' seeds lie apart, also for neighbouring generator seeds
WARMUP_UPDATES = 30  # of each member
MIN_AVERAGE_SHARE = 0.005  # of the newest weights in the average
CHUNK_ROWS = 16  # of boards at a time: what is computed for each cell then stays in the cache


class Opinions(NamedTuple):
    """What M members say of N transitions with given next states."""

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
        self._family = choose_family(spec)
        self.members: list[Member] = []
        for member in range(config.num_members):
            # torch's layers draw their start values from the global generator; leave it as it was.
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(config.seed + SEED_STRIDE * (member + 1))
                self.members.append(self._family.make(spec, config.size))
        self.optimizers = [
            torch.optim.Adam(self._family.group_parameters(network, config), fused=True)
            for network in self.members
        ]
        # Opinions and proposals come from moving averages of the weights. In Deep RTS 1v1 these
        # explain 0.79, 0.65, 0.92 of the rewards' variance at 41, 61, 82 thousand decisions, the
        # members themselves 0.75, 0.56, 0.82.
        self.averages = copy.deepcopy(self.members)
        self.steps = StepTable(len(spec.moving_planes), config.size.steps)
        self.num_updates = 0

    def count_steps(self, rows: TensorDict) -> None:
        """Take note of the steps that values take in real transitions."""
        self._family.note(self.averages + self.members, self.steps, rows)

    def train(
        self, rows: TensorDict, correction: RareCorrection, generator: torch.Generator
    ) -> dict[str, float]:
        """One optimiser step of the next member in turn; returns its losses in nats per row."""
        member = self.num_updates % len(self.members)
        network, optimizer = self.members[member], self.optimizers[member]
        stride = self.config.quiet_stride
        offset = int(torch.randint(stride, (), generator=generator))
        network.outcome.reward_std.fill_(correction.reward_variance**0.5)
        losses = self._family.find_losses(network, rows, correction, stride, offset)
        total = torch.stack(list(losses.values())).sum()
        optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(total)
        norm = nn.utils.clip_grad_norm_(network.parameters(), self.config.max_grad_norm)
        # Full steps from the first one on leave some members with a trunk of dead channels.
        warm = min(1.0, (self.num_updates // len(self.members) + 1) / WARMUP_UPDATES)
        for group in optimizer.param_groups:
            group["lr"] = warm * group["peak"]
        # One bad batch must not turn every weight into NaN for the rest of the run.
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

        Sampled, or the likeliest where `generator` is None.
        """
        following = torch.empty_like(observation)
        for member, network in enumerate(self.averages):
            places = torch.arange(observation.shape[0])[member :: len(self.members)]
            for part in torch.split(places, CHUNK_ROWS):
                if part.numel():
                    following[part] = network.decode(observation[part], action[part], generator)
        return following

    @torch.no_grad()
    def ask(self, rows: TensorDict) -> Opinions:
        """Every member's opinion of every row, given its next observation."""
        opinions = []
        for network in self.averages:
            answers = [self._family.ask(network, part) for part in _split(rows)]
            opinions.append([torch.cat(part) for part in zip(*answers, strict=True)])
        return Opinions(*(torch.stack(part) for part in zip(*opinions, strict=True)))

    def state_dict(self) -> dict[str, Any]:
        return {
            "members": [network.state_dict() for network in self.members],
            "averages": [network.state_dict() for network in self.averages],
            "steps": self.steps.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
            "num_updates": self.num_updates,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Learning rates stay those of this ensemble.

        Raises ValueError where the state has another number of members, or is damaged.
        """
        if len(state["members"]) != len(self.members):
            raise ValueError(
                f"the saved generator has {len(state['members'])} members, this one "
                f"{len(self.members)}: resume with num_members of the saved run"
            )
        for network, saved in zip(self.members, state["members"], strict=True):
            restore_weights(network, saved, "generator.members")
        for network, saved in zip(self.averages, state["averages"], strict=True):
            restore_weights(network, saved, "generator.averages")
        self.steps.restore(state["steps"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"], strict=True):
            peaks = [group["peak"] for group in optimizer.param_groups]
            restore_optimizer(optimizer, saved, "generator.optimizers")
            for group, peak in zip(optimizer.param_groups, peaks, strict=True):
                group["peak"] = peak
        self.num_updates = read_number(state, "num_updates", COUNT)


def _split(rows: TensorDict) -> list[TensorDict]:
    """Chunks of rows; one empty chunk if there are none."""
    return list(rows.split(CHUNK_ROWS)) if rows.shape[0] else [rows]
