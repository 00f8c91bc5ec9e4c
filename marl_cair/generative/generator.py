"""`Generator`, the interface of generators of transitions, and `CCDNGenerator`."""

from __future__ import annotations

import copy
from typing import Any, Protocol, cast

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from marl_cair.generative import quality, settings
from marl_cair.generative.gate import (
    GateReport,
    check_quality,
    find_broken_structure,
    measure_rare,
    tune_acceptance,
)
from marl_cair.generative.heldout import (
    TransitionRing,
    check_real_rows,
    is_heldout,
    make_empty_transitions,
    read_others,
)
from marl_cair.generative.networks.boards import is_picture
from marl_cair.generative.networks.ccdn import CCDN
from marl_cair.generative.networks.frames import FrameCCDN
from marl_cair.generative.networks.outcome import Outcome
from marl_cair.generative.quality import Imagined
from marl_cair.generative.rare import Correction, RareCounts
from marl_cair.generative.settings import MAX_ROUNDS, GeneratorConfig, GeneratorSpec
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights
from marl_cair.ranges import COUNT, read_number
from marl_cair.replay.sampler import restore_generator
from marl_cair.replay.transition import OTHER_ACTIONS, UNKNOWN_ACTION, mark_generated

CHUNK_ROWS = 64  # without gradients: the arrays of all cells then fit the cache
WARMUP_UPDATES = 50  # full steps from the start leave a trunk of dead channels
MIN_AVERAGE_SHARE = 0.005  # of the newest weights in the average
TRAINING, _GENERATING, _EVALUATING = range(3)


class Generator(Protocol):
    """Learns from real one-step transitions and generates artificial ones.

    TensorDicts have the keys of `marl_cair.replay.transition` and batch size [N], except the starts
    of `predict`.
    """

    @property
    def last_report(self) -> GateReport | None:
        """Report of the last `evaluate`, None before the first."""

    def observe(self, batch: TensorDict) -> None:
        """Add new real transitions: held-out rows for the gate, rare rows for training."""

    def hold_out(self, batch: TensorDict) -> None:
        """Add real transitions for `evaluate` alone: those that a data set holds out."""

    def update(self, batch: TensorDict) -> dict[str, float]:
        """Learn from real transitions, sampled uniformly from replay; return losses for the log."""

    def evaluate(self) -> GateReport:
        """Compute metrics on held-out real transitions, and open or shut the gate."""

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """Return up to `num_rows` accepted transitions from the states of `starts`; none while the
        gate is shut.
        """

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """Return the transition from each of `starts` ("observation", "action_mask", "action"), and
        whether it is accepted: bool [N], false while the gate is shut.
        """

    def state_dict(self) -> dict[str, Any]:
        """Return the state from which a resumed run continues with the same bits."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`."""

    def export_knowledge(self) -> dict[str, Any]:
        """Return the learned weights for another run: data only, without any transition. Entries
        that `state_dict` has too must have the same name: they are written once.
        """

    def import_knowledge(self, knowledge: dict[str, Any]) -> None:
        """Start from the weights of another run; the gate is evaluated on rows of this run only."""


class CCDNGenerator:
    """A CCDN behind a quality gate."""

    def __init__(self, config: GeneratorConfig, spec: GeneratorSpec) -> None:
        self.config, self.spec = config, spec
        # torch's layers draw their initial weights from the global generator.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = (FrameCCDN if is_picture(spec) else CCDN)(spec, config.size)
        # Predictions come from a moving average of the weights.
        self.average = copy.deepcopy(self.network)
        weights = self.network.parameters()
        self.optimizer = torch.optim.Adam(weights, lr=config.learning_rate, fused=True)
        self.num_updates = 0
        self.last_report: GateReport | None = None
        self._counts = RareCounts(config.heldout_share, config.heldout_ends)
        self._heldout = TransitionRing(spec, config.heldout_capacity)
        self._rare_heldout = TransitionRing(spec, config.heldout_capacity // 8)
        self._rare = TransitionRing(spec, config.rare_capacity)
        self._generators = [
            torch.Generator().manual_seed(config.seed * 7919 + use) for use in range(3)
        ]
        self._kinds = torch.tensor(spec.kinds)

    def observe(self, batch: TensorDict) -> None:
        """Add new real transitions; each once, when it enters replay.

        Raises ValueError for generated rows, rows of more than one step, rows without a replay
        index, and rewards outside the spec's range.
        """
        heldout, rare, config = self._split(batch), self._counts.count(batch), self.config
        self._heldout.add(batch[is_heldout(batch["index"], config.heldout_share, config.seed)])
        self._rare_heldout.add(batch[heldout & rare])
        self._rare.add(batch[~heldout & rare])

    def hold_out(self, batch: TensorDict) -> None:
        """Add real transitions to the held-out rows. Raises ValueError as `observe` does."""
        check_real_rows(batch, self.spec)
        rewards, ends = batch["next", "reward"][:, 0], batch["next", "terminated"][:, 0]
        self._heldout.add(batch)
        self._rare_heldout.add(batch[self._counts.find_rare(rewards, ends)])

    def update(self, batch: TensorDict) -> dict[str, float]:
        """One optimiser step on `batch` less its held-out rows, of which a share `rare_share` is
        replaced by rare rows that `observe` stored.

        Returns mean losses per row, of boards in nats. Raises ValueError as `observe` does.
        """
        learnable, random = batch[~self._split(batch)], self._generators[TRAINING]
        rare = self._rare.sample(round(self.config.rare_share * len(batch)), random)
        common = learnable[: max(0, len(batch) - len(rare))]
        if not len(common) + len(rare):
            return {}
        keys = rare.keys()
        rows = cast(TensorDict, torch.cat([common.select(*keys), rare]))
        rewards, ends = rows["next", "reward"][:, 0], rows["next", "terminated"][:, 0]
        is_rare = self._counts.find_rare(rewards, ends)
        is_rare[len(common) :] = True  # a reward that was rare when it was stored may be common now
        return self._learn(rows, self._counts.correct(is_rare, ends, len(rare)))

    def _learn(self, rows: TensorDict, correction: Correction) -> dict[str, float]:
        network, optimizer = self.network, self.optimizer
        rows = self._move(rows)
        others = read_others(rows)
        hidden = torch.rand(len(rows), generator=self._generators[TRAINING]).to(others.device)
        others[hidden < settings.UNKNOWN_SHARE] = UNKNOWN_ACTION
        units = [self._counts.reward_unit, self._counts.end_unit]
        network.outcome.reward_units.copy_(torch.tensor(units))
        correction = correction._replace(weights=correction.weights.to(others.device))
        losses = self._compute_losses(rows, others, correction)
        total = torch.stack(list(losses.values())).sum()
        optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(total)
        norm = nn.utils.clip_grad_norm_(network.parameters(), self.config.max_grad_norm)
        for group in optimizer.param_groups:
            warm = min(1.0, (self.num_updates + 1) / WARMUP_UPDATES)
            group["lr"] = warm * self.config.learning_rate
        # One bad batch must not turn all weights into NaN.
        if bool(torch.isfinite(norm)):
            optimizer.step()
        self._average_weights()
        self.num_updates += 1
        found = {name: float(loss.detach()) for name, loss in losses.items()}
        return {**found, "total": float(total.detach()), "grad_norm": float(norm)}

    def _compute_losses(
        self, rows: TensorDict, others: Tensor, correction: Correction
    ) -> dict[str, Tensor]:
        return self.network.compute_losses(rows, others, *correction)

    def _move(self, rows: TensorDict) -> TensorDict:
        device = self.network.outcome.reward_units.device
        return rows if device.type == "cpu" else rows.to(device, non_blocking=True)

    @torch.no_grad()
    def _average_weights(self) -> None:
        """Move the average towards the network; it spans about a ninth of all updates."""
        share = max(MIN_AVERAGE_SHARE, 9.0 / (self.num_updates + 9.0))
        ours, newest = self.average.parameters(), self.network.parameters()
        torch._foreach_lerp_(list(ours), list(newest), share)
        self.average.outcome.reward_units.copy_(self.network.outcome.reward_units)

    @torch.no_grad()
    def imagine(self, rows: TensorDict, generator: torch.Generator | None = None) -> Imagined:
        """Predict what follows on `rows` [N], whatever the gate says: the likeliest next state, or
        a sampled one with a `generator`.

        rows: "observation", "action_mask", "action" and, if recorded, "other_actions".
        """
        if not len(rows):  # `pixel_unshuffle` fails for no frames
            none = torch.zeros(0)
            return Imagined(rows["observation"], rows["action_mask"], none, none, none)
        parts = [self._imagine(part, generator) for part in rows.split(CHUNK_ROWS)]
        return Imagined(*(torch.cat(part) for part in zip(*parts, strict=True)))

    def _imagine(self, rows: TensorDict, generator: torch.Generator | None) -> Imagined:
        network, rows = self.average, self._move(rows)
        following, surety, outcome = network.decode(rows, read_others(rows), generator)
        low, high = self.spec.reward_range
        mask = self._read_mask(outcome)
        reward = network.outcome.expect_reward(outcome).clamp(low, high)
        made = following, mask, reward, outcome.end.sigmoid(), surety
        return Imagined(*(part.cpu() for part in made))

    def _read_mask(self, outcome: Outcome) -> Tensor:
        mask = outcome.mask > 0.0
        mask[:, self.spec.noop_action] = True  # legal in every state
        return mask

    def evaluate(self) -> GateReport:
        """Compute metrics on held-out rows: one half tunes the acceptance, the other tests it."""
        gate = self.config.gate
        needed = settings.MIN_HELDOUT_ROWS
        if self._heldout.num_rows < needed:
            found, share = self._heldout.num_rows, self.config.heldout_share
            reason = f"only {found} held-out rows, {needed} are needed; heldout_share is {share}"
            if not share:
                reason = f"the data set holds out {found} rows, {needed} are needed: collect more"
            self.last_report = GateReport(False, (reason,))
            return self.last_report
        rows = self._heldout.sample(gate.evaluation_rows, self._generators[_EVALUATING])
        made = self.imagine(rows)
        metrics = quality.measure_rows(rows, made, self.spec)
        metrics |= self.rate_masks(rows)
        rare = self._rare_heldout.select(torch.arange(self._rare_heldout.num_rows))
        is_rare = self._counts.find_rare(rare["next", "reward"][:, 0])
        made_rare, going_on = self.imagine(rare), made.end[~rows["next", "terminated"][:, 0]]
        metrics |= measure_rare(rare, made_rare, is_rare, going_on)
        half = len(rows) // 2
        ends = made_rare.end[rare["next", "terminated"][:, 0]]
        acceptance = tune_acceptance(made.select(slice(half)), ends, metrics, gate)
        tested, rest = rows[half:], made.select(slice(half, None))
        accepted = acceptance.accept(rest, self._counts.find_rare(rest.reward))
        metrics["accepted/end_bound"] = acceptance.unlikely
        metrics |= quality.measure_acceptance(tested, rest, self.spec, accepted)
        reasons = check_quality(metrics, gate.loosen() if self._is_open else gate)
        self.last_report = GateReport(not reasons, reasons, metrics, acceptance)
        return self.last_report

    def rate_masks(self, rows: TensorDict) -> dict[str, float]:
        """Share of right mask entries of real `rows` [N], by their own next states."""
        rows = rows[~rows["next", "terminated"][:, 0]]
        if not len(rows):
            return {}
        parts = map(self._move, rows.split(CHUNK_ROWS))
        masks = [self._read_mask(self.average.judge(part, read_others(part))) for part in parts]
        right = torch.cat(masks).cpu() == rows["next", "action_mask"]
        return {"mask/given_next": float(right.float().mean())}

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """Return up to `num_rows` accepted transitions; fewer after `MAX_ROUNDS` of proposals.

        Empty while the gate is shut. starts: real transitions, sampled with replacement;
        "observation", "action_mask", "action" and, if there, "other_actions" are read. Raises
        ValueError for no starts.
        """
        if starts.shape[0] == 0:
            raise ValueError("starts is empty: give one or more real transitions to start from")
        made, num_made = [make_empty_transitions(self.spec, 0)], 0
        random = self._generators[_GENERATING]
        for _ in range(MAX_ROUNDS if self._is_open else 0):
            missing = num_rows - num_made
            if missing <= 0:
                break
            begun = starts[torch.randint(len(starts), (missing,), generator=random)]
            begun["action"] = self._choose_actions(begun["action"], begun["action_mask"])
            rows, accepted = self.predict(begun)
            made.append(rows[accepted])
            num_made += len(made[-1])
        return cast(TensorDict, torch.cat(made))

    @property
    def _is_open(self) -> bool:
        return self.last_report is not None and self.last_report.passed

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """Return one transition for each of `starts`, and whether it passes all tests, bool [N].

        Other players' actions that `starts` do not have are those of other rows, or of held-out
        rows: an estimate of how they play.
        """
        rows = make_empty_transitions(self.spec, starts.shape[0])
        report = self.last_report
        if report is None or not report.passed:
            return rows, torch.zeros(starts.shape[0], dtype=torch.bool)
        random = self._generators[_GENERATING]
        for key in ("observation", "action_mask", "action"):
            rows[key] = starts[key]
        if self.spec.num_others:
            rows[OTHER_ACTIONS] = self._draw_others(starts, random)
        made = self.imagine(rows, random)
        rows["next", "observation"], rows["next", "action_mask"] = made[:2]
        rows["next", "reward"] = made.reward[:, None]
        rows["next", "terminated"] = rows["next", "done"] = (made.end > 0.5)[:, None]
        mark_generated(rows)
        accepted = report.acceptance.accept(made, self._counts.find_rare(made.reward))
        return rows, accepted & ~find_broken_structure(rows, self.spec)

    def _draw_others(self, starts: TensorDict, random: torch.Generator) -> Tensor:
        """The other seats' actions [N, O]: those of `starts`, else those of held-out rows."""
        known = starts.get(OTHER_ACTIONS, None)
        if known is not None and bool((known >= 0).all()):
            return cast(Tensor, known)
        places = torch.randint(self._heldout.num_rows, (len(starts),), generator=random)
        drawn = self._heldout.select(places)[OTHER_ACTIONS]
        return drawn if known is None else torch.where(known >= 0, known, drawn)

    def _choose_actions(self, behaviour: Tensor, mask: Tensor) -> Tensor:
        """Return the actions `behaviour` [N], replaced by random legal ones in some rows.

        These are uniform over legal kinds first: a tower has many cells, a unit one action.
        """
        random = self._generators[_GENERATING]
        sizes = torch.zeros(mask.shape[0], self.spec.num_kinds)
        sizes.index_add_(1, self._kinds, mask.float())
        weights = mask.float() / sizes[:, self._kinds].clamp_min(1.0)
        weights[:, self.spec.noop_action] = weights[:, self.spec.noop_action].clamp_min(1e-6)
        other = torch.multinomial(weights, 1, generator=random).squeeze(-1)
        chance = torch.rand(mask.shape[0], generator=random)
        return torch.where(chance < self.config.counterfactual_share, other, behaviour)

    def state_dict(self) -> dict[str, Any]:
        """Return network, optimiser, counts, rings, random states and report: data only."""
        report = None if self.last_report is None else self.last_report.to_dict()
        return {
            "network": self._export_network(),
            "counts": self._counts.state_dict(),
            "heldout": self._heldout.state_dict(),
            "rare_heldout": self._rare_heldout.state_dict(),
            "rare": self._rare.state_dict(),
            "generators": [generator.get_state() for generator in self._generators],
            "report": report,
        }

    def _export_network(self) -> dict[str, Any]:
        return {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "num_updates": self.num_updates,
        }

    def _import_network(self, state: dict[str, Any]) -> None:
        restore_weights(self.network, state["network"], "generator.network")
        restore_weights(self.average, state["average"], "generator.average")
        restore_optimizer(self.optimizer, state["optimizer"], "generator.optimizer")
        self.num_updates = read_number(state, "num_updates", COUNT)

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict` with the same bits.

        Raises ValueError if the state was saved with larger rings.
        """
        self._import_network(state["network"])
        self._counts.load_state_dict(state["counts"])
        for name in ("heldout", "rare_heldout", "rare"):
            getattr(self, f"_{name}").load_state_dict(state[name])
        for generator, saved in zip(self._generators, state["generators"], strict=True):
            restore_generator(generator, {"generator": saved})
        saved = state["report"]
        self.last_report = None if saved is None else GateReport.from_dict(saved)

    def export_knowledge(self) -> dict[str, Any]:
        """Return network and optimiser, with the spec and sizes they belong to."""
        described = settings.describe_network(self.spec, self.config)
        return {**described, "network": self._export_network()}

    def import_knowledge(self, knowledge: dict[str, Any]) -> None:
        """Start from the network of `export_knowledge`; the gate stays shut until `evaluate`.

        Raises ValueError if it is for other transitions, or of another size.
        """
        for name, own in settings.describe_network(self.spec, self.config).items():
            if knowledge.get(name) != own:
                raise ValueError(f"its {name} is {knowledge.get(name)}, but this run's is {own}")
        self._import_network(knowledge["network"])

    def _split(self, batch: TensorDict) -> Tensor:
        """Check real rows; return which of them are held out, bool [N]."""
        check_real_rows(batch, self.spec)
        ends, config = batch["next", "terminated"][:, 0], self.config
        share = torch.where(ends, config.heldout_ends, config.heldout_share)
        return is_heldout(batch["index"], share, config.seed)
