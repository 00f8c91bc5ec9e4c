"""Opponents of a training run: draws one for each game, and records the win rates."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.checkpoint import LIVE_FOLDER, AgentDescription, save_agent
from marl_cair.games.game import Agent, Game
from marl_cair.games.players.weak_bot import list_strengths, split_name
from marl_cair.league.agents.load import load_agent
from marl_cair.league.agents.mixtures import is_mixture, read_mixture
from marl_cair.league.play.arena import Load
from marl_cair.policies.q_network import QNetwork
from marl_cair.ranges import COUNT, FLAG, MOST, WEIGHT, Range, read_number, read_numbers
from marl_cair.replay.transition import NO_OPPONENT
from marl_cair.self_play import samplers
from marl_cair.self_play.live_rating import LiveRating
from marl_cair.self_play.pool import BOT, FOREIGN, LIVE, SNAPSHOT, Member, Pool
from marl_cair.self_play.samplers import BOTS, CURRICULUM, LATEST_ID, PFSP_BOTS, SamplerOptions
from marl_cair.self_play.shared_folder import LEAGUE_EXPLOITER, MAIN, MAIN_EXPLOITER, LeagueSeat
from marl_cair.self_play.win_rates import EVEN, OPPONENT, BettingTest, WinRecords
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.config import WARMUP_MIXTURE, OpponentSettings

SNAPSHOTS = "pool"  # the name of all snapshots together in the log
_SOONEST_SNAPSHOT = 0.25  # of snapshot_every_frames, after which a win rate may earn a snapshot
SNAPSHOT_ERROR = 0.025  # chance of an early snapshot of a learner that is not better by the margin


class Meeting(NamedTuple):
    """The result of the learner's team against one opponent's in a finished game."""

    opponent: int
    score: float  # 1 if the learner's team is ahead of that one, 0 behind, 1/2 level
    points: float  # of the learner's team in the whole game
    game: int  # numbers rise from game to game of a world, and differ between worlds


class OpponentBook:
    """All opponents of a run by number, the learner's win rates against them, and the draws.

    `latest`, bots and foreign agents are drawn game by game. Of the snapshots a line-up plays for
    a while (`pool_active` draws, as each forward pass costs the same for any number of games),
    drawn again every `redraw_every_frames` and with each snapshot, when the win rates are read too.

    In scenarios of one team there are no opponents: every draw is NO_OPPONENT.

    Args:
        settings: mixture, samplers and pool.
        game, scenario: that are played.
        pool: without bots and agents yet.
        seed: of the draws, the bots and the foreign agents.
        seat: the learner's place in a league; its opponents are then the league's too.
        load: how to get the agents of `settings`, as `load_agent`.

    Raises ValueError for samplers of a league without `seat`, and as bots, agents and `Pool` do.
    """

    def __init__(
        self,
        settings: OpponentSettings,
        game: Game,
        scenario: Any,
        pool: Pool,
        seed: int,
        seat: LeagueSeat | None = None,
        load: Load = load_agent,
    ) -> None:
        self.settings = settings = expand_mixtures(settings)
        self.seat, self._seed = seat, seed
        for name in settings.find_names() if seat is None else ():
            allowed = "another sampler outside a league (`marl-cair league train`)"
            require(name not in samplers.LEAGUE_SAMPLERS, "opponent.mixture", name, allowed)
        self.is_over = False  # in a league: a player was frozen, and the learner is reset
        self.is_alone = game.make_spec(scenario).num_teams == 1
        self.live_rating = LiveRating()
        self.records = WinRecords(settings.half_life_frames, settings.prior_games)
        # Of the newest policy alone, nearly: older games are those of other policies.
        self._since_snapshot = WinRecords(settings.half_life_frames, settings.prior_games)
        bar = EVEN + (settings.snapshot_margin or 0.0)
        self._bets = BettingTest(bar, SNAPSHOT_ERROR)
        self.pool = pool
        self._options = SamplerOptions(settings.delta, settings.recency, settings.pfsp_power)
        if not self.is_alone:
            for bot in make_bots(settings.find_names(), game, scenario):
                self.pool.add(BOT, bot, seed)
            for name, source in settings.agents.items():
                agent = load(source, game.name, scenario)
                agent.name = name
                self.pool.add(FOREIGN, agent, seed)
            if seat is not None:
                for place, path in seat.find_live_mains().items():
                    live = load_agent(path, game.name, scenario)
                    live.seed(seed + place)
                    self.pool.add_live(place, seat.mains[place], live)
        self._numbers: list[int] = []  # of the opponents that are drawn now
        self._probabilities: list[float] = []
        self._drawn_for = (-1, -1)  # period and phase of the line-up
        self._last_snapshot_frames = 0
        self._rng = np.random.default_rng(seed)

    @property
    def representations(self) -> set[str]:
        """Representations of bots and foreign agents."""
        members = (kept for kept in self.pool.members if kept.kind != SNAPSHOT)
        return {self.pool.agent(member.number).representation for member in members}

    def name(self, number: int) -> str:
        """The name of a member of the pool in the log: snapshots share one."""
        return SNAPSHOTS if self.pool.is_snapshot(number) else self.pool.name(number)

    def draw(self, count: int, frames: int) -> NDArray[np.int16]:
        """Opponents for `count` teams whose games begin now, int16 [count]."""
        if self.is_alone:
            return np.full(count, NO_OPPONENT, np.int16)
        phase = int(frames >= self.settings.warmup_frames)
        now = (frames // self.settings.redraw_every_frames, phase)
        if now != self._drawn_for:
            self._draw_line_up(frames)
            self._drawn_for = now
        drawn = self._rng.choice(self._numbers, count, p=self._probabilities)
        return np.asarray(drawn, np.int16)

    def _draw_line_up(self, frames: int) -> None:
        is_warm = frames >= self.settings.warmup_frames
        mixture = self.settings.mixture if is_warm else WARMUP_MIXTURE
        standings = samplers.read_standings(self.pool, self.records, frames)
        probabilities = samplers.mix(mixture, standings, self._options)
        snapshots = np.array([self.pool.is_snapshot(int(n)) for n in standings.numbers])
        direct = np.flatnonzero(~snapshots & (probabilities > 0))
        self._numbers = standings.numbers[direct].tolist()
        self._probabilities = probabilities[direct].tolist()
        share = float(probabilities[snapshots].sum())
        if share > 0:
            numbers, weights = standings.numbers[snapshots].tolist(), probabilities[snapshots]
            slots = self.settings.pool_active
            self._numbers += samplers.draw_evenly(self._rng, numbers, weights, slots)
            self._probabilities += [share / slots] * slots

    def note(self, meetings: Iterable[Meeting], frames: int, running: int) -> None:
        """Record games that ended at `frames`; `running`: the lowest number of one that goes on."""
        for opponent, score, _, game in meetings:
            self._bets.book(game, opponent, score)
            self.records.book(opponent, score, frames)
            self._since_snapshot.book(opponent, score, frames)
            self.live_rating.note(opponent, score)
        self._bets.settle(running)

    def beats_the_best(self, frames: int) -> bool:
        """Whether the learner's win rate against the pool's best snapshot is above 1/2 by the
        margin, and the last snapshot is not recent. SNAPSHOT_ERROR bounds the chance of a wrong
        yes between two snapshots, however often this is called. A main exploiter has to beat every
        main agent so, a league exploiter every player in the pool.
        """
        margin, rivals = self.settings.snapshot_margin, self._find_bar()
        soonest = _SOONEST_SNAPSHOT * self.settings.snapshot_every_frames
        if margin is None or not rivals or frames - self._last_snapshot_frames < soonest:
            return False
        return all(self._bets.is_above(rival.number) for rival in rivals)

    def _find_bar(self) -> list[Member]:
        """Opponents that the learner has to beat for an early snapshot."""
        role = self.seat.role if self.seat else MAIN
        if role == MAIN_EXPLOITER:
            return [kept for kept in self.pool.members if kept.kind == LIVE]
        if role == LEAGUE_EXPLOITER:
            return self.pool.snapshots
        best = self.pool.best_snapshot()
        return [best] if best else []

    def join_league(self) -> None:
        """Adopt players that other learners of the league have frozen since."""
        if self.seat is None or self.is_alone:
            return
        new = [player for player in self.seat.find_new_players() if self.pool.adopt(player)]
        if new:
            self._drawn_for = (-1, -1)

    def publish(self, network: QNetwork, about: AgentDescription) -> None:
        """Write the learner's newest policy and its records for the league."""
        if self.seat is None:
            return
        met = {kept.number: kept.name for kept in self.pool.members}
        evidence = {name: self.records.evidence(n, about.frames) for n, name in met.items()}
        counts = [self.records.count(number) for number in met]
        self.seat.save_records(about.frames, evidence, counts)
        folder = self.seat.folder / LIVE_FOLDER / self.seat.owner
        save_agent(folder, network, replace(about, name=self.seat.owner))

    def add_snapshot(self, network: QNetwork, about: AgentDescription) -> Member:
        """Freeze a copy of the learner, and draw the line-up again."""
        frames = about.frames
        met = {
            kept.number: self._since_snapshot.evidence(kept.number, frames)
            for kept in self.pool.members
        }
        member = self.pool.add_snapshot(network, about, met)
        self._since_snapshot.clear()
        self._bets.clear()
        self.live_rating.freeze(member.number)
        self._last_snapshot_frames = frames
        self._drawn_for = (-1, -1)
        if self.seat is not None:
            # From the run's seed and this moment: the same in a resumed run.
            luck = np.random.default_rng([self._seed, frames]).random()
            self.is_over = bool(luck < self.seat.reset_chance)
        return member

    def forget_unused(self, in_play: NDArray[np.int16]) -> None:
        """Release the networks of snapshots that neither play nor can be drawn."""
        self.pool.release({*self._numbers, *np.unique(in_play).tolist()})

    def report(self, frames: int) -> dict[str, float]:
        """By log name: the pool's size, the learner's lowest win rate in it, its live rating, and
        the strength of each bot in a curriculum.
        """
        row, snapshots = self.live_rating.report(), self.pool.snapshots
        if CURRICULUM in self.settings.find_names():
            standings = samplers.read_standings(self.pool, self.records, frames)
            for bot, index in samplers.find_unbeaten(standings).items():
                row[f"curriculum/{bot}"] = split_name(standings.names[index])[1]
        if not snapshots:
            return row
        lowest = min(self.records.estimate(kept.number, frames) for kept in snapshots)
        row |= {"pool/snapshots": float(len(snapshots)), "pool/lowest_win_rate": lowest}
        return row

    def state_dict(self) -> dict[str, Any]:
        """Draws, pool, records and random generators, as tensors and plain data."""
        return {
            "rng": export_rng(self._rng),
            "pool": self.pool.state_dict(),
            "records": self.records.state_dict(),
            "since_snapshot": self._since_snapshot.state_dict(),
            "bets": self._bets.state_dict(),
            "numbers": list(self._numbers),
            "probabilities": list(self._probabilities),
            "drawn_for": self._drawn_for,
            "last_snapshot_frames": self._last_snapshot_frames,
            "is_over": self.is_over,
            "live_rating": self.live_rating.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`."""
        import_rng(self._rng, state["rng"])
        self.pool.load_state_dict(state["pool"])
        self.records.load_state_dict(state["records"])
        self._since_snapshot.load_state_dict(state["since_snapshot"])
        self._bets.load_state_dict(state["bets"])
        numbers = read_numbers(state["numbers"], "numbers", OPPONENT)
        self.pool.require_members({*numbers} - {LATEST_ID})
        shares = read_numbers(state["probabilities"], "probabilities", WEIGHT)
        is_none = not numbers and not shares
        if len(numbers) != len(shares) or not (is_none or abs(sum(shares) - 1.0) < 1e-8):
            raise ValueError(f"{len(numbers)} opponents have the probabilities {shares!r:.80}")
        self._numbers, self._probabilities = numbers, shares
        period, phase = read_numbers(state["drawn_for"], "drawn_for", Range(-1, MOST))
        # Without numbers the line-up is drawn again.
        self._drawn_for = (-1, -1) if is_none else (period, phase)
        self._last_snapshot_frames = read_number(state, "last_snapshot_frames", COUNT)
        self.is_over = read_number(state, "is_over", FLAG)
        self.live_rating.load_state_dict(state["live_rating"])


def expand_mixtures(settings: OpponentSettings) -> OpponentSettings:
    """Replace mixtures by their members, called name_00, name_01, ...: one is drawn for each game,
    and has its own win rate.

    Raises:
        CheckpointError: a mixture that cannot be read.
        ValueError: another agent has the name of a member.
    """
    mixtures = {n: read_mixture(one) for n, one in settings.agents.items() if is_mixture(one)}
    if not mixtures:
        return settings
    agents = {name: one for name, one in settings.agents.items() if name not in mixtures}
    shares: dict[str, dict[str, float]] = {}
    for name, mixture in mixtures.items():
        members = {f"{name}_{place:02}": one for place, one in enumerate(mixture.sources)}
        for taken in agents.keys() & members:
            raise ValueError(f"opponent.agents has {taken!r}, as a member of {name} is called")
        agents |= members
        shares[name] = dict(zip(members, mixture.weights, strict=True))

    expanded: dict[str, float] = {}
    for name, weight in settings.mixture.items():
        for member, share in shares.get(name, {name: 1.0}).items():
            expanded[member] = expanded.get(member, 0.0) + share * weight
    return replace(settings, agents=agents, mixture=expanded)


def make_bots(names: Collection[str], game: Game, scenario: Any) -> list[Agent]:
    """The bots among `names`; if `bots` or `pfsp_bots` is one of them, all that can play the
    scenario; if `curriculum` is, these at all strengths.

    Raises:
        ValueError: a bot that is named cannot play it, or none can.
    """
    made: list[Agent] = []
    refused: ValueError | None = None
    all_of = [name for name in (BOTS, PFSP_BOTS, CURRICULUM) if name in names]
    listed = [*chain(*map(list_strengths, game.bots))] if CURRICULUM in names else [*game.bots]
    # In one order in every process: sets of names have another in each.
    weak = sorted(name for name in names if name in game.bots and name not in listed)
    for name in [*(listed if all_of else filter(names.__contains__, listed)), *weak]:
        try:
            made.append(game.bot(name, scenario))
        except ValueError as error:
            refused = error
            if name in names:
                raise ValueError(f"{error}; or leave {name!r} out of opponent.mixture") from error
    if refused and not made:
        raise ValueError(f"{refused}; or leave {all_of[0]!r} out of opponent.mixture") from refused
    return made


def export_rng(rng: np.random.Generator) -> str:
    """The generator's state as text: its 128-bit numbers fit no tensor."""
    return json.dumps(rng.bit_generator.state)


def import_rng(rng: np.random.Generator, state: str) -> None:
    """Continue where `export_rng` was called. Raises ValueError for another text."""
    try:
        rng.bit_generator.state = json.loads(state)
    except (KeyError, TypeError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"{state!r:.80} is no random state of NumPy ({error!r})") from error
