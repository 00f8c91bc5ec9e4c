"""Measure a league: games a minute on Deep Line Wars 10x15, what recording them, ratings of many
games and their report take.

python -m benchmarks.league [--agents 100] [--games 100000] [--play-games 960] [--workers 2]
    [--network-games 512] [--skip-play] [--skip-ratings] [--skip-report]
Games are of a whole `run_league` in a folder that is thrown away, less the start of its workers;
ratings are of simulated games, half of them in each seat, two to a block.
"""

import argparse
import dataclasses
import itertools
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks._networks import save_network
from marl_cair.cluster import LOCAL, choose_pool
from marl_cair.games import GAMES
from marl_cair.league.agents.load import describe_agent, find_fingerprint, load_agent
from marl_cair.league.play.arena import Arena, Rules
from marl_cair.league.play.blocks import Entrant
from marl_cair.league.play.schedule import schedule_meetings
from marl_cair.league.ratings.averages import AVERAGES, NASH, average
from marl_cair.league.ratings.cycles import find_cycles
from marl_cair.league.ratings.fit import check_fit
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.payoffs import find_payoffs
from marl_cair.league.ratings.rate import rate
from marl_cair.league.report.report import report_stored
from marl_cair.league.store.schema import AgentRecord, PlayedGame
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from marl_cair.policies.q_network import QNetworkConfig

GAME, SCENARIO = "deep_line_wars", "10x15"
BOTS = ("rusher", "economist", "turtle", "counter")


def simulate(num_agents: int, num_games: int, seed: int) -> Games:
    """Bradley-Terry games, spread evenly over all pairs."""
    rng = np.random.default_rng(seed)
    strength = rng.normal(0.0, 1.0, num_agents)
    pairs = np.array(list(itertools.combinations(range(num_agents), 2)))
    pairs = pairs[np.arange(num_games // 2) % len(pairs)]
    agents = np.stack((pairs, pairs[:, ::-1]), 1).reshape(-1, 2)
    chance = 1.0 / (1.0 + np.exp(strength[agents[:, 1]] - strength[agents[:, 0]]))
    won = (rng.random(len(agents)) < chance).astype(float)
    points = np.stack((won, 1.0 - won), 1)
    blocks = np.repeat(np.arange(len(pairs)), 2)
    return Games(agents, points, 2.0 - points, blocks, np.zeros(len(agents), np.bool_))


def measure_ratings(num_agents: int, num_games: int) -> None:
    """Print the seconds of each part, the best of two."""
    games = simulate(num_agents, num_games, 0)
    names = [f"agent {number:03}" for number in range(num_agents)]
    payoffs = find_payoffs(num_agents, games)
    parts: dict[str, Callable[[], object]] = {
        "ratings with intervals": lambda: rate(names, games),
        "payoffs with intervals": lambda: find_payoffs(num_agents, games),
        "test of fit": lambda: check_fit(num_agents, games),
        "circles": lambda: find_cycles(num_agents, games),
        "Nash averaging": lambda: average(payoffs, AVERAGES[NASH]),
    }
    print(f"{num_agents} agents, {len(games.agents)} games")
    for name, call in parts.items():
        seconds = []
        for _ in range(2):
            start, cpu = time.perf_counter(), time.process_time()
            call()
            seconds.append((time.perf_counter() - start, time.process_time() - cpu))
        wall, used = min(seconds)
        print(f"  {name:24} {wall:6.2f} s ({used:.2f} s of CPU)", flush=True)


def store_games(folder: Path, games: Games) -> None:
    """A league file of the games, of agents that there are not."""
    game = GAMES[GAME]
    scenario = game.scenario(SCENARIO, reward=game.rated_reward)
    settings = {
        "game": GAME,
        "game_version": game.version,
        "scenario": dataclasses.asdict(scenario),
        "seed": 0,
        "seating": "all",
        "team_of_seat": [0, 1],
    }
    order = np.lexsort((np.arange(len(games.agents)), *np.sort(games.agents, axis=1).T))
    with closing(LeagueStore(folder / STORE_FILE, settings)) as store:
        ids = [
            store.add_agent(AgentRecord(name, name, "bot", "scripted", game.version, "{}"))
            for name in (f"agent {number:03}" for number in range(int(games.agents.max()) + 1))
        ]
        line_ups = itertools.groupby(order.tolist(), lambda at: tuple(sorted(games.agents[at])))
        for line_up, places in line_ups:
            played = []
            for number, place in enumerate(places):
                agents, points = games.agents[place], tuple(games.points[place].tolist())
                entries = tuple(line_up.index(agent) for agent in agents)
                played.append(
                    PlayedGame(
                        block=number // 2,
                        number=number % 2,
                        map_seed=number // 2,
                        entries=entries,
                        points=points,
                        ranks=tuple(2.0 - point for point in points),
                        winner=int(points[1]),
                        is_truncated=False,
                        decisions=100,
                        trajectory=str(place),
                        forfeited=(False, False),
                        reason="",
                    )
                )
            store.add_games([ids[agent] for agent in line_up], played)


def measure_report(num_agents: int, num_games: int) -> None:
    """Print what `marl-cair league report` takes, without films, the best of two."""
    with tempfile.TemporaryDirectory() as folder:
        store_games(Path(folder), simulate(num_agents, num_games, 0))
        seconds = []
        for _ in range(2):
            start, cpu = time.perf_counter(), time.process_time()
            report_stored(Path(folder), with_replays=False)
            seconds.append((time.perf_counter() - start, time.process_time() - cpu))
        size = (Path(folder) / "report.html").stat().st_size
    wall, used = min(seconds)
    print(f"  {'report':24} {wall:6.2f} s ({used:.2f} s of CPU), {size / 1e6:.1f} MB", flush=True)


def measure_play(title: str, sources: list[str], num_games: int, workers: int, out: Path) -> None:
    """Print games a minute of all pairs of `sources`, stored as a league stores them."""
    game = GAMES[GAME]
    scenario = game.scenario(SCENARIO, reward=game.rated_reward)
    rules = Rules(game, scenario, 0, "all")
    agents = [load_agent(source, GAME, scenario) for source in sources]
    entrants = sorted(
        (
            Entrant(source, find_fingerprint(agent, game), agent, source)
            for source, agent in zip(sources, agents, strict=True)
        ),
        key=lambda one: one.fingerprint,
    )
    settings = {"seed": 0, "team_of_seat": [0, 1], "game_version": game.version}
    with closing(LeagueStore(out / f"{title}.sqlite", settings)) as store:
        ids = [store.add_agent(describe_agent(e.name, e.agent, game)) for e in entrants]
        jobs = schedule_meetings(len(entrants), 2, num_games, rules.games_per_chunk)
        make_pool = choose_pool(LOCAL, workers, out)
        with closing(Arena(rules, entrants, ids, store, make_pool, load_agent)) as arena:
            with tqdm(disable=True) as bar:
                arena.play(jobs[: 4 * workers], bar)  # starts workers, compiles rules
            held = len(store.read_games().agents)
            start, cpu = time.perf_counter(), time.process_time()
            with tqdm(unit=" games") as bar:
                arena.play(jobs, bar)
            seconds, used = time.perf_counter() - start, time.process_time() - cpu
        played = len(store.read_games().agents) - held
    print(
        f"{title}: {played} games in {seconds:.1f} s ({used:.1f} s of CPU in this process), "
        f"{60.0 * played / seconds:.0f} a minute",
        flush=True,
    )


def measure_recording(title: str, sources: list[str], num_chunks: int, out: Path) -> None:
    """Print the processor time of games with and without --record: the middle of 41 pairs."""
    game = GAMES[GAME]
    scenario = game.scenario(SCENARIO, reward=game.rated_reward)
    rules = Rules(game, scenario, 0, "all")
    agents = [load_agent(source, GAME, scenario) for source in sources]
    line_up = [Entrant(one.name, find_fingerprint(one, game), one) for one in agents]
    rules.play(line_up, range(1))  # compiles rules
    used: dict[bool, list[float]] = {False: [], True: []}
    for number in range(41):
        for is_recorded in (False, True) if number % 2 else (True, False):
            record = out / title / f"{number}" if is_recorded else None
            start = time.process_time()
            played = len(rules.play(line_up, range(num_chunks), record))
            used[is_recorded].append(time.process_time() - start)
    plain = float(np.median(used[False]))
    recorded = plain + float(np.median(np.subtract(used[True], used[False])))
    sizes = [path.stat().st_size for path in (out / title).rglob("*.replay")]
    print(
        f"{title}: {played} games take {plain:.2f} s of CPU, {recorded:.2f} s with --record "
        f"({recorded / plain - 1.0:+.1%}, {1e6 * (recorded - plain) / played:.0f} us a game); "
        f"{np.mean(sizes):.0f} bytes a game",
        flush=True,
    )


def main() -> None:
    """Measure what the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agents", type=int, default=100)
    parser.add_argument("--games", type=int, default=100_000)
    parser.add_argument("--play-games", type=int, default=960, help="of each pair of bots")
    parser.add_argument("--network-games", type=int, default=512, help="of two conv networks")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--skip-play", action="store_true")
    parser.add_argument("--skip-ratings", action="store_true")
    parser.add_argument("--skip-report", action="store_true")
    options = parser.parse_args()
    if not options.skip_ratings:
        measure_ratings(options.agents, options.games)
    if not options.skip_report:
        measure_report(options.agents, options.games)
    if options.skip_play:
        return
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        measure_play("bots", list(BOTS), options.play_games, options.workers, out)
        networks = [
            save_network(
                out / f"net{seed}", SCENARIO, "planes", QNetworkConfig(body="conv"), seed=seed
            )
            for seed in (0, 1)
        ]
        measure_play("conv", networks, options.network_games, options.workers, out)
        measure_recording("recorded bots", list(BOTS[:2]), 64, out)
        measure_recording("recorded conv", networks, 4, out)


if __name__ == "__main__":
    main()
