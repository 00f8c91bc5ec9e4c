"""The scripted birds: how far each flies, from what it sees alone."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.flappy_bird.bots import BOTS
from marl_cair.games.randomness import episode_seeds
from tests.games.bot_play import (
    Positions,
    assert_answers_each_row_on_its_own,
    assert_repeats_and_continues,
)


def start(scenario: str, num_worlds: int, seed: int = 0, **options: int) -> BatchedEngine:
    engine = make_engine("flappy_bird", scenario, num_worlds, **options)
    worlds = np.arange(num_worlds)
    engine.reset(episode_seeds(seed, worlds, np.zeros(num_worlds, np.int64)))
    return engine


def fly(engine: BatchedEngine, name: str, num_decisions: int) -> np.ndarray:
    """Pipes passed by one bot in all seats [B, P]."""
    bot = engine.game.bot(name, engine.scenario)
    bot.seed(1)
    rows = engine.num_worlds * engine.num_players
    for _ in range(num_decisions):
        seen = engine.observe(bot.representation).reshape(rows, -1)
        chosen = bot.act(seen, engine.action_mask().reshape(rows, -1))
        engine.step(chosen.reshape(engine.num_worlds, -1))
        if (engine.terminated | engine.truncated).all():
            break
    assert not engine.illegal_actions.any()
    return engine._worlds.pipes_passed.copy()


@pytest.mark.slow
def test_the_oracle_passes_a_thousand_classic_pipes():
    engine = start("classic", 4, max_ticks=38_000)
    assert (fly(engine, "oracle", 38_000) >= 1_000).all()
    assert engine.truncated.all()


@pytest.mark.plain_python
def test_the_oracle_flies_a_while_in_plain_python():
    engine = start("classic", 1, max_ticks=220)
    assert fly(engine, "oracle", 220) == [[5]]
    assert engine.truncated.all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "ticks", "ticks_per_step"),
    [
        *((name, 2_000, 1) for name in ("easy", "hard", "race-4")),
        *(("classic", 3_000, ticks) for ticks in (2, 3)),
    ],
)
def test_the_oracle_does_not_die_without_wind(scenario, ticks, ticks_per_step):
    engine = start(scenario, 8, max_ticks=ticks, ticks_per_step=ticks_per_step)
    fly(engine, "oracle", ticks // ticks_per_step)
    assert engine.truncated.all()
    assert not engine.eliminated.any()


@pytest.mark.slow
def test_bots_are_as_strong_as_their_names():
    passed = {name: fly(start("classic", 32, max_ticks=1_500), name, 1_500) for name in BOTS}
    means = {name: counts.mean() for name, counts in passed.items()}
    assert means["random"] < 0.5
    assert 2 < means["reflex"] < 30
    assert means["oracle"] > 38


@pytest.mark.plain_python
@pytest.mark.parametrize("name", BOTS)
def test_a_bot_repeats_continues_and_answers_each_row_on_its_own(name):
    engine = start("classic", 8)
    fly(engine, "reflex", 40 if is_compiling() else 12)
    seen, mask = engine.observe("features")[:, 0], engine.action_mask()[:, 0]

    positions = Positions(engine, seen, mask)
    assert_repeats_and_continues(name, positions)
    if name != "random":
        assert_answers_each_row_on_its_own(name, positions)


@pytest.mark.plain_python
def test_an_oracle_that_cannot_live_still_answers():
    engine = start("classic", 1)
    fly(engine, "oracle", 3)
    engine._worlds.bird_y[:] = 38_400
    fly(engine, "oracle", 1)
    assert engine.terminated.all()
