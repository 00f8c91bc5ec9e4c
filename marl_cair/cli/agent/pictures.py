"""Draws the pictures and the film of `marl-cair explain`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from marl_cair.games.replays import replay_steps
from marl_cair.league.play.film import write_gif

if TYPE_CHECKING:
    from marl_cair.cli.agent.explain import ExplainedGame
    from marl_cair.policies.actor import PolicyActor

MAX_FRAMES, FPS = 120, 8  # of the film
MOST_BARS = 10  # actions in a picture, those with the largest values
MOST_NAMES = 12  # kinds of action in a picture
_BLUE, _ORANGE, _GREY = "#3b6ea8", "#d9822b", "#9aa3ad"
_ROW, _LEFT, _WIDTH = 24, 150, 320  # pixels of the film's bars


def save_all(
    explained: ExplainedGame,
    agent: PolicyActor,
    returns: NDArray[np.float64],
    gamma: float,
    num_steps: int,
    folder: Path,
) -> list[str]:
    """Write all pictures and numbers to `folder`; returns the names of the files."""
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        folder / "steps.npz",
        observation=explained.observation,
        action_mask=explained.action_mask,
        values=explained.values,
        action=explained.played,
        reward=explained.rewards,
        discounted_return=returns,
        gamma=gamma,
    )
    length = len(returns)
    decided = np.arange(0, length, explained.every)
    free = decided[explained.action_mask[decided].sum(1) > 1]
    decided = free if len(free) else decided  # steps with one legal action show little
    chosen = np.unique(decided[np.linspace(0, len(decided) - 1, num_steps).round().astype(int)])
    every = -(-length // MAX_FRAMES)
    kept = range(0, length, every)
    boards = render_steps(explained, {*chosen.tolist(), *kept})
    figures: dict[str, Figure] = {
        "values.png": draw_values(explained, boards, chosen),
        "actions.png": draw_actions(explained),
        "overestimation.png": draw_overestimation(explained, returns, gamma),
    }
    presences = agent.find_presences(explained.observation[chosen])
    if presences is not None:
        figures["presence.png"] = draw_presence(explained, presences, chosen)
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=150)
    frames = (np.asarray(draw_frame(explained, boards[s], s)) for s in kept)
    write_gif(folder / "film.gif", frames, FPS)
    return [*figures, "film.gif", "steps.npz"]


def render_steps(explained: ExplainedGame, steps: set[int]) -> dict[int, NDArray[np.uint8]]:
    """Pictures of the game before each of `steps`, uint8 [h, w, 3], played again."""
    games = enumerate(replay_steps(explained.replay))
    return {step: engine.render(0).copy() for step, engine in games if step in steps}


def rank_actions(explained: ExplainedGame, step: int) -> NDArray[np.int64]:
    """Up to MOST_BARS legal actions of a step by value, the largest first."""
    order = np.argsort(-explained.values[step], kind="stable")
    return order[: min(MOST_BARS, int(explained.action_mask[step].sum()))]


def draw_values(
    explained: ExplainedGame, boards: dict[int, NDArray[np.uint8]], chosen: NDArray[np.int64]
) -> Any:
    """For each step: the game, action values, and advantages over the mean of legal actions."""
    figure, axes = _make_figure(len(chosen), 3, (12.5, 3.1 * len(chosen)), [1.0, 1.0, 1.0])
    names = explained.replay.spec.action_names
    for (board, value, advantage), step in zip(axes, chosen.tolist(), strict=True):
        board.imshow(boards[step])
        board.set_axis_off()
        board.set_title(f"step {step}", fontsize=10)
        ranked, row = rank_actions(explained, step), explained.values[step]
        mean = row[explained.action_mask[step]].mean()
        colours = [_ORANGE if one == explained.played[step] else _BLUE for one in ranked]
        places = np.arange(len(ranked))
        value.barh(places, row[ranked], color=colours)
        advantage.barh(places, row[ranked] - mean, color=colours)
        value.set_yticks(places, [names[one] for one in ranked], fontsize=8)
        advantage.set_yticks([])
        legal = int(explained.action_mask[step].sum())
        value.set_title(f"Q: best {len(ranked)} of {legal} legal actions", fontsize=10)
        advantage.set_title("advantage: Q minus the mean over legal actions", fontsize=10)
        for axis in (value, advantage):
            axis.invert_yaxis()
            _clean(axis)
    axes[0][1].text(
        *(0.98, 0.04, "orange: played"), ha="right", color=_ORANGE, transform=axes[0][1].transAxes
    )
    return figure


def draw_actions(explained: ExplainedGame) -> Any:
    """How often each kind of action was played, and when."""
    spec = explained.replay.spec
    played = explained.played.astype(np.int64)
    names, kinds = spec.action_group_names, spec.action_groups[played].astype(np.int64)
    if spec.num_actions <= MOST_NAMES:
        names, kinds = spec.action_names, played
    counts = np.bincount(kinds, minlength=len(names))
    order = np.argsort(-counts, kind="stable")
    order = order[counts[order] > 0][:MOST_NAMES]
    size = (11.0, 1.4 + 0.32 * max(4, len(order)))
    figure, axes = _make_figure(1, 2, size, [1.0, 1.6])
    share, when = axes[0]
    places = np.arange(len(order))
    share.barh(places, counts[order] / len(kinds), color=_BLUE)
    share.set_yticks(places, [names[one] for one in order], fontsize=9)
    share.set_xlabel("share of steps")
    for place, one in enumerate(order.tolist()):
        steps = np.flatnonzero(kinds == one)
        when.plot(steps, np.full(len(steps), place), "|", color=_BLUE, markersize=9)
    when.set_yticks([])
    when.set_xlim(-0.5, len(kinds) - 0.5)
    when.set_xlabel("step")
    for axis in (share, when):
        axis.set_ylim(len(order) - 0.5, -0.5)
        _clean(axis)
    return figure


def draw_overestimation(
    explained: ExplainedGame, returns: NDArray[np.float64], gamma: float
) -> Any:
    """The largest value at each step, and the discounted return that followed."""
    figure, axes = _make_figure(1, 1, (8.0, 3.6), [1.0])
    axis, largest = axes[0][0], explained.values.max(1)
    steps = np.arange(len(returns))
    axis.fill_between(steps, largest, returns, color=_GREY, alpha=0.25, linewidth=0)
    axis.plot(steps, largest, color=_BLUE, label="largest Q of a legal action")
    axis.plot(
        steps, returns, color=_ORANGE, label=f"discounted return that followed (gamma {gamma:g})"
    )
    axis.set_xlabel("step")
    axis.set_ylabel("value, in units of the reward")
    mean = float(np.mean(largest - returns))
    axis.set_title(f"mean overestimation {mean:+.3f}; game {explained.ending}", fontsize=10)
    axis.legend(frameon=False, fontsize=9)
    _clean(axis)
    return figure


def draw_presence(
    explained: ExplainedGame, presences: NDArray[np.float32], chosen: NDArray[np.int64]
) -> Any:
    """Presence of each type of part over the board of each step; grey: the observed planes."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgb

    num_steps, num_types = presences.shape[:2]
    height, width = explained.observation.shape[-2:]
    size = 1.45 * num_types + 0.9, 1.5 * num_steps * height / width + 0.6
    figure, axes = _make_figure(num_steps, num_types, size)
    tint = to_rgb("#d6336c")
    overlay = LinearSegmentedColormap.from_list("presence", [(*tint, 0.0), (*tint, 0.9)])
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    low, high = float(presences.min()), float(presences.max())
    for row, step, parts in zip(axes, chosen.tolist(), presences, strict=True):
        planes = explained.observation[step].astype(np.float64)
        varying = planes[np.ptp(planes.reshape(len(planes), -1), axis=1) > 0]
        board = varying.mean(0) if len(varying) else planes.mean(0)
        for number, (axis, presence) in enumerate(zip(row, parts, strict=True)):
            axis.imshow(board, "Greys", vmin=0.0, vmax=2.0 * max(board.max(), 1e-9), extent=extent)
            shown = axis.imshow(presence, overlay, vmin=low, vmax=high, extent=extent)
            axis.set_xticks([])
            axis.set_yticks([])
            if step == chosen[0]:
                axis.set_title(f"part {number}", fontsize=9)
            if number == 0:
                axis.set_ylabel(f"step {step}", fontsize=9)
    figure.colorbar(shown, ax=figure.axes, label="presence", fraction=0.02, pad=0.01)
    return figure


def draw_frame(explained: ExplainedGame, board: NDArray[np.uint8], step: int) -> Image.Image:
    """One frame of the film: the game, and the values of the best actions as bars."""
    game = Image.fromarray(board)
    height = max(game.height, _ROW * (MOST_BARS + 2))
    frame = Image.new("RGB", (game.width + _LEFT + _WIDTH, height), "white")
    frame.paste(game, (0, (height - game.height) // 2))
    draw, font = ImageDraw.Draw(frame), ImageFont.load_default(13)
    finite = explained.values[np.isfinite(explained.values)]
    low, high = min(0.0, float(finite.min())), max(0.0, float(finite.max()))
    start, scale = game.width + _LEFT, (_WIDTH - 70) / max(high - low, 1e-9)
    names, zero = explained.replay.spec.action_names, start - low * scale
    draw.text((start, 4), f"step {step}: action values Q", fill="black", font=font)
    for place, action in enumerate(rank_actions(explained, step).tolist()):
        value, top = float(explained.values[step, action]), _ROW * (place + 1) + 4
        end = zero + value * scale
        colour = _ORANGE if action == explained.played[step] else _BLUE
        draw.rectangle((min(zero, end), top, max(zero, end), top + _ROW - 8), fill=colour)
        label = names[action] if len(names[action]) <= 19 else f"{names[action][:18]}."
        draw.text((start - 6, top), label, fill="black", font=font, anchor="ra")
        draw.text((max(zero, end) + 4, top), f"{value:.2f}", fill="black", font=font)
    return frame


def _make_figure(
    rows: int, columns: int, size: tuple[float, float], widths: list[float] | None = None
) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, width_ratios=widths)


def _clean(axis: Any) -> None:
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(labelsize=8)
