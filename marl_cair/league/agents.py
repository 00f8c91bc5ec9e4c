"""`load_agent`: a checkpoint or a scripted bot as an agent that acts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from marl_cair.checkpoint import AgentDescription, CheckpointError, load_network
from marl_cair.games import GAMES
from marl_cair.games.game import Agent
from marl_cair.lookup import find_by_name
from marl_cair.policies.actor import MaskedEpsilonGreedy, PolicyActor

if TYPE_CHECKING:
    from marl_cair.games.game import Game


def load_agent(
    source: str | os.PathLike[str],
    game: str | None = None,
    scenario: Any = None,
    epsilon: float = 0.0,
) -> Agent:
    """An agent by name or path; `agent.act(observations, action_mask)` gives actions.

    Args:
        source: a checkpoint's folder, or a bot as "deep_line_wars/rusher" (just "rusher" where
            `game` is given). A folder that exists is taken before a bot's name.
        game: the game that it is to play; a checkpoint of another game is refused.
        scenario: a scenario (or its name) that it is to play; None: the one that it was trained
            on, or the game's default.
        epsilon: chance of a random legal action.

    Raises:
        CheckpointError: no checkpoint, a broken one, or one that does not fit game or scenario.
        UnknownNameError: no such bot or game; names the nearest.
    """
    path = Path(source)
    if path.is_dir():
        return _load_checkpoint(path, game, scenario, epsilon)
    named_game, _, bot = str(source).rpartition("/")
    owner = named_game or game
    if owner is not None and owner in GAMES:
        if game is not None and owner != game:
            raise CheckpointError(f"{source} is a bot of {owner}, it cannot play {game}")
        kind = f"{owner} bot or checkpoint folder"
        return _make_bot(find_by_name(kind, bot, GAMES[owner].bots), GAMES[owner], scenario)
    raise CheckpointError(
        f"{source} is neither a folder with a checkpoint nor a bot; bots are named "
        "<game>/<bot>, for example deep_line_wars/rusher"
    )


def _make_bot(factory: Any, game: Game, scenario: Any) -> Agent:
    chosen = game.scenario(scenario) if scenario is None or isinstance(scenario, str) else scenario
    bot: Agent = factory(chosen, game.make_spec(chosen))
    return bot


def _load_checkpoint(path: Path, game: str | None, scenario: Any, epsilon: float) -> Agent:
    network, about = load_network(path)
    if game is not None and about.game != game:
        raise CheckpointError(
            f"{path} was trained on {about.game}, it cannot play {game}: give one of {game}"
        )
    chosen = find_by_name("game", about.game, GAMES)
    _check_version(path, about, chosen)
    if scenario is None:
        played = chosen.scenario(about.scenario, **about.scenario_options)
    else:
        played = chosen.scenario(scenario) if isinstance(scenario, str) else scenario
    spec = chosen.make_spec(played)
    _check_fit(path, about, spec)
    exploration = MaskedEpsilonGreedy(seed=0, action_groups=spec.action_groups)
    return PolicyActor(network, about.name, about.representation, exploration, epsilon)


def _check_version(path: Path, about: AgentDescription, game: Game) -> None:
    if about.game_version != game.version:
        raise CheckpointError(
            f"{path} was trained on version {about.game_version} of {about.game}'s rules, this is "
            f"version {game.version}: train it again, or install the marl_cair of that version"
        )


def _check_fit(path: Path, about: AgentDescription, spec: Any) -> None:
    if about.action_names != spec.action_names:
        raise CheckpointError(
            f"{path} has another action space ({len(about.action_names)} actions: "
            f"{', '.join(about.action_names[:4])}, ...) than this scenario ({spec.num_actions}: "
            f"{', '.join(spec.action_names[:4])}, ...): play it on the scenario it was trained on"
        )
    known = find_by_name("representation", about.representation, spec.representations)
    if tuple(about.observation_shape) != known.shape:
        raise CheckpointError(
            f"{path} sees {about.representation} of shape {list(about.observation_shape)}, this "
            f"scenario's has {list(known.shape)}: play it on a board of the size it was trained on"
        )
