"""`python -m marl_cair.league.agents.host MODULE:FUNCTION`: serves an agent as a process.

It speaks that protocol from the other side, so that a function of Python can have a time limit.
What the agent prints goes to standard error, and there is nothing for it to read.
"""

from __future__ import annotations

import base64
import json
import os
import sys
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import change_scenario, restore_fields
from marl_cair.league.agents.foreign import AgentFault, describe_crash, digest_code, make_foreign
from marl_cair.league.agents.process import BASE64


def serve(source: str, asked: IO[str], output: IO[str]) -> None:
    """Answer the lines of `asked` until they end. What an agent raises is its answer."""
    agent: Any = None
    observed: dict[str, Any] = {}
    masked: dict[str, Any] = {}
    for line in asked:
        message = json.loads(line)
        answer: dict[str, Any]
        try:
            if message["type"] == "hello":
                agent, digest = _make(source, message)
                known = message["representations"]
                seen = str(getattr(agent, "representation", next(iter(known))))
                # The caller refuses an unknown name.
                observed = known.get(seen, {})
                shape = [*message["action_shape"], len(message["actions"])]
                masked = {"dtype": "bool", "shape": shape}
                answer = {
                    "type": "ready",
                    "name": str(getattr(agent, "name", source)),
                    "representation": seen,
                    "digest": digest,
                    "arrays": BASE64,
                }
            else:
                if hasattr(agent, "seed"):
                    agent.seed(message["seed"])
                num = message["num"]
                observations = _read(message["observations"], num, observed)
                actions = agent.act(observations, _read(message["masks"], num, masked))
                answer = {"actions": np.asarray(actions).tolist()}
        except AgentFault as fault:
            answer = {"error": str(fault)}
        except (Exception, SystemExit) as error:  # noqa: BLE001  # whatever foreign code raises
            answer = {"error": describe_crash(error)}
        output.write(json.dumps(answer) + "\n")
        output.flush()


def _read(text: str, num: int, about: dict[str, Any]) -> NDArray[Any]:
    """The array [num, *shape] that was written as text."""
    flat: NDArray[Any] = np.frombuffer(base64.b64decode(text), about["dtype"])
    return flat.reshape(num, *about["shape"]).copy()  # its own, to write to


def _make(source: str, hello: dict[str, Any]) -> tuple[Any, str]:
    """The agent, and the digest of its module's source; "" without one."""
    game = GAMES[hello["game"]]
    fields = restore_fields(hello["scenario"])
    scenario = change_scenario(game.name, game.scenario(None), fields)
    agent, code = make_foreign(source, scenario, game.make_spec(scenario))
    return agent, digest_code(source, code) if code else ""


if __name__ == "__main__":
    # By number: libraries and programs that the agent starts know nothing of `sys.stdout`.
    questions, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    serve(sys.argv[1], questions, answers)
