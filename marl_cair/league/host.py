"""`python -m marl_cair.league.host MODULE:FUNCTION`: anybody's agent behind `league.process`.

It speaks that protocol from the other side, so that a function of Python can have a time limit.
What the agent prints goes to standard error.
"""

from __future__ import annotations

import json
import sys
from typing import IO, Any

import numpy as np

from marl_cair.games import GAMES
from marl_cair.games.scenario_checks import change_scenario, restore_fields
from marl_cair.league.foreign import digest_code, make_foreign


def serve(source: str, asked: IO[str], told: IO[str]) -> None:
    """Answer the lines of `asked` until they end. What an agent raises is its answer."""
    agent: Any = None
    dtype = ""
    for line in asked:
        message = json.loads(line)
        answer: dict[str, Any]
        try:
            if message["type"] == "hello":
                agent, digest = _make(source, message)
                seen = getattr(agent, "representation", next(iter(message["representations"])))
                dtype = message["representations"][seen]["dtype"]
                name = str(getattr(agent, "name", source))
                answer = {"type": "ready", "name": name, "representation": seen, "digest": digest}
            else:
                answer = {"actions": _ask(agent, message, dtype)}
        except Exception as error:  # noqa: BLE001  # whatever foreign code raises
            told_error = " ".join(str(error).split())
            answer = {"error": f"crashed in act: {type(error).__name__}: {told_error}"}
        told.write(json.dumps(answer) + "\n")
        told.flush()


def _ask(agent: Any, message: dict[str, Any], dtype: str) -> Any:
    if hasattr(agent, "seed"):
        agent.seed(message["seed"])
    observations = np.array(message["observations"], dtype)
    actions = agent.act(observations, np.array(message["masks"], np.bool_))
    return np.asarray(actions).tolist()


def _make(source: str, hello: dict[str, Any]) -> tuple[Any, str]:
    """The agent, and the digest of its module's source; "" without one."""
    game = GAMES[hello["game"]]
    fields = restore_fields(hello["scenario"])
    scenario = change_scenario(game.name, game.scenario(None), fields)
    agent, code = make_foreign(source, scenario, game.make_spec(scenario))
    return agent, digest_code(source, code) if code else ""


if __name__ == "__main__":
    answers, sys.stdout = sys.stdout, sys.stderr
    serve(sys.argv[1], sys.stdin, answers)
