"""Who plays the other teams: an opponent for each world, drawn anew when its game begins."""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.policies.actor import MaskedEpsilonGreedy, PolicyActor
from marl_cair.policies.q_network import QNetwork
from marl_cair.replay.transition import NO_OPPONENT
from marl_cair.training.config import LATEST, POOL, SCRIPTED, OpponentSettings

LATEST_ID = 0  # the learner itself; bots follow from 1, snapshots from FIRST_SNAPSHOT_ID
FIRST_SNAPSHOT_ID = 1_000


class Snapshot(NamedTuple):
    """A frozen copy of the learner."""

    opponent_id: int
    frames: int
    agent: PolicyActor


class OpponentBook:
    """All opponents of a run by number, and the draw of one.

    Where all seats are of one team (one-player scenarios) there is nobody to meet: every draw is
    NO_OPPONENT, whatever the settings say.

    Args:
        settings: weights and pool.
        game, scenario: for the bots.
        representation: what snapshots look at.
        seed: of the draws.
    """

    def __init__(
        self,
        settings: OpponentSettings,
        game: Game,
        scenario: Any,
        representation: str,
        seed: int,
    ) -> None:
        self.settings = settings
        self._representation = representation
        spec = game.make_spec(scenario)
        self._groups, self._is_alone = spec.action_groups, spec.num_teams == 1
        self.bots: dict[int, Agent] = {}
        self.names: dict[int, str] = {LATEST_ID: LATEST}
        needed = set() if self._is_alone else set(settings.choose_bots(game.bots))
        for number, name in enumerate(game.bots, start=1):
            self.names[number] = name
            if name in needed:
                self.bots[number] = game.bot(name, scenario)
                self.bots[number].seed(seed + number)
        self.snapshots: list[Snapshot] = []
        self.retired: list[Snapshot] = []  # out of the pool, with games still to finish
        self.active: list[int] = []  # numbers of the snapshots that play now
        self.num_snapshots = 0
        self._rng = np.random.default_rng(seed)

    def agent(self, opponent_id: int) -> Agent:
        """The opponent with that number (not LATEST_ID, which is the learner, or NO_OPPONENT)."""
        if opponent_id in self.bots:
            return self.bots[opponent_id]
        everyone = (*self.snapshots, *self.retired)
        return next(kept.agent for kept in everyone if kept.opponent_id == opponent_id)

    def draw(self, count: int, frames: int) -> NDArray[np.int16]:
        """Opponents for `count` games that begin now, int16 [count]."""
        if self._is_alone:
            return np.full(count, NO_OPPONENT, np.int16)
        warming = frames < self.settings.warmup_frames
        mixture = self.settings.warmup_mixture if warming else self.settings.mixture
        names = list(mixture)
        weights = np.array([mixture[name] for name in names])
        chosen = self._rng.choice(len(names), count, p=weights / weights.sum())
        return np.array([self._draw_from(names[index]) for index in chosen], np.int16)

    def _draw_from(self, source: str) -> int:
        if source == LATEST:
            return LATEST_ID
        if source == SCRIPTED:
            return int(self._rng.choice(list(self.bots)))
        if source == POOL:
            # Before the first snapshot the newest self stands in.
            return int(self._rng.choice(self.active)) if self.active else LATEST_ID
        return next(number for number, name in self.names.items() if name == source)

    def add_snapshot(self, network: QNetwork, frames: int) -> None:
        """Freeze a copy of the learner, thin the pool, and draw who plays from now on."""
        number = FIRST_SNAPSHOT_ID + self.num_snapshots
        self.num_snapshots += 1
        self.snapshots.append(self._freeze(network, number, frames))
        if len(self.snapshots) > self.settings.pool_capacity:
            # The one that leaves the smallest gap goes: the history stays evenly covered.
            frames_of = np.array([kept.frames for kept in self.snapshots])
            gaps = frames_of[2:] - frames_of[:-2]
            self.retired.append(self.snapshots.pop(1 + int(gaps.argmin()) if len(gaps) else 0))
        self._draw_active()

    def forget_unused(self, in_play: NDArray[np.int16]) -> None:
        """Drop snapshots that have left the pool and whose last games are over."""
        self.retired = [kept for kept in self.retired if kept.opponent_id in in_play]

    def _freeze(self, network: QNetwork, number: int, frames: int) -> Snapshot:
        frozen = deepcopy(network).eval().requires_grad_(False)
        exploration = MaskedEpsilonGreedy(seed=number, action_groups=self._groups)
        agent = PolicyActor(frozen, f"snapshot-{frames}", self._representation, exploration)
        self.names[number] = agent.name
        return Snapshot(number, frames, agent)

    def _draw_active(self) -> None:
        ages = np.linspace(1.0, 0.0, len(self.snapshots))
        weights = np.exp(-self.settings.pool_recency * ages)
        count = min(self.settings.pool_active, len(self.snapshots))
        numbers = [snapshot.opponent_id for snapshot in self.snapshots]
        chosen = self._rng.choice(numbers, count, replace=False, p=weights / weights.sum())
        self.active = sorted(int(number) for number in chosen)

    def state_dict(self) -> dict[str, Any]:
        """Draws, pool and the bots' generators, as tensors and plain data."""
        return {
            "rng": export_rng(self._rng),
            "bots": {number: bot.state_dict() for number, bot in self.bots.items()},
            "snapshots": [_export_snapshot(kept) for kept in self.snapshots],
            "retired": [_export_snapshot(kept) for kept in self.retired],
            "active": list(self.active),
            "num_snapshots": self.num_snapshots,
        }

    def load_state_dict(self, state: Mapping[str, Any], network: QNetwork) -> None:
        """Continue from `state_dict`; `network` gives the snapshots their architecture."""
        import_rng(self._rng, state["rng"])
        for number, saved in state["bots"].items():
            self.bots[number].load_state_dict(saved)
        self.snapshots = [self._import_snapshot(saved, network) for saved in state["snapshots"]]
        self.retired = [self._import_snapshot(saved, network) for saved in state["retired"]]
        self.active = list(state["active"])
        self.num_snapshots = state["num_snapshots"]

    def _import_snapshot(self, saved: Mapping[str, Any], network: QNetwork) -> Snapshot:
        snapshot = self._freeze(network, saved["number"], saved["frames"])
        snapshot.agent.network.load_state_dict(saved["weights"])
        snapshot.agent.load_state_dict(saved["agent"])
        return snapshot


def _export_snapshot(snapshot: Snapshot) -> dict[str, Any]:
    return {
        "number": snapshot.opponent_id,
        "frames": snapshot.frames,
        "weights": dict(snapshot.agent.network.state_dict()),
        "agent": snapshot.agent.state_dict(),
    }


def export_rng(rng: np.random.Generator) -> str:
    """The generator's state as text: its 128-bit numbers fit no tensor."""
    return json.dumps(rng.bit_generator.state)


def import_rng(rng: np.random.Generator, state: str) -> None:
    """Continue where `export_rng` was called."""
    rng.bit_generator.state = json.loads(state)
