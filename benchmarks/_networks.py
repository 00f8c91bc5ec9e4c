"""Networks of the presets, and checkpoints of untrained ones: for benchmarks and tests."""

import dataclasses
from importlib.resources import files
from pathlib import Path
from typing import Any

from marl_cair.checkpoint import AgentDescription, save_agent
from marl_cair.games import GAMES
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.training.settings.config_file import read_yaml


def read_preset(name: str) -> QNetworkConfig:
    """The network that `policy=name` trains."""
    path = files("marl_cair") / "conf" / "policy" / f"{name}.yaml"
    return QNetworkConfig.from_dict(read_yaml(str(path)))


def save_network(
    folder: Path,
    scenario: str,
    representation: str,
    config: QNetworkConfig,
    rules: str = "deep_line_wars",
    **changes: Any,
) -> str:
    """Save one and return its folder; an untrained one plays long games.

    scenario: its name; rules: the game; changes: other values of the description's fields, and
    `options`, of those of the scenario.
    """
    game = GAMES[rules]
    played = game.scenario(scenario, **changes.pop("options", {}))
    spec = game.make_spec(played)
    shape = spec.representations[representation].shape
    about = AgentDescription(
        name=folder.name,
        game=game.name,
        game_version=game.version,
        scenario=scenario,
        scenario_options=dataclasses.asdict(played),
        representation=representation,
        observation_shape=shape,
        action_names=spec.action_names,
        network=config.to_dict(),
        frames=0,
        updates=0,
        seed=0,
    )
    about = dataclasses.replace(about, **changes)
    save_agent(folder, make_q_network(config, shape, spec.num_actions, seed=about.seed), about)
    return str(folder)
