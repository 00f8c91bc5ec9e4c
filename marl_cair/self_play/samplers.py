"""Opponent samplers: each maps the pool's win rates to sampling probabilities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.players.weak_bot import split_name
from marl_cair.lookup import LazyTable, check_name
from marl_cair.outside import OutsideCodeError
from marl_cair.self_play.pool import BOT, FOREIGN, LIVE, SNAPSHOT, Pool
from marl_cair.self_play.shared_folder import LEAGUE_EXPLOITER, MAIN, MAIN_EXPLOITER
from marl_cair.self_play.win_rates import EVEN, WinRecords

LATEST = "latest"  # the learner itself, with the number 0
LATEST_ID = 0
# Bots of the pool, all that can play the scenario: at full strength, or at all strengths.
BOTS, PFSP_BOTS, CURRICULUM = "bots", "pfsp_bots", "curriculum"
BEATEN = 0.7  # a win rate from which on `curriculum` makes a bot stronger
LEARNER = "learner"  # a kind, beside BOT, FOREIGN, LIVE and SNAPSHOT

Probabilities = NDArray[np.float64]


class Standings(NamedTuple):
    """K opponents to sample from: the learner itself, then the pool's members in order."""

    numbers: NDArray[np.int64]  # [K]
    names: tuple[str, ...]  # K
    kinds: tuple[str, ...]  # K
    win_rate: NDArray[np.float64]  # [K], the learner's expected score in 0..1
    payoff: NDArray[np.float64]  # [K, K], row against column; used for the pool only
    owners: tuple[str, ...] = ()  # in a league: the learner of each opponent
    roles: tuple[str, ...] = ()  # in a league: that learner's role

    def find(self, kind: str, roles: tuple[str, ...]) -> NDArray[np.int64]:
        """Indices of the members of one kind whose learners have one of `roles`."""
        of_role = [i for i, role in enumerate(self.roles) if role in roles]
        return np.array([i for i in of_role if self.kinds[i] == kind], int)

    @property
    def all_bots(self) -> NDArray[np.int64]:
        """Indices of the bots, of all strengths."""
        return np.array([i for i, kind in enumerate(self.kinds) if kind == BOT], int)

    @property
    def bots(self) -> NDArray[np.int64]:
        """Indices of the bots at full strength."""
        return np.array([i for i in self.all_bots if split_name(self.names[i])[1] == 1], int)

    @property
    def pool(self) -> NDArray[np.int64]:
        """Indices of the frozen policies (foreign agents and snapshots), oldest first."""
        frozen = (FOREIGN, SNAPSHOT)
        return np.array([i for i, kind in enumerate(self.kinds) if kind in frozen], int)

    def spread(self, chosen: NDArray[np.int64], weights: Probabilities) -> Probabilities:
        """Probabilities [K] proportional to the weights of `chosen`; uniform if all weights are 0.

        If none is chosen the learner plays itself, as before the first snapshot.
        """
        probabilities = np.zeros(len(self.numbers))
        if not len(chosen):
            probabilities[0] = 1.0
            return probabilities
        total = weights.sum()
        probabilities[chosen] = weights / total if total > 0 else 1.0 / len(chosen)
        return probabilities


class SamplerOptions(NamedTuple):
    """Parameters of samplers."""

    delta: float = 0.5  # `delta_uniform` leaves out this share of the pool, the oldest
    recency: float = 3.0  # `recent` weighs by exp(-recency * age), age 0 (newest) to 1 (oldest)
    power: float = 2.0  # of `pfsp`, `pfsp_easy` and `pfsp_bots`


Sampler = Callable[[Standings, SamplerOptions], Probabilities]


def latest(standings: Standings, options: SamplerOptions) -> Probabilities:
    """The learner itself: plain self-play."""
    return standings.spread(np.array([0]), np.ones(1))


def delta_uniform(standings: Standings, options: SamplerOptions) -> Probabilities:
    """The newest 1 - delta of the pool, uniformly (Bansal et al. 2018, "Emergent complexity via
    multi-agent competition").
    """
    pool = standings.pool
    newest = pool[min(int(options.delta * len(pool)), max(0, len(pool) - 1)) :]
    return standings.spread(newest, np.ones(len(newest)))


def recent(standings: Standings, options: SamplerOptions) -> Probabilities:
    """The pool; newer members have more weight."""
    pool = standings.pool
    ages = np.linspace(1.0, 0.0, len(pool)) if len(pool) > 1 else np.zeros(len(pool))
    return standings.spread(pool, np.exp(-options.recency * ages))


def curriculum(standings: Standings, options: SamplerOptions) -> Probabilities:
    """Each bot with equal probability, at the lowest strength at which it is not beaten yet. Win
    rates grow old, so that a bot that was beaten long ago is met again at a lower strength.
    """
    chosen = np.array([*find_unbeaten(standings).values()], int)
    return standings.spread(chosen, np.ones(len(chosen)))


def find_unbeaten(standings: Standings) -> dict[str, int]:
    """By bot: the index of its lowest strength that is not beaten yet, or of its full strength."""
    strengths, names = dict[str, list[int]](), [split_name(name) for name in standings.names]
    for index in sorted(standings.all_bots.tolist(), key=lambda i: names[i][1]):
        strengths.setdefault(names[index][0], []).append(index)
    return {
        bot: next((i for i in indices if standings.win_rate[i] < BEATEN), indices[-1])
        for bot, indices in strengths.items()
    }


def nash(standings: Standings, options: SamplerOptions) -> Probabilities:
    """The maximum-entropy Nash mixture of the pool's payoffs: PSRO (Lanctot et al. 2017).

    Payoffs come from the learner's own games; unplayed pairs count as even. Give `uniform` a share
    beside it, so that all members are played.
    """
    pool = standings.pool
    payoff = standings.payoff[np.ix_(pool, pool)] - EVEN
    from marl_cair.league.ratings.equilibrium import maximum_entropy_nash

    return standings.spread(pool, maximum_entropy_nash(payoff))


def main_agents(standings: Standings, options: SamplerOptions) -> Probabilities:
    """For a main exploiter: the current main agents of a league, uniformly. A main agent that is
    hardly ever beaten (AlphaStar: win rate up to 0.1) is replaced by its past, equal ones first.
    """
    chosen = standings.find(LIVE, (MAIN,))
    return _newest_or_past(standings, chosen, options, bar=0.1)


def main_self_play(standings: Standings, options: SamplerOptions) -> Probabilities:
    """For a main agent: itself and the other current main agents of a league, uniformly. One that
    is seldom beaten (AlphaStar: win rate up to 0.3) is replaced by its past, equal ones first.
    """
    others = standings.find(LIVE, (MAIN,))
    return _newest_or_past(standings, np.array([0, *others.tolist()]), options, bar=0.3)


def forgotten(standings: Standings, options: SamplerOptions) -> Probabilities:
    """For a main agent: exploiters that still win (win rate below 0.3), else past main agents that
    win again (below 0.7), weighted as by `pfsp`; else itself. AlphaStar's verification branch.
    """
    for roles, bar in (((MAIN_EXPLOITER, LEAGUE_EXPLOITER), 0.3), ((MAIN,), 0.7)):
        past = standings.find(SNAPSHOT, roles)
        lost = past[standings.win_rate[past] < bar]
        if len(lost):
            return standings.spread(lost, (1.0 - standings.win_rate[lost]) ** options.power)
    return latest(standings, options)


def _newest_or_past(
    standings: Standings, chosen: NDArray[np.int64], options: SamplerOptions, bar: float
) -> Probabilities:
    """`chosen`, uniformly; those with a win rate up to `bar` are replaced by their past."""
    if not len(chosen):
        return latest(standings, options)
    total = np.zeros(len(standings.numbers))
    past = standings.find(SNAPSHOT, (MAIN,))
    for one in chosen.tolist():
        theirs = np.array([i for i in past if standings.owners[i] == standings.owners[one]], int)
        if standings.win_rate[one] > bar or not len(theirs):
            total[one] += 1.0 / len(chosen)
        else:
            rate = standings.win_rate[theirs]
            total += standings.spread(theirs, rate * (1.0 - rate)) / len(chosen)
    return total


def _weigh(
    find: Callable[[Standings], NDArray[np.int64]],
    weights: Callable[[Probabilities, SamplerOptions], Probabilities],
) -> Sampler:
    """A sampler with weights by the learner's win rates against the members that `find` returns."""

    def sample(standings: Standings, options: SamplerOptions) -> Probabilities:
        chosen = find(standings)
        return standings.spread(chosen, weights(standings.win_rate[chosen], options))

    return sample


_BOTS, _POOL = attrgetter("bots"), attrgetter("pool")
_OWN: dict[str, Sampler] = {
    LATEST: latest,
    # Prioritised fictitious self-play (Vinyals et al. 2019, "Grandmaster level in StarCraft II"):
    # hard opponents (f_hard), equal opponents (f_var), and easy ones, for weak learners.
    "pfsp": _weigh(_POOL, lambda rates, options: (1.0 - rates) ** options.power),
    "pfsp_variance": _weigh(_POOL, lambda rates, options: rates * (1.0 - rates)),
    "pfsp_easy": _weigh(_POOL, lambda rates, options: rates**options.power),
    # Fictitious self-play (Heinrich, Lanctot and Silver 2015).
    "uniform": _weigh(_POOL, lambda rates, options: np.ones(len(rates))),
    "delta_uniform": delta_uniform,
    "recent": recent,
    "nash": nash,
    BOTS: _weigh(_BOTS, lambda rates, options: np.ones(len(rates))),
    PFSP_BOTS: _weigh(_BOTS, lambda rates, options: (1.0 - rates) ** options.power),
    CURRICULUM: curriculum,
    "main_self_play": main_self_play,
    "main_agents": main_agents,
    "forgotten": forgotten,
}
SAMPLERS: LazyTable[Sampler] = LazyTable(_OWN, group="marl_cair.samplers")
# These have opponents only in a league.
LEAGUE_SAMPLERS = ("main_self_play", "main_agents", "forgotten")


def mix(
    mixture: Mapping[str, float], standings: Standings, options: SamplerOptions
) -> Probabilities:
    """Probabilities [K] of a mixture: weights by name of a sampler, a bot or a foreign agent.

    Raises:
        UnknownNameError: an unknown name; names the nearest.
        ValueError: no weight above 0, or one below.
    """
    weights = np.array(list(mixture.values()), np.float64)
    if not (np.isfinite(weights) & (weights >= 0)).all() or not weights.sum() > 0:
        raise ValueError(
            f"the mixture is {dict(mixture)}: weights must be 0 or more, and one of them above 0"
        )
    total = np.zeros(len(standings.numbers))
    for name, weight in zip(mixture, weights / weights.sum(), strict=True):
        if weight > 0:
            total += weight * _sample(name, standings, options)
    probabilities: Probabilities = total / total.sum()
    return probabilities


def _sample(name: str, standings: Standings, options: SamplerOptions) -> Probabilities:
    """Probabilities [K] of one source. Raises OutsideCodeError for a sampler from outside that
    fails or returns something else.
    """
    members = zip(standings.names, standings.kinds, strict=True)
    named = [member for member, kind in members if kind in (BOT, FOREIGN)]
    if name in named:
        return standings.spread(np.array([standings.names.index(name)]), np.ones(1))
    check_name("opponent", name, named, SAMPLERS)
    found: Probabilities = SAMPLERS.make(name, standings, options)
    if not SAMPLERS.is_outside(name):
        return found
    shape = (len(standings.numbers),)
    found = np.asarray(found)
    is_fit = found.shape == shape and np.issubdtype(found.dtype, np.number)
    if not is_fit or not ((found >= 0) & np.isfinite(found)).all() or not found.sum() > 0:
        raise OutsideCodeError(
            f"sampler {name} returned {found.tolist()!r:.80} of shape {list(found.shape)}, it must "
            f"be probabilities of shape {list(shape)}: 0 or more, one for each opponent"
        )
    probabilities: Probabilities = found / found.sum()
    return probabilities


def read_standings(pool: Pool, records: WinRecords, frames: int) -> Standings:
    """The opponents of the pool, and the learner's win rates against them at `frames`."""
    members = pool.members
    numbers = [LATEST_ID, *(member.number for member in members)]
    payoff = np.full((len(numbers), len(numbers)), EVEN)
    payoff[1:, 1:] = pool.payoff(numbers[1:])
    return Standings(
        np.array(numbers, np.int64),
        (LATEST, *(member.name for member in members)),
        (LEARNER, *(member.kind for member in members)),
        np.array([EVEN, *(records.estimate(number, frames) for number in numbers[1:])]),
        payoff,
        ("", *(member.owner for member in members)),
        ("", *(member.role for member in members)),
    )


def draw_evenly(
    rng: np.random.Generator, numbers: Sequence[int], probabilities: Probabilities, count: int
) -> list[int]:
    """Draw `count` of `numbers` by systematic sampling: each number's count differs from its
    expectation by less than one (one random offset, equal steps through summed probabilities).
    """
    if not count:
        return []
    places = (rng.random() + np.arange(count)) / count
    ends = np.cumsum(probabilities)
    chosen = np.searchsorted(ends / ends[-1], places, side="right")
    return [numbers[int(index)] for index in np.minimum(chosen, len(numbers) - 1)]
