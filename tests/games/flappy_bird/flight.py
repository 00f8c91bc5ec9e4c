"""One world of Flappy Bird that a test flies in, and its rules written a second time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from marl_cair.games import make_engine
from marl_cair.games.flappy_bird.state import World

NOOP, FLAP = range(2)


class Flight:
    """One world; positions in pixels. What is written to `world` is what the engine plays on."""

    def __init__(self, scenario: str = "classic", seed: int = 0, **options: Any) -> None:
        self.engine = make_engine("flappy_bird", scenario, **options)
        self.engine.reset(seed)
        self.world = World(*(rows[0] for rows in self.engine._worlds))

    def play(self, *flaps: int) -> list[float]:
        """One decision; `flaps` of all seats, or of none. Returns the rewards."""
        chosen = flaps or (NOOP,) * self.engine.num_players
        self.engine.step(np.array([chosen]))
        return [float(reward) for reward in self.engine.rewards[0]]

    def wait(self, num_decisions: int) -> None:
        for _ in range(num_decisions):
            self.play()

    def y(self, player: int = 0) -> float:
        return int(self.world.bird_y[player]) / 100

    def velocity(self, player: int = 0) -> float:
        return int(self.world.velocity[player]) / 100

    def pipes(self) -> list[float]:
        return [int(x) / 100 for x in self.world.pipe_x]

    def next_gap(self) -> int:
        """The upper edge of the gap that is met next."""
        ahead = zip(self.pipes(), self.world.gap_top.tolist(), strict=True)
        return min(pipe for pipe in ahead if pipe[0] > 31)[1]

    def hover(self, *players: int) -> None:
        """Hold birds at the height of the gap that is met next, at rest."""
        ahead = [pipe for pipe, x in enumerate(self.pipes()) if x > 31 - 4]
        pipe = min(ahead, key=lambda index: self.pipes()[index])
        for player in players or range(self.engine.num_players):
            self.world.bird_y[player] = (int(self.world.gap_top[pipe]) + 30) * 100
            self.world.velocity[player] = 0
            self.world.motion[player] = 0

    def is_over(self) -> bool:
        return bool(self.engine.terminated[0] or self.engine.truncated[0])

    def seen(self, representation: str, player: int = 0) -> np.ndarray:
        return self.engine.observe(representation)[0, player]

    def can_flap(self, player: int = 0) -> bool:
        return bool(self.engine.action_mask()[0, player, FLAP])


@dataclass
class Reference:
    """The classic game for one in floats, after the description of PLE: 34 x 24 pixels of bird,
    whose box of collision lies half a bird left of and above it, and 52 pixels of pipe.
    """

    gaps: list[int]
    y: float = 256.0
    speed: float = 0.0
    has_flapped: bool = True  # it starts with a flap
    thrust: float = 0.0
    pipes: list[float] = field(default_factory=lambda: [340.0, 484.0, 628.0])
    over: bool = False

    def step(self, flap: bool, new_gaps: Sequence[int]) -> float:
        """One tick; gaps of renewed pipes are those of `new_gaps`. Returns the reward."""
        if flap:
            self.speed, self.has_flapped = 0.0, True
        lives, reward = 1, 0.0
        for x in self.pipes:
            is_in = x - 26 - 20 <= 57 < x + 26
            for other, gap in zip(self.pipes, self.gaps, strict=True):
                boxes_meet = int(other) - 26 < 74 and int(other) + 26 > 40
                if boxes_meet and is_in and self.y - 12 + 12 <= gap:
                    lives -= 1
                if boxes_meet and is_in and self.y + 24 > gap + 100:
                    lives -= 1
            if x - 26 <= 57 < x - 26 + 4:
                reward += 1.0
        for index, x in enumerate(self.pipes):
            if x < -52:
                self.pipes[index] = 288 + 52 + 288 * 0.2
                self.gaps[index] = new_gaps[index]
        if self.y >= 0.79 * 512 - 24 or self.y <= 0:
            lives -= 1
        self._fly()
        self.pipes = [x - 4.0 for x in self.pipes]
        self.over = lives <= 0
        return reward - 5.0 * self.over

    def _fly(self) -> None:
        tick = 1.0 / 30.0
        if self.speed < 10.0 and self.thrust == 0.0:
            self.speed += 1.0
        if self.thrust + tick <= tick and self.has_flapped:
            self.thrust += tick
            self.speed -= 9.0
        else:
            self.thrust, self.has_flapped = 0.0, False
        self.y += self.speed
