"""Sentences of a league's report: headline, summary, comparisons, test of fit, warnings."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from marl_cair.league.ratings.fit import NOTICED_SHARE, NUM_SIMULATIONS, FitTest
from marl_cair.league.ratings.groups import SWEEP_PROBABILITY
from marl_cair.league.ratings.intervals import LEVEL
from marl_cair.league.ratings.likelihood import PRIOR_ELO
from marl_cair.league.ratings.rate import Ladder, Rating
from marl_cair.league.report.table import LeagueTable

ENOUGH_POWER = 0.8
SHOWN_CYCLES, SHOWN_PAIRS = 5, 4
BOUND_SIGNS = {"": "", "lower": ">=", "upper": "<="}
LIMITS = (
    "The intervals hold for these agents only: they say how the ratings would vary if the same "
    "agents played more games on other map seeds of the same scenario.\n"
    "They do not cover training variance: the same algorithm trained from another seed gives "
    "another agent, often of quite different strength. To compare algorithms, train several seeds "
    "of each, rate all of them together, and compare the spread between seeds.\n"
    "They do not cover other scenarios, other maps, or opponents unlike these agents. "
    "`marl-cair league exploit AGENT` trains opponents against one agent and measures its "
    "exploitability.\n"
    f"Ratings have a normal prior with a standard deviation of {PRIOR_ELO:,.0f} Elo about their "
    "mean. It affects ratings of agents with few points."
).split("\n")


def write_headline(table: LeagueTable) -> str:
    """The strongest agent, or that none is significantly the strongest."""
    if not table.ratings:
        return "No agent can be rated yet"
    best = table.ratings[0].name
    if len(table.ratings) == 1:
        return f"{best} is the only agent"
    close = [
        name for place, name in enumerate(table.names) if place and not table.differs(0, place)
    ]
    if not close:
        return f"{best} is the strongest"
    if len(close) == 1:
        return f"{best} and {close[0]} lead: their ratings do not differ significantly"
    return f"{best} leads, but {len(close)} other ratings do not differ significantly from its"


def write_summary(table: LeagueTable) -> list[str]:
    """How certain the headline is, which pairs are not distinguished, whether ratings suffice."""
    if table.ladder is None:
        return [*_list_forfeits(table), explain_no_ladder(table)]
    if len(table.ratings) == 1:
        return ["All games were played by one agent: a league needs two or more."]
    sentences = [*_list_forfeits(table), _describe_best(table, table.ladder)]
    sentences.append(_list_close_pairs(table))
    sentences.append(f"Is one number per agent enough? {describe_fit(table.fit)}")
    return [*sentences, describe_cycles(table)] if table.cycles else sentences


def _list_forfeits(table: LeagueTable) -> list[str]:
    lost: Counter[str] = Counter()
    for name, _, count in table.forfeits:
        lost[name] += count
    games = {rating.name: rating.games for rating in table.ratings}
    return [
        f"{name} forfeited {count}{f' of its {games[name]}' if name in games else ''} games: its "
        "score is not of its play alone (see Errors and forfeits)."
        for name, count in lost.items()
    ]


def _describe_best(table: LeagueTable, ladder: Ladder) -> str:
    best, second = table.ratings[:2]
    sure = f"it ranks first in {best.probability_first:.0%} of the resamples"
    gap = ladder.differences[0][1]
    if gap is None and not table.differs(0, 1):
        return f"{best.name} won every point against {second.name}, but in too few games: {sure}."
    if gap is None:
        return (
            f"No agent of a lower group took a point off the group of {best.name}: these games do "
            f"not limit its lead over {second.name}, the second."
        )
    numbers = f"{gap.elo:.0f} Elo [{gap.low:.0f}, {gap.high:.0f}]"
    unsure = "" if gap.low > 0.0 else "; the difference is not significant"
    return f"{best.name} is {numbers} ahead of {second.name}, the second{unsure}; {sure}."


def _list_close_pairs(table: LeagueTable) -> str:
    close = [
        f"{table.names[above]} and {table.names[below]}"
        for above, below in combinations(range(len(table.names)), 2)
        if not table.differs(above, below)
    ]
    if not close:
        return "All ratings differ significantly."
    more = len(close) - SHOWN_PAIRS
    rest = f"; and {more} more pair{'s' if more > 1 else ''}" if more > 0 else ""
    shown = "; ".join(close[:SHOWN_PAIRS])
    return f"Pairs whose ratings do not differ significantly: {shown}{rest}."


def explain_no_ladder(table: LeagueTable) -> str:
    """The reason why there are no ratings."""
    return f"No ladder: {table.why_unrated}."


def format_rating(rating: Rating) -> tuple[str, str, str, str, str]:
    """Elo, interval, share of first places, score and games."""
    elo = f"{BOUND_SIGNS[rating.bound]} {rating.elo:+.0f}".strip()
    low = f"{'<' * rating.open_low}{rating.low:+.0f}"
    high = f"{'>' * rating.open_high}{rating.high:+.0f}"
    interval = "" if rating.low == rating.high else f"[{low}, {high}]"
    first, score = f"{rating.probability_first:.0%}", f"{rating.score:.1%}"
    return elo, interval, first, score, str(rating.games)


def describe_resampling(ladder: Ladder) -> str:
    """The number of resamples, and the error of the intervals from their limited number."""
    return (
        f"Intervals are from {ladder.num_resamples:,} resamples of map seeds, with half a won and "
        "half a lost block for each rating: another seed of the resampling moves their ends by "
        f"{ladder.move:.1f} Elo at most (95 %; ends with < and > by more)."
    )


def explain_bounds(ratings: Sequence[Rating]) -> list[str]:
    """The meaning of the marks in the ladder; none without marks."""
    notes = []
    if any(rating.is_bound for rating in ratings):
        notes.append(
            "A line separates groups: no agent below it took a point off an agent above it, so "
            "these games do not limit the distance. The zero is in the largest group. >= and <= "
            "mark bounds, which have no interval: all ratings of a group may be larger (smaller) "
            "by the same unknown number. The distance shown is the smallest at which such a clean "
            f"sweep has a probability of {SWEEP_PROBABILITY:.1%}."
        )
    if any(rating.open_low or rating.open_high for rating in ratings):
        notes.append(
            "< and >: this end is set by the prior only, because the distance to the other agents "
            "rests on a few games (in more than 2.5 % of the resamples no point limits it). Play "
            "more games."
        )
    return notes


def compare_pairs(table: LeagueTable) -> list[str]:
    """A sentence for each pair of neighbours, and for other pairs that do not differ."""
    sentences = []
    for row, gaps in enumerate(table.ladder.differences if table.ladder else ()):
        for column in range(row + 1, len(gaps)):
            above, below, gap = table.ratings[row], table.ratings[column], gaps[column]
            differs = table.differs(row, column)
            numbers = f"{above.elo - below.elo:+.0f} or more (no point went the other way)"
            if gap is not None:
                numbers = f"{gap.elo:+.0f} [{gap.low:+.0f}, {gap.high:+.0f}]"
            if not differs:
                words = f"{above.name} and {below.name} do not differ significantly"
                sentences.append(f"{words}: {numbers}")
            elif column == row + 1:
                sentences.append(f"{above.name} is stronger than {below.name}: {numbers}")
    return sentences


def describe_seats(table: LeagueTable) -> str:
    """The advantage of each seat in Elo."""
    seats = "seat" if table.num_teams == 2 else "team"
    advantages = ", ".join(
        f"{seats} {number} {seat.elo:+.0f} [{seat.low:+.0f}, {seat.high:+.0f}]"
        for number, seat in enumerate(table.ladder.seats if table.ladder else ())
    )
    return f"Advantage of each {seats} (Elo, 95 %): {advantages}."


def describe_repeats(table: LeagueTable) -> list[str]:
    """The pairs with repeated games; none without repeats."""
    repeats, counts = table.payoffs.repeats, table.payoffs.counts
    listed = ", ".join(
        f"{table.names[row]} v {table.names[column]} {repeats[row, column]} of "
        f"{repeats[row, column] + counts[row, column]}"
        for row, column in np.argwhere(np.triu(repeats)).tolist()
    )
    return [f"Games that repeat another, in the same seats, are not counted: {listed}."] * bool(
        listed
    )


def describe_fit(fit: FitTest | None) -> str:
    """The result of the test of fit."""
    if fit is None:
        return "Too few pairs have met to show a cycle: this takes three agents that all meet."
    numbers = (
        f"{format_p_value(fit.p_value)}; deviance {fit.deviance:.1f}, {fit.by_chance:.1f} expected "
        f"by chance; scores differ from the ratings' by {100 * fit.misfit:.1f} percentage points "
        f"(root mean square), {100 * fit.misfit_by_chance:.1f} expected by chance"
    )
    power = (
        f"if every pair deviated by {100 * NOTICED_SHARE:.0f} percentage points, the test would "
        f"find it with a probability of about {fit.power:.0%}"
    )
    if fit.p_value <= LEVEL:
        return f"No ({numbers}): read the score matrix, not the ladder alone."
    if fit.power < ENOUGH_POWER:
        return f"There are too few games to decide ({numbers}): {power}."
    return f"There is no evidence against it ({numbers}): {power}."


def format_p_value(p_value: float) -> str:
    """Where none of N simulations is as extreme, only that it is below 1 / N."""
    if p_value * (NUM_SIMULATIONS + 1) < 1.5:
        return f"p < {math.ceil(1000.0 / NUM_SIMULATIONS) / 1000.0:.3f}"
    return f"p = {p_value:.3f}"


def describe_cycles(table: LeagueTable) -> str:
    """The clearest cycles of three agents."""
    cycles = table.cycles
    if not cycles:
        return "No significant cycle of three agents."
    verb = "beats" if table.num_teams == 2 else "comes in above"
    shown = []
    for one, two, three, share in cycles[:SHOWN_CYCLES]:
        shown.append(
            f"{one} {verb} {two}, {two} {verb} {three}, and {three} {verb} {one} (with "
            f"{share:.0%} of the points or more)"
        )
    more = len(cycles) - len(shown)
    noun = "cycle" if len(cycles) == 1 else "cycles"
    rest = f"; and {more} more in cycles.csv" if more else ""
    return f"{len(cycles)} {noun} of three: {'; '.join(shown)}{rest}."
