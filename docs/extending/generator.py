"""A generator of transitions: repeats real transitions that it remembers, labelled as generated.

It is a baseline: a learned generator must be better. No change of marl_cair is needed. With
this file in the current folder:

    marl-cair train generator.name=generator:MemoryGenerator
"""

import torch

from marl_cair.generative.gate import GateReport
from marl_cair.generative.heldout import TransitionRing, make_empty_transitions
from marl_cair.replay.transition import mark_generated

CAPACITY = 2_000  # transitions
LEAST_ROWS = 500  # transitions at which the gate opens


class MemoryGenerator:
    """Fulfils `marl_cair.generative.generator.Generator`."""

    def __init__(self, config, spec):
        self.spec = spec
        self.last_report = None
        self._ring = TransitionRing(spec, CAPACITY)
        self._random = torch.Generator().manual_seed(config.seed)

    def observe(self, batch):
        """Remember real transitions."""
        self._ring.add(batch)

    def hold_out(self, batch):
        """This gate needs no held-out transitions."""

    def update(self, batch):
        """Nothing is learned; returns losses for the log."""
        return {}

    def evaluate(self):
        """Open the gate if enough is remembered."""
        num_rows = self._ring.num_rows
        reasons = () if num_rows >= LEAST_ROWS else (f"{num_rows} of {LEAST_ROWS} transitions",)
        self.last_report = GateReport(passed=not reasons, reasons=reasons)
        return self.last_report

    @property
    def _is_open(self):
        return self.last_report is not None and self.last_report.passed

    def generate(self, starts, num_rows):
        """Up to `num_rows` transitions; none while the gate is shut."""
        rows = self._ring.sample(num_rows if self._is_open else 0, self._random)
        mark_generated(rows)
        return rows

    def predict(self, starts):
        """What follows on each start, and whether it is accepted: only what was seen exactly."""
        rows = make_empty_transitions(self.spec, starts.shape[0])
        known = self._ring.select(torch.arange(self._ring.num_rows))
        accepted = torch.zeros(starts.shape[0], dtype=torch.bool)
        for place in range(starts.shape[0]):
            start = starts[place]
            same = (known["observation"] == start["observation"]).flatten(1).all(1)
            same &= (known["action"] == start["action"]) & self._is_open
            if same.any():
                rows[place] = known[int(same.nonzero()[0, 0])]
                accepted[place] = True
        for key in ("observation", "action_mask", "action"):
            rows[key] = starts[key]
        mark_generated(rows)
        return rows, accepted

    def state_dict(self):
        """Data that a resumed run continues from with the same bits."""
        report = None if self.last_report is None else self.last_report.to_dict()
        return {
            "ring": self._ring.state_dict(),
            "random": self._random.get_state(),
            "report": report,
        }

    def load_state_dict(self, state):
        self._ring.load_state_dict(state["ring"])
        self._random.set_state(state["random"])
        report = state["report"]
        self.last_report = None if report is None else GateReport.from_dict(report)

    def export_knowledge(self):
        """What another run may begin with: nothing."""
        return {}

    def import_knowledge(self, knowledge):
        """Begin with what another run exported: nothing."""
