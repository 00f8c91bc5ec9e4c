"""Settings of the generator: a game's transitions, network sizes, gate thresholds, training."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, cast

from marl_cair.policies.config import NO_CELL

if TYPE_CHECKING:
    from marl_cair.replay.transition import TransitionSpec

ARCHITECTURE = 4  # of the network: raised when weights from before no longer fit
MAX_ROUNDS = 4  # of proposals in one call, if many are rejected
# Of an open gate: factor for changed cells, which vary by 0.03; gains of scalars vary by 0.01.
_SLACK_OF_CELLS, _SLACK_OF_GAINS = 0.9, 0.02
_SLACK_WHEN_OPEN = 0.7  # of shares found or explained, which vary by 0.1
MIN_HELDOUT_ROWS = 200  # below this the standard error of a share is above 3 %
CERTAIN_TERMINAL = 0.8  # the network must be this sure of an end, or of none at least
UNKNOWN_SHARE = 0.1  # of rows trained without the other players' actions


def _require(holds: bool, name: str, value: object, allowed: str) -> None:
    if not holds:
        raise ValueError(f"{name} is {value}, expected {allowed}")


@dataclass(frozen=True)
class GeneratorSpec:
    """Shape and meaning of the transitions of one game, from one seat's view.

    observation_shape: (C, H, W) of the uint8 planes; the last `num_uniform` are constant over the
        board, the others are called spatial.
    action_kinds: [A], kind of each action (0, 1, ...); actions of a kind share one embedding.
        None: each action is a kind of its own.
    action_cells: [A], row * W + column of the cell that an action names, NO_CELL without one.
    reward_range: lowest and highest reward of one step.
    static_planes: spatial planes that never change during an episode.
    exclusive_plane_groups: spatial planes of which at most one is above 0 at any cell.
    event_plane_groups: spatial planes in which one event appears at the same cell (a unit and its
        progress); samples draw the place of the event once for the group.
    num_frames: above 1 the planes are that many grey frames, the oldest first, and the newest is
        predicted; num_frames is C, `num_uniform` is 0 and the older frames are static.
    num_others: other seats whose actions are recorded.
    tolerance: largest difference of cell values that the metrics do not count as a change: frames
        have invisible differences of shade.
    Raises ValueError for inconsistent numbers.
    """

    observation_shape: tuple[int, int, int]
    num_actions: int
    num_uniform: int
    noop_action: int
    action_kinds: Sequence[int] | None = None
    action_cells: Sequence[int] | None = None
    reward_range: tuple[float, float] = (-1.0, 1.0)
    static_planes: tuple[int, ...] = ()
    exclusive_plane_groups: tuple[tuple[int, ...], ...] = ()
    event_plane_groups: tuple[tuple[int, ...], ...] = ()
    num_frames: int = 1
    tolerance: int = 0
    num_others: int = 0

    def __post_init__(self) -> None:
        if self.num_frames > 1:
            if self.num_frames != self.num_planes or self.num_uniform:
                raise ValueError(
                    f"num_frames is {self.num_frames}, num_uniform {self.num_uniform}: each of the "
                    f"{self.num_planes} planes must be a frame, so {self.num_planes} and 0"
                )
            object.__setattr__(self, "static_planes", tuple(range(self.num_frames - 1)))
        most = self.num_planes - 1  # at least one plane is spatial
        uniform, noop = self.num_uniform, self.noop_action
        last_action = self.num_actions - 1
        low, high = self.reward_range
        _require(0 <= self.tolerance < 255, "tolerance", self.tolerance, "0..254")
        _require(0 <= uniform <= most, "num_uniform", uniform, f"0..{most}")
        _require(0 <= noop <= last_action, "noop_action", noop, f"0..{last_action}")
        _require(low < high, "reward_range", self.reward_range, "(lowest, highest) of one step")
        last_cell = self.num_rows * self.num_columns - 1
        self._check_per_action("action_kinds", self.action_kinds, 0, last_action)
        self._check_per_action("action_cells", self.action_cells, NO_CELL, last_cell)
        last = self.num_spatial - 1
        groups = (self.static_planes, *self.exclusive_plane_groups, *self.event_plane_groups)
        for plane in (plane for group in groups for plane in group):
            _require(0 <= plane <= last, "plane", plane, f"a spatial plane, 0..{last}")

    def _check_per_action(
        self, name: str, values: Sequence[int] | None, low: int, high: int
    ) -> None:
        if values is None:
            return
        if len(values) != self.num_actions:
            raise ValueError(
                f"{name} has {len(values)} entries, expected one for each of the "
                f"{self.num_actions} actions"
            )
        for value in values:
            _require(low <= value <= high, f"an entry of {name}", value, f"{low}..{high}")
        # A tuple is hashable and frozen; engines give int16 arrays.
        object.__setattr__(self, name, tuple(int(value) for value in values))

    @property
    def transition(self) -> TransitionSpec:
        """The spec of the same transitions in replay."""
        from marl_cair.replay.transition import TransitionSpec

        return TransitionSpec(
            self.observation_shape,
            self.num_actions,
            self.num_uniform,
            num_others=self.num_others,
        )

    @property
    def num_planes(self) -> int:
        return self.observation_shape[0]

    @property
    def num_rows(self) -> int:
        return self.observation_shape[1]

    @property
    def num_columns(self) -> int:
        return self.observation_shape[2]

    @property
    def num_spatial(self) -> int:
        return self.num_planes - self.num_uniform

    @property
    def kinds(self) -> tuple[int, ...]:
        """Kind of each action."""
        own = range(self.num_actions)
        return tuple(own if self.action_kinds is None else self.action_kinds)

    @property
    def num_kinds(self) -> int:
        return max(self.kinds) + 1

    @property
    def cells(self) -> tuple[int, ...]:
        """Cell of each action, NO_CELL without one."""
        if self.action_cells is None:
            return (NO_CELL,) * self.num_actions
        return tuple(self.action_cells)

    @property
    def moving_planes(self) -> tuple[int, ...]:
        """Spatial planes that can change; the generator predicts these cell by cell."""
        return tuple(plane for plane in range(self.num_spatial) if plane not in self.static_planes)


@dataclass(frozen=True)
class NetworkSize:
    """Sizes of the network."""

    channels: int = 16  # of the board trunk
    depth: int = 3  # convolutions of the trunk after the first
    hidden: int = 64  # of the context, the edited values and the outcome heads
    table_width: int = 8  # embedding of each value of each uniform plane
    action_embedding: int = 16  # embedding of each action
    shifts: tuple[tuple[int, int], ...] = ((0, 1), (0, -1), (1, 0), (-1, 0))  # steps of values
    distances: bool = False  # rewards depend on path distances from moving to static planes
    obstacle_planes: tuple[int, ...] = ()  # of `distances`: planes that block paths initially

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if type(item.default) is int:
                _require(value >= 1, f"size.{item.name}", value, "1 or more")


@dataclass(frozen=True)
class ThesisSize:
    """The network of `ccdn_thesis`."""

    form: str = "published"  # or "code", of the released program
    hidden: int = 32  # units of the fully connected layers; 32, 64, ..., 512 in the thesis
    learning_rate: float = 1e-4  # of Adam; 1e-5 in the released program

    def __post_init__(self) -> None:
        _require(self.hidden >= 1, "thesis.hidden", self.hidden, "1 or more")
        _require(self.learning_rate > 0, "thesis.learning_rate", self.learning_rate, "above 0")


@dataclass(frozen=True)
class AdversarialSettings:
    """The discriminator of `ccgan`."""

    weight: float = 0.1  # of the adversarial loss, beside log likelihoods
    channels: int = 32  # of the discriminator
    learning_rate: float = 1e-3  # of its Adam

    def __post_init__(self) -> None:
        _require(self.weight >= 0, "adversarial.weight", self.weight, "0 or more")
        _require(self.channels >= 1, "adversarial.channels", self.channels, "1 or more")
        rate = self.learning_rate
        _require(rate > 0, "adversarial.learning_rate", rate, "above 0")


@dataclass(frozen=True)
class GateConfig:
    """Thresholds for the use of generated transitions, each with its reason."""

    min_changed_f1: float = 0.6  # a copy scores 0; emptying every cell half if all units move
    min_change_explained: float = 0.6  # of pictures and vectors, for the F1: of squared change
    min_reward_explained: float = 0.6  # of their variance; what views hide cannot be explained
    max_constant_reward_error: float = 0.2  # if rewards hardly vary: error as a share of theirs
    min_terminals: int = 5  # fewer held-out ends cannot show the AUC: generate no ends
    min_terminal_auc: float = 0.85  # below, P(end) is of little use
    # An end generated as a row that continues bootstraps from a state that does not exist. Rows
    # that may end, but not surely, are not generated: P(end) has a bound, tuned on held-out ends.
    max_terminal_overlooked: float = 0.3  # share of held-out ends that may lie below that bound
    max_terminal_ece: float = 0.02  # calibration error, about the base rate of ends in long games
    min_rare_rows: int = 10  # rare rewards: as min_terminals
    max_rare_missed: float = 0.4  # share of wrong rare rewards
    min_mask_accuracy: float = 0.98  # of entries: a wrong entry shifts a max over many actions
    min_scalar_gain: float = -0.03  # accuracy of each uniform plane, and of masks, less a copy's
    evaluation_rows: int = 512  # held-out rows per evaluation; half of them tune the acceptance
    tail: float = 0.03  # share of predictions for real rows that are rejected as unsure

    def __post_init__(self) -> None:
        for holds, name, allowed in (
            (
                0.0 < self.max_terminal_overlooked <= 1.0,
                "max_terminal_overlooked",
                "a share above 0, at most 1",
            ),
            (0.0 < self.tail < 0.5, "tail", "a share above 0 and below 0.5"),
            (self.min_terminals >= 1, "min_terminals", "1 or more"),
            (self.min_rare_rows >= 1, "min_rare_rows", "1 or more"),
            (
                self.evaluation_rows >= MIN_HELDOUT_ROWS,
                "evaluation_rows",
                f"{MIN_HELDOUT_ROWS} or more",
            ),
        ):
            _require(holds, name, getattr(self, name), allowed)

    def loosen(self) -> GateConfig:
        """Thresholds of an open gate: without slack, noise would open and shut it in turn."""
        slack = _SLACK_WHEN_OPEN
        auc_above_chance = max(0.0, self.min_terminal_auc - 0.5)
        return replace(
            self,
            min_changed_f1=_SLACK_OF_CELLS * self.min_changed_f1,
            min_change_explained=_SLACK_OF_CELLS * self.min_change_explained,
            min_reward_explained=slack * self.min_reward_explained,
            min_scalar_gain=self.min_scalar_gain - _SLACK_OF_GAINS,
            min_terminal_auc=self.min_terminal_auc - (1.0 - slack) * auc_above_chance,
            max_rare_missed=1.0 - slack * (1.0 - self.max_rare_missed),
        )


@dataclass(frozen=True)
class GeneratorConfig:
    """How the generator learns and generates."""

    learning_rate: float = 5e-3  # of Adam
    max_grad_norm: float = 100.0  # far above the usual: clipping every step would bias odds
    rare_share: float = 0.25  # of each training batch: rows with a rare reward or an end
    rare_capacity: int = 2048  # such rows that are kept
    heldout_share: float = 0.1  # of real transitions, by hash; 0 with data sets, which have theirs
    heldout_ends: float = 0.5  # of ends: they are few, and few are enough to learn from
    heldout_capacity: int = 4096  # transitions; fewer hold only a part of each game
    counterfactual_share: float = 0.5  # of rows whose first step is generated take another action
    seed: int = 0  # of weights and sampling; a training run gives its own
    size: NetworkSize = field(default_factory=NetworkSize)
    thesis: ThesisSize = field(default_factory=ThesisSize)
    adversarial: AdversarialSettings = field(default_factory=AdversarialSettings)
    gate: GateConfig = field(default_factory=GateConfig)

    def __post_init__(self) -> None:
        for name, least in (("rare_capacity", 1), ("heldout_capacity", MIN_HELDOUT_ROWS)):
            value = getattr(self, name)
            _require(value >= least, name, value, f"{least} or more")
        for name in ("learning_rate", "max_grad_norm"):
            _require(getattr(self, name) > 0.0, name, getattr(self, name), "a number above 0")
        for name in ("rare_share", "heldout_share", "heldout_ends"):
            share = getattr(self, name)
            is_off = share == 0.0 and name != "rare_share"  # where a data set holds out
            _require(is_off or 0.0 < share < 1.0, name, share, "a share above 0 and below 1")
        most = self.heldout_ends  # else the gate would be tested on ends that are learned
        allowed = f"heldout_ends, which is {most}, at most"
        _require(self.heldout_share <= most, "heldout_share", self.heldout_share, allowed)
        share = self.counterfactual_share
        _require(0.0 <= share <= 1.0, "counterfactual_share", share, "0..1")


def describe_network(spec: GeneratorSpec, config: GeneratorConfig) -> dict[str, Any]:
    """The settings that a network must be used with, as plain data."""
    described = {**asdict(spec), "size": asdict(config.size), "architecture": ARCHITECTURE}
    del described["reward_range"]  # clamps predictions, no weights depend on it
    # Tuples become lists, as in saved settings.
    return cast(dict[str, Any], json.loads(json.dumps(described)))
