"""Scripted players of multitask and duel: functions of what `getState` of the game returns.

Each returns the keys to hold until the next call, at most two, and may be called every few ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flash.description import find_description
from marl_cair.games.flash.scenarios import Scenario
from marl_cair.games.game import Agent, GameSpec

State = Mapping[str, Any]
# multitask
ARROW_MARGIN = 22.0  # pixels between the centres of avatar and arrow that are safe
ARROW_LENGTH = 42.0  # half an arrow, half the avatar and some pixels
AVATAR_LIMIT, AVATAR_STEP = 64, 4  # pixels
AVATAR_MOVES = {0: None, -AVATAR_STEP: "up", AVATAR_STEP: "down"}
DODGE_HORIZON = 50  # ticks
SPARE_TICKS = 8  # be out of an arrow's way so much earlier
JUMP_DISTANCE, JUMP_TICKS = 21.0, 11.0  # jump so far before a hurdle, and so many of its ticks

# duel: the keys of each player
DUEL_KEYS = (
    {"up": "w", "down": "s", "fire": "d", "shield": "a"},
    {"up": "up", "down": "down", "fire": "left", "shield": "right"},
)
SHIP_X, SHIP_STEP, SHIP_HALF_HEIGHT = 200.0, 5.0, 30.0
MISS = 42.0  # pixels between the centres of ship and bolt at which the bolt misses
KEEP_OFF = 66.0  # do not move towards the enemy while a bolt flies by so near
SHIELD_TICKS, DODGE_TICKS = 6, 24  # shield against, or dodge, a bolt that arrives so soon


def play_multitask(state: State) -> set[str]:
    """Keys ("left", "right", "up", "down") that keep all open tasks of multitask going."""
    if state["scene"] != "stage":
        return set()
    tilt, is_urgent = _balance(state["balance"])
    if "jump" in state and _must_jump(state["jump"]):
        return {"left", "right"}
    move = _dodge(state["dodge"]) if "dodge" in state else None
    must_heat = "hover" in state and state["hover"]["y"] + 12 * state["hover"]["velocity"] > 0
    if must_heat and not is_urgent and move is None:
        return {"up", "down"}
    return {key for key in (tilt, move) if key is not None}


def _balance(task: State) -> tuple[str | None, bool]:
    """Tilts against the ball's position and speed; urgent when the ball is far out or fast."""
    wanted = -0.004 * task["position"] - 0.06 * task["velocity"]
    error = wanted - task["angle"] - 6 * task["turn"]
    is_urgent = abs(task["position"]) > 45 or abs(task["velocity"]) > 2
    if abs(error) < 0.02:
        return None, is_urgent
    return ("right" if error > 0 else "left"), is_urgent


def _dodge(task: State) -> str | None:
    """The move with the fewest ticks in danger, by dynamic programming over heights."""
    danger = dict.fromkeys(range(-AVATAR_LIMIT, AVATAR_LIMIT + 1, AVATAR_STEP), 0)
    for tick in range(DODGE_HORIZON, 0, -1):
        heights = [
            arrow["y"]
            for arrow in task["arrows"]
            if -ARROW_LENGTH / abs(arrow["speed"])
            < -arrow["x"] / arrow["speed"] - tick
            < ARROW_LENGTH / abs(arrow["speed"]) + SPARE_TICKS
        ]
        danger = {
            y: sum(abs(y - height) < ARROW_MARGIN for height in heights)
            + min(danger[y + move] for move in AVATAR_MOVES if y + move in danger)
            for y in danger
        }
    y = AVATAR_STEP * round(task["y"] / AVATAR_STEP)
    best = min(AVATAR_MOVES, key=lambda move: danger.get(y + move, DODGE_HORIZON))
    return AVATAR_MOVES[best]


def _must_jump(task: State) -> bool:
    return task["height"] == 0 and any(
        -JUMP_DISTANCE < hurdle["distance"] < JUMP_DISTANCE + JUMP_TICKS * hurdle["speed"]
        for hurdle in task["hurdles"]
    )


def play_duel(state: State, player: int) -> set[str]:
    """Keys of player 0 or 1 of duel (else IndexError): dodge or shield bolts, else aim and fire."""
    keys = DUEL_KEYS[player]
    if state["scene"] != "stage":
        return set()
    own, enemy = state["players"][player], state["players"][1 - player]
    ticks, dy = _next_bolt(state, player)
    if ticks < DODGE_TICKS and abs(dy) < MISS:
        room = state["wall"] - SHIP_HALF_HEIGHT
        ways = [(MISS - dy, "up", room + own["y"]), (MISS + dy, "down", room - own["y"])]
        free = [(pixels, way) for pixels, way, space in ways if pixels < space]
        pixels, way = min(free, default=(math.inf, ""))
        if pixels <= ticks * SHIP_STEP:
            return {keys[way]}
        return {keys["shield"]} if ticks < SHIELD_TICKS else set()
    distance = enemy["y"] - own["y"]
    is_covered = abs(own["y"] - state["block"]["y"]) < state["block"]["half_height"] + 8
    pressed = set()
    if abs(distance) > 8 and ticks > DODGE_TICKS:
        pressed.add(keys["down" if distance > 0 else "up"])
    if abs(distance) < 40 and own["energy"] > 60 and not is_covered:
        pressed.add(keys["fire"])
    return pressed


def _next_bolt(state: State, player: int) -> tuple[float, float]:
    """Ticks until the first bolt that would come near the player, and its height below it."""
    ship = (-SHIP_X, SHIP_X)[player]
    arrivals = [(math.inf, 0.0)]
    for bolt in state["bolts"]:
        ticks = (ship - bolt["x"]) / bolt["vx"]
        dy = bolt["y"] + bolt["vy"] * ticks - state["players"][player]["y"]
        if bolt["owner"] != player and ticks > 0 and abs(dy) < KEEP_OFF:
            arrivals.append((ticks, dy))
    return min(arrivals)


class VectorPlayer:
    """A scripted player as an agent: it sees the representation `vector`.

    play: keys to hold, of a state as `getState` returns it and a player's number.
    """

    representation = "vector"

    def __init__(
        self,
        name: str,
        play: Callable[[State, int], set[str]],
        paths: Sequence[str],
        action_names: Sequence[str],
    ) -> None:
        self.name, self._play, self._paths = name, play, paths
        actions = [frozenset(action.split("+")) for action in action_names]
        self._numbers = {action: number for number, action in enumerate(actions)}

    def seed(self, seed: int) -> None:
        """Nothing is drawn."""

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        chosen = np.zeros(len(observation), np.int64)
        for row, (_, *values) in enumerate(observation.tolist()):
            state = restore_state(self._paths, values)
            # Each player sees itself as the first.
            held = self._play({**state, "scene": "stage"}, 0)
            chosen[row] = self._numbers[frozenset(held or {"noop"})]
        return chosen

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Nothing is drawn."""


def restore_state(paths: Sequence[str], values: Sequence[float]) -> dict[str, Any]:
    """Nested dicts and lists from the values at `paths`; parts that are 0 throughout, as missing
    arrows, are left out.
    """
    tree: dict[str, Any] = {}
    for path, value in zip(paths, values, strict=True):
        *parents, name = path.split(".")
        node = tree
        for parent in parents:
            node = node.setdefault(parent, {})
        node[name] = value
    return {"bolts": []} | {name: _prune(part) for name, part in tree.items() if _has_values(part)}


def _prune(part: Any) -> Any:
    if not isinstance(part, dict):
        return part
    if all(name.isdecimal() for name in part):
        return [_prune(one) for one in part.values() if _has_values(one)]
    return {name: _prune(one) for name, one in part.items()}


def _has_values(part: Any) -> bool:
    return any(map(_has_values, part.values())) if isinstance(part, dict) else part != 0


def make_bot(name: str, scenario: Scenario, spec: GameSpec) -> Agent:
    """A bot of BOTS. Raises ValueError for another game, or another action space than `keys`."""
    game, play = _PLAYERS[name]
    described = find_description(scenario.description)
    if (described.title.lower(), scenario.actions) != (game, "keys"):
        raise ValueError(
            f"flash: the bot {name} plays {game} with actions=keys, not {scenario.description} "
            f"with actions={scenario.actions}: take the bot random"
        )
    paths = [number.path for number in described.numbers]
    return VectorPlayer(name, play, paths, spec.action_names)


_PLAYERS: dict[str, tuple[str, Callable[[State, int], set[str]]]] = {
    "juggler": ("multitask", lambda state, player: play_multitask(state)),
    "duelist": ("duel", play_duel),
}
BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    name: partial(make_bot, name) for name in _PLAYERS
}
