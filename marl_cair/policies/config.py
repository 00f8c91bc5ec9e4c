"""Settings of a Q-network: validated plain data, stored in checkpoints."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace

from marl_cair import policies
from marl_cair.lookup import check_name, find_by_name
from marl_cair.outside import is_place

NORMS = ("none", "layer")
THESIS_CAPSULE, LENGTH = "thesis_capsule", "length"  # a body and its head
_NOT_OF_THESIS_CAPSULE = "hidden_width", "norm", "memory", "distances", "cell_values", "noisy"
DUELING, QUANTILE = "dueling", "quantile"  # heads with advantages, which an embedding can have
NAF = "naf"  # a head of actions as points
NUM_QUANTILES = 32
NUM_LAYERS = {"conv": 3, "capsule": 2}  # convolutions that `conv_channels` can replace
NO_CELL = -1  # of `action_cells`: the action points at no cell
# Later settings, which are no part of an agent's fingerprint at these values: older agents keep
# theirs.
LATER: Mapping[str, object] = {
    "norm": "none",
    "conv_channels": (),
    "conv_strides": (),
    "memory": policies.NO_MEMORY,
    "memory_width": None,
    "noisy": False,
    "num_quantiles": None,
    "action_shape": (),
}

_LEAST_NUMBERS = {"hidden_width": 1, "memory_width": 1, "num_quantiles": 1, "action_embedding": 0}
_LEAST_IN_LISTS = {
    "conv_channels": 1,
    "conv_strides": 1,
    "obstacle_planes": 0,
    "action_cells": NO_CELL,
    "action_kinds": 0,
    "action_shape": 1,
}


@dataclass(frozen=True)
class CapsuleSizes:
    """Sizes of the `capsule` body: 260 k weights; 129 for each action, 33 by embeddings of 32."""

    trunk_channels: int = 32  # planes after the strided convolutions
    grid_side: int = 5  # cells along each side of the fixed pooling grid
    num_part_types: int = 8  # kinds of part a cell can hold
    part_pose_size: int = 8  # numbers that describe one part
    num_entities: int = 8  # entity capsules; does not depend on the number of actions
    entity_pose_size: int = 16  # numbers that describe one entity
    num_routing_passes: int = 2  # 1: every part goes to every entity with weight 1

    def __post_init__(self) -> None:
        for item in fields(self):
            _require_at_least(1, f"capsule.{item.name}", getattr(self, item.name))


@dataclass(frozen=True)
class QNetworkConfig:
    """Body, head and their sizes. None: the body's default."""

    body: str = "conv"  # from the observation to features: a name, or module:Class
    head: str = "dueling"  # features to values: dueling, plain, quantile, naf, length, module:Class
    hidden_width: int | None = None  # capsule 128, thesis_conv 512, other bodies 256
    action_embedding: int | None = 0  # rank; 0: full. None, in older agents: 32 with body=capsule
    num_quantiles: int | None = None  # of the quantile head; None: 32
    noisy: bool = False  # learned noise in the head's dense layers, for exploration.kind=noisy
    norm: str = "none"  # of the body's layers: none or layer (GroupNorm, LayerNorm)
    conv_channels: tuple[int, ...] = ()  # of conv, capsule, own bodies; empty: by input size
    conv_strides: tuple[int, ...] = ()  # of each, with 3 x 3 kernels; empty: by the input's size
    memory: str = policies.NO_MEMORY  # between body and head: none, lstm or gru
    memory_width: int | None = None  # features after the memory; None: hidden_width
    distances: bool = False  # add path distances over the board, longer than kernels reach
    obstacle_planes: tuple[int, ...] = ()  # of `distances`: planes that block paths initially
    cell_values: bool = False  # values of actions that point at a cell use the cells around it
    action_cells: tuple[int, ...] = ()  # of each action, -1: none; empty: the game's
    action_kinds: tuple[int, ...] = ()  # of each action; a kind shares weights; empty: the game's
    action_shape: tuple[int, ...] = ()  # places of an action: the game's
    vector_low: tuple[float, ...] = ()  # of a vector's entries, scaled to -1; empty: the game's
    vector_high: tuple[float, ...] = ()  # of a vector's entries, scaled to 1; empty: the game's
    frame_differences: bool = False  # of stacked images: the newest, and the changes before it
    capsule: CapsuleSizes = field(default_factory=CapsuleSizes)

    def __post_init__(self) -> None:
        check_name("network", self.body, policies.NETWORKS)
        check_name("head", self.head, policies.HEADS)
        check_name("memory", self.memory, (policies.NO_MEMORY,), policies.MEMORIES)
        for name in ("distances", "cell_values", "frame_differences", "noisy"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} is {getattr(self, name)!r}, it must be True or False")
        for name, least in _LEAST_NUMBERS.items():
            if getattr(self, name) is not None:
                _require_at_least(least, name, getattr(self, name))
        check_name("norm", self.norm, NORMS)
        for name, least in _LEAST_IN_LISTS.items():
            object.__setattr__(self, name, tuple(getattr(self, name)))
            for place, value in enumerate(getattr(self, name)):
                _require_at_least(least, f"{name}[{place}]", value)
        for name in ("vector_low", "vector_high"):
            object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))
        self._check_combinations()
        self._check_head()

    def _check_combinations(self) -> None:
        takes_layers = self.body in NUM_LAYERS or policies.NETWORKS.is_outside(self.body)
        if self.conv_channels and not takes_layers:
            raise ValueError(
                f"conv_channels is {list(self.conv_channels)}, but body is {self.body!r}: set it "
                f"and conv_strides to [], or use body={' or '.join(map(repr, NUM_LAYERS))}"
            )
        if self.action_shape and (self.head != DUELING or self.cell_values or self.noisy):
            raise ValueError(
                f"actions have a place at each cell of {list(self.action_shape)}, which has a head "
                f"of its own: use head={DUELING!r}, cell_values=False and noisy=False"
            )
        is_thesis = self.body == THESIS_CAPSULE
        if is_thesis != (self.head == LENGTH):
            raise ValueError(
                f"body is {self.body!r} and head {self.head!r}, but values of {THESIS_CAPSULE!r} "
                f"are lengths of its capsules: use head={LENGTH!r} with this body, and only with it"
            )
        for name in _NOT_OF_THESIS_CAPSULE if is_thesis else ():
            if getattr(self, name) not in (None, False, "none"):
                raise ValueError(
                    f"{name} is {getattr(self, name)!r}, but body {THESIS_CAPSULE!r} has capsules "
                    "for features, and their lengths are its values: leave it out, or use "
                    "body='capsule'"
                )
        # A body from outside may have any number.
        by_size = NUM_LAYERS.get(self.body, len(self.conv_channels))
        num_layers = len(self.conv_strides) or (by_size if self.conv_channels else 0)
        if len(self.conv_channels) != num_layers:
            raise ValueError(
                f"conv_channels has {len(self.conv_channels)} entries, but conv_strides "
                f"{len(self.conv_strides)}: give as many of both, or {by_size} channels and no "
                "strides"
            )
        if self.obstacle_planes and not self.distances:
            raise ValueError(
                f"obstacle_planes is {list(self.obstacle_planes)}, but distances is False: set it "
                "to True, or leave obstacle_planes empty"
            )
        if self.memory == policies.NO_MEMORY and self.memory_width is not None:
            raise ValueError(
                f"memory_width is {self.memory_width}, but memory is {self.memory!r}: set it to "
                f"{' or '.join(policies.MEMORIES)}, or leave memory_width None"
            )
        if (self.action_cells or self.action_kinds) and not self.reads_cells:
            raise ValueError(
                "action_cells or action_kinds are given, but cell_values is False: set it to True, "
                f"use head={NAF!r}, or leave them empty"
            )
        pairs = list(zip(self.vector_low, self.vector_high, strict=False))
        is_equal = len(self.vector_low) == len(self.vector_high)
        if not is_equal or not all(low < high for low, high in pairs):
            raise ValueError(
                f"vector_low is {list(self.vector_low)} and vector_high {list(self.vector_high)}, "
                "but they must have equal lengths, and each low must be below its high"
            )
        if self.frame_differences and self.distances:
            raise ValueError(
                "frame_differences is for images, distances for boards: set one to False"
            )

    def _check_head(self) -> None:
        if self.head not in (DUELING, QUANTILE) and self.action_embedding:
            raise ValueError(
                f"action_embedding is {self.action_embedding}, but head {self.head!r} has none: "
                f"set it to 0 or None, or use head={DUELING!r} or head={QUANTILE!r}"
            )
        if self.head != QUANTILE and self.num_quantiles is not None:
            raise ValueError(
                f"num_quantiles is {self.num_quantiles}, but head {self.head!r} has no quantiles: "
                f"leave it None, or use head={QUANTILE!r}"
            )

    @property
    def reads_cells(self) -> bool:
        """Whether the network needs the cell and the kind of each action."""
        return self.cell_values or self.head == NAF

    def with_bounds(self, low: object, high: object) -> "QNetworkConfig":
        """Return these settings with the bounds of a vector's entries, unless they have their own
        or `low` and `high` are single bounds of all entries.
        """
        if self.vector_low or not (isinstance(low, tuple) and isinstance(high, tuple)):
            return self
        return replace(self, vector_low=low, vector_high=high)

    def with_actions(
        self, cells: Sequence[int], kinds: Sequence[int], shape: Sequence[int] = ()
    ) -> "QNetworkConfig":
        """Return these settings with the shape of actions, and with the cell (or NO_CELL) and the
        kind of each if they are needed and not set.
        """
        has_shape = self.action_shape == tuple(shape)
        fitted = self if has_shape else replace(self, action_shape=tuple(shape))
        if not self.reads_cells:
            return fitted
        return replace(
            fitted,
            action_cells=self.action_cells or tuple(cells),
            action_kinds=self.action_kinds or tuple(kinds),
        )

    def resolve_hidden_width(self) -> int:
        """Return the number F of features between body and head."""
        if self.hidden_width is not None:
            return self.hidden_width
        return policies.NETWORKS[self.body].DEFAULT_HIDDEN_WIDTH

    def resolve_memory_width(self) -> int:
        """Return the number W of features after the memory."""
        return self.memory_width or self.resolve_hidden_width()

    def resolve_state_size(self) -> int:
        """Return the size S of the recurrent state, 0 without memory."""
        if self.memory == policies.NO_MEMORY:
            return 0
        return policies.MEMORIES[self.memory].STATES * self.resolve_memory_width()

    def resolve_action_embedding(self) -> int:
        """Return the rank r of the action embedding, 0 without one."""
        if self.head not in (DUELING, QUANTILE):
            return 0
        if self.action_embedding is not None:
            return self.action_embedding
        return 32 if self.body == "capsule" else 0

    def resolve_num_quantiles(self) -> int:
        """Return the number K of quantiles of each action, 0 for other heads than `quantile`."""
        return (self.num_quantiles or NUM_QUANTILES) if self.head == QUANTILE else 0

    def list_code(self) -> list[str]:
        """Return the names that are classes `module:Class` of a user."""
        return [name for name in (self.body, self.head) if is_place(name)]

    def to_dict(self) -> dict[str, object]:
        """Return nested plain values for `from_dict`."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, object]) -> "QNetworkConfig":
        """Read what `to_dict` wrote. Raises ValueError for unknown keys."""
        _refuse_unknown_keys("network setting", values, cls)
        rest = {name: value for name, value in values.items() if name != "capsule"}
        sizes = values.get("capsule", {})
        if not isinstance(sizes, Mapping):
            raise ValueError(f"capsule is {sizes!r}, it must be sizes by name")
        _refuse_unknown_keys("capsule size", sizes, CapsuleSizes)
        return cls(**rest, capsule=CapsuleSizes(**sizes))  # type: ignore[arg-type]  # checked there


def _refuse_unknown_keys(kind: str, values: Mapping[str, object], owner: type) -> None:
    known = {item.name: item for item in fields(owner)}
    for name in values:
        find_by_name(kind, name, known)


def _require_at_least(minimum: int, name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < minimum:
        raise ValueError(f"{name} is {value!r}, but must be an integer of at least {minimum}")
