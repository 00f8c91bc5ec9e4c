"""What a generator must know of a game's transitions, and how large and how strict it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

from marl_cair.policies.config import NO_CELL

if TYPE_CHECKING:
    from marl_cair.replay.transition import TransitionSpec


@dataclass(frozen=True)
class GeneratorSpec:
    """Shape and meaning of the transitions of one game, seen by one seat.

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
    num_frames: above 1 the planes are so many pictures in grey, the oldest first, of which the
        newest is predicted; all of them, so `num_uniform` is 0 and the others are static.
    tolerance: values of a cell that differ by no more are taken for equal where it is counted which
        cells have changed: pictures have shades that nobody sees.

    Raises ValueError where a number does not fit the others.
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

    def __post_init__(self) -> None:
        if self.num_frames > 1:
            if self.num_frames != self.num_planes or self.num_uniform:
                raise ValueError(
                    f"num_frames is {self.num_frames}, num_uniform {self.num_uniform}: each of the "
                    f"{self.num_planes} planes must be a picture, so {self.num_planes} and 0"
                )
            object.__setattr__(self, "static_planes", tuple(range(self.num_frames - 1)))
        _require_int(0 <= self.tolerance < 255, "tolerance", self.tolerance, "0..254")
        _require_int(
            0 <= self.num_uniform < self.num_planes,
            "num_uniform",
            self.num_uniform,
            f"0..{self.num_planes - 1} (at least one plane must be spatial)",
        )
        _require_int(
            0 <= self.noop_action < self.num_actions,
            "noop_action",
            self.noop_action,
            f"0..{self.num_actions - 1}",
        )
        low, high = self.reward_range
        if not low < high:
            raise ValueError(
                f"reward_range is {self.reward_range}, expected (lowest, highest) of one step"
            )
        cells = self.num_rows * self.num_columns
        self._check_per_action("action_kinds", self.action_kinds, 0, self.num_actions - 1)
        self._check_per_action("action_cells", self.action_cells, NO_CELL, cells - 1)
        groups = (self.static_planes, *self.exclusive_plane_groups, *self.event_plane_groups)
        for plane in (plane for group in groups for plane in group):
            _require_int(
                0 <= plane < self.num_spatial,
                "plane",
                plane,
                f"a spatial plane, 0..{self.num_spatial - 1}",
            )

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
            _require_int(low <= value <= high, f"an entry of {name}", value, f"{low}..{high}")
        # Hashable and frozen, whatever the caller gave (a list, an engine's int16 array).
        object.__setattr__(self, name, tuple(int(value) for value in values))

    @property
    def transition(self) -> TransitionSpec:
        """The same transitions as replay knows them."""
        from marl_cair.replay.transition import TransitionSpec

        return TransitionSpec(self.observation_shape, self.num_actions, self.num_uniform)

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
        return (
            tuple(range(self.num_actions))
            if self.action_kinds is None
            else tuple(self.action_kinds)
        )

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
        static = set(self.static_planes)
        return tuple(plane for plane in range(self.num_spatial) if plane not in static)


def _require_int(holds: bool, name: str, value: int, allowed: str) -> None:
    if not holds:
        raise ValueError(f"{name} is {value}, expected {allowed}")


@dataclass(frozen=True)
class NetworkSize:
    """Sizes of one network. An update of 64 at [28, 10, 15] takes about 20 ms (one busy core)."""

    channels: int = 16  # of the board trunk; 32 costs almost three times as much
    hidden: int = 64  # of the context and the outcome heads
    readout: int = 24  # learned features of each cell that the outcome heads see
    factors: int = 12  # of these, whose products with all planes are summed over the board
    near_factors: int = 8  # features of each cell and its neighbourhood that the economy sees
    economy_hidden: int = 32  # for each uniform plane
    table_width: int = 8  # learned numbers for each value of each uniform plane
    action_embedding: int = 16  # learned numbers for each action
    side_features: int = 4  # of each cell, which are seen around the cells where a plane is on
    reward_bins: int = 63  # odd, so that one bin is exactly 0
    shifts: tuple[tuple[int, int], ...] = (  # (row, column) offsets a value may come from
        (0, 1),
        (0, -1),
        (1, 0),
        (-1, 0),
    )
    frame_channels: int = 32  # of each patch of 4 x 4 pixels, where pictures are seen
    steps: int = 6  # of each plane's own values that are candidates, the commonest ones
    distances: bool = False  # rewards see how far the way is from what moves to what is static
    obstacle_planes: tuple[int, ...] = ()  # of `distances`: planes that block ways, to begin with

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if type(item.default) is int:
                _require_int(value >= 1, f"size.{item.name}", value, "1 or more")
        if self.factors > self.readout:
            raise ValueError(
                f"size.factors is {self.factors}, expected at most size.readout, {self.readout}: "
                "they are the first of these"
            )
        if self.reward_bins % 2 == 0 or self.reward_bins < 3:
            raise ValueError(
                f"size.reward_bins is {self.reward_bins}, expected an odd number, 3 or more"
            )


@dataclass(frozen=True)
class GateConfig:
    """When generated transitions may be used; the reason for each number stands beside it."""

    min_heldout_rows: int = 200  # below this the standard error of a share is above 3 %
    min_changed_f1: float = 0.6  # copying scores 0; emptying every cell scores half where all walk
    max_cell_error_ratio: float = 0.7  # of the copy's: the moves are predicted, not smeared
    max_nll_ratio: float = 0.8  # of copy + marginal: knows where and when, not only how often
    max_change_ratio: float = 1.5  # samples change cells as often as the game, within this factor
    # Of the copy's: what others spend cannot be foreseen. Nor can a rounded clock, of which copying
    # is the best single guess whoever guesses (Deep RTS: it steps in two of five decisions): it is
    # also enough that the uniform planes alone keep to max_nll_ratio.
    max_uniform_mae_ratio: float = 0.6  # of the copy's, unless the likelihood ratio holds
    # Where a rounded clock is all that changes, nobody can be better than its odds, which the copy
    # has; then it is enough to be within one level in nearly all rows.
    max_uniform_far: float = 0.01  # share of rows with a plane off by 2 or more of 255
    min_reward_explained: float = 0.7  # of variance; few large rewards make it scatter by 0.1
    max_reward_mae_if_constant: float = 1e-3  # where rewards hardly vary: be near that constant
    min_terminals: int = 10  # with fewer held-out ends, recall cannot be told: make no ends
    min_terminal_auc: float = 0.85  # below, what the members say of ends is worth little
    # An end that would be made as a row that goes on bootstraps from a state that does not exist.
    # One in doubt is not counted: Deep RTS shows a clock at 0 for two decisions, of which one ends
    # the game, so nobody can recall half of such ends, and no such row is ever made.
    max_terminal_overlooked: float = 0.3  # share of ends that would go on, doubtful ones apart
    max_doubtful_rows: float = 0.25  # turned away so that no more ends than that are overlooked
    max_terminal_ece: float = 0.02  # calibration error, about the base rate of ends in long games
    min_rare_rows: int = 10  # rare rewards: the same rule as for ends
    # Members agree on missing rewards, so agreement cannot show it.
    max_rare_missed: float = 0.4  # share of rare rewards that would be another, doubtful ends apart
    min_mask_accuracy: float = 0.98  # of entries: a wrong entry shifts a max over many actions
    slack_when_open: float = 0.7  # of shares found or explained, which scatter by 0.1
    small_slack_when_open: float = 0.9  # of all cells and uniform planes, which scatter by 0.03
    evaluation_rows: int = 512  # held-out rows measured at a time; half tune the acceptance
    tail: float = 0.03  # share of real rows that each likelihood test may turn away
    max_reward_spread: float = 1.0  # of members, in standard deviations of real rewards
    certain_terminal: float = 0.8  # every member must be this sure of end or no end

    def __post_init__(self) -> None:
        if not 0.0 < self.tail < 0.5:
            raise ValueError(f"tail is {self.tail}, expected a share above 0 and below 0.5")
        for name in ("slack_when_open", "small_slack_when_open"):
            slack = getattr(self, name)
            if not 0.0 < slack <= 1.0:
                raise ValueError(f"{name} is {slack}, expected a share above 0, at most 1")
        if not 0.0 <= self.max_doubtful_rows < 1.0:
            raise ValueError(
                f"max_doubtful_rows is {self.max_doubtful_rows}, expected 0 up to below 1"
            )
        # Every second end may have chosen what is asked of the others.
        _require_int(self.min_terminals >= 2, "min_terminals", self.min_terminals, "2 or more")
        _require_int(self.min_rare_rows >= 1, "min_rare_rows", self.min_rare_rows, "1 or more")
        if not 0.5 <= self.certain_terminal < 1.0:
            raise ValueError(
                f"certain_terminal is {self.certain_terminal}, expected 0.5 up to below 1"
            )

    def loosen(self) -> GateConfig:
        """What an open gate must keep to: without slack, scatter would open and shut it in turn."""
        large, small = self.slack_when_open, self.small_slack_when_open
        return replace(
            self,
            min_changed_f1=small * self.min_changed_f1,
            max_cell_error_ratio=1.0 - small * (1.0 - self.max_cell_error_ratio),
            max_nll_ratio=1.0 - small * (1.0 - self.max_nll_ratio),
            max_uniform_mae_ratio=1.0 - small * (1.0 - self.max_uniform_mae_ratio),
            min_reward_explained=large * self.min_reward_explained,
            max_terminal_overlooked=1.0 - large * (1.0 - self.max_terminal_overlooked),
            max_rare_missed=1.0 - large * (1.0 - self.max_rare_missed),
        )


@dataclass(frozen=True)
class GeneratorConfig:
    """How the generator learns and generates."""

    num_members: int = 3  # independently seeded networks; 1 leaves nothing to disagree
    learning_rate: float = 3e-3  # of Adam
    economy_learning_rate: float = 1e-2  # its features are counts, which seldom differ from 0
    frame_learning_rate: float = 1e-3  # of the networks of pictures
    max_grad_norm: float = 100.0  # far above the usual: clipping every step would bias odds
    rare_share: float = 0.25  # of each training batch: half rare rewards, half ends
    rare_reward_share: float = 0.02  # of all rows, which the seldom rewards make up together
    rare_capacity: int = 2048  # transitions, half with rare rewards, half ends
    heldout_share: float = 0.1  # of real transitions, by hash of their index
    heldout_capacity: int = 4096  # transitions; worlds in step would show but a part of their games
    counterfactual_share: float = 0.5  # of rows whose first step is generated take another action
    max_rounds: int = 4  # of proposals in one call, if many are turned away
    quiet_stride: int = 16  # one in so many quiet cells is trained on (weight 16)
    seed: int = 0  # of weights and draws; a training run gives its own
    size: NetworkSize = field(default_factory=NetworkSize)
    gate: GateConfig = field(default_factory=GateConfig)

    def __post_init__(self) -> None:
        for name, least in (
            ("num_members", 1),
            ("rare_capacity", 2),  # one of each kind
            ("heldout_capacity", 8),  # an eighth of it is of rare rows
            ("max_rounds", 1),
            ("quiet_stride", 1),
        ):
            value = getattr(self, name)
            _require_int(value >= least, name, value, f"{least} or more")
        for name in ("rare_share", "heldout_share"):
            share = getattr(self, name)
            if not 0.0 < share < 1.0:
                raise ValueError(f"{name} is {share}, expected a share above 0 and below 1")
        if not 0.0 <= self.counterfactual_share <= 1.0:
            raise ValueError(f"counterfactual_share is {self.counterfactual_share}, expected 0..1")
