"""Recorded games: the same actions end in the same state, to the bit, in every later version.

`pytest tests/games --update-playthroughs` records them anew. That is a change of rules: it raises
the game's version and stands in the change log.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts.definition import VERSION
from marl_cair.games.engine import BatchedEngine

FOLDER = Path(__file__).parent / "recorded"
TICKS = 10_000


class Record(NamedTuple):
    """A recorded game and the bots that once chose its actions."""

    scenario: str
    bots: tuple[str, ...]

    @property
    def path(self) -> Path:
        return FOLDER / f"{self.scenario}.txt"

    def start(self) -> BatchedEngine:
        engine = make_engine("deep_rts", self.scenario)
        engine.reset(0)
        return engine


RECORDS = (
    Record("1v1-15x15", ("mixed", "turtle")),
    Record("FFA-4-31x31-fog", ("economist", "rusher", "archers", "boomer")),
)


def play_on(engine: BatchedEngine, actions: np.ndarray, games: int) -> int:
    """One decision; a game that is over gives way to the next. Returns how many have begun."""
    engine.step(actions[None])
    if engine.terminated[0] or engine.truncated[0]:
        engine.reset(games)
        games += 1
    return games


def digest(engine: BatchedEngine) -> str:
    hashed = hashlib.sha256()
    for name, value in sorted(engine.state_dict().items()):
        hashed.update(name.encode() + value.tobytes())
    hashed.update(engine.observe("planes").tobytes())
    return hashed.hexdigest()


def record(played: Record) -> str:
    """Let the bots play; a line for each decision, then the hash of the end."""
    engine, games = played.start(), 1
    agents = [engine.game.bot(name, engine.scenario) for name in played.bots]
    for seat, agent in enumerate(agents):
        agent.seed(seat)
    lines = [f"version {VERSION}"]
    for _ in range(TICKS // engine.spec.ticks_per_step):
        seen, mask = engine.observe("planes"), engine.action_mask()
        chosen = np.array(
            [agent.act(seen[:, seat], mask[:, seat])[0] for seat, agent in enumerate(agents)]
        )
        lines.append(" ".join(map(str, chosen)))
        games = play_on(engine, chosen, games)
    return "\n".join([*lines, digest(engine), ""])


@pytest.mark.parametrize(
    "played", RECORDS if is_compiling() else RECORDS[:1], ids=lambda played: played.scenario
)
def test_a_recorded_game_ends_as_it_ended(played, update_playthroughs):
    if update_playthroughs:
        played.path.parent.mkdir(exist_ok=True)
        played.path.write_text(record(played), "utf-8")
    version, *decisions, expected = played.path.read_text("utf-8").splitlines()
    engine, games = played.start(), 1
    assert version == f"version {VERSION}"
    assert len(decisions) * engine.spec.ticks_per_step == TICKS
    for line in decisions:
        games = play_on(engine, np.array(line.split(), int), games)
    assert digest(engine) == expected
