"""Recipes: settings that are known to work on a scenario, as words of `marl-cair train`."""

from __future__ import annotations

from typing import NamedTuple


class Recipe(NamedTuple):
    """Words of the command line, and what they are for. Words that a user gives go before them."""

    about: str
    words: tuple[str, ...]


RECIPES = {
    # A game lasts up to 1,000 decisions: at a discount of 0.99 its end is worth nothing at first,
    # and the shaping cancels out of every choice once learned: nothing is left to choose by.
    "deep_rts_duel": Recipe(
        "Deep RTS, two players: beats random within minutes and keeps to it",
        (
            "game=deep_rts",
            "scenario=1v1-15x15",
            "learner.gamma=0.997",
            "learner.n_steps=16",
            "demonstration.bots=[mixed,rusher]",
            "opponent.mixture={random: 0.4, bots: 0.4, latest: 0.2}",
            "evaluation.every_frames=25000",
            "evaluation.bots=[random,mixed]",
        ),
    ),
    "deep_rts_economy": Recipe(
        "Deep RTS, one player: the highest score in 600 seconds",
        (
            "game=deep_rts",
            "scenario=Economy-15x15",
            "demonstration.bots=[economist]",
            "evaluation.every_frames=25000",
            "evaluation.games=16",
            "evaluation.bots=[random,economist]",
        ),
    ),
}
