"""Collects data sets of unique transitions from games between agents, or of random play."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent, Game
from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.games.randomness import EpisodeSeeds
from marl_cair.replay.dataset import (
    EPISODE,
    HELDOUT_SHARE,
    SEAT,
    STEP,
    DatasetDescription,
    new_dataset,
    read_description,
)
from marl_cair.replay.transition import OTHER_ACTIONS, Key

NUM_WORLDS = 32
NUM_OUTSIDE = 4  # of games in processes of their own, as browsers
# Of five episodes in the order of their starts, two are held out.
_CYCLE, _HELDOUT_OF_CYCLE = 5, (1, 3)
_MOST_REPEATS = 20  # seen transitions for each new one, before the game counts as too small


def collect_dataset(
    folder: str | Path,
    game: Game,
    scenario: tuple[str, Any],
    representation: str,
    agents: Sequence[Agent],
    num_rows: int = 100_000,
    seed: int = 0,
) -> DatasetDescription:
    """Play games and write `num_rows` unique transitions of all seats to `folder`.

    scenario: its name, and the scenario. agents: one for each seat. A transition is unique by all
    that a network sees of it: observations, masks, actions of all seats, reward and end. Episodes
    are held out as a whole, two of five, until 40 % of the transitions are.
    Raises ValueError for a game with an action at each cell, fewer than 10 transitions, and a game
    with fewer unique transitions, or too few episodes.
    """
    name, played = scenario
    spec = game.make_spec(played)
    if spec.action_shape:
        raise ValueError(
            f"the scenario has an action at each cell of {list(spec.action_shape)}, but a data set "
            "holds one action for each seat: choose another form of actions (actions=unit)"
        )
    if num_rows < 10:
        raise ValueError(f"rows is {num_rows}, it must be 10 or more: four of ten are held out")
    seen = spec.representations[representation]
    num_heldout = round(HELDOUT_SHARE * num_rows)
    about = DatasetDescription(
        game.name,
        game.version,
        name,
        dataclasses.asdict(played),
        representation,
        tuple(seen.shape),
        np.dtype(seen.dtype).name,
        spec.num_actions,
        spec.num_players,
        tuple(agent.name for agent in agents),
        seed,
        num_rows - num_heldout,
        num_heldout,
        train_episodes=0,  # counted when all are there
        heldout_episodes=0,
    )
    num_worlds = NUM_WORLDS if game.has_snapshots else NUM_OUTSIDE
    make = partial(BatchedEngine, game, played, num_worlds)
    with new_dataset(Path(folder), about) as made, closing(make()) as engine:
        sides = [_Side(made.train), _Side(made.heldout)]
        play = Play(engine, representation, agents, seed)
        digests: set[bytes] = set()
        num_seen = 0
        while any(side.missing for side in sides):
            columns = play.step()
            num_seen += len(columns[EPISODE])
            is_heldout = np.isin(columns[EPISODE] % _CYCLE, _HELDOUT_OF_CYCLE)
            fresh = _find_new(columns, digests)
            for number, side in enumerate(sides):
                side.extend(columns, fresh[is_heldout[fresh] == number])
            if num_seen > _MOST_REPEATS * max(num_rows, 1_000):
                raise ValueError(
                    f"only {len(digests):,} unique transitions were found in {num_seen:,}, for "
                    f"{num_rows:,}: ask for fewer rows, or take a larger scenario"
                )
    return read_description(folder)


class _Side:
    """Rows of one side of the split, filled from the front."""

    def __init__(self, rows: TensorDict) -> None:
        self._rows, self.missing = rows, len(rows)

    def extend(self, columns: Mapping[Key, NDArray[Any]], chosen: NDArray[np.int64]) -> None:
        first = len(self._rows) - self.missing
        chosen = chosen[: self.missing]
        for key, values in columns.items():
            self._rows[key][first : first + len(chosen)] = torch.from_numpy(values[chosen])
        self.missing -= len(chosen)


class Play:
    """Games in progress; `step` plays one step of each and returns its transitions."""

    def __init__(
        self, engine: BatchedEngine, representation: str, agents: Sequence[Agent], seed: int
    ) -> None:
        self.engine, self.representation, self.agents = engine, representation, agents
        self.seeds = EpisodeSeeds(engine.num_worlds, seed)
        engine.reset(self.seeds.next())
        for seat, agent in enumerate(agents):
            agent.seed(seed * 1_009 + seat)
        worlds, players = engine.num_worlds, engine.num_players
        self.episode, self.length = np.arange(worlds), np.zeros(worlds, np.int64)
        self.states = np.zeros((worlds, players, max(1, find_state_size(*agents))), np.float32)
        self.observation, self.mask = engine.observe(representation), engine.action_mask()

    def step(self) -> dict[Key, NDArray[Any]]:
        """Columns [N, ...] of the transitions of all seats that are not out."""
        engine, plays = self.engine, ~self.engine.eliminated
        actions = self._act()
        engine.step(actions)
        following, next_mask = engine.observe(self.representation), engine.action_mask()
        terminated = engine.terminated[:, None] | engine.eliminated
        shape = plays.shape
        others = [np.roll(actions, -seat, 1)[:, 1:] for seat in range(shape[1])]
        columns: dict[Key, NDArray[Any]] = {
            "observation": self.observation,
            "action_mask": self.mask,
            "action": actions,
            ("next", "observation"): following,
            ("next", "action_mask"): next_mask,
            ("next", "reward"): engine.rewards[..., None],
            ("next", "terminated"): terminated[..., None],
            ("next", "done"): (terminated | engine.truncated[:, None])[..., None],
            EPISODE: np.broadcast_to(self.episode[:, None], shape),
            SEAT: np.broadcast_to(np.arange(shape[1]), shape),
            STEP: np.broadcast_to(self.length[:, None], shape),
        }
        if shape[1] > 1:
            columns[OTHER_ACTIONS] = np.stack(others, 1)
        columns = {key: values[plays] for key, values in columns.items()}
        self._restart(engine.terminated | engine.truncated, following, next_mask)
        return columns

    def _act(self) -> NDArray[np.int64]:
        engine = self.engine
        actions = np.zeros((engine.num_worlds, engine.num_players), np.int64)
        for seat, agent in enumerate(self.agents):
            seen = engine.observe_in_place(agent.representation)[:, seat]
            places = np.arange(engine.num_worlds), np.full(engine.num_worlds, seat)
            actions[:, seat] = call_agent(agent, self.states, places, seen, self.mask[:, seat])
        return actions

    def _restart(
        self, over: NDArray[np.bool_], observation: NDArray[Any], mask: NDArray[np.bool_]
    ) -> None:
        self.length += 1
        if over.any():
            self.engine.reset(self.seeds.next(over), over)
            self.states[over], self.length[over] = 0.0, 0
            self.episode[over] = self.episode.max() + 1 + np.arange(int(over.sum()))
            observation, mask = self.engine.observe(self.representation), self.engine.action_mask()
        self.observation, self.mask = observation, mask


def _find_new(columns: Mapping[Key, NDArray[Any]], known: set[bytes]) -> NDArray[np.int64]:
    """Places of the transitions that are not in `known` yet, int64 [K]; adds them."""
    seen = [values for key, values in columns.items() if key not in (EPISODE, SEAT, STEP)]
    fresh = []
    for place in range(len(columns[EPISODE])):
        digest = hashlib.blake2b(digest_size=16)
        for values in seen:
            digest.update(values[place].tobytes())
        if (mark := digest.digest()) not in known:
            known.add(mark)
            fresh.append(place)
    return np.array(fresh, np.int64)
