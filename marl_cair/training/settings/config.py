"""Settings of a training run: frozen dataclasses grouped by noun.

Units stand in the names. A frame is one step of one environment copy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from marl_cair.games import GAMES
from marl_cair.games.game import GameSpec
from marl_cair.generative import GENERATORS
from marl_cair.generative.settings import GeneratorConfig
from marl_cair.lookup import check_name
from marl_cair.policies import NO_MEMORY
from marl_cair.policies.config import QUANTILE, QNetworkConfig
from marl_cair.replay import MAX_FRACTION
from marl_cair.self_play.samplers import SAMPLERS
from marl_cair.training.settings.checks import (
    Allowed,
    Count,
    Device,
    Natural,
    NonNegative,
    Positive,
    Seed,
    Share,
    ShareAboveZero,
    ShareBelowOne,
    Threads,
    check_fields,
    require,
)
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.settings.evaluation import CheckpointSettings, EvaluationSettings
from marl_cair.training.settings.exploration import (
    EPSILON_GREEDY,
    EXPLORATIONS,
    NOISY,
    ExplorationSettings,
)
from marl_cair.training.settings.learner import LOSSES, LearnerSettings, NfspSettings
from marl_cair.training.settings.offline import OfflineSettings
from marl_cair.training.settings.replay import ReplaySettings

# After AlphaStar and OpenAI Five; not shown to be the best (`marl-cair experiment opponents`).
SELF_PLAY = {"latest": 0.5, "pfsp": 0.35, "uniform": 0.1, "bots": 0.05}
WARMUP_MIXTURE = {"random": 1.0}
NO_GENERATOR, GAMES_FOLDER = "none", "games"  # in a run's folder: games of the last evaluation
ENDLESS_FRAMES = 10**9  # as total_frames: the clock ends the run
_Margin = Annotated[float, Allowed(lambda x: 0 <= x < 0.5, "0 or more, below 0.5, or null")]
_Branch = Annotated[int, Allowed(lambda n: 0 <= n <= 20, "0..20")]
_Score = Annotated[float, Allowed(math.isfinite, "a number or null")]


@dataclass(frozen=True)
class GameSettings:
    """The game that is learned, its scenario, and the observation."""

    name: str = "deep_line_wars"  # which game is learned
    scenario: str = "10x15"  # board and rules
    representation: str = "planes"  # the learner's observation
    reward: str | None = None  # training reward; None: "shaped" where there is one, else the rated
    options: dict[str, Any] = field(default_factory=dict)  # fields of the scenario to change

    def __post_init__(self) -> None:
        spec = self.spec
        check_name(f"{self.name} representation", self.representation, spec.representations)
        GAMES[self.name].scenario(self.scenario, reward=self.learned_reward)
        for name, owner in (("reward", "game.reward"), ("shaping_discount", "learner.gamma")):
            given, place = self.options.get(name), f"game.options.{name}"
            require(name not in self.options, place, given, f"left out: set {owner}")

    @property
    def learned_reward(self) -> str:
        """Name of the training reward; evaluations always use the game's rated reward."""
        game = GAMES[self.name]
        return self.reward or ("shaped" if "shaped" in game.rewards else game.rated_reward)

    @property
    def played_scenario(self) -> Any:
        """The scenario with `options`."""
        return GAMES[self.name].scenario(self.scenario, **self.options)

    @property
    def rated_scenario(self) -> Any:
        """The scenario on which agents are rated, with the game's rated reward."""
        game = GAMES[self.name]
        return game.scenario(self.scenario, **{**self.options, "reward": game.rated_reward})

    @property
    def spec(self) -> GameSpec:
        """Seats, actions and representations of the scenario."""
        return GAMES[self.name].make_spec(self.played_scenario)


@dataclass(frozen=True)
class OpponentSettings:
    """Policies of the other teams, if there are any; an opponent is drawn for each rival team.

    Names in a mixture are bots, `agents`, or samplers (`self_play.samplers`): `latest` (the
    newest policy; it learns from those seats too), `bots` (all, evenly), `pfsp_bots` (all, those
    with a low win rate against them more often), `curriculum` (all, each at the lowest of
    seven strengths at which it is not beaten), and of the pool, which is snapshots and `agents`,
    `uniform`, `delta_uniform`, `recent`, `pfsp`, `pfsp_variance`, `pfsp_easy` and `nash`.
    """

    mixture: dict[str, float] = field(default_factory=SELF_PLAY.copy)  # weights by opponent's name
    warmup_frames: Natural = 0  # frames in which `random` alone is played in place of `mixture`
    agents: dict[str, str] = field(default_factory=dict)  # by name: folder or module:function
    snapshot_every_frames: Count = 100_000  # frames between two snapshots for the pool
    snapshot_margin: _Margin | None = 0.1  # one more once the best is surely beaten by it; or null
    pool_capacity: Count = 32  # snapshots kept for play, spread over the run; Nash's support stays
    pool_active: Count = 4  # draws from the snapshots that play at one time
    redraw_every_frames: Count = 10_000  # frames between two such draws
    delta: ShareBelowOne = 0.5  # share of the pool, the oldest, that `delta_uniform` leaves out
    recency: NonNegative = 3.0  # of `recent`: weight exp(-recency * age), age 0..1
    pfsp_power: NonNegative = 2.0  # of `pfsp`, `pfsp_bots` ((1 - win rate) ** power), `pfsp_easy`
    half_life_frames: Count = 100_000  # frames after which a game counts half in a win rate
    prior_games: Positive = 2.0  # even games that every win rate starts from

    def __post_init__(self) -> None:
        check_fields(self, "opponent.")
        mixture = self.mixture
        require(len(mixture) > 0, "opponent.mixture", mixture, "one or more weights by name")
        for opponent, weight in mixture.items():
            require(0 <= weight < math.inf, f"opponent.mixture.{opponent}", weight, "0 or more")
        require(sum(mixture.values()) > 0, "opponent.mixture", mixture, "above 0 in sum")
        for name in self.agents:
            plain = re.fullmatch(r"\w+", name) is not None and name not in SAMPLERS
            allowed = f"names of letters, digits and _, none of {', '.join(SAMPLERS)}"
            require(plain, "opponent.agents", name, allowed)

    def find_names(self) -> set[str]:
        """Names that have a weight above 0 at any time."""
        first = WARMUP_MIXTURE if self.warmup_frames else {}
        return {name for name, weight in [*self.mixture.items(), *first.items()] if weight > 0}

    def check_names(self, bots: Mapping[str, Any]) -> None:
        """Raise ValueError for an unknown name in a mixture, or an agent with the name of a bot."""
        for name in self.agents:
            allowed = f"another name than the game's bots have: {', '.join(bots)}"
            require(name not in bots, "opponent.agents", name, allowed)
        for name in self.mixture:
            check_name("opponent", name, bots, self.agents, SAMPLERS)


@dataclass(frozen=True)
class CollectorSettings:
    """How experience is gathered."""

    num_worlds: Count = 128  # environment copies
    steps_per_batch: Count = 16  # steps of each copy between two rounds of learning
    num_threads: Threads = 1  # CPU threads of the engine
    stagger_steps: Natural = 256  # random steps within which the first games begin; 0: all at once

    def __post_init__(self) -> None:
        check_fields(self, "collector.")


@dataclass(frozen=True)
class GeneratorSettings:
    """When the generator of artificial transitions learns, is measured and generates."""

    name: str = "ccdn"  # "none": all transitions are real
    batch_size: Count = 32  # real transitions of its own update
    frames_per_update: Count = 32  # frames collected for each of its updates while the gate is shut
    open_frames_per_update: Count = 128  # the same while it is open: fewer updates suffice then
    evaluate_every_frames: Count = 25_000  # frames between two evaluations of the gate
    # So a generated row is learned from as often as a real one: a fifth of batches and of rows.
    refill_every_frames: Count = 4_000  # frames between two refills while the gate is open
    rows_per_refill: Count = 1_000  # transitions
    rollout_steps: Count = 1  # generated steps at the end of a generated row, n_steps at most
    branch_steps: _Branch = 0  # above 0: one-step rows of roll-outs so long, not rollout_steps
    warmup_frames: Natural = 0  # frames in which batches are all real, even if the gate is open
    loss_weight: ShareAboveZero = 1.0  # of a generated row in the loss; of a real row 1 (dqn)
    transfer: bool = False  # let `initial_generator` be of another scenario of the game
    model: GeneratorConfig = field(default_factory=GeneratorConfig)

    def __post_init__(self) -> None:
        check_name("generator", self.name, (NO_GENERATOR,), GENERATORS)
        check_fields(self, "generator.")
        require(self.model.seed == 0, "generator.model.seed", self.model.seed, "0: give seed=N")


@dataclass(frozen=True)
class TrainConfig:
    """A whole run."""

    out: str = "runs/train"  # output folder
    seed: Seed = 0  # of everything random in the run
    total_frames: Count = 500_000  # environment steps; the run ends there
    max_minutes: Positive | None = None  # of this call; None: no limit
    stop_score: _Score | None = None  # ends the run when evaluations reach it; None: never
    synthetic_fraction: Share = 0.2  # generated share of each batch, 0..0.9; offline up to 1
    initial_agent: str | None = None  # folder of one whose network begins; None: a new one
    initial_generator: str | None = None  # folder of a run whose generator begins; None: a new one
    device: Device = "cpu"  # of the networks: cpu, cuda or cuda:N; bits differ between devices
    torch_threads: Threads | None = 1  # of a CPU; None: OMP_NUM_THREADS, or as torch chooses
    game: GameSettings = field(default_factory=GameSettings)
    policy: QNetworkConfig = field(default_factory=QNetworkConfig)
    opponent: OpponentSettings = field(default_factory=OpponentSettings)
    demonstration: DemonstrationSettings = field(default_factory=DemonstrationSettings)
    offline: OfflineSettings = field(default_factory=OfflineSettings)
    collector: CollectorSettings = field(default_factory=CollectorSettings)
    exploration: ExplorationSettings = field(default_factory=ExplorationSettings)
    replay: ReplaySettings = field(default_factory=ReplaySettings)
    learner: LearnerSettings = field(default_factory=LearnerSettings)
    nfsp: NfspSettings = field(default_factory=NfspSettings)
    generator: GeneratorSettings = field(default_factory=GeneratorSettings)
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)
    checkpoint: CheckpointSettings = field(default_factory=CheckpointSettings)

    def __post_init__(self) -> None:
        check_fields(self)
        if (goal := self.stop_score) is not None and self.game.spec.num_teams > 1:
            require(
                self.evaluation.bots != (), "evaluation.bots", (), "one or more with stop_score"
            )
            require(goal <= 1, "stop_score", goal, "1 or less: a share of the points")
        self._check_scenarios()
        self._check_network()
        self._check_generated()
        if not LOSSES.is_outside(self.learner.algorithm):
            self.check_algorithm()
        bots = GAMES[self.game.name].bots
        self.opponent.check_names(bots)
        for bot in (*self.evaluation.bots, *self.demonstration.bots):
            check_name(f"{self.game.name} bot", bot, bots)

    def _check_network(self) -> None:
        """Raise ValueError for a head or noisy layers without their loss or exploration."""
        head, loss = self.policy.head, self.learner.algorithm
        if (head == QUANTILE) != (loss == QUANTILE) and not LOSSES.is_outside(loss):
            raise ValueError(
                f"policy.head is {head!r} and learner.algorithm {loss!r}, but quantiles need this "
                f"loss, and this loss needs quantiles: set both to {QUANTILE!r}, or neither"
            )
        noisy, kind = self.policy.noisy, self.exploration.kind
        if noisy != (kind == NOISY) and not EXPLORATIONS.is_outside(kind):
            raise ValueError(
                f"policy.noisy is {str(noisy).lower()} and exploration.kind {kind!r}, but noisy "
                "layers replace random actions: set policy.noisy=true exploration.kind=noisy, or "
                f"policy.noisy=false exploration.kind={EPSILON_GREEDY}"
            )

    def _check_generated(self) -> None:
        """Raise ValueError for batches without real rows that are not allowed."""
        fraction, settings = self.synthetic_fraction, self.generator
        if fraction <= MAX_FRACTION:
            return
        allowed = f"0..{MAX_FRACTION} without offline.dataset"
        require(self.offline.dataset is not None, "synthetic_fraction", fraction, allowed)
        require(settings.name != NO_GENERATOR, "generator.name", settings.name, "a generator")
        steps = self.learner.n_steps
        whole = settings.branch_steps > 0 or settings.rollout_steps >= steps
        allowed = f"learner.n_steps ({steps}) or more, or branch_steps above 0: no step may be real"
        require(whole, "generator.rollout_steps", settings.rollout_steps, allowed)

    @property
    def has_generator(self) -> bool:
        """Whether generated transitions are wanted."""
        return self.generator.name != NO_GENERATOR and self.synthetic_fraction > 0

    @property
    def fills_replay(self) -> bool:
        """Whether transitions are stored: for the learner, or for the generator."""
        return self.learner.learns_from_replay or self.has_generator

    def evaluated_scenarios(self) -> dict[str, Any]:
        """Scenarios on which the learner is rated, by option, as `EvaluationSettings.changes`."""
        game, make = self.game, GAMES[self.game.name].scenario
        return {
            place: make(game.scenario, **{**game.options, **changes})
            for place, changes in self.evaluation.changes().items()
        }

    def check_algorithm(self) -> None:
        """Raise ValueError for parts that do not fit the loss; if there are any, imports it."""
        given = {"demonstration": self.demonstration.is_given, "nfsp": self.nfsp.enabled}
        given |= {"offline.dataset": self.offline.dataset is not None}
        given |= {"generator.loss_weight below 1": self.generator.loss_weight < 1.0}
        for name in (name for name, is_given in given.items() if is_given):
            allowed = f"dqn with {name}, which learns from the replay buffer"
            is_fit = self.learner.learns_from_replay
            require(is_fit, "learner.algorithm", self.learner.algorithm, allowed)
        if self.offline.dataset is not None:
            plays = self.nfsp.enabled or self.demonstration.is_given
            allowed = "null with nfsp.enabled or demonstration: their games are not played offline"
            require(not plays, "offline.dataset", self.offline.dataset, allowed)
        elif self.fills_replay:
            self._check_replay()
        if self.policy.memory != NO_MEMORY:
            self._check_memory()
        if self.game.spec.action_shape:
            self._check_action_shape()

    def _check_replay(self) -> None:
        """Raise ValueError for a buffer that drops steps before they have a next one."""
        spec, seen = self.game.spec, self.opponent.mixture
        seats = spec.num_players // (1 if "latest" in seen else spec.num_teams)
        least = 2 * seats * self.collector.num_worlds
        allowed = f"{least} or more: two steps of each own seat and world (collector.num_worlds)"
        held = self.replay.capacity_transitions
        require(held >= least, "replay.capacity_transitions", held, allowed)

    def _check_action_shape(self) -> None:
        """Raise ValueError for parts that cannot learn from an action at each cell."""
        takes = LOSSES[self.learner.algorithm].TAKES_ACTION_SHAPES
        if not takes or self.has_generator:
            raise ValueError(
                f"the scenario has an action at each cell of {list(self.game.spec.action_shape)}: "
                "set recipe=pqn (learner.algorithm=pqn generator=none), or one action per step: "
                "game.options.actions=unit of deep_rts"
            )

    def _check_memory(self) -> None:
        """Raise ValueError for parts that cannot train a network with memory."""
        learner, replay = self.learner, self.replay
        has_no_state = self.has_generator and not learner.learns_from_replay
        reads_steps = not LOSSES[learner.algorithm].READS_SEQUENCES
        for is_refused, reason, instead in (
            (has_no_state, "without replay no generated one has a state", "generator=none"),
            (self.offline.dataset, "a data set has no history", "offline.dataset=null"),
            (self.nfsp.enabled, "NFSP's reservoir holds single steps", "nfsp.enabled=false"),
            (reads_steps, "this loss reads single transitions", "learner.algorithm=dqn or pqn"),
        ):
            if is_refused:
                raise ValueError(
                    f"policy.memory is {self.policy.memory!r}, which learns from sequences of "
                    f"steps, but {reason}: set {instead}, or policy.memory=none"
                )
        if not learner.learns_from_replay:
            return
        size, steps, held = learner.batch_size, replay.sequence_steps, replay.capacity_transitions
        count = size // steps
        allowed = f"a multiple of replay.sequence_steps, which is {steps}, with policy.memory"
        require(size % steps == 0, "learner.batch_size", size, allowed)
        mixes = 1 <= count * self.synthetic_fraction <= count - 1 or not self.has_generator
        allowed = f"so large that some of its {count} sequences are generated and some are real"
        require(mixes, "learner.batch_size", size, allowed)
        streams = self.collector.num_worlds * self.game.spec.num_players
        least = 2 * streams * (steps + replay.burn_in_steps + 1)  # two, half of them tails
        allowed = f"{least} or more, for the sequences of {streams} seats (policy.memory)"
        require(held >= least, "replay.capacity_transitions", held, allowed)

    def _check_scenarios(self) -> None:
        """Raise ValueError for an evaluated scenario of other observations or actions."""
        own, seen = self.game.spec, self.game.representation
        for place, scenario in self.evaluated_scenarios().items():
            other = GAMES[self.game.name].make_spec(scenario)
            shapes = own.representations[seen].shape, other.representations[seen].shape
            if shapes[0] != shapes[1] or own.action_names != other.action_names:
                raise ValueError(
                    f"{place} shows {list(shapes[1])} and has "
                    f"{other.num_actions} actions, training shows {list(shapes[0])} and has "
                    f"{own.num_actions}: the learner can only be rated where they are the same"
                )
