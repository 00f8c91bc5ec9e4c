"""`ThesisGenerator`: the thesis's CCDN as a generator. It predicts grey frames and nothing else.

The thesis does not say where rewards and ends of its generated transitions came from. Here they
are those of the real transition from which a generated one starts, with its action: only the next
frame is generated. There is no gate.
"""

from __future__ import annotations

from typing import Any, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.gate import GateReport
from marl_cair.generative.networks.thesis import SIDE, ThesisCCDN, to_frames, to_observation
from marl_cair.generative.quality import Imagined
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights
from marl_cair.replay.sampler import restore_generator
from marl_cair.replay.transition import NEXT_OBSERVATION, mark_generated

CHUNK_ROWS = 32
FRAME = (1, SIDE, SIDE)


class ThesisGenerator:
    """Fulfils `Generator` for one grey frame, `representation=gray`, and returns of one step.

    Raises ValueError for other observations.
    """

    def __init__(self, config: GeneratorConfig, spec: GeneratorSpec) -> None:
        if spec.observation_shape != FRAME or spec.num_frames > 1:
            raise ValueError(
                f"ccdn_thesis predicts one grey frame {list(FRAME)}, the observations are "
                f"{list(spec.observation_shape)}: set game.representation=gray, or generator=ccdn"
            )
        self.config, self.spec = config, spec
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            size = config.thesis
            self.network = ThesisCCDN(spec.num_actions, size.hidden, size.form)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.thesis.learning_rate)
        self.last_report: GateReport | None = None
        self._random = torch.Generator().manual_seed(config.seed)

    def observe(self, batch: TensorDict) -> None:
        """Nothing is held out."""

    def hold_out(self, batch: TensorDict) -> None:
        """There is no gate."""

    def update(self, batch: TensorDict) -> dict[str, float]:
        """One step of Adam on the mean squared error of the next frames' pixels."""
        device = next(self.network.parameters()).device
        now, later = (to_frames(batch[key].to(device)) for key in ("observation", NEXT_OBSERVATION))
        loss = self.network.compute_loss(now, batch["action"].to(device), later)
        self.optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        self.optimizer.step()
        return {"mse": float(loss.detach())}

    def evaluate(self) -> GateReport:
        """The thesis has no gate: it is open."""
        self.last_report = GateReport(True, ())
        return self.last_report

    @torch.no_grad()
    def imagine(self, rows: TensorDict, generator: torch.Generator | None = None) -> Imagined:
        """The next frames of `rows` [N]; rewards and ends are 0, masks those of before."""
        device = next(self.network.parameters()).device
        parts = [
            to_observation(
                self.network(to_frames(part["observation"].to(device)), part["action"].to(device))
            ).cpu()
            for part in rows.split(CHUNK_ROWS)
        ]
        zeros = torch.zeros(len(rows))
        frames = torch.cat(parts) if parts else rows["observation"]
        return Imagined(frames, rows["action_mask"].clone(), zeros, zeros, zeros)

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """`num_rows` of the real transitions `starts`, with generated next frames."""
        places = torch.randint(len(starts), (num_rows,), generator=self._random)
        rows = cast(TensorDict, starts[places])
        rows[NEXT_OBSERVATION] = self.imagine(rows).observation
        mark_generated(rows)
        return rows

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """The next frames; not accepted, as rewards and ends are unknown."""
        rows = starts.clone()
        made = self.imagine(rows)
        rows["next"] = TensorDict(
            {
                "observation": made.observation,
                "action_mask": made.action_mask,
                "reward": torch.zeros(len(rows), 1),
                "terminated": torch.zeros(len(rows), 1, dtype=torch.bool),
                "done": torch.zeros(len(rows), 1, dtype=torch.bool),
            },
            [len(rows)],
        )
        return rows, torch.zeros(len(rows), dtype=torch.bool)

    def state_dict(self) -> dict[str, Any]:
        """Network, optimiser and random state."""
        return {**self.export_knowledge(), "random": self._random.get_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`."""
        self.import_knowledge(state)
        restore_generator(self._random, {"generator": state["random"]})

    def export_knowledge(self) -> dict[str, Any]:
        """Network and optimiser."""
        return {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict()}

    def import_knowledge(self, knowledge: dict[str, Any]) -> None:
        """Start from `export_knowledge`. Raises ValueError for a network of another size."""
        restore_weights(self.network, knowledge["network"], "generator.network")
        restore_optimizer(self.optimizer, knowledge["optimizer"], "generator.optimizer")
