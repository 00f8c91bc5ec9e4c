"""Builds a training run from its configuration, and saves and restores its state."""

from __future__ import annotations

import dataclasses
import math
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torchrl.collectors import Collector

from marl_cair import checkpoint, files
from marl_cair.checkpoint import AgentDescription, CheckpointError
from marl_cair.games import GAMES
from marl_cair.games.torchrl_env import BatchedGameEnv
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.arena import Load
from marl_cair.policies import GREEDY, SAMPLED
from marl_cair.policies.actor import MaskedEpsilonGreedy, MaskedSampling, PolicyActor
from marl_cair.policies.q_network import QNetwork, make_q_network
from marl_cair.ranges import COUNT, FLAG, WEIGHT, Range, read_number, read_numbers
from marl_cair.replay.reservoir import Reservoir
from marl_cair.self_play.pool import Pool
from marl_cair.self_play.shared_folder import LeagueSeat
from marl_cair.stored import DamagedFileError, read_json
from marl_cair.training import memory, state_file
from marl_cair.training.collecting.average_policy import AveragePolicy, OwnPolicies
from marl_cair.training.collecting.demonstrations import Demonstrators
from marl_cair.training.collecting.exploration import make_exploration
from marl_cair.training.collecting.filling import fill_from_dataset
from marl_cair.training.collecting.metrics import EpisodeStatistics, RunningMeans
from marl_cair.training.collecting.opponents import OpponentBook
from marl_cair.training.collecting.recorded import fill_from_replays
from marl_cair.training.collecting.seats import SeatRouter
from marl_cair.training.collecting.stagger import stagger_starts
from marl_cair.training.generating import generators
from marl_cair.training.initial_network import (
    count_training,
    describe_rows,
    fit_policy,
    make_initial_network,
    make_replay,
)
from marl_cair.training.learner import Learner
from marl_cair.training.outside_trials import try_parts
from marl_cair.training.run_log import RunLog
from marl_cair.training.settings import config_file
from marl_cair.training.settings.checks import find_device
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.learner import AVERAGE

BEST_FOLDER = "best"
RESUME_FOLDER, BEST_SCORE_FILE = "resume", "best_score.json"
REPLAY_FOLDER, RESERVOIR_FOLDER = "replay", "reservoir"
_SCORES = Range(-math.inf, math.inf, float)  # -inf before the first
_NUM_SEEDS = 18


class TrainingRun:
    """Environment, collector, replay, generator, learner and log of one run.

    Args:
        config: all settings.
        resume: resume from the state in `config.out`; begin if there is none.
        seat: the learner's place in a league.
        load: how to get the agents of `config.opponent`, as `load_agent`.

    Raises:
        OutputFolderError: the folder holds another run, or this one without `resume`.
        NotEnoughSpaceError: the disk cannot hold the run's state.
        CheckpointError: the state to resume from cannot be read.
        ValueError: the generator cannot work on the representation.
        DeviceError: this machine does not have `config.device`.
    """

    def __init__(
        self,
        config: TrainConfig,
        resume: bool = False,
        seat: LeagueSeat | None = None,
        load: Load = load_agent,
    ) -> None:
        self.device = find_device(config.device)
        config.check_algorithm()
        self.config, self.seat = config, seat
        self.folder = Path(config.out)
        self._resumes = resume and files.find_folder(self.folder / RESUME_FOLDER).is_dir()
        memory.keep_freed_memory()
        self._claim = ExitStack()
        words = np.random.SeedSequence(config.seed).generate_state(_NUM_SEEDS)
        self._seeds: list[int] = words.tolist()
        torch.default_generator.manual_seed(self._seeds[17])  # code from outside may draw from it
        if resume and (self.folder / files.RUN_MARKER).is_file():
            with self._claim_folder(resume):
                pass  # other settings are refused before their agents are loaded
        self._make_game(load)
        self._make_replay()
        self._make_learner()
        self._make_collector()
        # The settings are valid from here on.
        real, rows = self.replay.real, self.transition_spec
        state_file.require_space(self.folder, config, real, rows, self._resumes)
        self._claim.enter_context(self._claim_folder(resume))
        try:
            self._begin(resume)
        except BaseException:
            self._claim.close()
            raise

    def _begin(self, resume: bool) -> None:
        """Start, or resume from the last saved state."""
        config_file.save_config(self.config)
        self.frames, self.processor_seconds = 0, 0.0  # of collecting and learning, in all sittings
        self.saved_frames: int | None = None  # of the last saved state
        self.best_score = self.confirmed_score = -math.inf  # the second: of a repeated evaluation
        self.gate_is_open, self.generator_is_on, self.generator_failures = False, True, 0
        files.recover_folder(self.folder / RESUME_FOLDER)
        # Checked again: another process may have saved its first state here since.
        if resume and (self.folder / RESUME_FOLDER).is_dir():
            self.restore()
        self.book.join_league()
        self.log = RunLog(self.folder, self.frames)

    @property
    def evaluation_seed(self) -> int:
        """Seed of the games that rate the learner while it trains."""
        return self._seeds[8]

    @property
    def is_offline(self) -> bool:
        """Whether the run learns from a data set, without playing."""
        return self.config.offline.dataset is not None

    @property
    def may_use_generated(self) -> bool:
        """Whether batches may hold generated rows."""
        return self.gate_is_open and self.frames >= self.config.generator.warmup_frames

    def _make_game(self, load: Load) -> None:
        game, opponent = self.config.game, self.config.opponent
        worlds, folder = self.config.collector.num_worlds, self.folder / checkpoint.SNAPSHOT_FOLDER
        self.game, self.scenario = GAMES[game.name], game.played_scenario
        for rated in self.config.evaluated_scenarios().values():
            for bot in self.config.evaluation.bots:
                self.game.bot(bot, rated)  # raises now for one that cannot play there
        played, demonstration = (self.game, self.scenario), self.config.demonstration
        self.demonstrators = Demonstrators(demonstration, *played, worlds, self._seeds[9])
        kept = opponent.pool_capacity, opponent.prior_games
        pool = Pool(folder, *played, game.representation, *kept, self.seat, self.device)
        self.book = OpponentBook(opponent, *played, pool, self._seeds[6], self.seat, load)
        others = self.demonstrators.representations | self.book.representations
        memory.require_memory_of_games(self.config, *played)
        self.env = BatchedGameEnv(
            game.name,
            game.scenario,
            worlds,
            representation=game.representation,
            extra_representations=tuple(sorted(others - {game.representation})),
            num_threads=self.config.collector.num_threads,
            seed=self._seeds[0],
            **config_file.learned_fields(self.config),
        )
        self.spec = self.env.engine.spec
        self.seen = self.env.engine.representation(game.representation)
        latest, source = str(self.folder / checkpoint.LATEST_FOLDER), self.config.initial_agent
        source = latest if source and self._resumes else source  # the first may be elsewhere now
        self.policy = fit_policy(self.config.policy, self.seen, self.spec, source=source)

    def _make_replay(self) -> None:
        config, seen, engine = self.config, self.seen, self.env.engine
        self.transition_spec = spec = describe_rows(config, self.policy, seen, self.spec)
        memory.require_memory_of_learning(config, self.policy, seen, spec)
        self.replay = make_replay(config, spec, self._seeds[1:3])
        storage = self.replay.real.storage
        saved = files.find_folder(self.folder / RESUME_FOLDER)
        is_kept = self._resumes and (saved / REPLAY_FOLDER).is_dir()
        if config.demonstration.replays is not None and not is_kept:
            shown, scale = config.demonstration, config.learner.reward_scale
            fill_from_replays(storage, shown, engine, seen.name, scale)
        if self.is_offline and not is_kept:
            fill_from_dataset(storage, config, engine)
        self.make_generator(None if self._resumes else config.initial_generator)

    def make_generator(self, source: str | None = None) -> None:
        """Make the generator, if there is one; it begins with the weights of the run `source`."""
        make = generators.make_generator
        self.generator = make(self.config, self.seen, self.spec, self._seeds[3], source)
        generators.move_generator(self.generator, self.device)

    def _claim_folder(self, resume: bool) -> AbstractContextManager[bool]:
        advice = f"resume it with `{config_file.resume_command(self.config)}`"
        fixed, source = config_file.fixed_settings(self.config), config_file.CONFIG_FILE
        kind = checkpoint.TRAINING
        return files.claim_output_folder(self.folder, kind, fixed, resume, advice, source)

    def _make_learner(self) -> None:
        config, seeds = self.config, self._seeds
        seen, shape, num_actions = self.seen.name, self.seen.shape, self.spec.num_actions
        source = None if self._resumes else config.initial_agent
        self._trained_before = count_training(source)  # frames and updates
        wanted = (self.game.name, seen, shape, num_actions)
        network = make_initial_network(source, self.policy, wanted, seed=seeds[4])
        acts = self.spec.action_groups, self.spec.action_shape
        exploration = make_exploration(config.exploration, *acts)
        try_parts(config, network, self.seen, self.spec, self.transition_spec)
        network = network.to(self.device)
        self.learner = Learner(network, config.learner, config.demonstration, seeds[16])
        random = MaskedEpsilonGreedy(seeds[5])  # its generator is that of the exploration
        self.actor = PolicyActor(self.learner.behaviour, "learner", seen, random)
        self.newest = PolicyActor(self.learner.newest, "newest", seen)
        self.rated = PolicyActor(self.learner.average, "learner", seen)
        self.own, self.average_policy = OwnPolicies(self.actor, exploration), None
        if config.nfsp.enabled:
            network = make_q_network(self.policy, shape, num_actions, seeds[10]).to(self.device)
            rows = Reservoir(self.transition_spec, config.nfsp.capacity_rows, seeds[11])
            self.average_policy = AveragePolicy(network, config.nfsp, rows)
            if config.nfsp.played == AVERAGE:
                self.rated = PolicyActor(network, "learner", seen, MaskedSampling(seeds[12]))
            sampling = MaskedSampling(seeds[13], self.spec.action_groups)
            average = PolicyActor(network, "average", seen, sampling)
            self.own = self.own._replace(average=average, eta=config.nfsp.eta)
        learner, worlds = config.learner, config.collector.num_worlds
        self.shuffling = torch.Generator().manual_seed(seeds[14])  # of steps, without replay
        self.statistics = EpisodeStatistics(worlds, self.spec, learner.gamma, learner.reward_scale)
        self.means = RunningMeans()

    def _make_collector(self) -> None:
        config = self.config
        self.router = SeatRouter(
            self.env,
            self.own,
            self.book,
            self.demonstrators,
            self.statistics,
            self._seeds[7],
            notes_best=not self.learner.loss.LEARNS_FROM_REPLAY,
        )
        untouched = self.router.export_state(), self.book.state_dict()
        self.collector = Collector(
            self.env,
            self.router,
            frames_per_batch=config.collector.num_worlds * config.collector.steps_per_batch,
            total_frames=-1,
            track_traj_ids=False,
            auto_register_policy_transforms=False,  # SeatRouter finds new games by itself
        )
        # The collector calls its policy once when it is made: those draws must not count.
        self.router.import_state(untouched[0])
        self.book.load_state_dict(untouched[1])
        if config.collector.stagger_steps and not (self._resumes or self.is_offline):
            stagger_starts(self.env, config.collector.stagger_steps, self._seeds[15])
            self.collector._carrier.update(self.env.current())

    def describe_agent(self) -> AgentDescription:
        """The learner as it is now, for a checkpoint."""
        game = self.config.game
        return AgentDescription(
            name=f"{self.folder.name}",
            game=self.game.name,
            game_version=self.game.version,
            scenario=game.scenario,
            scenario_options=dataclasses.asdict(self.scenario) | {"reward": game.learned_reward},
            representation=self.seen.name,
            observation_shape=self.seen.shape,
            action_names=self.spec.action_names,
            network=self.policy.to_dict(),
            frames=self.frames,
            updates=self.learner.updates,
            seed=self.config.seed,
            plays=SAMPLED if self.rated.is_sampled else GREEDY,
            frames_total=self._trained_before[0] + self.frames,
            updates_total=self._trained_before[1] + self.learner.updates,
        )

    @property
    def rated_network(self) -> QNetwork:
        """The network that is rated, kept and frozen: averaged weights, or the average policy."""
        return self.rated.network

    def save_agent(self, folder: str = checkpoint.LATEST_FOLDER) -> None:
        """Write the agent as it is now to `<out>/<folder>`."""
        checkpoint.save_agent(self.folder / folder, self.rated_network, self.describe_agent())

    def note_score(self, score: float) -> None:
        """Keep the agent in `<out>/best` if its score is not below the best so far."""
        if score >= self.best_score:
            self.best_score = score
            self.save_agent(BEST_FOLDER)
            files.write_json(self.folder / BEST_SCORE_FILE, {"score": score})

    def add_snapshot(self) -> None:
        """Freeze the learner for the pool, as an agent on disk."""
        about = dataclasses.replace(self.describe_agent(), name=f"{self.folder.name}@{self.frames}")
        self.book.add_snapshot(self.rated_network, about)

    def save_state(self) -> None:
        """Write the complete state to `<out>/resume`, whole or not at all.

        The generator's weights are written to the run's folder too, for other runs.
        """
        state = {
            "frames": self.frames,
            "processor_seconds": self.processor_seconds,
            "trained_before": self._trained_before,
            "best_score": self.best_score,
            "confirmed_score": self.confirmed_score,
            "gate_is_open": self.gate_is_open,
            "generator_is_on": self.generator_is_on,
            "generator_failures": self.generator_failures,
            "learner": self.learner.state_dict(),
            "book": self.book.state_dict(),
            "router": self.router.export_state(),
            "statistics": self.statistics.export_state(),
            "means": self.means.export_state(),
            "env": state_file.to_tensors(self.env.game_state()),
            "torch_rng": torch.get_rng_state(),
            "shuffling": self.shuffling.get_state(),
        }
        if self.average_policy:
            state["average_policy"] = self.average_policy.state_dict()
            state["rated"] = self.rated.state_dict()
        with files.replaced_folder(self.folder / RESUME_FOLDER) as fresh:
            if self.generator:
                fields = config_file.learned_fields(self.config)
                made_for = generators.describe_task(self.game, fields, self.spec)
                state["generator"] = generators.save_generator(self.generator, fresh, made_for)
            state_file.save_state(state, fresh)
            if self.config.checkpoint.include_replay:
                self.replay.save(fresh / REPLAY_FOLDER)
            if self.average_policy:  # a sample of the whole run: it cannot be collected again
                self.average_policy.reservoir.save(fresh / RESERVOIR_FOLDER)
        self.saved_frames = self.frames
        if self.generator:
            generators.publish_generator(self.folder / RESUME_FOLDER, self.folder)

    def restore(self) -> None:
        """Continue from `save_state`.

        Raises:
            CheckpointError: the state cannot be read, or is of other settings or another version.
        """
        folder = self.folder / RESUME_FOLDER
        state = state_file.load_state(folder)
        try:
            self._import_state(state, folder)
        except DamagedFileError as error:  # it names the file
            raise CheckpointError(f"{error}") from error
        except Exception as error:  # a damaged state can raise anything
            raise CheckpointError(
                f"{folder} does not fit this run's settings, or is damaged: {error!r}"
            ) from error

    def _import_state(self, state: Any, folder: Path) -> None:
        self.frames = read_number(state, "frames", COUNT)
        self.processor_seconds = read_number(state, "processor_seconds", WEIGHT)
        self.best_score = read_number(state, "best_score", _SCORES)
        if "confirmed_score" in state:  # not in states from before it was saved
            self.confirmed_score = read_number(state, "confirmed_score", _SCORES)
        frames, updates = read_numbers(state["trained_before"], "trained_before", COUNT)
        self._trained_before = frames, updates
        # An agent that is better than any before the state was saved is on disk all the same.
        kept = self.folder / BEST_SCORE_FILE
        if kept.is_file():
            best = read_number(read_json(kept), "score", _SCORES)
            self.best_score = max(self.best_score, float(best))
        self.gate_is_open = read_number(state, "gate_is_open", FLAG)
        self.generator_is_on = read_number(state, "generator_is_on", FLAG)
        self.generator_failures = read_number(state, "generator_failures", COUNT)
        self.learner.load_state_dict(state["learner"])
        self.book.load_state_dict(state["book"])
        self.router.import_state(state["router"])
        if self.game.has_snapshots:  # the running games, else given up
            self.statistics.import_state(state["statistics"])
        self.means.import_state(state["means"])
        self.env.load_game_state(state_file.to_arrays(state["env"]))
        if self.generator:
            generators.restore_generator(self.generator, folder, state["generator"])
        if (folder / REPLAY_FOLDER).is_dir():
            self.replay.load(folder / REPLAY_FOLDER)
            if not self.game.has_snapshots:
                self.replay.real.storage.forget_streams()
        self.replay.generated_open = self.may_use_generated
        if self.average_policy:
            self.average_policy.load_state_dict(state["average_policy"])
            self.average_policy.reservoir.load(folder / RESERVOIR_FOLDER)
            self.rated.load_state_dict(state["rated"])
        # TorchRL's collector does not save the running games: it would start new ones.
        self.collector._carrier.update(self.env.current())
        torch.set_rng_state(state["torch_rng"])
        self.shuffling.set_state(state["shuffling"])
        self.saved_frames = self.frames

    def close(self) -> None:
        """Shut the collector and the log, and release the folder."""
        self.collector.shutdown()
        self.log.close()
        self._claim.close()
