"""`Generator`, the interface of generators of transitions, and `CCDNGenerator`."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any, Protocol, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.ensemble import Ensemble, Predictions
from marl_cair.generative.gate import (
    Acceptance,
    GateReport,
    check_metrics,
    find_rejections,
    tune_acceptance,
)
from marl_cair.generative.heldout import TransitionRing, is_heldout, make_empty_transitions
from marl_cair.generative.metrics import compute_metrics, decide_mask, predict_heldout
from marl_cair.generative.networks.outcome import RewardBins
from marl_cair.generative.rare import RareCounts, Stratum
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.replay.sampler import restore_generator
from marl_cair.replay.transition import NO_ACTION, NO_INDEX, NO_OPPONENT, check_transitions

_TRAINING, _GENERATING, _EVALUATING = range(3)


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
    """An ensemble of CCDN v2 networks behind a quality gate."""

    def __init__(self, config: GeneratorConfig, spec: GeneratorSpec) -> None:
        self.config = config
        self.spec = spec
        self.ensemble = Ensemble(spec, config)
        self.last_report: GateReport | None = None
        bins = RewardBins(spec.reward_range, config.size.reward_bins)
        self._counts = RareCounts(bins, config.rare_reward_share)
        self._heldout = TransitionRing(spec, config.heldout_capacity)
        self._rare_heldout = TransitionRing(spec, config.heldout_capacity // 8)
        self._rare = {
            stratum: TransitionRing(spec, config.rare_capacity // 2)
            for stratum in (Stratum.RARE_REWARD, Stratum.END)
        }
        self._generators = [
            torch.Generator().manual_seed(config.seed * 7919 + use) for use in range(3)
        ]
        self._kinds = torch.tensor(spec.kinds)

    def observe(self, batch: TensorDict) -> None:
        """Add new real transitions; each once, when it enters replay.

        Raises ValueError for generated rows, rows of more than one step, rows without a replay
        index, and rewards outside the spec's range.
        """
        heldout = self._split(batch)
        self._heldout.add(batch[heldout])
        strata = self._counts.count(batch)
        self._rare_heldout.add(batch[heldout & (strata != Stratum.COMMON)])
        for stratum, ring in self._rare.items():
            ring.add(batch[~heldout & (strata == stratum)])
        self.ensemble.count_steps(batch[~heldout])

    def update(self, batch: TensorDict) -> dict[str, float]:
        """One optimiser step of one member, in turn, on `batch` less its held-out rows.

        A share `rare_share` of the rows is replaced by rows that `observe` stored, one half with
        rare rewards and one half ends; if there are too few of one kind, more of the other.
        Returns mean losses in nats per row. Raises ValueError as `observe` does.
        """
        learnable = batch[~self._split(batch)]
        generator = self._generators[_TRAINING]
        rare = self._draw_rare(round(self.config.rare_share * batch.shape[0]), generator)
        num_rare = sum(rows.shape[0] for rows in rare.values())
        common = learnable[: max(0, batch.shape[0] - num_rare)]
        if not common.shape[0] + num_rare:
            return {}
        parts = {Stratum.COMMON: common, **rare}
        keys = rare[Stratum.END].keys()
        rows = cast(TensorDict, torch.cat([part.select(*keys) for part in parts.values()]))
        drawn_from = torch.cat(
            [torch.full((part.shape[0],), int(stratum)) for stratum, part in parts.items()]
        )
        rewards, ends = rows["next", "reward"].squeeze(-1), rows["next", "terminated"].squeeze(-1)
        strata = self._counts.find_strata(rewards, ends)
        # A reward that was rare when it was stored may be common now; it counts as it was drawn.
        strata = torch.where(drawn_from == Stratum.COMMON, strata, drawn_from)
        return self.ensemble.train(rows, self._counts.correct(drawn_from, strata), generator)

    def _draw_rare(self, num: int, generator: torch.Generator) -> dict[Stratum, TensorDict]:
        rare, ends = self._rare[Stratum.RARE_REWARD], self._rare[Stratum.END]
        num_ends = min(ends.num_rows, num - min(rare.num_rows, num // 2))
        return {
            Stratum.RARE_REWARD: rare.sample(num - num_ends, generator),
            Stratum.END: ends.sample(num_ends, generator),
        }

    def evaluate(self) -> GateReport:
        """Compute metrics on held-out rows: one half tunes the acceptance, the other tests it."""
        gate = self.config.gate
        if self._heldout.num_rows < gate.min_heldout_rows:
            reason = (
                f"only {self._heldout.num_rows} held-out rows, {gate.min_heldout_rows} are needed"
            )
            self.last_report = GateReport(False, (reason,))
            return self.last_report
        generator = self._generators[_EVALUATING]
        rows = self._heldout.sample(gate.evaluation_rows, generator)
        rare = self._rare_heldout.select(torch.arange(self._rare_heldout.num_rows))
        held = predict_heldout(self.ensemble, rows, rare, generator)
        half = rows.shape[0] // 2
        acceptance = tune_acceptance(held.select(slice(None, half)), gate)
        metrics = compute_metrics(held, self.spec, self._counts, acceptance.certainty)
        tested = held.select(slice(half, None))
        accepted = self._find_accepted(tested.rows, tested.predictions, acceptance)
        metrics["acceptance/real_rows"] = float(accepted.float().mean())
        is_open = self.last_report is not None and self.last_report.passed
        reasons = check_metrics(metrics, gate.loosen() if is_open else gate)
        self.last_report = GateReport(not reasons, reasons, metrics, acceptance)
        return self.last_report

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """Return up to `num_rows` accepted transitions; fewer after `max_rounds` of proposals.

        Empty while the gate is shut. starts: real transitions, sampled with replacement;
        "observation", "action_mask" and "action" are read. Raises ValueError for no starts.
        """
        if starts.shape[0] == 0:
            raise ValueError("starts is empty: give one or more real transitions to start from")
        report = self.last_report
        if report is None or not report.passed:
            return make_empty_transitions(self.spec, 0)
        made, num_made = [make_empty_transitions(self.spec, 0)], 0
        for _ in range(self.config.max_rounds):
            missing = num_rows - num_made
            if missing <= 0:
                break
            rows, predicted = self._propose(starts, missing)
            made.append(rows[self._find_accepted(rows, predicted, report.acceptance)])
            num_made += len(made[-1])
        return torch.cat(made)

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """Return one transition for each of `starts`, and whether it passes all tests, bool [N]."""
        report = self.last_report
        if report is None or not report.passed:
            rows = make_empty_transitions(self.spec, starts.shape[0])
            return rows, torch.zeros(starts.shape[0], dtype=torch.bool)
        rows, predicted = self._generate_rows(
            starts["observation"], starts["action_mask"], starts["action"]
        )
        return rows, self._find_accepted(rows, predicted, report.acceptance)

    def state_dict(self) -> dict[str, Any]:
        """Return networks, optimisers, counts, rings, random states and report: data only."""
        report = None if self.last_report is None else self.last_report.to_dict()
        return {
            "ensemble": self.ensemble.state_dict(),
            "counts": self._counts.state_dict(),
            "heldout": self._heldout.state_dict(),
            "rare_heldout": self._rare_heldout.state_dict(),
            "rare": {stratum.name: ring.state_dict() for stratum, ring in self._rare.items()},
            "generators": [generator.get_state() for generator in self._generators],
            "report": report,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict` with the same bits.

        Raises ValueError if the state was saved with other members or larger rings.
        """
        self.ensemble.load_state_dict(state["ensemble"])
        self._counts.load_state_dict(state["counts"])
        self._heldout.load_state_dict(state["heldout"])
        self._rare_heldout.load_state_dict(state["rare_heldout"])
        for stratum, ring in self._rare.items():
            ring.load_state_dict(state["rare"][stratum.name])
        for generator, saved in zip(self._generators, state["generators"], strict=True):
            restore_generator(generator, {"generator": saved})
        saved = state["report"]
        self.last_report = None if saved is None else GateReport.from_dict(saved)

    def export_knowledge(self) -> dict[str, Any]:
        """Return networks, optimisers and step counts, with the spec and sizes they belong to."""
        return {**_describe(self.spec, self.config), "ensemble": self.ensemble.state_dict()}

    def import_knowledge(self, knowledge: dict[str, Any]) -> None:
        """Start from the networks of `export_knowledge`; the gate stays shut until `evaluate`.

        Raises ValueError if they are for other transitions or of another size.
        """
        for name, own in _describe(self.spec, self.config).items():
            if knowledge.get(name) != own:
                raise ValueError(f"its {name} is {knowledge.get(name)}, but this run's is {own}")
        self.ensemble.load_state_dict(knowledge["ensemble"])

    def _propose(self, starts: TensorDict, num_rows: int) -> tuple[TensorDict, Predictions]:
        generator = self._generators[_GENERATING]
        places = torch.randint(starts.shape[0], (num_rows,), generator=generator)
        observation, mask = starts["observation"][places], starts["action_mask"][places]
        action = self._choose_actions(starts["action"][places], mask, generator)
        return self._generate_rows(observation, mask, action)

    def _generate_rows(
        self, observation: Tensor, mask: Tensor, action: Tensor
    ) -> tuple[TensorDict, Predictions]:
        following = self.ensemble.propose(observation, action, self._generators[_GENERATING])
        rows = make_empty_transitions(self.spec, observation.shape[0])
        rows["observation"], rows["action_mask"], rows["action"] = observation, mask, action
        rows["next", "observation"] = following
        predicted = self.ensemble.predict(rows)
        terminated = (predicted.terminal.mean(0) > 0.5)[:, None]
        low, high = self.spec.reward_range
        rows["next", "action_mask"] = decide_mask(predicted.mask, self.spec.noop_action)
        rows["next", "reward"] = predicted.reward.mean(0).clamp(low, high)[:, None]
        rows["next", "terminated"], rows["next", "done"] = terminated, terminated.clone()
        rows["is_generated"].fill_(True)
        rows["expert_action"].fill_(NO_ACTION)
        rows["index"].fill_(NO_INDEX)
        rows["opponent"].fill_(NO_OPPONENT)
        return rows, predicted

    def _choose_actions(
        self, behaviour: Tensor, mask: Tensor, generator: torch.Generator
    ) -> Tensor:
        """Return the actions `behaviour` [N], replaced by random legal ones in some rows.

        These are uniform over legal kinds first: a tower has many cells, a unit one action.
        """
        sizes = torch.zeros(mask.shape[0], self.spec.num_kinds)
        sizes.index_add_(1, self._kinds, mask.float())
        weights = mask.float() / sizes[:, self._kinds].clamp_min(1.0)
        weights[:, self.spec.noop_action] = weights[:, self.spec.noop_action].clamp_min(1e-6)
        other = torch.multinomial(weights, 1, generator=generator).squeeze(-1)
        chance = torch.rand(mask.shape[0], generator=generator)
        counterfactual = chance < self.config.counterfactual_share
        return torch.where(counterfactual, other, behaviour)

    def _find_accepted(
        self, rows: TensorDict, predicted: Predictions, acceptance: Acceptance
    ) -> Tensor:
        """Which rows pass all tests, bool [N]."""
        is_rare = self._counts.is_rare_reward
        rejections = find_rejections(rows, predicted, acceptance, self.spec, is_rare)
        return ~torch.stack(list(rejections.values())).any(0)

    def _split(self, batch: TensorDict) -> Tensor:
        """Check real rows; return which of them are held out, bool [N]."""
        check_transitions(batch, self.spec.transition)
        if bool(batch["is_generated"].any()):
            raise ValueError(
                f"{int(batch['is_generated'].sum())} of the rows are generated: a generator learns "
                "from real transitions only"
            )
        steps = batch["steps_to_next_obs"]
        if bool((steps != 1).any()):
            raise ValueError(
                f"steps_to_next_obs reaches {int(steps.max())}, expected 1 everywhere: sample "
                "one-step transitions for the generator"
            )
        if bool((batch["index"] < 0).any()):
            raise ValueError(
                f"index {int(batch['index'].min())} is no slot of replay: it must be 0 or more, "
                "as it determines which rows are held out"
            )
        rewards, (low, high) = batch["next", "reward"], self.spec.reward_range
        if not bool(((rewards >= low) & (rewards <= high)).all()):
            raise ValueError(
                f"rewards reach from {float(rewards.min())} to {float(rewards.max())}, outside of "
                f"reward_range {self.spec.reward_range}: widen it in the GeneratorSpec"
            )
        return is_heldout(batch["index"], self.config.heldout_share, self.config.seed)


def _describe(spec: GeneratorSpec, config: GeneratorConfig) -> dict[str, Any]:
    """Return the settings that networks must be used with."""
    described = {**asdict(spec), "num_members": config.num_members, "size": asdict(config.size)}
    # Tuples become lists, as in saved settings.
    return cast(dict[str, Any], json.loads(json.dumps(described)))
