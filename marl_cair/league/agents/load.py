"""Loads a checkpoint, mixture, bot or foreign agent, and computes its fingerprint."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from marl_cair import checkpoint
from marl_cair.checkpoint import AgentDescription, CheckpointError, find_agent, read_description
from marl_cair.files import find_folder
from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import Agent, Game
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.league.agents import allowed_code
from marl_cair.league.agents.allowed_code import is_foreign, is_process
from marl_cair.league.agents.foreign import ForeignAgent, load_foreign
from marl_cair.league.agents.mixtures import is_mixture, read_mixture
from marl_cair.league.agents.process import load_hosted, load_process
from marl_cair.league.store.schema import AgentRecord
from marl_cair.lookup import find_by_name
from marl_cair.outside import read_code
from marl_cair.policies import PLAYS, SAMPLED
from marl_cair.policies.config import LATER

if TYPE_CHECKING:
    from marl_cair.policies.actor import PolicyActor

# Folders of a run, or a league, that hold checkpoints.
_SHELVES = (checkpoint.SNAPSHOT_FOLDER, checkpoint.PLAYERS, checkpoint.LIVE_FOLDER)


def load_agent(
    source: str | os.PathLike[str],
    game: str | None = None,
    scenario: Any = None,
    epsilon: float = 0.0,
    answer_seconds: float | None = None,
    answer_memory: int = 0,
    answer_processes: int = 0,
) -> Agent:
    """Load an agent by name or path; `agent.act(observations, action_mask)` returns actions.

    A source that a file names must pass `league.agents.allowed_code.require_allowed` before.

    Args:
        source: the folder of a checkpoint, of a training run (its newest agent) or of a mixture; a
            bot as "deep_line_wars/rusher" ("rusher" if `game` is given); a foreign agent as
            "module:function" (see `foreign`) or "process:COMMAND" (see `process`). A folder that
            exists is taken before a bot of that name.
        game: the game to play; a checkpoint of another game is refused.
        scenario: a scenario or its name; default: the one that the checkpoint was trained on, or
            the game's default.
        epsilon: probability of a random legal action.
        answer_seconds: limit for each answer of a foreign agent, which then runs in a process of
            its own. None, without the two limits below: commands have
            `allowed_code.ANSWER_SECONDS`; functions run in this process without a limit, so that
            one that hangs or exits ends the caller. (The `marl-cair` commands set a limit.)
        answer_memory: limit in bytes for each process of a foreign agent; 0: none.
        answer_processes: limit for the number of its processes; 0: none.

    Raises:
        CheckpointError: no checkpoint, a damaged one, or one that does not fit game or scenario.
        ForeignAgentError: a foreign agent that cannot be found or fails.
        UnknownNameError: no such bot or game; names the nearest.
    """
    path = Path(source)
    if is_mixture(source):
        mixture = read_mixture(source)
        members = [load_agent(one, game, scenario, epsilon) for one in mixture.sources]  # no code
        return MixedAgent(members, mixture.weights, path.absolute().name)
    if is_checkpoint(source):
        return _load_checkpoint(path, game, scenario, epsilon)
    if is_process(source) or is_foreign(source):
        owning = find_by_name("game", game or next(iter(GAMES)), GAMES)
        chosen = _make_scenario(owning, scenario)
        if is_process(source):
            usual, load = allowed_code.ANSWER_SECONDS, load_process
        elif answer_seconds is None and not answer_memory and not answer_processes:
            return load_foreign(str(source), chosen, owning.make_spec(chosen))
        else:
            usual, load = allowed_code.FUNCTION_SECONDS, load_hosted
        seconds = usual if answer_seconds is None else answer_seconds
        limits = allowed_code.Limits(seconds, answer_memory, answer_processes)
        return load(str(source), owning, chosen, limits)
    named_game, _, bot = str(source).rpartition("/")
    owner = named_game or game
    if owner is not None and owner in GAMES:
        if game is not None and owner != game:
            raise CheckpointError(f"{source} is a bot of {owner}, it cannot play {game}")
        kind = f"{owner} bot or checkpoint folder"
        make = find_by_name(kind, bot, GAMES[owner].bots)
        chosen = _make_scenario(GAMES[owner], scenario)
        return make(chosen, GAMES[owner].make_spec(chosen))
    if path.is_file():
        raise CheckpointError(f"{source} is a file: give the folder of the checkpoint")
    raise CheckpointError(
        f"{source} is neither a folder with a checkpoint nor a bot; bots are named "
        "<game>/<bot>, for example deep_line_wars/rusher, agents of your own module:function or "
        "process:COMMAND"
    )


def is_checkpoint(source: str | os.PathLike[str]) -> bool:
    """Whether `source` is a folder."""
    return not is_process(source) and find_folder(source).is_dir()


def describe_agent(name: str, agent: Agent, game: Game, source: str = "") -> AgentRecord:
    """The league file's record of an agent, with the name in the league and the agent's source."""
    kind, policy = "bot", "scripted"
    configuration: dict[str, Any] = {"representation": agent.representation}
    if source:
        place = find_agent(Path(source).absolute()) if is_checkpoint(source) else source
        configuration["source"] = str(place)
    actor = _find_actor(agent)
    if actor:
        kind = "network"
        policy = f"epsilon-greedy {actor.epsilon:g}" if actor.epsilon else "greedy"
        if actor.is_sampled:
            policy = f"sampled, epsilon {actor.epsilon:g}" if actor.epsilon else "sampled"
        configuration["network"] = actor.network.config.to_dict()
        if source and is_checkpoint(source):
            configuration["training"] = describe_training(Path(source))
    elif isinstance(agent, ForeignAgent):
        kind, policy = "foreign", "its own"
    elif isinstance(agent, MixedAgent):
        kind, policy = "mixture", f"one of {len(agent.members)}, drawn before each game"
        prints = [find_fingerprint(member, game) for member in agent.members]
        configuration["members"] = dict(zip(prints, agent.weights.tolist(), strict=True))
    fingerprint = find_fingerprint(agent, game)
    about = json.dumps(configuration, sort_keys=True)
    return AgentRecord(fingerprint, name, kind, policy, game.version, about)


def find_distinct(sources: Iterable[str], game: Game, scenario: Any) -> dict[str, str]:
    """Sources by fingerprint; of identical agents the first. Raises as `load_agent`."""
    found: dict[str, str] = {}
    for source in sources:
        agent = load_agent(source, game.name, scenario)
        found.setdefault(find_fingerprint(agent, game), source)
    return found


def read_source(record: AgentRecord) -> str:
    """The source of a league's agent, as for `load_agent`; "" if unknown."""
    return str(json.loads(record.configuration).get("source") or "")


def describe_training(folder: Path) -> dict[str, Any]:
    """The run of the checkpoint in `folder`, its seed and its frames of training, which distinguish
    the snapshots of different runs; empty if the checkpoint cannot be read any more.
    """
    try:
        about = read_description(folder)
    except CheckpointError:
        return {}
    place = find_agent(folder.absolute())
    run, name = place.parent, about.name.partition("@")[0]  # snapshots are called run@frames
    if run.name == checkpoint.PLAYERS:  # of a league: learner-generation-frames
        name = place.name.rpartition("-")[0]
    if run.name in _SHELVES:
        run = run.parent
    training = {"run": str(run), "name": name, "seed": about.seed, "frames": about.frames}
    return {**training, "frames_total": about.frames_total}


def shorten_paths(paths: Sequence[str], taken: Collection[str] = ()) -> dict[str, str]:
    """Short names by path: the fewest last parts that make all names unique, also among `taken`.

    The last part `latest` is left out; snapshots keep the name of their run.
    """
    parts = {path: _split_path(path) for path in paths}
    for depth in range(1, max((len(run) for run, _ in parts.values()), default=0) + 1):
        short = {path: "/".join([*run[-depth:], *age]) for path, (run, age) in parts.items()}
        if len({*short.values(), *taken}) == len(short) + len(taken):
            return short
    return {path: path for path in parts}


def _split_path(path: str) -> tuple[list[str], list[str]]:
    """The parts of the path of an agent or its run, and of a snapshot of the run."""
    parts = [p for p in Path(path).absolute().parts if p not in ("/", checkpoint.LATEST_FOLDER)]
    is_snapshot = len(parts) > 2 and parts[-2] == checkpoint.SNAPSHOT_FOLDER
    return (parts[:-2], parts[-1:]) if is_snapshot else (parts, [])


def find_fingerprint(agent: Agent, game: Game) -> str:
    """Identity of an agent, independent of name and path: a bot's rules version, or a hash of
    everything that a network's actions depend on, as it was loaded.
    """
    if isinstance(agent, ForeignAgent):
        return agent.fingerprint
    if isinstance(agent, MixedAgent):
        prints = [find_fingerprint(member, game) for member in agent.members]
        mixed = sorted(zip(prints, agent.weights.tolist(), strict=True))
        return hashlib.blake2b(json.dumps(mixed).encode(), digest_size=16).hexdigest()
    actor = _find_actor(agent)
    if not actor:
        return f"{game.name} {game.version} {agent.name}"
    network = actor.network
    digest = hashlib.blake2b(digest_size=16)
    config = {n: v for n, v in network.config.to_dict().items() if n not in LATER or v != LATER[n]}
    about = (config, network.num_actions, actor.representation, actor.epsilon)
    digest.update(json.dumps(about, sort_keys=True).encode())
    if actor.is_sampled:
        digest.update(SAMPLED.encode())
    for place in network.config.list_code():
        digest.update(read_code(place))
    for name, tensor in sorted(network.state_dict().items()):
        value = tensor.cpu().numpy()
        digest.update(f"{name} {value.dtype} {value.shape}".encode())
        digest.update(value.tobytes())
    return digest.hexdigest()


def find_scenario(
    agents: Sequence[str], game_name: str | None = None, scenario: str | None = None
) -> tuple[Game, str, dict[str, Any]]:
    """The game that agents play by default, the scenario's name, and its fields.

    The named game, else the one that a checkpoint was trained on, else a bot's ("game/bot"), else
    the first. The named scenario; else the one that the game's checkpoints were trained on, with
    all its fields and the rated reward; else the game's default.

    Raises:
        CheckpointError: a damaged checkpoint; or no scenario is named and two checkpoints differ.
        UnknownNameError: no such game.
    """
    agents = [
        member
        for source in agents
        for member in (read_mixture(source).sources if is_mixture(source) else (source,))
    ]
    trained = [(name, read_description(name)) for name in agents if is_checkpoint(name)]
    prefixes = [name.rpartition("/")[0] for name in agents]
    named = [about.game for _, about in trained] + [name for name in prefixes if name in GAMES]
    game = find_by_name("game", game_name or next(iter([*named, *GAMES])), GAMES)
    seen = {
        name: {**find_trained(game, about), "reward": game.rated_reward}
        for name, about in trained
        if about.game == game.name
    }
    if scenario is not None or not seen:
        return game, scenario or game.default_scenario, {}
    (first, chosen), *others = seen.items()
    for name, other in others:
        if other != chosen:
            raise CheckpointError(
                f"{first} was trained on {_format_difference(chosen, other)}, {name} on "
                f"{_format_difference(other, chosen)}: say by --scenario what all are to play"
            )
    return game, chosen.pop("scenario"), chosen


def find_trained(game: Game, about: AgentDescription) -> dict[str, Any]:
    """The scenario that a checkpoint was trained on: its name under "scenario", and its fields.

    A scenario that a user has registered (`register_scenario`) is unknown in another process. Then
    the fields, which a checkpoint has all, change the game's default. A field that is newer than
    the checkpoint has the value of the named scenario.
    """
    fields, name = restore_fields(about.scenario_options), about.scenario
    if name not in game.scenarios and vars(game.scenario()).keys() <= fields.keys():
        name = game.default_scenario
    if name in game.scenarios:
        fields = {**vars(game.scenario(name)), **fields}
    return {"scenario": name, **fields}


def _format_difference(own: dict[str, Any], other: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {v}" for name, v in own.items() if other.get(name) != v)


def _make_scenario(game: Game, scenario: Any) -> Any:
    is_named = scenario is None or isinstance(scenario, str)
    return game.scenario(scenario) if is_named else scenario


def _find_actor(agent: Agent) -> PolicyActor | None:
    """The agent if it is a network; does not import torch."""
    module = sys.modules.get("marl_cair.policies.actor")
    return agent if module and isinstance(agent, module.PolicyActor) else None


def _load_checkpoint(path: Path, game: str | None, scenario: Any, epsilon: float) -> Agent:
    from marl_cair.policies.actor import PolicyActor

    network, about = checkpoint.load_network(path)
    if game is not None and about.game != game:
        raise CheckpointError(
            f"{path} was trained on {about.game}, it cannot play {game}: give one of {game}"
        )
    chosen = find_by_name("game", about.game, GAMES)
    if about.game_version not in (chosen.version, *chosen.agents_of):
        raise CheckpointError(
            f"{path} was trained on version {about.game_version} of {about.game}'s rules, this is "
            f"version {chosen.version}: train it again, or install the marl_cair of that version"
        )
    if scenario is None:
        trained = find_trained(chosen, about)
        played = chosen.scenario(trained.pop("scenario"), **trained)
    else:
        played = _make_scenario(chosen, scenario)
    spec = chosen.make_spec(played)
    _check_fit(path, about, spec)
    exploration = PLAYS[about.plays](seed=0, action_groups=spec.action_groups)
    return PolicyActor(network, about.name, about.representation, exploration, epsilon)


def _check_fit(path: Path, about: AgentDescription, spec: Any) -> None:
    if about.action_names != spec.action_names:
        raise CheckpointError(
            f"{path} has another action space ({len(about.action_names)} actions: "
            f"{', '.join(about.action_names[:4])}, ...) than this scenario ({spec.num_actions}: "
            f"{', '.join(spec.action_names[:4])}, ...): play it on the scenario it was trained on, "
            f"{about.scenario}"
        )
    known = find_by_name("representation", about.representation, spec.representations)
    if tuple(about.observation_shape) != known.shape:
        raise CheckpointError(
            f"{path} sees {about.representation} of shape {list(about.observation_shape)}, this "
            f"scenario's has {list(known.shape)}: play it on a board of the size it was trained on"
        )
