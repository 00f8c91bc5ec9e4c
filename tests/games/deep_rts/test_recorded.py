"""Recorded games: the same actions end in the same state, bit for bit, in every later version.

`pytest tests/games --update-playthroughs` records them again. That is a change of rules: it raises
the game's version and stands in the change log.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts.definition import VERSION
from marl_cair.games.engine import BatchedEngine

FOLDER = Path(__file__).parent / "recorded"
TICKS = 10_000
# The scenarios, and the bots that chose the actions.
RECORDED = {
    "1v1-15x15": ("mixed", "turtle"),
    "FFA-4-31x31-fog": ("economist", "rusher", "archers", "boomer"),
}


def play(scenario: str, choose: Callable[[BatchedEngine, int], np.ndarray]) -> str:
    """Play all steps, with new games where one has ended; returns the hash of the end."""
    engine, games = make_engine("deep_rts", scenario), 1
    engine.reset(0)
    for step in range(TICKS // engine.spec.ticks_per_step):
        engine.step(choose(engine, step)[None])
        if engine.terminated[0] or engine.truncated[0]:
            engine.reset(games)
            games += 1
    hashed = hashlib.sha256()
    for name, value in sorted(engine.state_dict().items()):
        hashed.update(name.encode() + value.tobytes())
    hashed.update(engine.observe("planes").tobytes())
    return hashed.hexdigest()


def record(scenario: str) -> str:
    """Let the bots play; a line for each step, then the hash of the end."""
    game = make_engine("deep_rts", scenario).game
    agents = [game.bot(name, game.scenario(scenario)) for name in RECORDED[scenario]]
    for seat, agent in enumerate(agents):
        agent.seed(seat)
    lines = [f"version {VERSION}"]

    def choose(engine: BatchedEngine, step: int) -> np.ndarray:
        seen, mask = engine.observe("planes"), engine.action_mask()
        chosen = [agent.act(seen[:, p], mask[:, p])[0] for p, agent in enumerate(agents)]
        lines.append(" ".join(map(str, chosen)))
        return np.array(chosen)

    end = play(scenario, choose)
    return "\n".join([*lines, end, ""])


@pytest.mark.parametrize("scenario", RECORDED if is_compiling() else list(RECORDED)[:1])
def test_recorded_game_ends_as_it_ended(scenario, update_playthroughs):
    path = FOLDER / f"{scenario}.txt"
    if update_playthroughs:
        path.parent.mkdir(exist_ok=True)
        path.write_text(record(scenario), "utf-8")
    version, *steps, expected = path.read_text("utf-8").splitlines()
    assert version == f"version {VERSION}"
    actions = [np.array(line.split(), int) for line in steps]
    assert play(scenario, lambda engine, step: actions[step]) == expected
    assert len(steps) * make_engine("deep_rts", scenario).spec.ticks_per_step == TICKS
