"""Packs a recorded game for the viewer: plain data as JSON, bytes as base64."""

from __future__ import annotations

import base64
import json
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import GameSpec
from marl_cair.games.registry import GAMES
from marl_cair.games.replays import Replay, replay_steps
from marl_cair.text import clean_text
from marl_cair.viewer.colours import list_seat_colours
from marl_cair.viewer.measures import Measurements, find_events
from marl_cair.viewer.tiles import MOST_TILES, PackedView, TilePacker

FORMAT_VERSION = 1  # other data need another script
MAX_BYTES = 2_000_000  # of the text of one game
MOST_CHOICES = 5  # best actions that are shown, of an agent's values
_MOST_ORDERS = 3  # kinds of orders that are named, where a seat gives many in a step


def pack_game(
    replay: Replay,
    *,
    max_bytes: int = MAX_BYTES,
    views: Sequence[int | None] | None = None,
    every: int = 1,
    fps: float | None = None,
) -> str:
    """The game as JSON text for `page.make_element`; it is played again once for each view.

    max_bytes: seats' views are left out that would make it larger, and of the first view only each
        second, fourth, ... picture is kept until it fits.
    views: seats, or None for the spectator; the default is the spectator, then all seats.
    every: pictures are of each so many steps, and of the end.
    fps: steps per second; the default is the pace of the game.

    Raises ReplayError as `replay_steps`, ValueError for a seat that does not exist.
    """
    wanted = [None, *range(len(replay.players))] if views is None else list(views)
    if wrong := [seat for seat in wanted if seat not in (None, *range(len(replay.players)))]:
        raise ValueError(
            f"there is no seat {wrong[0]}: the game has the seats 0 to {len(replay.players) - 1}"
        )
    measured, data = Measurements(), _describe(replay, fps)
    first = _pack_view(replay, wanted[0], every, measured)
    data |= _list_numbers(replay, measured, data["players"])
    left: float = max_bytes - len(json.dumps(data))
    while _text_size(first) > left and every <= len(replay.actions):
        every *= 2
        first = _pack_view(replay, wanted[0], every)
    packed = [first]
    for seat in wanted[1:]:
        if packed[-1] not in packed[:-1]:
            left -= _text_size(packed[-1])
        if left < packed[-1].num_bytes:  # a view is about as large as the one before
            break
        view = _pack_view(replay, seat, every)
        if view not in packed and _text_size(view) > left:
            break
        packed.append(view)
    distinct = list(dict.fromkeys(packed))
    data["every"], data["numLeftOut"] = every, len(wanted) - len(packed)
    data["pictures"] = [_format_pictures(one) for one in distinct]
    data["views"] = [
        _describe_view(replay, seat) | {"pictures": distinct.index(one)}
        for seat, one in zip(wanted, packed, strict=False)
    ]
    return json.dumps(data, separators=(",", ":"))


def _text_size(packed: PackedView) -> float:
    """Bytes as base64; a view with too many tiles is endless."""
    return inf if packed.num_tiles > MOST_TILES else packed.num_bytes * 4 / 3


def _pack_view(
    replay: Replay, seat: int | None, every: int, measured: Measurements | None = None
) -> PackedView:
    packer = TilePacker()
    for step, engine in enumerate(replay_steps(replay)):
        if step % every == 0 or step == len(replay.actions):
            packer.add(engine.render(0, seat))
        if measured is not None:
            measured.add(engine)
    return packer.pack()


def _describe(replay: Replay, fps: float | None) -> dict[str, Any]:
    """What the replay itself says."""
    game, spec = GAMES[replay.game], replay.spec
    names = Counter(replay.players)
    players = [
        clean_text(f"{name} (seat {seat})" if names[name] > 1 else name)
        for seat, name in enumerate(replay.players)
    ]
    return {
        "title": game.title,
        "rules": f"rules version {replay.rules_version}, map seed {replay.map_seed}",
        "players": players,
        "teams": spec.team_of_seat.tolist(),
        "steps": len(replay.actions),
        "fps": fps or spec.render_fps,
        "secondsPerStep": spec.ticks_per_step / spec.ticks_per_second,
        "actions": _pack_actions(replay),
        "values": _pack_values(replay),
    }


def _list_numbers(replay: Replay, measured: Measurements, players: Sequence[str]) -> dict[str, Any]:
    series = {**measured.list_series(), **_list_value_series(replay)}
    return {
        "series": [
            {"name": name, "isResource": name in replay.spec.resources, "values": _encode(values)}
            for name, values in series.items()
        ],
        "events": [event._asdict() for event in find_events(replay, measured, players)],
    }


def _describe_view(replay: Replay, seat: int | None) -> dict[str, Any]:
    teams = replay.spec.team_of_seat
    colours = list_seat_colours(replay.game, replay.scenario, teams, seat)
    return {"seat": seat, "colours": [f"#{bytes(colour).hex()}" for colour in colours]}


def _format_pictures(packed: PackedView) -> dict[str, Any]:
    return {
        "width": packed.width,
        "height": packed.height,
        "left": packed.left,
        "top": packed.top,
        "atlas": base64.b64encode(packed.atlas).decode(),
        "changes": base64.b64encode(packed.changes).decode(),
    }


def _pack_actions(replay: Replay) -> dict[str, Any]:
    """The action of each seat at each step as text: distinct texts, and their numbers [T, P]."""
    spec, actions = replay.spec, replay.actions
    if not spec.action_shape:
        used, numbers = np.unique(actions, return_inverse=True)
        texts = [spec.action_names[action] for action in used.tolist()]
    else:
        listed = [[_describe_orders(seat, spec) for seat in step] for step in actions]
        found, numbers = np.unique(np.array(listed, str), return_inverse=True)
        texts = found.tolist()
    shaped = np.reshape(numbers, actions.shape[:2])
    return {"texts": texts, "numbers": _encode(shaped.astype(np.float32))}


def _describe_orders(actions: NDArray[np.int32], spec: GameSpec) -> str:
    """The orders of one seat at all its places, by kind."""
    given = actions[actions != spec.noop_action]
    names = Counter(spec.action_group_names[spec.action_groups[action]] for action in given)
    parts = [f"{count} x {name}" for name, count in names.most_common(_MOST_ORDERS)]
    return ", ".join(parts) + (", ..." if len(names) > _MOST_ORDERS else "") or "noop"


def _pack_values(replay: Replay) -> list[dict[str, Any]]:
    """The best MOST_CHOICES actions by each kind of values [T, P, A] that the replay has."""
    packed = []
    for name, values in (replay.values or {}).items():
        if values.shape[2:] != (replay.spec.num_actions,):
            continue
        numbers = np.where(np.isfinite(values), values, -np.inf).astype(np.float32)
        best = np.argsort(-numbers, axis=-1, kind="stable")[..., :MOST_CHOICES]
        used, texts = np.unique(best, return_inverse=True)
        packed.append(
            {
                "name": name,
                "texts": [replay.spec.action_names[action] for action in used.tolist()],
                "choices": _encode(np.reshape(texts, best.shape).astype(np.float32)),
                "values": _encode(np.take_along_axis(numbers, best, -1)),
                "count": best.shape[-1],
            }
        )
    return packed


def _list_value_series(replay: Replay) -> Mapping[str, NDArray[np.float32]]:
    """Values [T, P] of a replay, over its steps [T + 1, P]."""
    values = {name: found for name, found in (replay.values or {}).items() if found.ndim == 2}
    return {
        name: np.nan_to_num(np.concatenate([found[:1], found]).astype(np.float32))
        for name, found in values.items()
        if len(found)
    }


def _encode(values: NDArray[np.float32]) -> str:
    """float32, little-endian, one byte of each number after the other: deflated, as base64."""
    planes = values.astype("<f4").ravel().view(np.uint8).reshape(-1, 4).T
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()
