"""Lists the rules that a game in a browser needs, and lays its arrays out in memory."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.browser.lowering import MATH, Kernel, Parameter, compile_object
from marl_cair.browser.wasm_file import Segment, make_module
from marl_cair.games.engine import Outcome
from marl_cair.games.game import NO_WINNER, Agent, Game, Representation
from marl_cair.games.scripted import ScriptedPlayer

PAGE_BYTES = 1 << 16  # of WebAssembly memory
STACK_TOP = 4 << 20  # constants of rules lie below the stack, arrays above it
_STACK_BYTES = 1 << 20
_ALIGNMENT = 16
EXACT = ("reset", "step", "look", "legal_actions")  # kernels that decide what happens
# The fields of scenarios that set the size of `image`, which people see in a browser.
PICTURE = "image"
PICTURE_OPTIONS: Mapping[str, Mapping[str, Any]] = {"deep_rts": {"tile_pixels": 32}}


class Memory:
    """Gives each array its address in WebAssembly memory, from STACK_TOP on."""

    def __init__(self) -> None:
        self.end = STACK_TOP
        self._placed: list[tuple[NDArray[Any], int]] = []
        self.named: dict[str, NDArray[Any]] = {}  # that the page reads or writes

    def find(self, array: NDArray[Any]) -> int:
        """The address of an array or of a view of one; a new one is placed."""
        start = _start(array)
        for placed, address in self._placed:
            offset = start - _start(placed)
            if 0 <= offset < placed.nbytes or (offset == 0 and array is placed):
                return address + offset
        address = self.end
        self._placed.append((array, address))
        self.end += -(-array.nbytes // _ALIGNMENT) * _ALIGNMENT
        return address

    def name(self, name: str, array: NDArray[Any]) -> NDArray[Any]:
        """Place an array that the page reads or writes by its name."""
        self.find(array)
        self.named[name] = array
        return array

    def describe(self) -> dict[str, dict[str, Any]]:
        """Address, dtype and shape of the arrays that have names."""
        return {
            name: {"address": self.find(one), "dtype": one.dtype.name, "shape": one.shape}
            for name, one in self.named.items()
        }

    def list_segments(self) -> list[Segment]:
        """The arrays that do not begin as zeros."""
        return [Segment(at, array.tobytes()) for array, at in self._placed if array.any()]


def _start(array: NDArray[Any]) -> int:
    """Where an array lies in this process."""
    return int(array.__array_interface__["data"][0])


def compile_rules(game: Game, scenario: Any, opponent: Agent) -> bytes:
    """A WebAssembly module with what one world of `scenario` needs to be played and shown, and the
    opponent where it is a bot.

    It exports the kernels of `list_kernels`; its note lists the arrays that the page uses, by name:
    address, dtype and shape; "world.NAME" are the state.

    Raises ValueError where the rules call functions that WebAssembly does not have, or an
    observation others than MATH.
    """
    memory = Memory()
    kernels = list_kernels(game, scenario, opponent, memory)
    code = compile_object(kernels, memory.find, exact=EXACT)
    about = {"arrays": memory.describe(), "pages": -(-memory.end // PAGE_BYTES), "stack": STACK_TOP}
    return make_module(
        code,
        [kernel.name for kernel in kernels],
        memory.list_segments(),
        STACK_TOP - _STACK_BYTES,
        json.dumps(about),
        MATH,
    )


def list_kernels(game: Game, scenario: Any, opponent: Agent, memory: Memory) -> list[Kernel]:
    """The rules with their arguments; names the arrays that the page uses in `memory`."""
    spec, rules = game.make_spec(scenario), game.make_rules(scenario)
    worlds = _allocate(game, scenario, memory)
    seats = (1, spec.num_players)
    outcome = Outcome(
        rewards=np.zeros(seats, np.float32),
        terminated=np.zeros(1, np.bool_),
        truncated=np.zeros(1, np.bool_),
        winner=np.full(1, NO_WINNER, np.int8),
        eliminated=np.zeros(seats, np.bool_),
    )
    for name, field in outcome._asdict().items():
        memory.name(name, field)
    seeds = memory.name("seeds", np.zeros(1, np.uint64))
    actions = memory.name("actions", np.zeros(seats, np.int32))
    mask = memory.name("mask", np.zeros((*seats, spec.num_actions), np.bool_))
    kernels = [
        Kernel("reset", game.reset, (worlds, rules, seeds, np.ones(1, np.bool_), 0, 1)),
        Kernel("step", game.step, (worlds, rules, actions, outcome, 0, 1)),
        Kernel("legal_actions", game.legal_actions, (worlds, rules, mask, 0, 1)),
    ]
    if hasattr(rules, "ticks_per_step"):
        # `step` of fewer ticks: on a copy of the state it shows what is between two steps.
        fewer = rules._replace(ticks_per_step=Parameter())
        kernels.append(Kernel("look", game.step, (worlds, fewer, actions, outcome, 0, 1)))
    observed = dict.fromkeys(("vector", opponent.representation))
    shown = [spec.representations[name] for name in observed if name in spec.representations]
    kernels += [_see(one, worlds, rules, seats, memory) for one in shown]
    painted = change_picture(game, scenario)
    picture = game.make_spec(painted).representations[PICTURE]
    kernels.append(_see(picture, worlds, game.make_rules(painted), seats, memory, "picture"))
    if isinstance(opponent, ScriptedPlayer):
        kernels.append(_decide(opponent, memory.named[opponent.representation], mask, memory))
    return kernels


def change_picture(game: Game, scenario: Any) -> Any:
    """The scenario with the picture that people see."""
    return dataclasses.replace(scenario, **PICTURE_OPTIONS.get(game.name, {}))


def _allocate(game: Game, scenario: Any, memory: Memory) -> Any:
    worlds = game.allocate(scenario, 1)
    for name, field in worlds._asdict().items():
        memory.name(f"world.{name}", field)
    return worlds


def _see(
    representation: Representation,
    worlds: Any,
    rules: Any,
    seats: tuple[int, int],
    memory: Memory,
    name: str = "",
) -> Kernel:
    """The kernel observe_NAME, which writes the array NAME."""
    name = name or representation.name
    out = memory.name(name, np.zeros((*seats, *representation.shape), representation.dtype))
    make = representation.make_memory
    written = (out,) if make is None else (make(1), out)
    return Kernel(f"observe_{name}", representation.observe, (worlds, rules, *written, 0, 1))


def _decide(bot: ScriptedPlayer, seen: NDArray[Any], mask: NDArray[Any], memory: Memory) -> Kernel:
    """The kernel that writes the bot's action in each seat to `decisions`."""
    rule: Any = bot._decide_all
    known: tuple[Any, ...] = ()
    if isinstance(rule, partial):
        rule, known = rule.func, rule.args
    random = memory.name("random", np.zeros(1, np.uint64))
    decisions = memory.name("decisions", np.zeros(mask.shape[1], np.int64))
    return Kernel("decide", rule, (*known, seen[0], mask[0], random, decisions))
