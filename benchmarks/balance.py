"""Is anything of a game too strong? Tournaments of single-minded players, and of the bots.

python -m benchmarks.balance [--games 1000] [--seed 0] [--preset balanced] [--csv payoffs.csv]
python -m benchmarks.balance --game deep_rts [--games 100] [--seed 0] [--preset balanced]
    [--csv payoffs.csv] [--map 1v1-15x15 --map 21x21-2p-fords ...]

Of Deep RTS it prints the tables of `_bot_tables`. Of Deep Line Wars it prints four: each item alone
against each other item and against a player that mixes all the others; pairs of one unit and one
tower, with the best answer to each; what players lose without one item; the bots. Of n games the
first player has seat 0 in one half and seat 1 in the other.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

import marl_cair
from benchmarks._bot_tables import BOARDS, report_tables
from benchmarks._matches import (
    MatchResult,
    play_match,
    play_round_robin,
    win_interval,
    write_results,
)
from marl_cair.games.deep_line_wars.bot_sight import (
    chord_table,
    make_knowledge,
    placement_order,
)
from marl_cair.games.deep_line_wars.bots import make_bot
from marl_cair.games.deep_line_wars.observation import OWN_LUMBER
from marl_cair.games.deep_line_wars.orders import FIRST_SPATIAL_TOWER, FIRST_SPATIAL_UNIT
from marl_cair.games.deep_line_wars.tables import (
    NUM_UNIT_KINDS,
    PRESETS,
    TOWER_NAMES,
    UNIT_NAMES,
)
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent

ITEMS = UNIT_NAMES + TOWER_NAMES
NO_ITEM = -1
MAX_REDRAWS = 20
BEYOND_MEANS = 10**6  # gold


class ItemPlayer:
    """Draws an item, saves until it is legal, buys it, draws again.

    Towers go to the cells that cover the rows best. A drawn tower for which lumber is missing is
    drawn again (lumber comes with time only), unless the player buys nothing but towers. Rows of a
    batch must be the same games at each call: it remembers what each saves for.

    Args:
        name: for tables.
        engine: with the spatial actions.
        weights: of the items in the draw, [items].
    """

    representation = "planes"

    def __init__(self, name: str, engine: BatchedEngine, weights: Sequence[float]) -> None:
        scenario = engine.scenario
        preset = PRESETS[scenario.preset]
        self.name = name
        self.weights = np.array(weights) / np.sum(weights)
        self.lumber = np.array([0] * NUM_UNIT_KINDS + list(preset.tower_cost_lumber))
        cells = scenario.rows * scenario.build_columns
        board = (scenario.rows, scenario.build_columns, scenario.columns)
        self.actions = [np.array([FIRST_SPATIAL_UNIT + kind]) for kind in range(NUM_UNIT_KINDS)]
        for kind, reach in enumerate(preset.tower_range_tiles):
            order = placement_order(chord_table(*board, reach))
            self.actions.append(FIRST_SPATIAL_TOWER + kind * cells + order)
        self.seed(0)

    def seed(self, seed: int) -> None:
        """Restart the generator and forget what was saved for."""
        self.generator = np.random.default_rng(seed)
        self.wanted = np.zeros(0, np.int64)

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        """One action for each of N rows: planes [N, C, H, W], mask [N, A] -> [N]."""
        num_rows = len(observation)
        if len(self.wanted) != num_rows:
            self.wanted = np.full(num_rows, NO_ITEM)
        self._draw_where(self.wanted == NO_ITEM)
        if self.weights[:NUM_UNIT_KINDS].any():
            for _ in range(MAX_REDRAWS):
                self._draw_where(self.lumber[self.wanted] > observation[:, OWN_LUMBER, 0, 0])
        actions = np.zeros(num_rows, np.int64)
        for item, candidates in enumerate(self.actions):
            rows = np.flatnonzero(self.wanted == item)
            if not len(rows):
                continue
            legal = action_mask[rows[:, None], candidates]
            choice = legal.argmax(1)
            is_bought = legal[np.arange(len(rows)), choice]
            actions[rows[is_bought]] = candidates[choice[is_bought]]
            self.wanted[rows[is_bought]] = NO_ITEM
        return actions

    def _draw_where(self, needed: NDArray[np.bool_]) -> None:
        if count := int(needed.sum()):
            self.wanted[needed] = self.generator.choice(len(ITEMS), count, p=self.weights)

    def state_dict(self) -> dict[str, Any]:
        """The generator and what each row saves for."""
        return {"generator": self.generator.bit_generator.state, "wanted": self.wanted.copy()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`."""
        self.generator.bit_generator.state = state["generator"]
        self.wanted = state["wanted"].copy()


def make_item_player(engine: BatchedEngine, *items: int) -> ItemPlayer:
    """Buy only the given items, drawn with equal chances."""
    weights = [float(item in items) for item in range(len(ITEMS))]
    return ItemPlayer(" + ".join(ITEMS[item] for item in items), engine, weights)


def make_mix(engine: BatchedEngine, without: int = NO_ITEM) -> ItemPlayer:
    """Buy all items, drawn with equal chances, but one."""
    return make_item_player(engine, *(item for item in range(len(ITEMS)) if item != without))


def play_against_mix(engine: BatchedEngine, seed: int) -> list[MatchResult]:
    """Each item alone against a player that mixes all the other items."""
    return [
        play_match(engine, make_item_player(engine, item), make_mix(engine, item), seed + item)
        for item in range(len(ITEMS))
    ]


def wins_against_drawn(
    results: Mapping[tuple[int, int], MatchResult], player: int, num_players: int
) -> tuple[int, int]:
    """(wins, games) against an opponent drawn uniformly from the others for each game."""
    rows = [results[player, other] for other in range(num_players) if other != player]
    return sum(row.wins for row in rows), sum(row.games for row in rows)


def describe(wins: int, games: int) -> str:
    """Share of wins in percent with its interval."""
    low, high = win_interval(wins, games)
    return f"{100 * wins / games:5.1f} [{100 * low:4.1f}, {100 * high:4.1f}]"


def print_payoffs(names: Sequence[str], results: Mapping[tuple[int, int], MatchResult]) -> None:
    """Percent of games that the row's player wins against the column's."""
    width = max(len(name) for name in names) + 2
    print(" " * width + "".join(f"{name[:12]:>14}" for name in names))
    for i, name in enumerate(names):
        cells = [
            "-" if i == j else f"{100 * results[i, j].wins / results[i, j].games:.0f}"
            for j in range(len(names))
        ]
        print(f"{name:<{width}}" + "".join(f"{cell:>14}" for cell in cells))


def report_items(engine: BatchedEngine, seed: int, file: TextIO | None) -> None:
    """Each item alone: against each other, against one drawn per game, against their mix."""
    players = [make_item_player(engine, item) for item in range(len(ITEMS))]
    results = play_round_robin(engine, players, seed)
    against_mix = play_against_mix(engine, seed + 100)
    print("\nOne item alone: % of games won by the row against the column")
    print_payoffs(ITEMS, results)
    print("\nagainst the others: (a) one drawn per game, (b) a player that mixes them")
    for item, name in enumerate(ITEMS):
        drawn = describe(*wins_against_drawn(results, item, len(ITEMS)))
        mixed = against_mix[item]
        print(
            f"{name:<16} (a) {drawn}   (b) {describe(mixed.wins, mixed.games)}, "
            f"loses {100 * mixed.losses / mixed.games:.0f}, {mixed.mean_ticks:.0f} ticks"
        )
    if file:
        write_results(file, "item", ITEMS, results)
        names = [*ITEMS, "mix of the others"]
        mixes = {(item, len(ITEMS)): result for item, result in enumerate(against_mix)}
        write_results(file, "mix", names, mixes)


def report_pairs(engine: BatchedEngine, seed: int, file: TextIO | None) -> None:
    """One unit with one tower, in equal parts: the best answer to each pair."""
    towers = range(NUM_UNIT_KINDS, len(ITEMS))
    pairs = list(itertools.product(range(NUM_UNIT_KINDS), towers))
    players = [make_item_player(engine, *pair) for pair in pairs]
    results = play_round_robin(engine, players, seed + 200)
    names = [player.name for player in players]
    print("\nOne unit and one tower in equal parts: wins against all other pairs, best answer")
    answers: dict[str, int] = dict.fromkeys(ITEMS, 0)
    for j, name in enumerate(names):
        others = [i for i in range(len(pairs)) if i != j]
        most = max(results[i, j].wins for i in others)
        best = [i for i in others if results[i, j].wins == most]
        for item in {item for i in best for item in pairs[i]}:
            answers[ITEMS[item]] += 1
        total = describe(*wins_against_drawn(results, j, len(pairs)))
        wins = describe(most, results[best[0], j].games)
        more = f" and {len(best) - 1} more" if len(best) > 1 else ""
        print(f"{name:<26} {total}   {wins} for {names[best[0]]}{more}")
    print(
        "pairs to which a best answer has it: " + ", ".join(f"{k} {v}" for k, v in answers.items())
    )
    if file:
        write_results(file, "pair", names, results)


def make_counter(engine: BatchedEngine, without: int) -> Agent:
    """The bot `counter`, who believes that one item cannot be paid."""
    known = make_knowledge(engine.scenario)
    prices = known.rules.unit_cost_gold.copy(), known.rules.tower_cost_gold.copy()
    if without < NUM_UNIT_KINDS:
        prices[0][without] = BEYOND_MEANS
    else:
        prices[1][without - NUM_UNIT_KINDS] = BEYOND_MEANS
    rules = known.rules._replace(unit_cost_gold=prices[0], tower_cost_gold=prices[1])
    return make_bot("counter", engine.scenario, engine.spec, known._replace(rules=rules))


def report_left_out(engine: BatchedEngine, seed: int, file: TextIO | None) -> None:
    """What `counter` and the mix of all items lose without one item."""
    others = [engine.game.bot(name, engine.scenario) for name in ("turtle", "economist", "zigzag")]
    full = engine.game.bot("counter", engine.scenario)
    matches = [(full, other) for other in others]
    whole = [play_match(engine, *match, seed + 400) for match in matches]
    names = ["all", *ITEMS, *(other.name for other in others), "counter", "mix"]
    table = {(0, len(ITEMS) + 1 + k): result for k, result in enumerate(whole)}
    print(
        "\nLeave one out: % of games won by `counter` without the item, and by the mix without it"
    )
    print(f"{'without':<16}" + "".join(f"{name:>12}" for name in names[len(ITEMS) + 1 :]))
    for item in range(len(ITEMS)):
        player = make_counter(engine, item)
        row = [play_match(engine, player, other, seed + 400) for other in (*others, full)]
        row.append(play_match(engine, make_mix(engine, item), make_mix(engine), seed + 400))
        table |= {(item + 1, len(ITEMS) + 1 + k): result for k, result in enumerate(row)}
        shares = [100 * result.wins / result.games for result in row]
        print(f"{ITEMS[item]:<16}" + "".join(f"{share:12.0f}" for share in shares))
    print(f"{'(nothing)':<16}" + "".join(f"{100 * r.wins / r.games:12.0f}" for r in whole))
    if file:
        write_results(file, "left out", names, table)


def report_bots(engine: BatchedEngine, seed: int, file: TextIO | None) -> None:
    """The game's scripted bots against each other."""
    names = list(engine.game.bots)
    players = [engine.game.bot(name, engine.scenario) for name in names]
    results = play_round_robin(engine, players, seed + 300)
    print("\nBots: % of games won by the row against the column")
    print_payoffs(names, results)
    for i, name in enumerate(names):
        rows = [results[i, j] for j in range(len(names)) if i != j]
        games = sum(row.games for row in rows)
        draws, late = sum(row.draws for row in rows), sum(row.truncations for row in rows)
        ticks = sum(row.mean_ticks for row in rows) / len(rows)
        print(
            f"{name:<12} {ticks:6.0f} ticks, draws {100 * draws / games:.1f} %, "
            f"time limit {100 * late / games:.1f} %"
        )
    if file:
        write_results(file, "bot", names, results)


def report_line_wars(arguments: argparse.Namespace, file: TextIO | None) -> None:
    """All four tables of Deep Line Wars."""
    engine = marl_cair.make_engine(
        "deep_line_wars", arguments.scenario, arguments.games or 1_000, preset=arguments.preset
    )
    for report in (report_items, report_pairs, report_left_out, report_bots):
        report(engine, arguments.seed, file)


def main() -> None:
    """Print the tables; write every match to the CSV file if one is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--game", default="deep_line_wars", choices=("deep_line_wars", "deep_rts"))
    parser.add_argument("--games", type=int, help="games of each match, even")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--scenario", default="10x15", help="of Deep Line Wars")
    parser.add_argument("--map", action="append", help="scenario or map of Deep RTS")
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    start = time.perf_counter()
    file = arguments.csv.open("w", newline="") if arguments.csv else None
    if file:
        header = "table first second wins losses draws truncations mean_ticks"
        csv.writer(file).writerow(header.split())
    if arguments.game == "deep_rts":
        boards, games = arguments.map or BOARDS, arguments.games or 100
        report_tables(boards, games, arguments.preset, arguments.seed, file)
    else:
        report_line_wars(arguments, file)
    if file:
        file.close()
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
