"""Writes the description of a SWF file: what `marl-cair flash add` does."""

from __future__ import annotations

import hashlib
import json
from argparse import Namespace
from pathlib import Path
from typing import Any

from marl_cair.files import write_atomically
from marl_cair.games.flash.browser.swf_header import read_header
from marl_cair.games.flash.description import read_description
from marl_cair.games.flash.ending import EndReader


def describe_swf(chosen: Namespace) -> str:
    """Write <out>/<name>.toml, as the options say, and a copy of the SWF beside it; returns what to
    do next.

    Raises:
        ValueError: the file is no SWF, or an option cannot be used; nothing is written then.
        FileExistsError: there is such a description.
    """
    swf, out = chosen.swf, chosen.out
    name = chosen.name or swf.stem
    path = out / f"{name}.toml"
    if path.exists():
        raise FileExistsError(f"{path} exists already: give another --name, or delete it")
    data, target = swf.read_bytes(), out / f"{name}.swf"
    is_new = not target.exists()
    if not is_new and target.read_bytes() != data:
        raise FileExistsError(f"{target} is another SWF: give another --name, or delete it")
    (width, height), fps = read_header(swf)
    entries: dict[str, Any] = {
        "title": name,
        "swf": f"{name}.swf",
        "sha256": hashlib.sha256(data).hexdigest(),
        "size": [width, height],
        "fps": max(1, round(fps)),
        "renderer": chosen.renderer,
        "start": [_read_input(word) for word in chosen.start.split(";") if word],
        "keys": [[key for key in part.split(",") if key] for part in chosen.keys.split(";")],
        "callback": chosen.callback,
        "done": _read_ending(chosen.done),
    }
    if chosen.mouse_grid:
        entries["mouse_grid"] = _read_numbers("--mouse-grid", chosen.mouse_grid.split("x"), 2)
    if "," in chosen.reward:
        entries["score"] = {"region": _read_numbers("--reward", chosen.reward.split(","), 4)}
    elif chosen.reward != "alive":
        entries["score"] = chosen.reward
    text = "".join(f"{key} = {_format(value)}\n" for key, value in entries.items() if value != "")
    out.mkdir(parents=True, exist_ok=True)
    try:
        write_atomically(target, data)
        write_atomically(path, text)
        EndReader(read_description(path)).check()
    except ValueError:
        path.unlink()
        if is_new:
            target.unlink()
        raise
    mouse = "" if chosen.keys else " game.options.actions=mouse"
    return (
        f"{path} describes {width} x {height} pixels at {fps:g} frames per second. Next:\n"
        f"  marl-cair flash play {path}\n"
        f"  marl-cair train recipe=flash game.options.description={path}{mouse}\n"
    )


def _read_input(word: str) -> str | int:
    return int(word) if word.isdecimal() and len(word) > 1 else word


def _read_ending(done: str) -> str | dict[str, Any]:
    *region, last = done.split(",")
    if not region:
        return done
    return {"region": _read_numbers("--done", region, 4), "picture": str(Path(last).resolve())}


def _read_numbers(option: str, parts: list[str], count: int) -> list[int]:
    if len(parts) != count or not all(part.strip().isdecimal() for part in parts):
        raise ValueError(f"{option} has {parts}, give {count} whole numbers")
    return [int(part) for part in parts]


def _format(value: Any) -> str:
    """TOML of plain data: JSON but for tables."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_format(one)}" for key, one in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
