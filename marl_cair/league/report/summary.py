"""What a league has found, in a few sentences: who is strongest, how sure, who is alike."""

from __future__ import annotations

from itertools import combinations

from marl_cair.league.ratings.diagnostics import tell_cycles, tell_fit
from marl_cair.league.report.table import LeagueTable
from marl_cair.league.report.wording import tell_no_ladder

SHOWN_PAIRS = 4


def tell_headline(table: LeagueTable) -> str:
    """Who is the strongest, or that nobody surely is."""
    if not table.ratings:
        return "Nobody can be rated yet"
    rivals = _find_rivals(table)
    best = table.ratings[0].name
    if len(table.ratings) == 1:
        return f"{best} has nobody to be compared with"
    if not rivals:
        return f"{best} is the strongest"
    if len(rivals) == 1:
        return f"{best} and {rivals[0]} lead and cannot be told apart"
    return f"{best} leads, but {len(rivals)} others cannot be told from it"


def tell_verdict(table: LeagueTable) -> list[str]:
    """How sure the headline is, who cannot be told apart, and whether a ladder tells enough."""
    if table.ladder is None:
        return [tell_no_ladder(table)]
    if len(table.ratings) == 1:
        return ["All games were played by one agent: a league needs two or more."]
    told = [_tell_best(table), _tell_alike(table)]
    if table.beyond is not None:
        told.append(f"Is one number per agent enough? {tell_fit(table.beyond.fit)}")
        if table.beyond.cycles:
            told.append(tell_cycles(table.beyond.cycles, table.numbered_names, table.num_teams))
    return told


def _find_rivals(table: LeagueTable) -> list[str]:
    """Who cannot be told from the first."""
    return [
        table.names[place]
        for place in range(1, len(table.ratings))
        if not table.tells_apart(0, place)
    ]


def _tell_best(table: LeagueTable) -> str:
    best, second = table.ratings[:2]
    sure = f"it comes first in {best.probability_first:.0%} of the resamples"
    gap = table.ladder.differences[0][1] if table.ladder else None
    if gap is None and not table.tells_apart(0, 1):
        return f"{best.name} took all points off {second.name}, in too few games to tell: {sure}."
    if gap is None:
        return (
            f"No agent of the groups below took a single point off {best.name}'s: how far ahead it "
            f"is of {second.name}, the second, these games do not limit."
        )
    numbers = f"{gap.elo:.0f} Elo [{gap.low:.0f}, {gap.high:.0f}]"
    if gap.low > 0.0:
        return f"{best.name} is {numbers} ahead of {second.name}, the second; {sure}."
    return (
        f"{best.name} has the highest rating, {numbers} ahead of {second.name}, which may as well "
        f"be the better one; {sure}."
    )


def _tell_alike(table: LeagueTable) -> str:
    """Pairs that cannot be told apart; of many the first and how many there are."""
    alike = []
    for above, below in combinations(range(len(table.names)), 2):
        if not table.tells_apart(above, below):
            alike.append(f"{table.names[above]} and {table.names[below]}")
    if not alike:
        return "All agents can be told apart."
    more = len(alike) - SHOWN_PAIRS
    rest = f"; nor can {more} more pairs" if more > 0 else ""
    return f"Cannot be told apart: {'; '.join(alike[:SHOWN_PAIRS])}{rest}."
