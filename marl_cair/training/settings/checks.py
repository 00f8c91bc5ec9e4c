"""Allowed values of settings: types with their range, and errors that name setting and value."""

from __future__ import annotations

import functools
import math
import numbers
import re
import types
import typing
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

if TYPE_CHECKING:
    import torch

MAX_THREADS = 1024  # each takes memory of its own


class Allowed(NamedTuple):
    """Beside the type of a dataclass's field: which values it may have, and the same in words."""

    holds: Callable[[Any], bool]
    words: str


Natural = Annotated[int, Allowed(lambda n: n >= 0, "0 or more")]
Count = Annotated[int, Allowed(lambda n: n >= 1, "1 or more")]
Threads = Annotated[int, Allowed(lambda n: 1 <= n <= MAX_THREADS, f"1..{MAX_THREADS}")]
Seed = Annotated[int, Allowed(lambda n: 0 <= n < 2**63, "0 or more")]
NonNegative = Annotated[float, Allowed(lambda x: 0 <= x < math.inf, "0 or more")]
Positive = Annotated[float, Allowed(lambda x: 0 < x < math.inf, "above 0")]
Share = Annotated[float, Allowed(lambda x: 0 <= x <= 1, "in 0..1")]
ShareAboveZero = Annotated[float, Allowed(lambda x: 0 < x <= 1, "above 0, at most 1")]
ShareBelowOne = Annotated[float, Allowed(lambda x: 0 <= x < 1, "0 or more, below 1")]
_DEVICE = re.compile(r"cpu|cuda(:(0|[1-9]\d?))?")
_NAMED = Allowed(lambda name: bool(_DEVICE.fullmatch(name)), "cpu, cuda or cuda:N")
Device = Annotated[str, _NAMED]


class DeviceError(ValueError):
    """A device that this machine does not have."""


def require(holds: bool, name: str, value: object, allowed: str) -> None:
    """Raise ValueError that names the setting, its value and what is allowed."""
    if not holds:
        raise ValueError(f"{name} is {value!r}, it must be {allowed}")


def find_device(name: str) -> torch.device:
    """The device of that name. Raises ValueError for another name, DeviceError for a GPU that is
    not there.
    """
    import torch

    require(_NAMED.holds(name), "device", name, _NAMED.words)
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if name == "cpu" or int(name.partition(":")[2] or 0) < count:
        return torch.device(name)
    fix = f"take cpu or cuda:0..{count - 1}"
    if not count:
        fix = "take cpu, or install a driver (see nvidia-smi) and a PyTorch with CUDA (pytorch.org)"
    raise DeviceError(
        f"device is {name!r}, but PyTorch {torch.__version__} finds {count} GPUs here "
        f"(torch.cuda.is_available() is {torch.cuda.is_available()}): {fix}"
    )


def require_once(name: str, values: Sequence[object]) -> None:
    """Raise ValueError if one of `values` occurs twice."""
    for place, value in enumerate(values):
        if value in values[:place]:
            raise ValueError(f"{name} has {value!r} twice: name each once")


def check_fields(settings: Any, inside: str = "") -> None:
    """Raise ValueError for a field of a dataclass whose value its type does not allow. None is
    allowed. inside: what stands before a field's name in the error.
    """
    owner: type = type(settings)
    for name, allowed in _find_allowed(owner):
        value = getattr(settings, name)
        require(value is None or allowed.holds(value), f"{inside}{name}", value, allowed.words)


@functools.cache
def _find_allowed(owner: type) -> list[tuple[str, Allowed]]:
    hints = typing.get_type_hints(owner, include_extras=True)
    found = []
    for name, hint in hints.items():
        for part in (hint, *typing.get_args(hint)) if _is_union(hint) else (hint,):
            if (kind := getattr(part, "__origin__", part)) in _KINDS:  # `Count` is int
                found.append((name, _KINDS[kind]))
            found += [(name, allowed) for allowed in getattr(part, "__metadata__", ())]
    return found


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (types.UnionType, typing.Union)


def _is_number(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


_KINDS: dict[Any, Allowed] = {
    bool: Allowed(lambda value: isinstance(value, bool), "True or False"),
    int: Allowed(lambda value: _is_number(value, numbers.Integral), "a whole number"),
    float: Allowed(lambda value: _is_number(value, numbers.Real), "a number"),
    str: Allowed(lambda value: isinstance(value, str), "a string"),
}
