"""Agent checkpoints: a network's weights and its description, as data only.

A checkpoint is a folder with `agent.json` (the description) and `weights.pt` (tensors). Loading
runs no code of these files.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, BinaryIO

from marl_cair.files import find_folder, read_run_kind, replaced_folder
from marl_cair.lookup import check_name
from marl_cair.memory import require_memory
from marl_cair.outside import CodeNotAllowedError, OutsideCodeError, require_known
from marl_cair.policies import GREEDY, HEADS, NETWORKS, PLAYS
from marl_cair.policies.config import QNetworkConfig
from marl_cair.stored import (
    TENSORS,
    DamagedFileError,
    check_plain_name,
    open_stored,
    read_json,
)

if TYPE_CHECKING:  # torch takes seconds, and most commands only read descriptions
    from marl_cair.policies.q_network import QNetwork

FORMAT = "marl_cair agent"
FORMAT_VERSION = 1
DESCRIPTION_FILE = "agent.json"
WEIGHTS_FILE = "weights.pt"
LATEST_FOLDER, SNAPSHOT_FOLDER = "latest", "snapshots"
# Kinds of runs whose folders hold agents.
TRAINING, LEAGUE_TRAINING = "training", "league training"
PSRO, EXPLOIT = "policy-space response oracles", "exploit"
SHARED, LIVE_FOLDER, PLAYERS = "shared", "live", "players"  # see `self_play.shared_folder`
MIXTURE_FOLDER, CANDIDATES_FOLDER = "mixture", "candidates"
EXPLOIT_FILE = "exploit.json"  # names the best candidate
_MOST_VALUES = 2_000_000  # in one file: a run's lists hold its last few thousand games


class CheckpointError(DamagedFileError):
    """A file or folder that is no checkpoint, a damaged one, or one for another purpose."""


@dataclass(frozen=True)
class AgentDescription:
    """The description of an agent.

    Attributes:
        name: for tables.
        game, game_version, scenario: where it was trained; `scenario_options` are all its fields,
            with the reward that was learned from (until 28 November 2026 the rated one).
        representation, observation_shape, action_names: of its observations and actions.
        network: `QNetworkConfig.to_dict()`.
        frames, updates: of training in its run.
        seed: of the training run.
        plays: how the network's outputs become actions, a name of `policies.PLAYS`.
        frames_total, updates_total: with all runs that it was trained in before (`initial_agent`,
            best responses that begin as an agent); at least those of its run.
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
        check_name("way to play", self.plays, PLAYS)
        for name, value in vars(self).items():
            if name in ("scenario_options", "network") and not isinstance(value, dict):
                raise ValueError(f"{name} is {value!r}, it must be values by name")


def save_agent(
    folder: str | os.PathLike[str],
    network: QNetwork,
    about: AgentDescription,
    more: Mapping[str, str] | None = None,
) -> None:
    """Write a checkpoint to `folder`, whole or not at all; replaces one that is there. more: texts
    of further files by name.
    """
    record = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(about)}
    weights = {name: value.detach().cpu() for name, value in network.state_dict().items()}
    with replaced_folder(folder) as fresh:
        (fresh / DESCRIPTION_FILE).write_text(json.dumps(record, indent=2) + "\n", "utf-8")
        save_tensors(weights, fresh / WEIGHTS_FILE)
        for name, text in (more or {}).items():
            (fresh / name).write_text(text, "utf-8")


def find_agent(folder: str | os.PathLike[str]) -> Path:
    """The agent's folder of a run: the newest agent of `train`, the mixture of `league psro`, the
    best response of `league exploit`.

    Raises:
        CheckpointError: `league train`, with several agents, or an unfinished `league exploit`.
    """
    place = Path(folder)
    kind = read_run_kind(place)
    if kind == LEAGUE_TRAINING:
        live = place / SHARED / LIVE_FOLDER
        names = ", ".join(sorted(one.name for one in live.glob("[!.]*"))) or "none yet"
        raise CheckpointError(
            f"{place} is a run of `league train`, which has several agents: name one of those in "
            f"{live} ({names}), or their mixture {place / MIXTURE_FOLDER}, which is written last"
        )
    if kind == EXPLOIT:
        return place / CANDIDATES_FOLDER / _read_chosen(place / EXPLOIT_FILE)
    inside = {TRAINING: LATEST_FOLDER, PSRO: MIXTURE_FOLDER}
    return place / inside[kind] if kind in inside else place


def _read_chosen(file: Path) -> str:
    try:
        return check_plain_name(read_json(file)["chosen"], "the chosen candidate")
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise CheckpointError(
            f"{file.parent} is a run of `league exploit` without a result ({error!r}): finish it, "
            f"or name one of {file.parent / CANDIDATES_FOLDER}"
        ) from error


def read_description(folder: str | os.PathLike[str]) -> AgentDescription:
    """The description of the agent in `folder` (of a run: of `find_agent`). Raises CheckpointError:
    no checkpoint, a damaged one, or a newer format.
    """
    place = find_agent(folder)
    path = find_folder(place) / DESCRIPTION_FILE
    if not path.is_file():
        raise CheckpointError(
            f"{place} is no agent checkpoint: it holds no {DESCRIPTION_FILE}; give the folder of "
            "one, for example runs/demo/conv/latest"
        )
    try:
        record = read_json(path)
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


def read_network_config(about: AgentDescription, file: str | os.PathLike[str]) -> QNetworkConfig:
    """The settings of the described network; nothing is imported. file: where the description is.

    Raises:
        CodeNotAllowedError: a body or head of a user, which this process has not imported and
            `outside.allow_code` does not allow.
        ValueError: unknown or damaged settings.
    """
    config = QNetworkConfig.from_dict(about.network)
    require_known(config.list_code(), file)
    return config


def load_network(folder: str | os.PathLike[str]) -> tuple[QNetwork, AgentDescription]:
    """The network with its weights, ready to act, and its description.

    Raises:
        CheckpointError: as `read_description`; or weights that are missing, damaged, not finite,
            anything but tensors, or do not fit the network; or its class is missing.
        CodeNotAllowedError: as `read_network_config`.
    """
    from marl_cair.policies.q_network import make_q_network
    from marl_cair.policies.saved_weights import restore_weights

    place = find_agent(folder)
    about = read_description(place)
    path = find_folder(place) / WEIGHTS_FILE
    weights = load_tensors(path)
    shape, num_actions = about.observation_shape, len(about.action_names)
    try:
        config = read_network_config(about, find_folder(place) / DESCRIPTION_FILE)
        # The described network is not allocated before its size fits the file.
        needed, held = count_weight_bytes(config, shape, num_actions), path.stat().st_size
        if needed > 2 * held:  # weights may be stored as float16
            raise ValueError(
                f"{DESCRIPTION_FILE} is of a network of {needed:,} bytes, the file has {held:,}"
            )
        network = make_q_network(config, shape, num_actions, seed=0)
        restore_weights(network, weights, WEIGHTS_FILE)
    except CodeNotAllowedError:
        raise
    except OutsideCodeError as error:
        raise CheckpointError(f"{place} needs code that is not in marl_cair: {error}") from error
    except (ValueError, TypeError, RuntimeError, ArithmeticError) as error:
        raise CheckpointError(f"{path} does not hold this agent's weights: {error}") from error
    return network.eval(), about


def count_weight_bytes(config: QNetworkConfig, shape: tuple[int, ...], num_actions: int) -> int:
    """Bytes of a network's weights, without making it. Raises ValueError as `QNetwork`, and for
    sizes that no memory could hold.
    """
    import torch

    from marl_cair.policies.q_network import QNetwork

    _ = NETWORKS[config.body], HEADS[config.head]  # imported here: their modules may make tensors
    try:
        with torch.device("meta"):
            network = QNetwork(config, shape, num_actions)
    except (RuntimeError, OverflowError) as error:
        raise ValueError(f"the network is too large for any memory ({error})") from error
    return sum(weight.nbytes for weight in network.parameters())


def save_tensors(values: Mapping[str, Any], path: Path) -> None:
    """Write tensors, of any device, and plain data for `load_tensors`. Raises OSError where the
    disk is full.
    """
    import torch
    from torch.utils._pytree import tree_map_only

    # torch writes files itself and reports a full disk as an error of its own position.
    buffer = io.BytesIO()
    torch.save(tree_map_only(torch.Tensor, torch.Tensor.cpu, dict(values)), buffer)
    path.write_bytes(buffer.getbuffer())


def load_tensors(path: str | os.PathLike[str]) -> Mapping[str, Any]:
    """Read tensors and plain data of `torch.save`, and nothing else. Raises CheckpointError: the
    file is missing, damaged, too large for the memory, or holds code.
    """
    import torch

    try:
        with open_stored(path, TENSORS) as file:
            size = os.fstat(file.fileno()).st_size
            _require_plain_zip(file, size)
            require_memory(f"{path}", size)
            file.seek(0)
            loaded: Mapping[str, Any] = torch.load(file, map_location="cpu", weights_only=True)
        _require_plain_data(loaded)
    except FileNotFoundError as error:
        raise CheckpointError(f"{path} is missing: the checkpoint is incomplete") from error
    except DamagedFileError as error:
        raise CheckpointError(f"{error}") from error
    except Exception as error:  # whatever a damaged file makes torch raise
        cause = f"{error}".partition("\n")[0] or type(error).__name__
        raise CheckpointError(
            f"{path} is cut short, or holds more than tensors and plain data: {cause}"
        ) from error
    if not isinstance(loaded, Mapping):
        raise CheckpointError(f"{path} holds a {type(loaded).__name__}, expected a dictionary")
    return loaded


def _require_plain_zip(file: BinaryIO, size: int) -> None:
    """Raise ValueError unless the file is a zip as torch writes it, without compression, so that
    its content is no larger than the file.
    """
    entries = zipfile.ZipFile(file).infolist()
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
        raise ValueError("parts of it are compressed")
    if sum(entry.file_size for entry in entries) > size:
        raise ValueError("its parts are larger than the file")


def _require_plain_data(loaded: Any) -> None:
    """Raise ValueError unless `loaded` is plain data and tensors no larger than their storage: a
    small storage can be viewed as a tensor of any size.
    """
    import torch

    left, num_values = [loaded], 0
    while left:
        value = left.pop()
        num_values += 1
        if num_values > _MOST_VALUES:
            raise ValueError(f"it holds more than {_MOST_VALUES:,} values")
        if isinstance(value, dict):
            left += [*value.keys(), *value.values()]
        elif isinstance(value, list | tuple):
            left += value
        elif isinstance(value, torch.Tensor):
            if value.layout != torch.strided or value.device.type != "cpu" or value.is_quantized:
                raise ValueError("a tensor of it is sparse, quantised, or on no CPU")
            if value.nbytes > value.untyped_storage().nbytes():
                raise ValueError(f"a tensor of shape {list(value.shape)} is more than it holds")
        elif not isinstance(value, str | bytes | int | float | NoneType):
            raise ValueError(f"it holds a {type(value).__name__}")
