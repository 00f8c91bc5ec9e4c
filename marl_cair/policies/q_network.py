"""`QNetwork`: action values of observations, from any body and head."""

from collections.abc import Callable, Sequence
from typing import Any, cast

import torch
from torch import Tensor, nn

from marl_cair import policies
from marl_cair.policies.body import Body, is_image, require_planes, standardise, standardise_changes
from marl_cair.policies.cell_values import CellValues, PlaceValues, check_cells
from marl_cair.policies.config import NAF, CapsuleSizes, QNetworkConfig
from marl_cair.policies.distances import DistanceMaps
from marl_cair.policies.heads import find_points, make_noisy
from marl_cair.policies.outside_check import check_outside

__all__ = ["CapsuleSizes", "QNetwork", "QNetworkConfig", "make_q_network"]

FIRST_VALUES = 0.01  # about their size, before learning, with normalised bodies
UINT8_SCALE = 1.0 / 255.0


class QNetwork(nn.Module):
    """Action values of observations; `make_q_network` makes one from a seed.

    With `config.memory` it is recurrent: each step has a state [N, S], 0 when an episode begins.

    Attributes:
        state_size: S numbers of the state; 0 without memory.
        num_quantiles: K of each action, with the head `quantile`; 0 with others.
        values_shape: of the values of one observation, (A,), or (H, W, A) where an action is chosen
            at each cell (`config.action_shape`): read "[..., A]" so below.

    Raises ValueError for a shape that the body does not support, or `num_actions` below 2.
    """

    middle: Tensor
    reach: Tensor

    def __init__(
        self, config: QNetworkConfig, observation_shape: Sequence[int], num_actions: int
    ) -> None:
        super().__init__()
        if num_actions < 2:
            raise ValueError(
                f"num_actions is {num_actions}, but a network needs at least 2 actions to choose "
                "between: use a scenario with more"
            )
        self.config = config
        self.observation_shape = tuple(int(size) for size in observation_shape)
        self.num_actions = num_actions
        self.values_shape = (*config.action_shape, num_actions)
        is_stack = is_image(self.observation_shape) and self.observation_shape[0] > 1
        if config.frame_differences and not is_stack:
            raise ValueError(
                f"frame_differences is True, but the observation {self.observation_shape} is no "
                "stack of two or more images [F, H, W] such as gray_stack: set it to False"
            )
        if config.vector_low and self.observation_shape != (len(config.vector_low),):
            raise ValueError(
                f"vector_low has {len(config.vector_low)} entries, but the observation shape is "
                f"{self.observation_shape}: give one for each entry of a vector, or none"
            )
        low, high = torch.tensor(config.vector_low), torch.tensor(config.vector_high)
        self.register_buffer("middle", (low + high) / 2, persistent=False)
        self.register_buffer("reach", (high - low) / 2, persistent=False)
        self.distances: DistanceMaps | None = None
        seen = self.observation_shape
        if config.distances:
            board = require_planes("distances", seen)
            self.distances = DistanceMaps(
                board, config.resolve_hidden_width(), config.obstacle_planes
            )
            seen = (2 * board[0], *board[1:])
        self.body: Body = policies.NETWORKS.make(config.body, seen, config)
        self.state_size, num_features = 0, self.body.num_features
        self.memory: nn.Module | None = None
        if config.memory != policies.NO_MEMORY:
            width = config.resolve_memory_width()
            memory = policies.MEMORIES[config.memory](num_features, width)
            self.memory, num_features, self.state_size = memory, width, memory.state_size
        self.num_quantiles = config.resolve_num_quantiles()
        cells, kinds = config.action_cells, config.action_kinds
        if config.reads_cells:
            check_cells(config, self.observation_shape, num_actions)
        self.head = self._make_head(num_features)
        self.cells: CellValues | None = None
        if config.cell_values:
            self.cells = CellValues(self.observation_shape, num_features, cells, kinds)

    def _make_head(self, num_features: int) -> nn.Module:
        config = self.config
        if config.action_shape:
            places = config.action_shape
            return PlaceValues(self.observation_shape, places, num_features, self.num_actions)
        sizes: list[Any] = [num_features, self.num_actions, config.resolve_action_embedding()]
        sizes += [self.num_quantiles] if self.num_quantiles else []
        if config.head == NAF:
            board = self.observation_shape[1], self.observation_shape[2]
            sizes += [find_points(config.action_kinds, config.action_cells, board)]
        head: nn.Module = policies.HEADS.make(config.head, *sizes)
        if self.config.noisy:
            make_noisy(head)
        if self.config.norm != "none":  # features do not shrink: large values would hide rewards
            _shrink_outputs(head)
        return head

    def forward(
        self, observation: Tensor, state: Tensor | None = None, quantiles: bool = False
    ) -> Any:
        """Observation uint8 or float [..., *observation_shape] -> action values float32 [..., A].

        With memory: observation [N, *observation_shape] and state float32 [N, S] -> the values
        [N, A] and the next state [N, S]. Raises ValueError for another or no state.

        quantiles: return the quantiles [..., A, K], whose mean is the values. Raises ValueError if
        the head has none.

        uint8 is scaled to [0, 1] here: it is stored and moved as bytes. Floats are not scaled,
        except vectors with `vector_low` and `vector_high`. Images (from 64 x 64 on, of up to 12
        channels) are standardised, or with `frame_differences` the newest frame and the changes
        before it. Raises ValueError for another shape, TypeError for another dtype.

        Under `torch.autocast` only the body and the kernels of `CellValues` compute in the lower
        precision: path distances are sums of steps, and the values of neighbouring actions differ
        by less than its rounding.
        """
        if self.memory is None:
            return self._find_values(observation, quantiles=quantiles)
        before, after = self._check_state(state, observation.shape[0]), []

        def remember(features: Tensor) -> Tensor:
            memory: Any = self.memory
            seen, following = memory(features, before)
            after.append(following)
            return cast(Tensor, seen)

        return self._find_values(observation, remember, quantiles), after[0]

    def _check_state(self, state: Tensor | None, num_rows: int) -> Tensor:
        if self.memory is None or state is None or state.shape != (num_rows, self.state_size):
            given = "none" if state is None else f"{list(state.shape)}"
            raise ValueError(
                f"the state is {given}, but a network of memory {self.config.memory!r} needs "
                f"[{num_rows}, {self.state_size}]: pass zeros where an episode begins, and then "
                "what the last step returned"
            )
        return state

    def unroll(
        self,
        observations: Tensor,
        state: Tensor | None,
        starts: Tensor,
        quantiles: bool = False,
    ) -> tuple[Tensor, Tensor]:
        """Values of sequences, by a network with memory: only the memory runs step by step.

        Args:
            observations: uint8 or float [T, N, *observation_shape].
            state: float32 [N, S], before the first step.
            starts: bool [T, N], the steps that begin an episode: their state is 0.
            quantiles: return quantiles [T, N, A, K] in place of values, as `forward`.

        Returns:
            Values float32 [T, N, A], and the state after each step, [T, N, S].

        Raises ValueError for another or no state.
        """
        memory: Any = self.memory
        num_steps, num_rows = starts.shape
        states = [self._check_state(state, num_rows)]

        def remember(features: Tensor) -> Tensor:
            seen = []
            for rows, begins in zip(features.reshape(num_steps, num_rows, -1), starts, strict=True):
                now, after = memory(rows, states[-1].masked_fill(begins.unsqueeze(1), 0.0))
                seen.append(now)
                states.append(after)
            return torch.cat(seen)

        return self._find_values(observations, remember, quantiles), torch.stack(states[1:])

    def _find_values(
        self,
        observation: Tensor,
        remember: Callable[[Tensor], Tensor] | None = None,
        quantiles: bool = False,
    ) -> Tensor:
        """Values [..., A], or quantiles [..., A, K]; `remember` maps the features [rows, F] of the
        body for the head.
        """
        if quantiles and not self.num_quantiles:
            raise ValueError(
                f"head {self.config.head!r} has no quantiles: use policy.head=quantile"
            )
        num_axes = len(self.observation_shape)
        if tuple(observation.shape[-num_axes:]) != self.observation_shape:
            raise ValueError(
                f"the observation has shape {tuple(observation.shape)}, but this network reads "
                f"[..., {', '.join(map(str, self.observation_shape))}]: use the representation "
                "that the network was made for"
            )
        batch_shape = observation.shape[:-num_axes]
        rows = observation.reshape(-1, *self.observation_shape)
        kind = observation.device.type
        is_reduced = torch.is_autocast_enabled(kind)
        with torch.autocast(kind, enabled=False):
            seen = self._prepare(rows)
            features = self._find_features(seen, is_reduced)
            if remember is not None:
                features = remember(features)
            values = self.read_values(seen, features, is_reduced)
        if self.num_quantiles and not quantiles:
            values = values.mean(-1)
        return values.reshape(*batch_shape, *values.shape[1:])

    def read_values(self, planes: Tensor, features: Tensor, is_reduced: bool = False) -> Tensor:
        """What the head makes of prepared observations and features [N, F]: values [N, A], or
        quantiles [N, A, K].
        """
        if self.config.action_shape:
            values: Tensor = self.head(planes, features, is_reduced)
            return values
        values = self.head(features)
        return values if self.cells is None else self.cells(planes, features, values, is_reduced)

    def _prepare(self, rows: Tensor) -> Tensor:
        seen = _to_float(rows, self.body.READS_CHANNELS_LAST)
        if self.config.frame_differences:
            return standardise_changes(seen)
        if self.config.vector_low:
            return (seen - self.middle) / self.reach
        return standardise(seen) if is_image(self.observation_shape) else seen

    def _find_features(self, seen: Tensor, is_reduced: bool) -> Tensor:
        planes, read = seen, None
        if self.distances is not None:
            planes, read = self.distances(seen)
        with torch.autocast(seen.device.type, enabled=is_reduced):
            features: Tensor = self.body(planes)
        return features.float() if read is None else read + features.float()


def make_q_network(
    config: QNetworkConfig, observation_shape: Sequence[int], num_actions: int, seed: int | None
) -> QNetwork:
    """Return a new network on the CPU; equal seeds give equal bits.

    With a seed torch's global random state does not change; None draws the weights from it.
    Raises ValueError as `QNetwork`, and OutsideCodeError as `check_outside`.
    """
    if seed is None:
        network = QNetwork(config, observation_shape, num_actions)
    else:
        with torch.random.fork_rng(devices=[]):
            # Layers draw from this generator only. torch.manual_seed would reseed the GPUs too.
            torch.default_generator.manual_seed(seed)
            network = QNetwork(config, observation_shape, num_actions)
    check_outside(network)
    return network


@torch.no_grad()
def _shrink_outputs(head: nn.Module) -> None:
    """Scale the weights of a head by FIRST_VALUES: of layers in a row only the last one's."""
    rows = [layer for layer in head.modules() if isinstance(layer, nn.Sequential)]
    weighty = [[layer for layer in row if [*layer.parameters()]] for row in rows]
    kept = {id(w) for row in weighty for layer in row[:-1] for w in layer.parameters()}
    for weight in head.parameters():
        if id(weight) not in kept:
            weight.mul_(FIRST_VALUES)


def _to_float(observation: Tensor, channels_last: bool) -> Tensor:
    if observation.dtype == torch.uint8:
        if channels_last:  # bytes are moved 3 times as fast as floats
            observation = observation.contiguous(memory_format=torch.channels_last)
        return observation.float().mul_(UINT8_SCALE)
    if observation.is_floating_point():
        return observation.float()
    raise TypeError(
        f"the observation has dtype {observation.dtype}, but must be torch.uint8 (0..255, scaled "
        "by the network) or floating point (taken as it is): convert it with .float()"
    )
