"""What a ladder cannot tell: whether one number per agent is enough, circles, other averages."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.averages import Averages, average_by_alpha_rank, average_by_nash
from marl_cair.league.ratings.cycles import Cycle, find_cycles
from marl_cair.league.ratings.fit import LEVEL, NOTICED_SHARE, NUM_SIMULATIONS, FitTest, check_fit
from marl_cair.league.ratings.payoffs import Payoffs
from marl_cair.league.ratings.rate import Games

ENOUGH_POWER = 0.8
SHOWN_CYCLES = 5
LINE_WIDTH = 100
NASH, ALPHA_RANK = "Nash averaging", "alpha-Rank"


@dataclass(frozen=True)
class Beyond:
    """Of n agents, by number; `order` tells which of them the ladder has first, second, ..."""

    fit: FitTest | None  # None: too few pairs have met for a circle to show
    cycles: tuple[Cycle, ...]
    averages: dict[str, Averages]  # by name
    order: NDArray[np.int64]


def look_beyond(
    games: Games, payoffs: Payoffs, seed: int = 0, with_alpha_rank: bool = False
) -> Beyond:
    """All of it; games and payoffs by the same numbers of agents, which are their order too.

    Raises:
        ValueError: alpha-Rank is asked for, and OpenSpiel is not installed.
    """
    num_agents = len(payoffs.counts)
    with ThreadPoolExecutor(1) as pool:
        fit = pool.submit(check_fit, num_agents, games, seed)
        cycles = find_cycles(num_agents, games)
        averages = {NASH: average_by_nash(payoffs)}
        if with_alpha_rank:
            averages[ALPHA_RANK] = average_by_alpha_rank(payoffs)
        return Beyond(fit.result(), cycles, averages, np.arange(num_agents))


def describe_beyond(beyond: Beyond, names: Sequence[str], num_teams: int) -> str:
    """As text; names by number. ASCII but for names."""
    parts = [tell_fit(beyond.fit), tell_cycles(beyond.cycles, names, num_teams)]
    text = "\n".join(textwrap.fill(part, LINE_WIDTH) for part in parts)
    told = [f"Is one number per agent enough?\n{text}"]
    told += [
        _describe_averages(title, found, [(int(n), names[n]) for n in beyond.order])
        for title, found in beyond.averages.items()
    ]
    return "\n\n".join(told)


def tell_fit(fit: FitTest | None) -> str:
    """The verdict of the test of fit, in words."""
    if fit is None:
        return "Too few pairs have met for a circle to show: this takes three that all meet."
    numbers = (
        f"{tell_p_value(fit.p_value)}; scores are {100 * fit.misfit:.1f} points of 100 off what "
        f"the ratings say on the mean, {100 * fit.misfit_by_chance:.1f} would be by chance"
    )
    power = (
        f"if every pair were {100 * NOTICED_SHARE:.0f} points of 100 off, that would show with a "
        f"chance of about {fit.power:.0%}"
    )
    if fit.p_value <= LEVEL:
        return f"No ({numbers}): read the matrix, not the ladder alone."
    if fit.power < ENOUGH_POWER:
        return f"There are too few games to tell ({numbers}): {power}."
    return f"Nothing speaks against it ({numbers}): {power}."


def tell_p_value(p_value: float) -> str:
    """In words: of N simulations, none of which is as extreme, only that it is below 1 / N."""
    if p_value * (NUM_SIMULATIONS + 1) < 1.5:
        return f"p < {math.ceil(1000.0 / NUM_SIMULATIONS) / 1000.0:.3f}"
    return f"p = {p_value:.3f}"


def tell_cycles(cycles: Sequence[Cycle], names: Sequence[str], num_teams: int) -> str:
    """The clearest circles of three, in words."""
    if not cycles:
        return "No three agents surely beat each other in a circle."
    verb = "beats" if num_teams == 2 else "comes in above"
    told = []
    for cycle in cycles[:SHOWN_CYCLES]:
        one, two, three = (names[agent] for agent in cycle.agents)
        told.append(
            f"{one} {verb} {two}, {two} {verb} {three}, and {three} {verb} {one} (with "
            f"{cycle.share:.0%} of the points or more)"
        )
    more = len(cycles) - len(told)
    circles = "circle" if len(cycles) == 1 else "circles"
    rest = f"; and {more} more in cycles.csv" if more else ""
    return f"{len(cycles)} {circles} of three: {'; '.join(told)}{rest}."


def _describe_averages(title: str, found: Averages, ranked: Sequence[tuple[int, str]]) -> str:
    width = max(len("agent"), *(len(name) for _, name in ranked))
    lines = [
        f"{title} (what is played by the weights, and the score against that; 95 %)",
        f"    {'agent':{width}} {'weight':>7} {'':>16} {'score':>7}",
    ]
    for place, (number, name) in enumerate(ranked, start=1):
        weight, skill = found.weights[number], found.skills[number]
        weights = f"[{found.low[number]:.1%}, {found.high[number]:.1%}]"
        skills = f"[{found.skill_low[number]:.1%}, {found.skill_high[number]:.1%}]"
        lines.append(
            f"{place:>3} {name:{width}} {weight:7.1%} {weights:>16} {skill:7.1%} {skills:>16}"
        )
    return "\n".join(lines)


def list_fit(beyond: Beyond) -> list[tuple[str, str]]:
    """The test of fit as names and values, for a table; without values where there is none."""
    names = ("deviance", "by_chance", "p_value", "misfit", "misfit_by_chance", "power")
    fit = beyond.fit
    return [
        (name, "" if fit is None else f"{getattr(fit, name):.6g}")
        for name in (*names, "dispersion")
    ]


def list_cycles(beyond: Beyond, names: Sequence[str]) -> list[tuple[str, ...]]:
    """All circles as rows of first, second, third and share."""
    return [
        (*(names[agent] for agent in cycle.agents), f"{cycle.share:.4f}") for cycle in beyond.cycles
    ]


def list_averages(beyond: Beyond, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Rows of method, agent, weight, its interval, score and its interval, best agent first."""
    rows = []
    for title, found in beyond.averages.items():
        columns = (
            found.weights,
            found.low,
            found.high,
            found.skills,
            found.skill_low,
            found.skill_high,
        )
        rows += [
            (title, names[number], *(f"{column[number]:.4f}" for column in columns))
            for number in beyond.order.tolist()
        ]
    return rows
