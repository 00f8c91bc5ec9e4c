"""Action selection: masked argmax, epsilon-greedy and sampling, and `PolicyActor`."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from marl_cair.policies.capsule_layers import PartCapsules
from marl_cair.policies.q_network import QNetwork

DRAWS_PER_ROW = 3  # whether to explore, the group, the action
CHUNK_ROWS, GPU_CHUNK_ROWS = 128, 2_048  # activations of 128 stay in the cache of a CPU core


@torch.no_grad()
def masked_argmax(values: Tensor, action_mask: Tensor) -> Tensor:
    """Return the legal action of the largest value, the lowest index among equals: int64 [...].

    `values` float [..., A], `action_mask` bool [..., A]. NaN counts as the lowest value. Raises
    ValueError if a row has no legal action, or the shapes differ.
    """
    if values.shape != action_mask.shape or action_mask.dtype != torch.bool:
        raise ValueError(
            f"the mask has shape {tuple(action_mask.shape)} and dtype {action_mask.dtype}, but the "
            f"values {tuple(values.shape)}: pass a bool mask of the same shape, [N, A] for N rows"
        )
    finite = torch.nan_to_num(values, nan=torch.finfo(values.dtype).min)
    # 1 - 1/mask is 0 or -inf; on a CPU adding it is 3 times as fast as masked_fill.
    penalty = 1.0 - action_mask.to(values.dtype).reciprocal()
    best, actions = (finite + penalty).max(-1)
    _require_legal_actions(best)
    return actions


def find_values(values: Tensor, action: Tensor, action_mask: Tensor | None = None) -> Tensor:
    """Values of the actions int64 [...] out of values float [..., A]: float [...].

    Actions [..., H, W] out of values [..., H, W, A] need action_mask bool [..., H, W, A]; their
    values are those of `average_places`, float [...].
    """
    chosen = values.gather(-1, action.unsqueeze(-1)).squeeze(-1)
    return chosen if action_mask is None else average_places(chosen, action_mask)


def average_places(values: Tensor, action_mask: Tensor) -> Tensor:
    """Values [..., H, W] of the actions at all places -> their mean over those that act, [...].

    A place acts where it has more than one legal action, by action_mask bool [..., H, W, A]. Where
    none does, it is the mean over all.
    """
    acts = (action_mask.sum(-1) > 1).flatten(-2)
    acts |= ~acts.any(-1, keepdim=True)
    sums: Tensor = values.flatten(-2).masked_fill(~acts, 0.0).sum(-1)
    return sums / acts.sum(-1)


class MaskedEpsilonGreedy:
    """Epsilon-greedy over the legal actions of a batch, with its own random generator.

    An exploring row draws a group uniformly from those with a legal action, then a legal action
    uniformly within it: otherwise the 60 cells of one tower kind would outweigh the one action that
    buys a unit. Without `action_groups` (int [A]) all legal actions are equally likely. Where an
    action has a shape, each place explores for itself. Each call always draws 3 numbers for each
    row: the stream depends on the number of rows alone. The generator is on the CPU: every device
    draws the same actions.
    """

    def __init__(self, seed: int, action_groups: npt.ArrayLike | Tensor | None = None) -> None:
        self.generator = torch.Generator()
        self.generator.manual_seed(seed)
        self._groups = None if action_groups is None else _number_groups(action_groups)

    def seed(self, seed: int) -> None:
        """Restart the random stream."""
        self.generator.manual_seed(seed)

    @torch.no_grad()
    def __call__(self, values: Tensor, action_mask: Tensor, epsilon: float | Tensor) -> Tensor:
        """Values float [N, A], mask bool [N, A], epsilon a number or [N] -> actions int64 [N].

        With an action shape: values and mask [N, H, W, A] -> actions [N, H, W].
        Raises ValueError if epsilon is outside 0..1 or a row has no legal action.
        """
        if values.ndim > 2:
            chances = _check_epsilon(epsilon, len(values)).expand(len(values))
            chances = chances.repeat_interleave(math.prod(values.shape[1:-1]))
            flat = self(values.flatten(0, -2), action_mask.flatten(0, -2), chances)
            return flat.view(values.shape[:-1])
        actions = self._exploit(values, action_mask)
        num_rows, num_actions = values.shape
        threshold = _check_epsilon(epsilon, num_rows)
        if self._groups is not None and len(self._groups) != num_actions:
            raise ValueError(
                f"action_groups has {len(self._groups)} entries, but there are {num_actions} "
                "actions: pass one group for each action"
            )
        draws = torch.rand(num_rows, DRAWS_PER_ROW, generator=self.generator, dtype=torch.float64)
        rows = (draws[:, 0] < threshold).nonzero().squeeze(1)
        if len(rows) == 0:
            return actions
        draws, rows = draws[rows, 1:].to(values.device), rows.to(values.device)
        actions[rows] = self._explore(action_mask[rows], draws)
        return actions

    def _exploit(self, values: Tensor, action_mask: Tensor) -> Tensor:
        """Actions int64 [N] of rows that do not explore."""
        return masked_argmax(values, action_mask)

    def _explore(self, legal: Tensor, draws: Tensor) -> Tensor:
        """Legal bool [M, A], draws float64 [M, 2] in [0, 1) -> actions int64 [M]."""
        if self._groups is not None:
            groups = self._groups.to(legal.device)
            members = torch.nn.functional.one_hot(groups).to(torch.float32)
            group_is_legal = legal.to(torch.float32) @ members > 0
            group = _pick_uniformly(group_is_legal, draws[:, 0])
            legal = legal & (groups == group.unsqueeze(1))
        return _pick_uniformly(legal, draws[:, 1])

    def state_dict(self) -> dict[str, Tensor]:
        """Return the state of the generator: {"generator": uint8 [S]}."""
        return {"generator": self.generator.get_state()}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Continue from `state_dict`."""
        try:
            self.generator.set_state(state["generator"].cpu())
        except (RuntimeError, TypeError, AttributeError) as error:
            raise ValueError(f"generator is no random state of torch ({error})") from error


class MaskedSampling(MaskedEpsilonGreedy):
    """As `MaskedEpsilonGreedy`, but rows that do not explore sample from the softmax over the legal
    values (a mixed strategy). Each call draws one more number for each row.
    """

    def _exploit(self, values: Tensor, action_mask: Tensor) -> Tensor:
        finite = torch.nan_to_num(values, nan=torch.finfo(values.dtype).min)
        best = finite.masked_fill(~action_mask, -torch.inf).amax(-1)
        _require_legal_actions(best)
        logits = finite.double().masked_fill(~action_mask, -torch.inf)
        ends = logits.softmax(-1).cumsum(-1)
        draws = torch.rand(len(values), generator=self.generator, dtype=torch.float64)
        # Below the rounded sum: the probability of an illegal action is exactly 0.
        total = ends[:, -1]
        wanted = torch.minimum(draws.to(ends.device) * total, total.nextafter(total.new_zeros(())))
        return (ends > wanted.unsqueeze(1)).to(torch.uint8).argmax(1)


class PolicyActor:
    """A Q-network as an agent: observations and masks -> actions, without gradients.

    `act` is the agent contract (NumPy in and out), `select_actions` the same on tensors. Where an
    action is chosen at each cell, read [N, A] as [N, H, W, A] and actions [N] as [N, H, W].

    Attributes:
        state_size: S numbers of the recurrent state of each row; 0 without memory.
    """

    def __init__(
        self,
        network: QNetwork,
        name: str,
        representation: str,
        exploration: MaskedEpsilonGreedy | None = None,
        epsilon: float = 0.0,
    ) -> None:
        self.network = network
        self.state_size = network.state_size
        self.name = name
        self.representation = representation
        self.exploration = exploration or MaskedEpsilonGreedy(seed=0)
        self.epsilon = epsilon

    @property
    def is_sampled(self) -> bool:
        """Whether actions are sampled instead of greedy."""
        return isinstance(self.exploration, MaskedSampling)

    @property
    def is_deterministic(self) -> bool:
        """Whether actions depend on the observations and the states alone."""
        return not self.is_sampled and self.epsilon == 0.0

    def seed(self, seed: int) -> None:
        """Restart the random stream of the exploration."""
        self.exploration.seed(seed)

    def compute_values(self, observation: Tensor) -> Tensor:
        """Observation [N, *shape] -> values float32 [N, A] on the CPU.

        Raises ValueError for a network with memory: use `step`.
        """
        return self.step(observation, torch.empty(len(observation), 0))[0]

    def step(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """One step of any network, on its device: values float32 [N, A] and the next state, on the
        CPU.

        Args:
            observation: [N, *shape].
            state: float32 [N, state_size].
        """
        device = next(self.network.parameters()).device
        num_rows = CHUNK_ROWS if device.type == "cpu" else GPU_CHUNK_ROWS
        values = torch.empty(len(observation), *self.network.values_shape, device=device)
        after = state.to(device, copy=True)
        with torch.inference_mode():
            for start in range(0, len(observation), num_rows):
                chunk = slice(start, start + num_rows)
                seen = observation[chunk].to(device, non_blocking=True)
                if self.state_size:
                    values[chunk], after[chunk] = self.network(seen, after[chunk])
                else:
                    values[chunk] = self.network(seen)
        return values.cpu(), after.cpu()

    def select_actions(
        self, observation: Tensor, action_mask: Tensor, epsilon: float | Tensor | None = None
    ) -> Tensor:
        """Observation [N, *shape], mask bool [N, A] -> actions int64 [N], all on the CPU.

        `epsilon` (a number or [N]) overrides the agent's own for this call.
        """
        values = self.compute_values(observation)
        chance = self.epsilon if epsilon is None else epsilon
        return self.exploration(values, action_mask, chance)

    def act(
        self,
        observation: npt.NDArray[Any],
        action_mask: npt.NDArray[np.bool_],
        state: npt.NDArray[np.float32] | None = None,
    ) -> Any:
        """Observation [N, *shape], mask bool [N, A] -> actions int64 [N].

        With memory: also state float32 [N, S] -> actions and the next state [N, S].
        """
        before = torch.empty(len(observation), 0) if state is None else _view_tensor(state)
        values, after = self.step(_view_tensor(observation), before)
        mask = _view_tensor(np.asarray(action_mask, bool))  # PettingZoo's are int8
        actions = self.exploration(values, mask, self.epsilon).numpy()
        return (actions, after.numpy()) if self.state_size else actions

    def values(
        self,
        observation: npt.NDArray[Any],
        action_mask: npt.NDArray[np.bool_],
        state: npt.NDArray[np.float32] | None = None,
    ) -> npt.NDArray[np.float32]:
        """Observation [N, *shape], mask bool [N, A] -> action values float32 [N, A], or, where
        actions are sampled, their probabilities.

        Those of illegal actions are -inf. The unit of values is the reward that the agent was
        trained with. state: float32 [N, state_size] before the step; None: as when an episode
        begins. Raises ValueError for a mask of other rows or actions.
        """
        if state is None:
            state = np.zeros((len(observation), self.state_size), np.float32)
        found, _ = self.step(_view_tensor(observation), _view_tensor(state))
        mask = np.asarray(action_mask, bool)
        if mask.shape != tuple(found.shape):
            raise ValueError(
                f"the mask has shape {mask.shape}, but the values have {tuple(found.shape)}: give "
                "observations [N, ...] and masks [N, A] of as many rows"
            )
        if self.is_sampled:
            found = found.masked_fill(~_view_tensor(mask), -torch.inf).softmax(-1)
        return np.where(mask, found.numpy(), np.float32(-np.inf))

    def find_presences(self, observation: npt.NDArray[Any]) -> npt.NDArray[np.float32] | None:
        """Presences float32 [N, T, h, w] of the network's first part capsules in [N, *shape]; None
        without such capsules.
        """
        layers = [part for part in self.network.modules() if isinstance(part, PartCapsules)]
        if not layers:
            return None
        found: list[npt.NDArray[np.float32]] = []
        hook = layers[0].register_forward_hook(
            lambda layer, given, output: found.append(output[1].float().cpu().numpy())
        )
        try:
            all_legal = np.ones((len(observation), self.network.num_actions), np.bool_)
            self.values(observation, all_legal)
        finally:
            hook.remove()
        return np.concatenate(found)

    def state_dict(self) -> dict[str, Tensor]:
        """Return the state of the exploration's generator, without the weights."""
        return self.exploration.state_dict()

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Continue from `state_dict`."""
        self.exploration.load_state_dict(state)


def _pick_uniformly(candidates: Tensor, draws: Tensor) -> Tensor:
    """Candidates bool [M, L], draws float64 [M] in [0, 1) -> index of one of them: int64 [M].

    By counts, not sums of probabilities: rounding never selects an index that is no candidate.
    """
    counts = candidates.cumsum(1, dtype=torch.int32)
    wanted = (draws * counts[:, -1]).to(torch.int32) + 1
    return (counts >= wanted.unsqueeze(1)).to(torch.uint8).argmax(1)


def _number_groups(action_groups: npt.ArrayLike | Tensor) -> Tensor:
    """Return the groups int64 [A] numbered 0, 1, ... without gaps."""
    groups = torch.as_tensor(np.asarray(action_groups))
    if groups.ndim != 1 or groups.is_floating_point() or len(groups) == 0:
        raise ValueError(
            f"action_groups has shape {tuple(groups.shape)} and dtype {groups.dtype}, but must be "
            "one integer for each action, [A]"
        )
    numbered: Tensor = torch.unique(groups, return_inverse=True)[1]
    return numbered


def _check_epsilon(epsilon: float | Tensor, num_rows: int) -> Tensor:
    """Return epsilon as float64 on the CPU, [] or [N]."""
    chance = torch.as_tensor(epsilon, dtype=torch.float64).cpu()
    if chance.shape not in ((), (num_rows,)):
        raise ValueError(
            f"epsilon has shape {tuple(chance.shape)}, but must be a number or one for each of "
            f"the {num_rows} rows"
        )
    if not bool(((chance >= 0.0) & (chance <= 1.0)).all()):
        raise ValueError(f"epsilon is {epsilon}, but a probability must lie in 0..1")
    return chance


def _require_legal_actions(best: Tensor) -> None:
    """Raise ValueError if a best value [N] is -inf: values are finite, so no action was legal."""
    if bool((best == -torch.inf).any()):
        row = int((best == -torch.inf).nonzero()[0, 0])
        raise ValueError(
            f"row {row} of the action mask allows no action: the no-op must always be legal"
        )


def _view_tensor(array: npt.NDArray[Any]) -> Tensor:
    """Return a tensor that shares the array's memory; read-only arrays are copied."""
    array = np.asarray(array)  # tensors too
    return torch.from_numpy(array if array.flags.writeable else array.copy())
