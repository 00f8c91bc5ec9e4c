"""Which networks an ensemble is made of, by what is observed: boards or stacks of pictures.

A new kind of observation is a network in a file of its own and a `Family` here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.loss import RareCorrection, find_losses
from marl_cair.generative.networks.ccdn import CCDN, Encoding, NextState
from marl_cair.generative.networks.cells import take_log
from marl_cair.generative.networks.economy import find_changes
from marl_cair.generative.networks.frame_network import FrameCCDN, ask_frames, find_frame_losses
from marl_cair.generative.networks.outcome import read_outcome
from marl_cair.generative.networks.steps import StepTable
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec, NetworkSize

COUNTED_STRIDE = 8  # one in so many rows shows enough of which steps are usual on the board

Member = CCDN | FrameCCDN
Groups = list[dict[str, Any]]


class Family(NamedTuple):
    """A network, and what an ensemble does with it."""

    make: Callable[[GeneratorSpec, NetworkSize], Member]
    find_losses: Callable[[Any, TensorDict, RareCorrection, int, int], dict[str, Tensor]]
    ask: Callable[[Any, TensorDict], tuple[Tensor, ...]]  # in the order of `Opinions`
    group_parameters: Callable[[Any, GeneratorConfig], Groups]  # for Adam, with "peak" rates
    note: Callable[[Sequence[Any], StepTable, TensorDict], None]  # new real transitions


def choose_family(spec: GeneratorSpec) -> Family:
    """The family that reads the observations of `spec`."""
    return FRAMES if spec.num_frames > 1 else BOARDS


def _note_boards(members: Sequence[CCDN], steps: StepTable, rows: TensorDict) -> None:
    """Take note of the steps and differences that values take."""
    now, later = rows["observation"], rows["next", "observation"]
    first = members[0]
    moving, counted = first.moving, slice(None, None, COUNTED_STRIDE)
    steps.count(now[counted][:, moving], later[counted][:, moving], first.size.shifts)
    first.economy.note_differences(*(first.split(planes)[1] for planes in (now, later)))
    for network in members:
        network.step_results.copy_(steps.results)
        network.economy.is_seen.copy_(first.economy.is_seen)


def _group_board_parameters(network: CCDN, config: GeneratorConfig) -> Groups:
    economy = [*network.near.parameters(), *network.economy.parameters()]
    # The cells' heads read the embedded changes as well.
    economy = [part for part in economy if part is not network.economy.change_weight]
    chosen = {id(parameter) for parameter in economy}
    rate = config.economy_learning_rate
    others = [parameter for parameter in network.parameters() if id(parameter) not in chosen]
    return [
        {"params": others, "lr": config.learning_rate, "peak": config.learning_rate},
        {"params": economy, "lr": rate, "peak": rate},
    ]


def _ask_boards(network: CCDN, rows: TensorDict) -> tuple[Tensor, ...]:
    following = rows["next", "observation"]
    encoding = network.encode(rows["observation"], rows["action"])
    _, later = network.split(following)
    changes = find_changes(encoding.scalars, later)
    economy = network.economy.find_log_prob(encoding.outlook, encoding.scalars, changes)
    board = network.reveal_economy(encoding, changes)
    state = NextState(following, changes, board)
    cells = _find_cell_log_probs(network, encoding, state)
    outcome = network.judge(encoding, state, rows["action_mask"])
    everything = torch.cat([economy, cells], -1)
    return (
        everything.sum(-1),
        everything.amin(-1),
        economy.sum(-1),
        *read_outcome(outcome, network.bins),
    )


def _find_cell_log_probs(network: CCDN, encoding: Encoding, state: NextState) -> Tensor:
    cells = network.open_cells(encoding, state.changes, state.board)
    masses = cells.find_masses(state.observation[:, network.moving]).masses
    return take_log(masses).flatten(1)


def _group_frame_parameters(network: FrameCCDN, config: GeneratorConfig) -> Groups:
    rate = config.frame_learning_rate
    return [{"params": list(network.parameters()), "lr": rate, "peak": rate}]


BOARDS = Family(CCDN, find_losses, _ask_boards, _group_board_parameters, _note_boards)
FRAMES = Family(
    FrameCCDN,
    lambda network, rows, correction, *_: find_frame_losses(network, rows, correction),
    ask_frames,
    _group_frame_parameters,
    lambda members, steps, rows: None,
)
