"""Writes the compiled loops over worlds and seats that all games have."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

from marl_cair.games.compiled import compiled, compiled_compact


def make_world_at(world: type[NamedTuple]) -> Callable[[Any, int], Any]:
    """The compiled function (worlds, index) -> one world as views of its rows, for a game's World.

    It is written out field by field, because rules can neither loop over fields nor name them.
    """
    fields = ", ".join(f"{name}=worlds.{name}[index]" for name in world._fields)
    source = f"def world_at(worlds, index):\n    return World({fields})"
    return compiled(write_rule(source, inspect.getfile(world), world.__module__, World=world))


_OVER_SEATS = """
def over_{name}(worlds, rules, out, first, last):
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range({num_players}):
            rule(world, rules, player, out[index, player])
"""
_OVER_RESETS = """
def over_{name}(worlds, rules, seeds, mask, first, last):
    for index in range(first, last):
        if mask[index]:
            world = world_at(worlds, index)
            {clear}
            rule(world, rules, seeds[index])
"""


def loop_over_seats(
    rule: Any, world_at: Any, *, compact: bool = False, num_players: int | None = None
) -> Callable[..., None]:
    """The kernel (worlds, rules, out [B, P, ...], first, last) of a rule for one seat: (world,
    rules, player, out [...]). It is faster where `num_players` is the same in all scenarios.
    `compact`: see `compiled_compact`.
    """
    made = write_loop(_OVER_SEATS, rule, world_at, num_players=num_players or "out.shape[1]")
    return compiled_compact(made) if compact else compiled(made)


def loop_over_resets(rule: Any, world_at: Any, world: type[NamedTuple]) -> Callable[..., None]:
    """The kernel (worlds, rules, seeds [B], mask bool [B], first, last) of a rule that begins
    a game: (world, rules, seed). All fields of the `world` are zeroed before.
    """
    clear = "; ".join(f"world.{name}[:] = 0" for name in world._fields)
    return compiled(write_loop(_OVER_RESETS, rule, world_at, clear=clear))


def write_loop(loop: str, rule: Any, world_at: Any, **parts: object) -> Callable[..., None]:
    """A loop around a rule, as if it stood in the rule's file: rules can take no rule as an
    argument. `loop` is its source, in which {name} is the rule's name.
    """
    plain = getattr(rule, "py_func", rule)
    source, file = loop.format(name=plain.__name__, **parts), inspect.getfile(plain)
    return write_rule(source, file, plain.__module__, rule=rule, world_at=world_at)


def write_rule(source: str, file: str, module: str, **names: Any) -> Callable[..., Any]:
    """The last function of a source that knows `names`, as if it stood in that file: whose sources
    a rule is of is read off its file.
    """
    scope = {**names, "__name__": module}
    exec(compile(source, file, "exec"), scope)  # noqa: S102
    made: Callable[..., Any] = list(scope.values())[-1]
    return made
