"""What the packages of games repeat: environments, the arrays of worlds, constants, specs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

import numpy as np

from marl_cair.games.game import NO_CELL, GameSpec, Representation

if TYPE_CHECKING:
    from pettingzoo import AECEnv

    from marl_cair.games.parallel_env import GameParallelEnv

Record = TypeVar("Record", bound=tuple[Any, ...])  # a NamedTuple


def make_environments(
    package: str, default_scenario: str
) -> tuple[Callable[..., GameParallelEnv], Callable[..., AECEnv[str, Any, Any]]]:
    """The functions `parallel_env` and `env` of the game whose package has this name."""
    game = package.rpartition(".")[2]

    def parallel_env(scenario: str = default_scenario, **options: Any) -> GameParallelEnv:
        """One game as a PettingZoo ParallelEnv; options as `games.parallel_env.GameParallelEnv`."""
        from marl_cair.games.parallel_env import GameParallelEnv  # loads the rules

        return GameParallelEnv(game, scenario, **options)

    def env(scenario: str = default_scenario, **options: Any) -> AECEnv[str, Any, Any]:
        """The same game turn by turn (AEC), through PettingZoo's own conversion."""
        from marl_cair.games.parallel_env import make_aec_env

        return make_aec_env(game, scenario, **options)

    for function in (parallel_env, env):  # as if the package defined them: pickle finds them there
        function.__module__, function.__qualname__ = package, function.__name__
    return parallel_env, env


# --- records of arrays and constants -----------------------------------------------------------


def allocate_world(world: type[Record], num_worlds: int, **sizes: int) -> Record:
    """Zeroed arrays for `num_worlds` worlds.

    Each field of `world` is Annotated[NDArray[dtype], axes]: "P 2" stands for [B, P, 2], where
    `sizes` gives P.
    """
    arrays = {}
    for name, hint in get_type_hints(world, include_extras=True).items():
        axes = [
            sizes[axis] if axis in sizes else int(axis) for axis in hint.__metadata__[0].split()
        ]
        arrays[name] = np.zeros((num_worlds, *axes), _dtype_of(hint.__origin__))
    return world(**arrays)


def fill_record(record: type[Record], *sources: Any, **given: Any) -> Record:
    """A NamedTuple of constants for kernels: ints, floats and arrays, as its fields are annotated.

    A field that is not `given` is the attribute of that name of the first source that has one.
    """
    values = {}
    for name, hint in get_type_hints(record).items():
        owner = next((source for source in sources if hasattr(source, name)), None)
        value = given[name] if name in given else getattr(owner, name)
        dtype = _dtype_of(hint)
        if dtype is not None:
            value = np.array(value, dtype)
        values[name] = hint(value) if hint in (int, float) else value
    return record(**values)


def _dtype_of(hint: Any) -> Any:
    """The dtype of an NDArray's annotation; None of any other."""
    types = get_args(hint)  # (shape, dtype[scalar]); from NumPy 2.5 on the scalar's type alone
    return (get_args(types[-1]) or types)[0] if types else None


# --- specs ---------------------------------------------------------------------------------------


def list_by_name(*shown: Representation) -> Mapping[str, Representation]:
    """The representations of a spec."""
    return MappingProxyType({one.name: one for one in shown})


def show_board(
    name: str,
    planes: tuple[str, ...],
    board: tuple[int, ...],
    observe: Callable[..., None],
    high: int = 255,
    **others: Any,
) -> Representation:
    """Planes uint8 [planes, *board]; `others` are further fields of Representation."""
    shape = (len(planes), *board)
    return Representation(name, shape, np.uint8, high, planes, observe, **others)


def show_picture(height: int, width: int, observe: Callable[..., None]) -> Representation:
    """`image`, uint8 [3, height, width]."""
    return show_board("image", ("red", "green", "blue"), (height, width), observe)


def show_gray(side: int, observe: Callable[..., None], name: str = "gray") -> Representation:
    """`gray`, uint8 [1, side, side]."""
    return show_board(name, ("luma",), (side, side), observe)


def show_numbers(
    name: str,
    entries: tuple[str, ...],
    high: tuple[float, ...],
    observe: Callable[..., None],
    low: tuple[float, ...] | None = None,
) -> Representation:
    """Numbers float32 [entries] in 0..high, or low..high."""
    lowest = low or (0.0,) * len(entries)
    return Representation(name, (len(entries),), np.float32, high, entries, observe, low=lowest)


def make_plain_spec(action_names: tuple[str, ...], **fields: Any) -> GameSpec:
    """A spec whose actions are each a kind of their own and point at no cell, with no planes or
    resources to name, but for what `fields` of GameSpec say.
    """
    num_actions = len(action_names)
    unused = ("static_planes", "exclusive_planes", "event_planes", "resources")
    plain: dict[str, Any] = {
        **dict.fromkeys(unused, ()),
        "action_groups": np.arange(num_actions, dtype=np.int16),
        "action_group_names": action_names,
        "action_cells": np.full(num_actions, NO_CELL, np.int32),
    }
    return GameSpec(action_names=action_names, **plain | fields)
