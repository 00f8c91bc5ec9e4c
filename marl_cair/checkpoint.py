"""Agent checkpoints: a network's weights and what they were trained on, as data only.

A checkpoint is a folder with `agent.json` (what it is) and `weights.pt` (tensors). Loading runs
nothing that the files say.
"""

from __future__ import annotations

import io
import json
import os
import pickle
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from marl_cair.files import find_folder, read_run_kind, replaced_folder
from marl_cair.lookup import find_by_name
from marl_cair.policies.actor import GREEDY, PLAYS
from marl_cair.policies.q_network import QNetwork, QNetworkConfig, make_q_network

FORMAT = "marl_cair agent"
FORMAT_VERSION = 1
DESCRIPTION_FILE = "agent.json"
WEIGHTS_FILE = "weights.pt"
LATEST_FOLDER, SNAPSHOT_FOLDER = "latest", "snapshots"
# Kinds of runs whose folders hold agents.
TRAINING, LEAGUE_TRAINING = "training", "league training"
PSRO, EXPLOIT = "policy-space response oracles", "exploit"
SHARED, LIVE_FOLDER = "shared", "live"  # of a league's training: see `league.shared`
MIXTURE_FOLDER, CANDIDATES_FOLDER = "mixture", "candidates"
EXPLOIT_FILE = "exploit.json"  # says which of the candidates is the best


class CheckpointError(ValueError):
    """A file or folder that is no checkpoint, a broken one, or one for something else."""


@dataclass(frozen=True)
class AgentDescription:
    """What the weights belong to.

    Attributes:
        name: for tables.
        game, game_version, scenario: where it was trained; `scenario_options` are all its fields.
        representation, observation_shape, action_names: what it sees and can do.
        network: `QNetworkConfig.to_dict()`.
        frames, updates: how long it was trained in its run.
        seed: of the training run.
        plays: how the network's outputs become actions, a name of `policies.actor.PLAYS`.
        frames_total, updates_total: the same with all runs that it went on from, one after the
            other (`initial_agent`, best responses that begin as an agent); at least those of its
            run, which is all that files of before know.
    """

    name: str
    game: str
    game_version: str
    scenario: str
    scenario_options: dict[str, Any]
    representation: str
    observation_shape: tuple[int, ...]
    action_names: tuple[str, ...]
    network: dict[str, Any]
    frames: int
    updates: int
    seed: int
    plays: str = GREEDY
    frames_total: int = 0
    updates_total: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames_total", max(self.frames, self.frames_total))
        object.__setattr__(self, "updates_total", max(self.updates, self.updates_total))
        find_by_name("way to play", self.plays, PLAYS)
        for name in ("scenario_options", "network"):
            value = getattr(self, name)
            if not isinstance(value, dict):
                raise ValueError(f"{name} is {value!r}, it must be values by name")


def save_agent(
    folder: str | os.PathLike[str],
    network: QNetwork,
    about: AgentDescription,
    more: Mapping[str, str] | None = None,
) -> None:
    """Write the checkpoint to `folder`, in place of one that is there, whole or not at all.

    more: texts of further files by name.
    """
    record = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(about)}
    weights = {name: value.detach().cpu() for name, value in network.state_dict().items()}
    with replaced_folder(folder) as fresh:
        (fresh / DESCRIPTION_FILE).write_text(json.dumps(record, indent=2) + "\n", "utf-8")
        save_tensors(weights, fresh / WEIGHTS_FILE)
        for name, text in (more or {}).items():
            (fresh / name).write_text(text, "utf-8")


def find_agent(folder: str | os.PathLike[str]) -> Path:
    """The folder of the agent that `folder` stands for: of a training run its newest, of
    policy-space response oracles their mixture, of `league exploit` the best response.

    Raises:
        CheckpointError: a league's training, which has several, or `league exploit` before its end.
    """
    place = Path(folder)
    kind = read_run_kind(place)
    if kind == LEAGUE_TRAINING:
        live = place / SHARED / LIVE_FOLDER
        names = ", ".join(sorted(one.name for one in live.glob("[!.]*"))) or "none yet"
        raise CheckpointError(
            f"{place} is a run of `league train`, which has several agents: name one of those in "
            f"{live} ({names}), or all as one, {place / MIXTURE_FOLDER}, which is there in the end"
        )
    if kind == EXPLOIT:
        return place / CANDIDATES_FOLDER / _read_chosen(place / EXPLOIT_FILE)
    inside = {TRAINING: LATEST_FOLDER, PSRO: MIXTURE_FOLDER}
    return place / inside[kind] if kind in inside else place


def _read_chosen(file: Path) -> str:
    try:
        return str(json.loads(file.read_text("utf-8"))["chosen"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise CheckpointError(
            f"{file.parent} is a run of `league exploit` without a result ({error!r}): let it end, "
            f"or name one of {file.parent / CANDIDATES_FOLDER}"
        ) from error


def read_description(folder: str | os.PathLike[str]) -> AgentDescription:
    """What the checkpoint in `folder` is; of a run, that of `find_agent`.

    Raises:
        CheckpointError: no checkpoint, a broken one, or one of a newer format.
    """
    place = find_agent(folder)
    path = find_folder(place) / DESCRIPTION_FILE
    if not path.is_file():
        raise CheckpointError(
            f"{place} is no agent checkpoint: it holds no {DESCRIPTION_FILE}; give the folder of "
            "one, for example runs/demo/conv/latest"
        )
    try:
        record = json.loads(path.read_text("utf-8"))
        if record.pop("format") != FORMAT:
            raise ValueError("it is of another program")
        version = record.pop("format_version")
        if version != FORMAT_VERSION:
            raise ValueError(
                f"its format version is {version}, this program reads {FORMAT_VERSION}"
            )
        for name in ("observation_shape", "action_names"):
            record[name] = tuple(record[name])
        return AgentDescription(**record)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise CheckpointError(f"{path} cannot be read as an agent checkpoint: {error}") from error


def load_network(folder: str | os.PathLike[str]) -> tuple[QNetwork, AgentDescription]:
    """The network with its weights, ready to act, and what it is.

    Raises:
        CheckpointError: as `read_description`; or weights that are missing, cut short, hold
            anything but tensors, or do not fit the network.
    """
    place = find_agent(folder)
    about = read_description(place)
    path = find_folder(place) / WEIGHTS_FILE
    try:
        config = QNetworkConfig.from_dict(about.network)
        network = make_q_network(config, about.observation_shape, len(about.action_names), seed=0)
        network.load_state_dict(load_tensors(path))
    except (ValueError, TypeError, RuntimeError) as error:
        raise CheckpointError(f"{path} does not hold this agent's weights: {error}") from error
    return network.eval(), about


def save_tensors(values: Mapping[str, Any], path: Path) -> None:
    """Write tensors and plain data for `load_tensors`. Raises OSError where the disk is full."""
    # torch writes files itself and reports a full disk as an error of its own position.
    buffer = io.BytesIO()
    torch.save(values, buffer)
    path.write_bytes(buffer.getbuffer())


def load_tensors(path: str | os.PathLike[str]) -> Mapping[str, Any]:
    """Read tensors and plain data that `torch.save` wrote, and nothing else.

    Raises:
        CheckpointError: the file is missing, cut short, or holds code.
    """
    try:
        loaded: Mapping[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise CheckpointError(f"{path} is missing: the checkpoint is incomplete") from error
    except (RuntimeError, EOFError, pickle.UnpicklingError, ValueError, KeyError, OSError) as error:
        raise CheckpointError(
            f"{path} is cut short, or holds more than tensors and plain data: {error}"
        ) from error
    if not isinstance(loaded, Mapping):
        raise CheckpointError(f"{path} holds a {type(loaded).__name__}, expected a dictionary")
    return loaded
