"""The panels beside the game: each is a function that writes what it shows below the last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.window import colours
from marl_cair.window.colours import Colour
from marl_cair.window.pen import MARGIN, Pen
from marl_cair.window.session import Moment, Session

MOST_BARS = 6
MOST_COLUMNS = 7
GRAPH_PIXELS = 44
RATES_KEPT = 120  # half seconds


@dataclass
class PanelState:
    """What the panels show.

    Attributes:
        seats: players whose numbers the viewer may see.
        inks: colour of each seat [P].
        frame_rates, tick_rates: of the last time, newest last.
    """

    session: Session
    moment: Moment
    seats: tuple[int, ...]
    inks: list[Colour]
    speed: str = ""
    frame_rates: list[float] = field(default_factory=list)
    tick_rates: list[float] = field(default_factory=list)


def show_status(pen: Pen, state: PanelState) -> None:
    """The game, its time, speed and view."""
    session, moment = state.session, state.moment
    spec, view = session.spec, moment.view
    pen.line(session.game.title, colours.BRIGHT)
    ticks = moment.step * spec.ticks_per_step
    pen.line(f"tick {ticks:,} of {spec.max_ticks:,}    {state.speed}")
    seen = "all" if view.seat is None else f"player {view.seat}"
    kind = f", {view.representation}" if view.representation else ""
    pen.line(f"view: {seen}{kind}", colours.DIM)
    pen.line("G: all keys", colours.DIM)


def show_players(pen: Pen, state: PanelState) -> None:
    """Names, with those that are out dimmed."""
    pen.heading("players")
    for seat, name in enumerate(state.session.names):
        is_out = bool(state.moment.eliminated[seat])
        text = f"{seat}  {name}{'  (out)' if is_out else ''}"
        pen.line(text, colours.DIM if is_out else colours.INK, state.inks[seat])


def show_resources(pen: Pen, state: PanelState) -> None:
    """What each player owns."""
    _show_table(pen, "resources", state.moment.numbers.resources, state)


def show_scoreboard(pen: Pen, state: PanelState) -> None:
    """How well each player does."""
    _show_table(pen, "scoreboard", state.moment.numbers.scoreboard, state)


def _show_table(
    pen: Pen, title: str, columns: Mapping[str, NDArray[np.float64]], state: PanelState
) -> None:
    if not columns or not state.seats:
        return
    pen.heading(title)
    names = list(columns)[:MOST_COLUMNS]
    rows = [[format_number(columns[name][seat]) for name in names] for seat in state.seats]
    pen.table(names, rows, [state.inks[seat] for seat in state.seats])


def show_actions(pen: Pen, state: PanelState) -> None:
    """The action distribution: shares of the most frequent kinds of each player."""
    counts = state.session.action_counts[list(state.seats)]
    if not counts.sum():
        return
    pen.heading("actions")
    shares = counts / np.maximum(1, counts.sum(1, keepdims=True))
    most = MOST_BARS if len(shares) <= MOST_BARS // 2 else MOST_BARS - 2
    top = np.argsort(-shares.max(0), kind="stable")[:most]
    names = state.session.spec.action_group_names
    for group in top.tolist():
        if not shares[:, group].any():
            continue
        label, row = names[group].replace("_", " "), shares[:, group].tolist()
        number = " ".join(f"{100 * share:.0f}" for share in row) if len(row) <= 2 else ""
        pen.bars(label, row, f"{number} %" if number else "", [state.inks[s] for s in state.seats])


def show_values(pen: Pen, state: PanelState) -> None:
    """The largest action values of an agent that is a network, the best first."""
    for seat in [seat for seat in state.seats if seat in state.moment.values][:2]:
        values = state.moment.values[seat]
        legal = np.flatnonzero(np.isfinite(values))
        top = legal[np.argsort(-values[legal], kind="stable")][: MOST_BARS - 1]
        is_sampled = getattr(state.session.agents[seat], "is_sampled", False)
        pen.heading(f"action {'probabilities' if is_sampled else 'values'} of player {seat}")
        low, high = float(values[legal].min()), float(values[legal].max())
        if is_sampled:
            low, high = 0.0, 1.0
        for action in top.tolist():
            share = (float(values[action]) - low) / max(1e-9, high - low)
            name = state.session.spec.action_names[action].replace("_", " ")
            pen.bars(name, [share], f"{values[action]:.3f}", [state.inks[seat]])


def show_graphs(pen: Pen, state: PanelState) -> None:
    """Score over the game; frames and ticks in a second over the last minute."""
    notes = state.session.history.notes
    pen.heading("over time")
    if notes and state.seats:
        lines = [[float(note.numbers.score[seat]) for note in notes] for seat in state.seats]
        inks = [state.inks[seat] for seat in state.seats]
        pen.graph(notes[-1].numbers.score_name, lines, inks, GRAPH_PIXELS)
    for title, rates in (("frames/s", state.frame_rates), ("ticks/s", state.tick_rates)):
        if rates:
            pen.graph(title, [rates[-RATES_KEPT:]], [colours.GOOD], GRAPH_PIXELS // 2)


PANELS: tuple[Callable[[Pen, PanelState], None], ...] = (
    *(show_status, show_players, show_resources, show_scoreboard),
    *(show_actions, show_values, show_graphs),
)


def draw_panels(surface: Any, state: PanelState) -> int:
    """Draw all panels, one below another; returns the height in pixels that they need."""
    surface.fill(colours.PANEL)
    pen = Pen(surface)
    for show in PANELS:
        show(pen, state)
    return pen.y + MARGIN


def format_number(value: float) -> str:
    """A number in few characters: 12, 0.25, 15k."""
    if abs(value) >= 10_000:
        return f"{value / 1000:.0f}k"
    return f"{value:.0f}" if float(value).is_integer() or abs(value) >= 100 else f"{value:.2f}"
