"""Games for tests of the viewer, played by bots."""

import numpy as np

from marl_cair.games import make_engine
from marl_cair.games.replays import Replay, ReplayWriter, read_replay, replay_steps


def record(path, game, bots, *, steps, values=None, names=None, **scenario) -> Replay:
    """The first `steps` steps of a game; `values`: by name, [steps, P, ...]."""
    engine = make_engine(game, **scenario)
    agents = [engine.game.bot(name, engine.scenario) for name in bots]
    for seat, agent in enumerate(agents):
        agent.seed(seat)
    engine.reset(0)
    with ReplayWriter(path, engine, map_seeds=[0], players=[names or bots]) as writer:
        for step in range(steps):
            mask = engine.action_mask()
            chosen = [
                agent.act(engine.observe(agent.representation)[:, seat], mask[:, seat])[0]
                for seat, agent in enumerate(agents)
            ]
            engine.step(np.array([chosen]))
            kept = {name: found[None, step] for name, found in (values or {}).items()}
            writer.add(np.array([chosen]), kept)
            if engine.terminated[0] or engine.truncated[0]:
                break
    return read_replay(path)


def pictures(replay, player=None):
    """What the engine draws, at each step."""
    return [engine.render(0, player) for engine in replay_steps(replay)]
