"""Speed of the TorchRL environment as a share of the bare engine's, for each game.

    python -m benchmarks.torchrl_env [--games flappy_bird] [--representations planes vector]
                                     [--num-worlds 1024] [--repeats 5]

One thread, processor time, default scenarios, games of all ages. Both play the same steps: random
legal actions, recorded beforehand from the same state. The engine steps, restarts what has ended,
observes every seat and reads its legal actions, into arrays that it reuses. The environment does
`step_and_maybe_reset`, once ours and once TorchRL's own. Best of the repeats, which alternate.
Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torchrl.envs import EnvBase

from benchmarks._legal_actions import make_draw_legal
from benchmarks._timing import best_seconds
from marl_cair.games import GAMES
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv

NUM_STEPS = 100  # on the clock
WARM_UP = 300  # steps before it, in which one world after the other is restarted


class Recorded:
    """An environment, the state in which the clock starts, and the actions from there on."""

    def __init__(self, game: str, representation: str, num_worlds: int) -> None:
        self.env = BatchedGameEnv(
            game, num_worlds=num_worlds, representation=representation, seed=0
        )
        self.representation = representation
        seats = (num_worlds, self.env.engine.num_players)
        self.actions = np.zeros((WARM_UP + NUM_STEPS, *seats), np.int64)
        draw, rng = make_draw_legal(), np.random.default_rng(0)
        starts = np.arange(num_worlds) * WARM_UP // num_worlds
        self.env.reset()
        mask = self.env.engine.action_mask()
        for number, chosen in enumerate(self.actions):
            if number == WARM_UP:
                self.state = self.env.game_state()
            draw(mask, rng.random(seats, np.float32), chosen)
            self._step_engine(chosen, starts == number, mask)
        self.actions = self.actions[WARM_UP:]

    def _step_engine(
        self, actions: NDArray[Any], restarted: NDArray[np.bool_], mask: NDArray[np.bool_]
    ) -> None:
        engine = self.env.engine
        engine.step(actions)
        ended = engine.terminated | engine.truncated | restarted
        if ended.any():
            engine.reset(self.env.seeds.next(ended), ended)
        engine.observe_in_place(self.representation)
        engine.action_mask(out=mask)

    def play_engine(self) -> None:
        """All recorded steps, by the engine alone."""
        engine = self.env.engine
        mask, none = engine.action_mask(), np.zeros(engine.num_worlds, np.bool_)
        for chosen in self.actions:
            self._step_engine(chosen, none, mask)

    def play_environment(self, step: Callable[..., Any]) -> None:
        """The same by `step`, which is `step_and_maybe_reset` of a class of environments."""
        state = self.env.current()
        for chosen in torch.from_numpy(self.actions):
            state[GROUP, "action"] = chosen
            state = step(self.env, state)[1]

    def measure(self, repeats: int) -> list[float]:
        """Agent-steps per second of the engine, of our environment, and by TorchRL's own step."""
        ways = (BatchedGameEnv.step_and_maybe_reset, EnvBase.step_and_maybe_reset)
        works: list[Callable[[], None]] = [self.play_engine]
        works += [partial(self.play_environment, way) for way in ways]
        best = [np.inf] * len(works)
        for _ in range(repeats):
            for place, work in enumerate(works):
                self.env.load_game_state(self.state)
                best[place] = min(best[place], best_seconds(work, 1, time.process_time))
        return [self.actions.size / seconds for seconds in best]


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--games", nargs="+", default=list(GAMES))
    parser.add_argument("--representations", nargs="+", default=["planes", "vector", "gray_stack"])
    parser.add_argument("--num-worlds", type=int, default=1024)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("| game | representation | engine | environment | | TorchRL's own step | |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for game in options.games:
        known = GAMES[game].make_spec(GAMES[game].scenario(None)).representations
        for name in (name for name in options.representations if name in known):
            engine, *rates = Recorded(game, name, options.num_worlds).measure(options.repeats)
            shares = " | ".join(f"{rate:,.0f} | {rate / engine:.0%}" for rate in rates)
            print(f"| {game} | `{name}` | {engine:,.0f} agent-steps/s | {shares} |", flush=True)


if __name__ == "__main__":
    main()
