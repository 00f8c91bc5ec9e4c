"""Schedules: round robins, seat designs, adaptive choice of games, and their ending."""

import itertools
from collections import Counter

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.league.play.adaptive import (
    AdaptivePlan,
    Clock,
    describe_ending,
    measure_ladder,
    play_adaptively,
)
from marl_cair.league.play.blocks import make_design
from marl_cair.league.play.schedule import Job, schedule_meetings
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.rate import rate
from tests.league.leagues import EDGES, count_games, make

AT_ONCE = 1e-9  # seconds: time is up after the first batch


def count_meetings(jobs, games_per_chunk):
    met = Counter()
    for job in jobs:
        for pair in itertools.combinations(sorted(set(job.line_up)), 2):
            met[pair] += games_per_chunk
    return met


class TestMeetings:
    def test_of_two_it_is_a_round_robin(self):
        jobs = schedule_meetings(4, 2, 20, 8)
        pairs = itertools.combinations(range(4), 2)
        assert sorted(jobs) == sorted(Job(pair, chunk) for pair in pairs for chunk in range(3))

    @pytest.mark.parametrize(("num_agents", "num_teams"), [(5, 3), (8, 4), (9, 8), (3, 4), (2, 8)])
    def test_all_pairs_meet_about_as_often(self, num_agents, num_teams):
        jobs = schedule_meetings(num_agents, num_teams, 80, 8)
        met = count_meetings(jobs, 8)
        assert len(met) == num_agents * (num_agents - 1) // 2
        assert min(met.values()) >= 80
        assert max(met.values()) <= 80 + 8 * 5
        assert all(len(job.line_up) == num_teams for job in jobs)

    def test_fewer_agents_than_teams_are_repeated_evenly(self):
        for job in schedule_meetings(3, 8, 40, 8):
            assert sorted(Counter(job.line_up).values()) == [2, 3, 3]

    def test_agents_of_the_ladder_do_not_play_each_other(self):
        jobs = schedule_meetings(4, 2, 8, 8, frozenset({0, 2}))
        assert sorted(job.line_up for job in jobs) == [(0, 1), (0, 3), (1, 2), (1, 3), (2, 3)]
        with pytest.raises(ValueError, match="all agents are on the ladder"):
            schedule_meetings(2, 2, 8, 8, frozenset({0, 1}))


def schedule_slowly(num_agents, num_teams, meetings, games_per_chunk, ladder=frozenset()):
    """The definition: each time the first of the pairs that have met least."""
    pairs = [p for p in itertools.combinations(range(num_agents), 2) if not ladder.issuperset(p)]
    met, chunks, jobs = np.zeros((num_agents, num_agents), int), Counter(), []
    while True:
        pair = min(pairs, key=lambda pair: int(met[pair]))
        if met[pair] >= meetings:
            return jobs
        chosen = list(pair)
        while len(chosen) < num_teams:
            copies = Counter(chosen)
            ranked = [(copies[a], met[a, chosen].sum(), met[a].sum(), a) for a in range(num_agents)]
            chosen.append(min(ranked)[-1])
        line_up = tuple(sorted(chosen))
        for one, two in itertools.permutations(sorted(set(line_up)), 2):
            met[one, two] += games_per_chunk
        jobs.append(Job(line_up, chunks[line_up]))
        chunks[line_up] += 1


@pytest.mark.parametrize("num_teams", [2, 3, 4, 8])
@pytest.mark.parametrize("num_agents", [2, 3, 6, 9])
def test_the_schedule_is_that_of_the_definition(num_agents, num_teams):
    for ladder in (frozenset(), frozenset({0}), frozenset(range(num_agents - 1))):
        for meetings in (1, 20, 64):
            words = num_agents, num_teams, meetings, 8, ladder
            assert schedule_meetings(*words) == schedule_slowly(*words)


def test_many_agents_are_scheduled_at_once():
    assert len(schedule_meetings(300, 2, 40, 8)) == 5 * 300 * 299 // 2  # hours by the definition


class TestDesigns:
    @pytest.mark.parametrize("num_teams", [2, 3, 4])
    def test_all_orders_balance_seats_and_neighbours(self, num_teams):
        design = make_design(num_teams, "all", 0)(0)
        assert sorted(map(tuple, design.tolist())) == list(itertools.permutations(range(num_teams)))

    @pytest.mark.parametrize("num_teams", [2, 3, 5, 8])
    def test_a_ring_has_every_entry_in_every_seat_once(self, num_teams):
        design = make_design(num_teams, "ring", 7)
        for block in range(20):
            entries = design(block)
            for axis in (entries, entries.T):
                assert all(sorted(row) == list(range(num_teams)) for row in axis.tolist())

    def test_rings_differ_between_blocks_and_seeds(self):
        rings = {
            tuple(make_design(6, "ring", seed)(block)[0].tolist())
            for seed in range(4)
            for block in range(25)
        }
        assert len(rings) > 60
        assert (make_design(6, "ring", 1)(3) == make_design(6, "ring", 1)(3)).all()

    def test_all_orders_of_many_are_refused(self):
        with pytest.raises(ValueError, match="5 teams have 120 orders: take 'ring'"):
            make_design(5, "all", 0)


class Simulation:
    """Bradley-Terry players; the games of a job depend on nothing but the job."""

    def __init__(self, strengths, repeats=(), map_spread=0.0, seed=0):
        self.strengths, self.repeats = np.array(strengths), repeats
        self.map_spread, self.seed = map_spread, seed

    def __call__(self, jobs):
        self.jobs = list(jobs)
        agents, ranks, blocks, is_repeat = [], [], [], []
        for job in jobs:
            rng = np.random.default_rng([self.seed, *job.line_up, job.chunk])
            shape = 4, len(self.strengths)
            on_map = self.strengths + self.map_spread * rng.normal(size=shape)
            for game in range(8):
                seated = job.line_up if game % 2 else job.line_up[::-1]
                keys = on_map[game // 2, list(seated)] + rng.gumbel(size=len(seated))
                agents.append(seated)
                ranks.append(1.0 + np.argsort(np.argsort(-keys)))
                blocks.append(4 * job.chunk + game // 2)
                is_repeat.append(job.line_up in self.repeats and job.chunk > 0)
        ranks = np.array(ranks)
        keys = np.column_stack((np.sort(agents, axis=1), blocks))
        _, keys = np.unique(keys, axis=0, return_inverse=True)
        games = Games(
            np.array(agents), 1.0 * (ranks == 1), ranks, keys.ravel(), np.array(is_repeat)
        )
        self.games = games
        return games, np.array(blocks)


def adapt(simulation, half_width, games=4_000, is_time_up=lambda: False, num_teams=2, zero=""):
    num_agents = len(simulation.strengths)
    names = list("abcdefghi"[:num_agents])

    def measure(played):
        return measure_ladder(rate(names, played, zero=zero).ratings, names, zero)

    limits = half_width, games, is_time_up, measure
    return play_adaptively(AdaptivePlan(num_agents, num_teams, 4, 8, *limits), simulation)


def count_points_of_loser(simulation):
    games = simulation.games
    return (games.points[games.agents == 0]).mean()


class TestAdaptive:
    @pytest.mark.parametrize("num_teams", [2, 3])
    def test_it_stops_when_all_intervals_are_as_narrow_as_asked(self, num_teams):
        simulation = Simulation([0.0, 0.5, 1.0, 2.0])
        jobs = adapt(simulation, 60.0, num_teams=num_teams)
        ladder = rate(list("abcd"), simulation.games)
        widths = [(rating.high - rating.low) / 2 for rating in ladder.ratings]
        assert 40.0 < max(widths) <= 60.0
        assert simulation.jobs == jobs

    @pytest.mark.parametrize("map_spread", [0.0, 1.5])
    def test_the_intervals_that_are_reported_end_it(self, map_spread):
        """They are wider than the predicted ones, above all where maps decide games."""
        for seed in range(5):
            simulation = Simulation([0.0, 0.3, 0.6], map_spread=map_spread, seed=seed)
            adapt(simulation, 60.0)
            ladder = rate(list("abc"), simulation.games)
            assert max((r.high - r.low) / 2 for r in ladder.ratings) <= 60.0

    def test_it_plays_informative_games(self):
        """Games between strong and weak agents say little."""
        simulation = Simulation([0.0, 0.2, 4.0, 4.2])
        adapt(simulation, 80.0)
        met = count_meetings(simulation.jobs, 8)
        assert met[0, 1] + met[2, 3] > 2 * (met[0, 3] + met[1, 2]) / 2

    def test_it_needs_fewer_games_than_a_round_robin(self):
        strengths = [0.0, 1.2, 2.4, 3.6, 4.8]
        simulation = Simulation(strengths)
        jobs = adapt(simulation, 70.0)
        per_pair = len(jobs) // 10
        even = Simulation(strengths)
        even(
            [Job(pair, c) for pair in itertools.combinations(range(5), 2) for c in range(per_pair)]
        )
        widest = [
            max((r.high - r.low) / 2 for r in rate(list("abcde"), one.games).ratings)
            for one in (simulation, even)
        ]
        assert widest[0] < widest[1]

    def test_a_pair_that_repeats_itself_is_left_alone(self):
        simulation = Simulation([0.0, 0.3], repeats=((0, 1),))
        assert len(adapt(simulation, 20.0)) <= 1 + 8

    def test_games_and_time_end_it(self):
        simulation = Simulation([0.0, 0.3, 0.1])
        adapt(simulation, 1.0, games=24)
        assert max(count_meetings(simulation.jobs, 8).values()) <= 24 + 8 * 8
        assert len(adapt(simulation, 1.0, is_time_up=lambda: True)) == 3

    def test_an_agent_that_never_lost_does_not_prevent_the_end(self):
        simulation = Simulation([0.0, 0.2, 60.0])
        jobs = adapt(simulation, 80.0)
        assert len(jobs) < 100

    @pytest.mark.parametrize("half_width", [60.0, 0.0])
    def test_a_sweep_of_the_first_games_is_no_end(self, half_width):
        """It ended after eight games in a third of such leagues."""
        for seed in range(12):
            simulation = Simulation([0.0, 2.3], seed=seed)  # 400 Elo: 8 of 8 games in 46 %
            assert len(adapt(simulation, half_width, games=480)) > 6
            assert 0.0 < count_points_of_loser(simulation) < 0.5

    def test_the_agent_that_is_rated_0_plays_no_more_than_others(self):
        strengths = [0.0, 0.4, 0.8, 1.2, 1.6]
        simulation = Simulation(strengths)
        adapt(simulation, 120.0, zero="a")
        counts = np.bincount(simulation.games.agents.ravel(), minlength=5)
        assert counts[0] <= counts.max()
        assert len(simulation.jobs) < 25  # 31 when it came first

    def test_a_hopeless_agent_does_not_take_all_games(self):
        simulation = Simulation([-60.0, *np.linspace(0.0, 1.0, 8)])
        adapt(simulation, 60.0, is_time_up=lambda: len(simulation.jobs) > 60)
        counts = np.bincount(simulation.games.agents.ravel(), minlength=9)
        assert counts[0] <= 48 + 8 * 8

    def test_agents_that_cannot_be_told_apart_by_more_games_end_it(self):
        simulation = Simulation([0.0, 60.0])
        assert 6 <= len(adapt(simulation, 60.0)) <= 6 + 8
        assert len(adapt(simulation, 0.0, games=160)) == 20  # only --time or --games ends this one


# --- the end of a league ------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_time_ends_the_first_round_too(tmp_path, capsys, monkeypatch, workers):
    """With many agents the first round takes hours."""
    monkeypatch.setattr("marl_cair.cli.match_options.read_seconds", lambda text, option: AT_ONCE)
    words = ["league", "random", "turtle", "rusher", "--scenario", "11x11", "--no-replays"]
    words += ["--workers", workers, "--out", str(tmp_path)]
    assert main([*words, "--time", "1s"]) == 0
    assert count_games(tmp_path) == 8
    text = capsys.readouterr().out
    assert "the time of --time is up" in text.splitlines()[-1]
    assert main([*words, "--time", "1s", "--ci", "25"]) == 0
    assert count_games(tmp_path) == 16  # stored games take no time
    text = capsys.readouterr().out.splitlines()[-1]
    assert text.startswith("Not reached: intervals within 25 Elo either way (--ci), there are non")
    assert "the time of --time is up" in text


def test_the_first_jobs_connect_all_agents():
    plan = AdaptivePlan(5, 2, 4, 8, 1.0, 8, lambda: True, lambda games: np.zeros(5))
    jobs = play_adaptively(plan, Simulation([0.0] * 5))
    assert [job.line_up for job in jobs[:4]] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert len(jobs) == 10


def test_a_clock_that_never_started_is_never_up():
    clock = Clock(AT_ONCE)
    assert not clock.is_time_up()
    clock.start()
    assert clock.is_time_up()
    assert clock.has_ended
    endless = Clock(0.0)
    endless.start()
    assert not endless.is_time_up()


def test_the_ending_is_reported():
    ratings = make(dict.fromkeys(EDGES, 22)).ratings
    within = "intervals are within 500 Elo either way (--ci)"
    assert describe_ending(500.0, ratings, is_time_up=True) == f"All {within}."
    text = describe_ending(1.0, ratings, is_time_up=False)
    assert text.startswith(
        "Not reached: intervals within 1 Elo either way (--ci), 4 of 4 are wider"
    )
    swept = describe_ending(1.0, (), is_time_up=False)
    assert "there are none: no agent has both won and lost, and all games are played" in swept
    assert "there are none: the time of --time is up" in describe_ending(1.0, (), is_time_up=True)
    assert describe_ending(0.0, ratings, is_time_up=False) == ""


def test_a_bound_is_no_interval():
    text = describe_ending(500.0, make().ratings, is_time_up=False)
    assert text.endswith("(--ci), but for 2 of 4 agents that have none.")
