"""Writes the page on which a game is played in a browser: one file, which opens from disk."""

from __future__ import annotations

import base64
import dataclasses
import json
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory
from typing import Any

from marl_cair.browser.compiling import load_rules
from marl_cair.browser.kernels import PICTURE, change_picture
from marl_cair.browser.runtime import find_runtime
from marl_cair.files import write_atomically
from marl_cair.games.game import NO_CELL, Game, GameSpec
from marl_cair.viewer.page import make_policy, read_theme

PAGE_FILE, NETWORK_FILE, RULES_FILE = "index.html", "agent.onnx", "rules.wasm"
_PARTS = Path(__file__).parent / "page"
# Kinds of action that the left and the right mouse button order where no tool is chosen.
_POINTERS: Mapping[str, Mapping[str, str]] = {"deep_rts": {"left": "select", "right": "go"}}


@dataclasses.dataclass(frozen=True)
class Opponent:
    """Who plays the other seats.

    Attributes:
        name: that the page shows.
        bot: a bot of the game, which is compiled with the rules; "" for a network.
        representation, dtype, state_size, plays: of a network, as its ONNX metadata say.
    """

    name: str
    bot: str = ""
    representation: str = ""
    dtype: str = ""
    state_size: int = 0
    plays: str = ""


def write_folder(
    folder: Path,
    game: Game,
    scenario_name: str,
    scenario: Any,
    opponent: Opponent,
    write_network: Callable[[Path], object] | None = None,
) -> None:
    """Write a page with the rules and the opponent into `folder`, which is new, empty, or of an
    earlier call.

    write_network: writes the ONNX file of an opponent that is a network; if it raises, nothing is
        written.

    Raises:
        ValueError: the folder holds other files, a person cannot play the scenario, or the rules
            cannot be compiled.
        InstallError: onnxruntime-web is missing, which plays networks.
    """
    check_playable(game, scenario)
    held = folder.iterdir() if folder.is_dir() else ()
    if {file.name for file in held if not file.name.startswith(".")} - {PAGE_FILE}:
        raise ValueError(f"{folder} holds other files than {PAGE_FILE}: give a new folder")
    files = {} if opponent.bot else {file.name: file.read_bytes() for file in find_runtime()}
    representation = opponent.representation
    if opponent.bot:
        representation = game.bot(opponent.bot, scenario).representation
    if write_network is not None:  # before the minutes of compiling: it may refuse the network
        with TemporaryDirectory() as made:
            write_network(Path(made) / NETWORK_FILE)
            files[NETWORK_FILE] = (Path(made) / NETWORK_FILE).read_bytes()
    files[RULES_FILE] = load_rules(game, scenario, opponent.bot, representation)
    about = describe_game(game, scenario_name, scenario, opponent, representation)
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / PAGE_FILE, make_page(about, files))


def make_page(about: Mapping[str, Any], files: Mapping[str, bytes]) -> str:
    """The page of a game that `describe_game` describes. `files`: by the names that it reads."""
    packed = {name: base64.b64encode(zlib.compress(one, 9)).decode() for name, one in files.items()}
    script = (_PARTS / "play.js").read_text("utf-8")  # built from viewer/play
    # Only this script can make a blob: it starts onnxruntime-web so.
    return Template((_PARTS / PAGE_FILE).read_text("utf-8")).substitute(
        policy=make_policy(script, " 'wasm-unsafe-eval' blob:") + "; img-src data:",
        style=read_theme() + (_PARTS / "style.css").read_text("utf-8"),
        content=json.dumps({"game": about, "files": packed}).replace("<", "\\u003c"),
        script=script,
    )


def check_playable(game: Game, scenario: Any) -> None:
    """Raise ValueError unless a person can play the scenario in a browser."""
    if not game.has_snapshots:
        raise ValueError(
            f"{game.name} runs outside of its rules and cannot be compiled for a browser: "
            "'marl-cair play flash' shows it in a window"
        )
    spec = game.make_spec(scenario)
    if spec.action_shape:
        raise ValueError(
            f"{game.name}: actions of shape {spec.action_shape} cannot be given by hand: choose "
            "another action space, for example --set actions=unit"
        )


def describe_game(
    game: Game, scenario_name: str, scenario: Any, opponent: Opponent, representation: str
) -> dict[str, Any]:
    """What the page needs to know, as plain values."""
    spec = game.make_spec(scenario)
    painted = change_picture(game, scenario)
    return {
        "name": game.name,
        "title": game.title,
        "summary": game.summary,
        "version": game.version,
        "scenario": scenario_name,
        "options": dataclasses.asdict(scenario),
        "pays": spec.pays,
        "team_of_seat": spec.team_of_seat.tolist(),
        "seconds_per_step": spec.ticks_per_step / spec.ticks_per_second,
        "ticks": spec.ticks_per_step,
        "has_look": spec.ticks_per_step > 1,
        "max_steps": -(-spec.max_ticks // spec.ticks_per_step),
        "actions": {
            "noop": spec.noop_action,
            "groups": spec.action_groups.tolist(),
            "group_names": list(spec.action_group_names),
            "cells": spec.action_cells.tolist(),
            "prices": _list_prices(game, scenario),
        },
        "board": _find_board(game, painted) if (spec.action_cells != NO_CELL).any() else None,
        "pointer": dict(_POINTERS.get(game.name, {})),
        "numbers": _list_numbers(spec),
        "opponent": {
            "kind": "bot" if opponent.bot else "network",
            "name": opponent.name,
            "representation": representation,
            "dtype": opponent.dtype,
            "stateSize": opponent.state_size,
            "plays": opponent.plays,
        },
    }


def _list_numbers(spec: GameSpec) -> list[dict[str, Any]]:
    """The resources, and where `vector` shows them: of the seat, and of its enemy or None."""
    if "vector" not in spec.representations:
        return []
    entries = {name: at for at, name in enumerate(spec.representations["vector"].plane_names)}
    return [
        {"label": name, "own": entries[f"own {name}"], "enemy": entries.get(f"enemy {name}")}
        for name in spec.resources
        if f"own {name}" in entries
    ]


def _list_prices(game: Game, scenario: Any) -> dict[str, str]:
    """What kinds of action cost, such as "40 gold, 1 lumber", in games with prices."""
    costs: dict[str, dict[str, int]] = {}
    if game.name == "deep_line_wars":
        from marl_cair.games.deep_line_wars.tables import PRESETS, TOWER_NAMES, UNIT_NAMES

        preset = PRESETS[scenario.preset]
        for name, gold in zip(UNIT_NAMES, preset.unit_cost_gold, strict=True):
            costs[f"buy_{name}"] = {"gold": gold}
        towers = zip(TOWER_NAMES, preset.tower_cost_gold, preset.tower_cost_lumber, strict=True)
        for name, gold, lumber in towers:
            costs[f"build_{name}"] = {"gold": gold, "lumber": lumber}
    elif game.name == "deep_rts":
        from marl_cair.games.deep_rts.rules import rulebook as rb
        from marl_cair.games.deep_rts.tables import NUM_RESOURCES, PRODUCT_NAMES, RESOURCE_NAMES

        first, last = rb.PRODUCT_COST, rb.PRODUCT_COST + NUM_RESOURCES
        amounts = game.make_rules(scenario).product[:, first:last].tolist()
        for name, one in zip(PRODUCT_NAMES, amounts, strict=True):
            costs[f"make_{name}"] = dict(zip(RESOURCE_NAMES, one, strict=True))
    return {
        kind: ", ".join(f"{amount} {name}" for name, amount in cost.items() if amount)
        for kind, cost in costs.items()
    }


def _find_board(game: Game, scenario: Any) -> dict[str, float]:
    """Where the board lies in the picture, in pixels: left and top edge, side of a tile."""
    left = top = 0.0
    width = game.make_spec(scenario).representations[PICTURE].shape[-1]
    tile = width / scenario.columns
    if game.name == "deep_line_wars":
        from marl_cair.games.deep_line_wars.rendering import board_box

        plain = getattr(board_box, "py_func", board_box)  # compiling it would take longer
        tile, top, left = plain(game.make_rules(scenario))
    return {
        "left": left,
        "top": top,
        "tile": tile,
        "rows": scenario.rows,
        "columns": scenario.columns,
    }
