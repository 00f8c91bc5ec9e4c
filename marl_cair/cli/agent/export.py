"""`marl-cair export`: write a trained agent as an ONNX model, which runs without torch."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import sys
import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from marl_cair import __version__
from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser
from marl_cair.files import atomic_path
from marl_cair.league.agents.load import find_scenario
from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.checkpoint import AgentDescription
    from marl_cair.policies.q_network import QNetwork

EXTRA = ("onnx", "onnxscript", "onnxruntime")
MASK_RULE = (
    "action_mask is true for legal actions; at least one is legal. values of illegal actions are "
    "-inf; action is the legal action with the largest value, the lowest number among equals"
)
_CHECKED_ROWS = 32
_TOLERANCE = 1e-3  # of values: kernels of onnxruntime sum in another order


def run(arguments: Sequence[str]) -> int:
    """Write the file and print its inputs and outputs; returns the exit code."""
    options = make_parser().parse_args(arguments)
    about = export_agent(options.agent, options.file)
    places = "H, W, " if json.loads(about["network"]).get("action_shape") else ""
    size = int(about["state_size"])
    state, after = (f", {each}state float32 [N, {size}]" if size else "" for each in ("", "next_"))
    sys.stdout.write(
        f"{options.file}: {about['name']} of {about['game']} {about['scenario']}\n"
        f"inputs   observation {about['observation_dtype']} [N, "
        f"{', '.join(map(str, json.loads(about['observation_shape'])))}], action_mask bool "
        f"[N, {places}A]{state}\n"
        f"outputs  values float32 [N, {places}A], action int64 [N{places and ', H, W'}]{after}; "
        f"A = {about['num_actions']}\n"
    )
    return EXIT_DONE


def export_agent(agent: str | os.PathLike[str], file: str | os.PathLike[str]) -> dict[str, str]:
    """Write the checkpoint (or run) in folder `agent` to `file` in the ONNX format.

    Inputs: `observation` [N, *shape] with the representation's dtype, `action_mask` bool [N, A], N
    of any size from 1; an agent with a recurrent state also has `state` float32 [N, S], zeros at
    the start of an episode. Outputs: `values` float32 [N, A], -inf for illegal actions, `action`
    int64 [N] (greedy), and `next_state`. Returns the metadata, which the file holds too.

    Raises:
        CheckpointError: as `checkpoint.load_network`.
        ValueError: a library of the extra `export` is missing, `file` has another ending, or the
            exported model gives other values than the agent.
    """
    from marl_cair.checkpoint import load_network

    missing = [name for name in EXTRA if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"export needs {', '.join(missing)}, which is not installed: "
            "pip install 'marl_cair[export]'"
        )
    if Path(file).suffix != ".onnx":
        raise ValueError(f"the file is {str(file)!r}, its name must end with .onnx")
    network, about = load_network(agent)
    game, scenario, fields = find_scenario([str(agent)])
    spec = game.make_spec(game.scenario(scenario, **fields))
    known = find_by_name("representation", about.representation, spec.representations)
    about = dataclasses.replace(about, scenario=scenario)  # a name that every process knows
    metadata = describe(about, np.dtype(known.dtype), network.state_size)
    with atomic_path(Path(file)) as unfinished:
        write_model(network, np.dtype(known.dtype), unfinished, metadata)
    return metadata


def describe(about: AgentDescription, dtype: np.dtype[Any], state_size: int) -> dict[str, str]:
    """The model's metadata: texts by name; lists and options are JSON."""
    return {
        "name": about.name,
        "game": about.game,
        "game_version": about.game_version,
        "scenario": about.scenario,
        "scenario_options": json.dumps(about.scenario_options),
        "representation": about.representation,
        "observation_shape": json.dumps(about.observation_shape),
        "observation_dtype": dtype.name,
        "action_names": json.dumps(about.action_names),
        "num_actions": str(len(about.action_names)),
        "mask_rule": MASK_RULE,
        "plays": about.plays,
        "state_size": str(state_size),
        "network": json.dumps(about.network),
        "marl_cair_version": __version__,
    }


def write_model(
    network: QNetwork, dtype: np.dtype[Any], file: Path, metadata: dict[str, str]
) -> None:
    """Write `network` as an ONNX model with `metadata`, and compare it with the network."""
    import onnx
    import torch
    from torch import Tensor, nn

    size = network.state_size

    class Exported(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(
            self, observation: Tensor, action_mask: Tensor, state: Tensor | None = None
        ) -> Any:
            has_state = state is not None
            found = self.network(observation, state) if has_state else self.network(observation)
            values, *after = found if has_state else (found,)
            legal = torch.where(action_mask, values, -torch.inf)
            return legal, legal.argmax(-1), *after

    rng = np.random.default_rng(0)
    shape = (_CHECKED_ROWS, *network.observation_shape)
    seen = rng.integers(0, 256, shape) if dtype == np.uint8 else rng.random(shape)
    mask = rng.random((_CHECKED_ROWS, *network.values_shape)) < 0.5
    mask[..., 0] |= ~mask.any(-1)
    given = {"observation": seen.astype(dtype), "action_mask": mask}
    outputs = ["values", "action"]
    if size:
        given["state"] = np.zeros((_CHECKED_ROWS, size), np.float32)
        outputs.append("next_state")
    tensors = tuple(torch.from_numpy(array) for array in given.values())
    rows = {0: torch.export.Dim("N", min=1)}
    each = (rows,) * len(tensors)
    model = Exported().eval().requires_grad_(requires_grad=False)
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)  # it warns that torchvision is not installed
    try:
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")
            wanted = [tensor.numpy() for tensor in model(*tensors)]
            graph = torch.export.export(model, tensors, dynamic_shapes=each, strict=False)
            program: Any = torch.onnx.export(
                graph, dynamo=True, input_names=list(given), output_names=outputs, verbose=False
            )
    finally:
        logger.setLevel(level)
    proto = program.model_proto
    onnx.helper.set_model_props(proto, metadata)
    onnx.save_model(proto, str(file))
    _compare(file, given, outputs, wanted)


def _compare(file: Path, given: dict[str, Any], names: list[str], wanted: list[Any]) -> None:
    import onnxruntime

    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    for name, one, other in zip(names, session.run(names, given), wanted, strict=True):
        if name != "action" and not np.allclose(one, other, atol=_TOLERANCE, rtol=_TOLERANCE):
            raise ValueError(
                f"the exported model gives other {name} than the agent: its body or head has parts "
                "that torch.onnx.export does not translate"
            )


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair export",
        description=__doc__,
        epilog="example: marl-cair export runs/demo/conv agent.onnx",
    )
    parser.add_argument("agent", metavar="AGENT", help=shared.CHECKPOINT_HELP)
    parser.add_argument("file", metavar="FILE.onnx", help="file to write; one there is replaced")
    return parser
