"""`python -m marl_cair.league.agents.host MODULE:FUNCTION`: serves a function's agent as a process.

It speaks the protocol of `process`, so that a Python function can have a time limit. What the
agent prints goes to standard error; its standard input is empty.
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
from marl_cair.games.players.recurrent import check_state, find_state_size
from marl_cair.league.agents.foreign import (
    AgentFault,
    describe_crash,
    digest_code,
    make_foreign,
    seed_agent,
)
from marl_cair.league.agents.process import BASE64


def serve(source: str, questions: IO[str], answers: IO[str]) -> None:
    """Answer each line until they end. An agent's exception is its answer."""
    agent: Any = None
    arrays: dict[str, dict[str, Any]] = {}  # dtype and shape of each argument of `act`
    for line in questions:
        message = json.loads(line)
        answer: dict[str, Any]
        try:
            if message["type"] == "hello":
                agent, digest = _make(source, message)
                known = message["representations"]
                seen = str(getattr(agent, "representation", next(iter(known))))
                shape = [*message["action_shape"], len(message["actions"])]
                masked = {"dtype": "bool", "shape": shape}
                # The caller refuses an unknown name.
                arrays = {"observations": known.get(seen, {}), "masks": masked}
                name = str(getattr(agent, "name", source))
                answer = {"type": "ready", "name": name, "representation": seen}
                answer |= {"digest": digest, "arrays": BASE64}
                if size := find_state_size(agent):
                    answer["state_size"] = size
                    arrays["state"] = {"dtype": "float32", "shape": [size]}
            else:
                seed_agent(agent, message["seed"])
                num = message["num"]
                given = [_read(message[name], num, about) for name, about in arrays.items()]
                answer = {"actions": agent.act(*given)}
                if "state" in arrays:
                    answer["actions"], state = answer["actions"]
                    state = check_state(state, given[-1].shape)
                    answer["state"] = base64.b64encode(state.tobytes()).decode()
                answer["actions"] = np.asarray(answer["actions"]).tolist()
        except AgentFault as fault:
            answer = {"error": str(fault)}
        except (Exception, SystemExit) as error:  # noqa: BLE001  # whatever foreign code raises
            answer = {"error": describe_crash(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _read(text: str, num: int, about: dict[str, Any]) -> NDArray[Any]:
    """Decode an array [num, *shape]; it can be written to."""
    flat: NDArray[Any] = np.frombuffer(base64.b64decode(text), about["dtype"])
    return flat.reshape(num, *about["shape"]).copy()


def _make(source: str, hello: dict[str, Any]) -> tuple[Any, str]:
    """The agent, and the digest of its module's source; "" without one."""
    game = GAMES[hello["game"]]
    fields = restore_fields(hello["scenario"])
    scenario = change_scenario(game.name, game.scenario(None), fields)
    agent, code = make_foreign(source, scenario, game.make_spec(scenario))
    return agent, digest_code(source, code) if code else ""


if __name__ == "__main__":
    # By number: libraries, and programs that the agent starts, do not use `sys.stdout`.
    stdin, stdout = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    serve(sys.argv[1], stdin, stdout)
