"""Settings of a training run: frozen dataclasses grouped by noun.

Units stand in the names. A frame is one decision of one world.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from marl_cair.games import GAMES
from marl_cair.generative import GENERATORS
from marl_cair.generative.settings import GeneratorConfig
from marl_cair.lookup import check_name, find_by_name
from marl_cair.policies.config import QNetworkConfig
from marl_cair.replay import MAX_FRACTION
from marl_cair.self_play.samplers import SAMPLERS
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.learner import LearnerSettings, interpolate
from marl_cair.training.settings.nfsp import NfspSettings

# Half its newest self, half what it must not forget, after AlphaStar and OpenAI Five. That it is
# the best is not shown: `python -m benchmarks.opponents` compares.
SELF_PLAY = {"latest": 0.5, "pfsp": 0.35, "uniform": 0.1, "bots": 0.05}
# What runs from before samplers called them.
RENAMED_OPPONENTS = {"pool": "uniform", "scripted": "bots"}
RENAMED_OPTIONS = {"pool_recency": "recency"}
NO_GENERATOR = "none"
MOST_THREADS = 1024  # each takes memory of its own
ENDLESS_FRAMES = 10**9  # as total_frames: the clock ends the run


@dataclass(frozen=True)
class GameSettings:
    """Which game is learned, on which scenario, seen how."""

    name: str = "deep_line_wars"  # which game is learned
    scenario: str = "10x15"  # board and rules
    representation: str = "planes"  # what the learner looks at
    reward: str | None = None  # training reward; None: "shaped" where there is one, else the rated
    options: dict[str, Any] = field(default_factory=dict)  # fields of the scenario to change

    def __post_init__(self) -> None:
        game = GAMES[self.name]
        scenario = game.scenario(self.scenario, **self.options)
        spec = game.make_spec(scenario)
        if spec.action_shape:
            raise ValueError(
                f"game.options.actions is {scenario.actions!r}, with an action at each place of "
                f"{list(spec.action_shape)}, but a Q-network chooses one action in each decision: "
                f"set it to {type(scenario).actions!r}, or train on the environments of "
                f"{self.name} with a method for such actions"
            )
        find_by_name(f"{self.name} representation", self.representation, spec.representations)
        game.scenario(self.scenario, reward=self.learned_reward)
        for name, owner in (("reward", "game.reward"), ("shaping_discount", "learner.gamma")):
            require(
                name not in self.options,
                f"game.options.{name}",
                self.options.get(name),
                f"left out: set {owner}",
            )

    @property
    def learned_reward(self) -> str:
        """What the learner is paid by; evaluations always use the game's rated reward."""
        game = GAMES[self.name]
        return self.reward or ("shaped" if "shaped" in game.rewards else game.rated_reward)

    @property
    def rated_scenario(self) -> Any:
        """The scenario as agents are rated on it, with the game's rated reward."""
        game = GAMES[self.name]
        return game.scenario(self.scenario, **{**self.options, "reward": game.rated_reward})


@dataclass(frozen=True)
class OpponentSettings:
    """Who plays the other teams, where there are any; each rival team draws its own.

    Names in a mixture are bots, `agents`, or samplers (`self_play.samplers`): `latest` (the
    newest self; it learns from those seats too), `bots` (all, evenly), `pfsp_bots` (all, those that
    are not beaten yet more often), and of the pool, which is snapshots and `agents`, `uniform`,
    `delta_uniform`, `recent`, `pfsp`, `pfsp_variance`, `pfsp_easy` and `nash`. Values are weights.
    """

    mixture: dict[str, float] = field(  # weights by name of who is met
        default_factory=lambda: dict(SELF_PLAY)
    )
    warmup_frames: int = 0  # frames until `mixture` takes the place of `warmup_mixture`
    warmup_mixture: dict[str, float] = field(  # weights by name of who is met first
        default_factory=lambda: {"random": 1.0}
    )
    agents: dict[str, str] = (
        field(  # others by name: a checkpoint's folder, a mixture's, or package.module:function
            default_factory=dict
        )
    )
    snapshot_every_frames: int = 100_000  # frames between two snapshots for the pool
    snapshot_margin: float | None = (
        0.1  # one more where the best is surely beaten by it; None: never
    )
    pool_capacity: int = 32  # snapshots kept for play, spread over the run; Nash's support stays
    pool_active: int = 4  # draws from the snapshots that play at one time
    redraw_every_frames: int = 10_000  # frames after which those are drawn anew
    delta: float = 0.5  # share of the pool, the oldest, that `delta_uniform` leaves out
    recency: float = 3.0  # of `recent`: weight exp(-recency * age), age 0..1
    pfsp_power: float = 2.0  # of `pfsp` and `pfsp_bots`, (1 - win rate) ** power, and `pfsp_easy`
    half_life_frames: int = 100_000  # frames after which a game counts half in a win rate
    prior_games: float = 2.0  # even games that every win rate starts from

    def __post_init__(self) -> None:
        for name, mixture in (("mixture", self.mixture), ("warmup_mixture", self.warmup_mixture)):
            require(len(mixture) > 0, f"opponent.{name}", mixture, "one or more weights by name")
            for opponent, weight in mixture.items():
                require(0 <= weight < math.inf, f"opponent.{name}.{opponent}", weight, "0 or more")
            require(sum(mixture.values()) > 0, f"opponent.{name}", mixture, "above 0 in sum")
        for name in ("warmup_frames", "recency", "pfsp_power"):
            require(getattr(self, name) >= 0, f"opponent.{name}", getattr(self, name), "0 or more")
        for name in ("snapshot_every_frames", "pool_capacity", "pool_active"):
            require(getattr(self, name) >= 1, f"opponent.{name}", getattr(self, name), "1 or more")
        for name in ("redraw_every_frames", "half_life_frames"):
            require(getattr(self, name) >= 1, f"opponent.{name}", getattr(self, name), "1 or more")
        require(self.prior_games > 0, "opponent.prior_games", self.prior_games, "above 0")
        require(0 <= self.delta < 1, "opponent.delta", self.delta, "0 or more, below 1")
        margin = self.snapshot_margin
        allowed = "0 or more, below 0.5, or null"
        require(margin is None or 0 <= margin < 0.5, "opponent.snapshot_margin", margin, allowed)
        for name in self.agents:
            plain = re.fullmatch(r"\w+", name) is not None and name not in SAMPLERS
            allowed = f"names of letters, digits and _, none of {', '.join(SAMPLERS)}"
            require(plain, "opponent.agents", name, allowed)

    def find_names(self) -> set[str]:
        """Names that have a weight above 0 at any time."""
        first = self.warmup_mixture if self.warmup_frames else {}
        return {name for name, weight in [*self.mixture.items(), *first.items()] if weight > 0}

    def check_names(self, bots: Mapping[str, Any]) -> None:
        """Raise ValueError where a mixture names nobody, or an agent is called as a bot."""
        for name in self.agents:
            allowed = f"another name than the game's bots have: {', '.join(bots)}"
            require(name not in bots, "opponent.agents", name, allowed)
        for place, mixture in (
            ("mixture", self.mixture),
            ("warmup_mixture", self.warmup_mixture),
        ):
            for name in mixture:
                renamed = RENAMED_OPPONENTS.get(name)
                allowed = f"called {renamed!r} now"
                require(renamed is None, f"opponent.{place}", name, allowed)
                find_by_name("opponent", name, {**bots, **self.agents, **SAMPLERS})


@dataclass(frozen=True)
class DemonstrationSettings:
    """Games in which a bot, or another agent, plays the learner's seats, and the learner learns
    from what it does: deep Q-learning from demonstrations (Hester et al. 2018). With `advise` they
    also say what they would do where the learner plays itself (DAgger, Ross et al. 2011).
    """

    bots: tuple[str, ...] = ()  # who shows how to play, one for each such game; (): nobody
    agents: dict[str, str] = field(  # others who do, by name: a checkpoint's folder or a function
        default_factory=dict
    )
    share: float = 0.25  # of games
    until_frames: int | None = None  # frames after which they neither play nor advise; None: never
    advise: bool = False  # they also tell what they would do wherever the learner plays
    turn_decisions: int | None = None  # after so many it is drawn anew who plays; None: whole games
    margin: float = 0.1  # by which the shown action is to be worth more than any other legal one
    margin_weight: float = 1.0  # of that loss, beside the TD error's

    def __post_init__(self) -> None:
        require(0 <= self.share <= 1, "demonstration.share", self.share, "a share in 0..1")
        frames = self.until_frames
        require(frames is None or frames >= 0, "demonstration.until_frames", frames, "0 or more")
        turn = self.turn_decisions
        require(turn is None or turn >= 1, "demonstration.turn_decisions", turn, "1 or more")
        require(
            not self.advise or self.is_given,
            "demonstration.advise",
            self.advise,
            "false where demonstration.bots and demonstration.agents are empty",
        )
        for name in ("margin", "margin_weight"):
            value = getattr(self, name)
            require(0 <= value < math.inf, f"demonstration.{name}", value, "0 or more")

    @property
    def is_given(self) -> bool:
        """Whether anybody shows anything."""
        return bool(self.bots or self.agents)


@dataclass(frozen=True)
class CollectorSettings:
    """How experience is gathered."""

    num_worlds: int = 128  # games at one time
    steps_per_batch: int = 16  # decisions of each world between two rounds of learning
    num_threads: int = 1  # CPU threads of the engine

    def __post_init__(self) -> None:
        for name in ("num_worlds", "steps_per_batch", "num_threads"):
            require(getattr(self, name) >= 1, f"collector.{name}", getattr(self, name), "1 or more")
        threads, allowed = self.num_threads, f"1..{MOST_THREADS}"
        require(threads <= MOST_THREADS, "collector.num_threads", threads, allowed)


@dataclass(frozen=True)
class ExplorationSettings:
    """Epsilon-greedy: uniform over the legal kinds of action, then over those of the kind."""

    epsilon_start: float = 1.0  # chance of exploring at frame 0
    epsilon_end: float = 0.02  # chance of exploring from `anneal_frames` on
    anneal_frames: int = 60_000  # frames from start to end, in a straight line

    def __post_init__(self) -> None:
        for name in ("epsilon_start", "epsilon_end"):
            value = getattr(self, name)
            require(0 <= value <= 1, f"exploration.{name}", value, "a probability in 0..1")
        require(self.anneal_frames >= 1, "exploration.anneal_frames", self.anneal_frames, ">= 1")

    def epsilon_at(self, frames: int) -> float:
        """Linear from start to end over `anneal_frames`."""
        return interpolate(self.epsilon_start, self.epsilon_end, frames / self.anneal_frames)


@dataclass(frozen=True)
class ReplaySettings:
    """Memory of real transitions."""

    capacity_transitions: int = 200_000  # the newest real transitions are kept
    generated_capacity_transitions: int = 20_000  # the newest generated ones
    min_transitions: int = 5_000  # transitions; learning starts with these
    scratch_dir: str | None = None  # observations on disk in this folder; None: in memory
    priority_alpha: float = 0.0  # how far TD errors decide which ones are drawn; 0: all are alike
    priority_beta: float = 0.4  # how far weights undo that to begin with; wholly at total_frames

    def __post_init__(self) -> None:
        for name in ("priority_alpha", "priority_beta"):
            value = getattr(self, name)
            require(0.0 <= value <= 1.0, f"replay.{name}", value, "0..1")
        low = self.min_transitions
        require(low >= 1, "replay.min_transitions", low, "1 or more")
        capacity = self.capacity_transitions
        require(capacity >= low, "replay.capacity_transitions", capacity, f"{low} or more")
        generated = self.generated_capacity_transitions
        require(generated >= 1, "replay.generated_capacity_transitions", generated, "1 or more")


@dataclass(frozen=True)
class GeneratorSettings:
    """When the generator of artificial transitions learns, is measured and generates."""

    name: str = "ccdn"  # "none": all transitions are real
    batch_size: int = 64  # real transitions of its own update
    frames_per_update: int = 64  # frames collected for each of its updates while the gate is shut
    open_frames_per_update: int = 256  # the same while it is open: what it knows it keeps with less
    evaluate_every_frames: int = 25_000  # frames between two looks at the gate
    # At these numbers a generated row is learned from as often as a real one: a fifth of each
    # batch, out of a fifth of all rows that come in.
    refill_every_frames: int = 4_000  # frames between two refills while the gate is open
    rows_per_refill: int = 1_000  # transitions
    rollout_steps: int = 1  # decisions at a generated row's end that are made up, n_steps at most
    model: GeneratorConfig = field(default_factory=GeneratorConfig)

    def __post_init__(self) -> None:
        check_name("generator", self.name, (NO_GENERATOR, *GENERATORS))
        for name in (
            "batch_size",
            "frames_per_update",
            "open_frames_per_update",
            "evaluate_every_frames",
            "refill_every_frames",
            "rows_per_refill",
            "rollout_steps",
        ):
            require(getattr(self, name) >= 1, f"generator.{name}", getattr(self, name), "1 or more")


@dataclass(frozen=True)
class EvaluationSettings:
    """Greedy games with the rated reward, while training: against bots, or alone where nobody else
    plays.
    """

    every_frames: int = 100_000  # frames between two evaluations
    games: int = 64  # games against each bot, rounded up to as many in each seat (or team)
    bots: tuple[str, ...] = ("random",)  # opponents; where one plays alone, who it is compared with
    options: dict[str, Any] = field(  # fields of the scenario to change: {max_ticks: 6000}
        default_factory=dict
    )
    scenarios: dict[str, dict[str, Any]] = field(  # played too: {heldout: {map: test-15x15-2p}}
        default_factory=dict
    )

    def __post_init__(self) -> None:
        require(self.every_frames >= 1, "evaluation.every_frames", self.every_frames, "1 or more")
        require(self.games >= 1, "evaluation.games", self.games, "1 or more")
        for name in self.scenarios:
            plain = re.fullmatch(r"[\w-]+", name) is not None
            require(plain, "evaluation.scenarios", name, "names of letters, digits, _ and -")
        for place, options in self.changes().items():
            require("reward" not in options, place, options, "without reward: the game's own rates")

    def changes(self) -> dict[str, dict[str, Any]]:
        """What is changed of the training scenario, by option: the scenario that chooses the best
        agent is the first, then those that are held out.
        """
        heldout = {f"evaluation.scenarios.{name}": self.scenarios[name] for name in self.scenarios}
        return {"evaluation.options": self.options} | heldout


@dataclass(frozen=True)
class CheckpointSettings:
    """What is kept on disk. `<out>/latest` is the agent at the last evaluation or state."""

    every_frames: int = 200_000  # frames between two resumable states
    include_replay: bool = True  # else a resumed run begins with an empty replay

    def __post_init__(self) -> None:
        require(self.every_frames >= 1, "checkpoint.every_frames", self.every_frames, "1 or more")


@dataclass(frozen=True)
class TrainConfig:
    """A whole run."""

    out: str = "runs/train"  # output folder
    seed: int = 0  # of everything random in the run
    total_frames: int = 500_000  # decisions of one world; the run ends there
    max_minutes: float | None = None  # of this sitting; None: no limit
    stop_score: float | None = None  # ends the run when evaluations reach it; None: never
    synthetic_fraction: float = 0.2  # generated share of each batch, 0..0.9
    initial_agent: str | None = None  # folder of one whose network begins; None: a new one
    initial_generator: str | None = None  # folder of a run whose generator begins; None: a new one
    torch_threads: int | None = None  # None: as torch chooses; fixed numbers give equal bits
    game: GameSettings = field(default_factory=GameSettings)
    policy: QNetworkConfig = field(default_factory=QNetworkConfig)
    opponent: OpponentSettings = field(default_factory=OpponentSettings)
    demonstration: DemonstrationSettings = field(default_factory=DemonstrationSettings)
    collector: CollectorSettings = field(default_factory=CollectorSettings)
    exploration: ExplorationSettings = field(default_factory=ExplorationSettings)
    replay: ReplaySettings = field(default_factory=ReplaySettings)
    learner: LearnerSettings = field(default_factory=LearnerSettings)
    nfsp: NfspSettings = field(default_factory=NfspSettings)
    generator: GeneratorSettings = field(default_factory=GeneratorSettings)
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)
    checkpoint: CheckpointSettings = field(default_factory=CheckpointSettings)

    def __post_init__(self) -> None:
        fraction = self.synthetic_fraction
        require(0 <= fraction <= MAX_FRACTION, "synthetic_fraction", fraction, f"0..{MAX_FRACTION}")
        require(self.total_frames >= 1, "total_frames", self.total_frames, "1 or more")
        require(0 <= self.seed < 2**63, "seed", self.seed, "0 or more")
        threads = self.torch_threads
        allowed = f"1..{MOST_THREADS}"
        require(threads is None or 1 <= threads <= MOST_THREADS, "torch_threads", threads, allowed)
        minutes = self.max_minutes
        require(minutes is None or minutes > 0, "max_minutes", minutes, "above 0")
        score = self.stop_score
        require(score is None or math.isfinite(score), "stop_score", score, "a number or null")
        self._check_scenarios()
        bots = GAMES[self.game.name].bots
        self.opponent.check_names(bots)
        for bot in (*self.evaluation.bots, *self.demonstration.bots):
            find_by_name(f"{self.game.name} bot", bot, bots)

    def evaluated_scenarios(self) -> dict[str, Any]:
        """Where the learner is rated, as `EvaluationSettings.changes` has it."""
        game, make = self.game, GAMES[self.game.name].scenario
        return {
            place: make(game.scenario, **{**game.options, **changes})
            for place, changes in self.evaluation.changes().items()
        }

    def _check_scenarios(self) -> None:
        """Whether the learner can look at, and act in, what it is to be rated on."""
        game = GAMES[self.game.name]
        own = game.make_spec(game.scenario(self.game.scenario, **self.game.options))
        seen = self.game.representation
        for place, scenario in self.evaluated_scenarios().items():
            other = game.make_spec(scenario)
            shapes = own.representations[seen].shape, other.representations[seen].shape
            if shapes[0] != shapes[1] or own.action_names != other.action_names:
                raise ValueError(
                    f"{place} shows {list(shapes[1])} and has "
                    f"{other.num_actions} actions, training shows {list(shapes[0])} and has "
                    f"{own.num_actions}: the learner can only be rated where they are the same"
                )
