"""Scripted players of multitask and duel: functions of what `getState` of the game returns.

Each returns the keys to hold until the next call, at most two, and may be called every few ticks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

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
