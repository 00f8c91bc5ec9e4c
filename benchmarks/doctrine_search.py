"""What numbers play Deep RTS best? A search over the doctrines of its scripted players.

    python -m benchmarks.doctrine_search [--generations 42] [--seed 1] [--scenario 1v1-15x15]
        [--games 400]

The same seed finds the same doctrine. It begins with the doctrines of the bots. Each generation
makes twelve new ones of the best eight: some numbers changed, or two crossed first. Each plays
every bot 16 times; the four best of them, and the four best of all, whose luck may fade, play more.
A doctrine's worth is the mean of its lowest share of points and of its mean share. In the end the
best plays --games games against each bot on other map seeds than it was chosen on.

`marl_cair.games.deep_rts.teacher` is what it found with these defaults, when the bots did not fight
off peasants.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import trange

import marl_cair
from benchmarks._bot_tables import describe_pair
from benchmarks._matches import MatchResult, play_match
from marl_cair.games import GAMES
from marl_cair.games.deep_rts.bots.bots import make_bot
from marl_cair.games.deep_rts.bots.doctrines import DOCTRINES, Doctrine

LOWEST = Doctrine(1, 3, 1, 1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0)
HIGHEST = Doctrine(10, 22, 3, 6, 2, 3, 20, 200, 5, 120, 3, 3, 3, 3, 12, 1)
PARENTS = 8
CHILDREN = 12
AGAIN = 4  # of the children, and of all, that play once more in each generation
FIRST_GAMES, NEXT_GAMES, LAST_GAMES = 16, 32, 64  # against each bot
SURE_GAMES = 100  # from which a doctrine can be the best
ENOUGH_GAMES = 2000
CLOSE = 0.05  # to the worst parent, of a child that plays again
SEEDS_APART = 100_000
FRESH_SEED = 10**9


@dataclass
class Record:
    """What a doctrine has won against each bot so far."""

    points: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(DOCTRINES)))
    games: int = 0  # against each

    @property
    def shares(self) -> NDArray[np.float64]:
        """Points of each game against each bot, float64 [bots]."""
        return self.points / self.games

    @property
    def worth(self) -> float:
        """Higher is better."""
        return float(self.shares.mean() + self.shares.min()) / 2


class Search:
    """Doctrines and their records on one scenario."""

    def __init__(self, scenario: str, seed: int) -> None:
        self.scenario = GAMES["deep_rts"].scenario(scenario)
        self.name, self.seed = scenario, seed * SEEDS_APART
        self.rng = np.random.default_rng(seed)
        spec = GAMES["deep_rts"].make_spec(self.scenario)
        self.make_player = partial(make_bot, "searched", self.scenario, spec)
        self.bots = {name: self.make_player(doctrine) for name, doctrine in DOCTRINES.items()}
        self.records: dict[Doctrine, Record] = {}
        self._engines: dict[int, Any] = {}
        for doctrine in DOCTRINES.values():
            self.seed += 1
            self.rate(doctrine, NEXT_GAMES)

    def play(self, doctrine: Doctrine, games: int, seed: int) -> list[MatchResult]:
        """Games against each bot."""
        if games not in self._engines:
            self._engines[games] = marl_cair.make_engine("deep_rts", self.name, games)
        engine = self._engines[games]
        player = self.make_player(doctrine)
        return [play_match(engine, player, bot, seed) for bot in self.bots.values()]

    def rate(self, doctrine: Doctrine, games: int) -> None:
        """Play games of the current seed, and add them to the doctrine's record."""
        results = self.play(doctrine, games, self.seed)
        record = self.records.setdefault(doctrine, Record())
        record.points += [one.wins + (one.draws + one.truncations) / 2 for one in results]
        record.games += games

    def rank(self, games: int) -> list[Doctrine]:
        """Those with as many games against each bot, the best first."""
        rated = [one for one, record in self.records.items() if record.games >= games]
        return sorted(rated, key=lambda one: -self.records[one].worth)

    def run_generation(self) -> None:
        """Make children, rate them, and rate the best of all again."""
        parents = self.rank(NEXT_GAMES)[:PARENTS]
        children: list[Doctrine] = []
        while len(children) < CHILDREN:
            child = self._make_child(parents)
            if child not in self.records and child not in children:
                children.append(child)
        self.seed += 1
        for child in children:
            self.rate(child, FIRST_GAMES)
        children.sort(key=lambda one: -self.records[one].worth)
        self.seed += 1
        worst = self.records[parents[-1]].worth - CLOSE
        for child in children[:AGAIN]:
            if self.records[child].worth > worst:
                self.rate(child, NEXT_GAMES)
        self.seed += 1
        for leader in self.rank(NEXT_GAMES)[:AGAIN]:
            played = self.records[leader].games
            if played < ENOUGH_GAMES:
                self.rate(leader, LAST_GAMES if played > SURE_GAMES else NEXT_GAMES)

    def _make_child(self, parents: list[Doctrine]) -> Doctrine:
        rng = self.rng
        first = parents[rng.integers(len(parents))]
        if rng.random() < 0.4:
            second = parents[rng.integers(len(parents))]
            from_first = rng.random(len(first)) < 0.5
            pairs = zip(first, second, from_first, strict=True)
            first = Doctrine(*(one if chosen else other for one, other, chosen in pairs))
        return self._change(first)

    def _change(self, doctrine: Doctrine) -> Doctrine:
        """One to three numbers changed, a little or to anything."""
        rng, numbers = self.rng, doctrine._asdict()
        for name in rng.choice(Doctrine._fields, rng.integers(1, 4), replace=False).tolist():
            low, high = getattr(LOWEST, name), getattr(HIGHEST, name)
            if rng.random() < 0.3:
                numbers[name] = int(rng.integers(low, high + 1))
                continue
            by = int(rng.choice([-1, 1]) * rng.integers(1, max(1, (high - low) // 6) + 1))
            numbers[name] = min(max(numbers[name] + by, low), high)
        if numbers["footmen"] + numbers["archers"] + numbers["cavalry"] == 0:
            numbers["archers"] = 1  # else it has no army
        return Doctrine(**numbers)


def main(argv: list[str] | None = None) -> None:
    """Search, and print the best doctrine with what it wins."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.doctrine_search")
    parser.add_argument("--generations", type=int, default=42)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scenario", default="1v1-15x15")
    parser.add_argument("--games", type=int, default=400, help="of the result, even")
    options = parser.parse_args(argv)
    if options.games < 2 or options.games % 2:
        parser.error(f"--games is {options.games}: give an even number, 2 or more")
    search = Search(options.scenario, options.seed)
    with trange(options.generations, unit="generation") as bar:
        for _ in bar:
            search.run_generation()
            for best in search.rank(SURE_GAMES)[:1]:
                record = search.records[best]
                bar.set_postfix(worth=f"{record.worth:.3f}", lowest=f"{record.shares.min():.2f}")
    best = (search.rank(SURE_GAMES) or search.rank(NEXT_GAMES))[0]
    print(f"{len(search.records)} doctrines; the best, of seed {options.seed}:")
    for name, number in best._asdict().items():
        print(f"    {name}={number},")
    print(f"\n| against | won-drawn-lost in % of {options.games}, 95 % of won |\n|---|---|")
    results = search.play(best, options.games, FRESH_SEED + options.seed)
    for name, result in zip(search.bots, results, strict=True):
        print(f"| `{name}` | {describe_pair(result)} |")


if __name__ == "__main__":
    main()
