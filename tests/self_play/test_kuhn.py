"""Kuhn poker of OpenSpiel: mixtures of a learner's past selves are less exploitable than 1/6.

Exploitability is OpenSpiel's: the mean over both seats of the reward of a best response. The best
of all 4,096 pure strategies is exploitable by exactly 1/6, the equilibrium by 0.
"""

import itertools
from typing import NamedTuple

import numpy as np
import pytest

from marl_cair.self_play.pool import FOREIGN, Pool
from marl_cair.self_play.samplers import LATEST_ID, SamplerOptions, mix, read_standings
from marl_cair.self_play.win_rates import WinRecords
from marl_cair.training.settings.config import SELF_PLAY
from tests.games.rock_paper_scissors import GAME

pyspiel = pytest.importorskip("pyspiel", reason="OpenSpiel is the extra `openspiel`")

EPISODES, BATCH, EVERY = 300_000, 500, 5  # a snapshot of 2,500 episodes each
EPSILON, RATE = 0.25, 0.05
WITHOUT_BOTS = {name: weight for name, weight in SELF_PLAY.items() if name != "bots"}


class Tree(NamedTuple):
    """A small game of OpenSpiel as arrays over its S states and I information states."""

    player: np.ndarray  # [S], -1 chance, -4 ended
    infoset: np.ndarray  # [S], -1 at other states
    child: np.ndarray  # [S, A]
    chance: np.ndarray  # [S, A] summed
    returns: np.ndarray  # [S, 2]
    names: list[str]  # of information states
    before: dict[int, tuple[int, int]]  # information state -> its owner's last one, and the action


def read_tree(game):
    states, infosets, before = [], {}, {}
    width = max(game.num_distinct_actions(), game.max_chance_outcomes())

    def walk(state, own):
        place = len(states)
        row = {"player": state.current_player(), "infoset": -1, "returns": [0.0, 0.0]}
        row |= {"child": [0] * width, "chance": [0.0] * width}
        states.append(row)
        if state.is_terminal():
            row["player"], row["returns"] = -4, state.returns()
            return place
        if state.is_chance_node():
            row["player"] = -1
            for action, share in state.chance_outcomes():
                row["chance"][action] = share
        else:
            name = state.information_state_string()
            row["infoset"] = infosets.setdefault(name, len(infosets))
            if row["player"] in own:
                before[row["infoset"]] = own[row["player"]]
        for action in state.legal_actions():
            now = own | {row["player"]: (row["infoset"], action)} if row["infoset"] >= 0 else own
            row["child"][action] = walk(state.child(action), now)
        return place

    walk(game.new_initial_state(), {})
    arrays = {
        name: np.array([row[name] for row in states])
        for name in ("player", "infoset", "child", "chance", "returns")
    }
    arrays["chance"] = arrays["chance"].cumsum(1)
    return Tree(**arrays, names=list(infosets), before=before)


class Table:
    """An agent with an action for each information state; it observes the state's number."""

    representation = "infoset"

    def __init__(self, name, actions):
        self.name, self.actions = name, actions

    def seed(self, seed):
        pass

    def act(self, observation, action_mask):
        return self.actions[observation]


def play(tree, choose, count, rng):
    """Walk `count` games to their ends: states and actions of each decision, and the last states.

    choose: (places of the games with a decision, player, infoset) -> actions.
    """
    state, steps = np.zeros(count, int), []
    while (running := tree.player[state] != -4).any():
        at_chance = np.flatnonzero(running & (tree.player[state] == -1))
        ends = tree.chance[state[at_chance]]
        drawn = (rng.random((len(at_chance), 1)) * ends[:, -1:] >= ends).sum(1)
        deciding = np.flatnonzero(running & (tree.player[state] >= 0))
        player, infoset = tree.player[state[deciding]], tree.infoset[state[deciding]]
        actions = choose(deciding, player, infoset)
        steps.append((deciding, player, infoset, actions))
        state[at_chance] = tree.child[state[at_chance], drawn]
        state[deciding] = tree.child[state[deciding], actions]
    return steps, state


def learn(tree, folder, mixture, seed):
    """Tabular Q-learning of both seats against the mixture's opponents; returns the pool."""
    rng = np.random.default_rng(seed)
    pool = Pool(folder, GAME, GAME.scenario(), "vector", capacity=1)
    records = WinRecords(half_life_frames=EPISODES / 10)
    values = rng.normal(0.0, 0.01, (len(tree.names), 2))
    bound = np.abs(tree.returns).max()
    for iteration in range(EPISODES // BATCH):
        frames = iteration * BATCH
        if iteration % EVERY == 0:
            standings = read_standings(pool, records, frames)
            shares = mix(mixture, standings, SamplerOptions())
        met = rng.choice(standings.numbers, BATCH, p=shares)
        seat = rng.integers(0, 2, BATCH)

        def choose(places, player, infoset, met=met, seat=seat):
            own = (player == seat[places]) | (met[places] == LATEST_ID)
            explores = own & (rng.random(len(places)) < EPSILON)
            actions = np.where(explores, rng.integers(0, 2, len(places)), values[infoset].argmax(1))
            for number in set(met[places[~own]].tolist()):
                theirs = ~own & (met[places] == number)
                actions[theirs] = pool.agent(number).act(infoset[theirs], None)
            return actions

        steps, ended = play(tree, choose, BATCH, rng)
        for places, player, infoset, actions in steps:
            own = (player == seat[places]) | (met[places] == LATEST_ID)
            earned = tree.returns[ended[places], player]
            for cell in set(zip(infoset[own].tolist(), actions[own].tolist(), strict=True)):
                chosen = own & (infoset == cell[0]) & (actions == cell[1])
                share = 1.0 - (1.0 - RATE) ** min(20, int(chosen.sum()))
                values[cell] += share * (earned[chosen].mean() - values[cell])
        scores = 0.5 + tree.returns[ended, seat] / (2 * bound)
        for number, score in zip(met.tolist(), scores.tolist(), strict=True):
            if number != LATEST_ID:
                records.book(number, score, frames)
        if iteration % EVERY == EVERY - 1:
            pool.add(FOREIGN, Table(f"snapshot_{iteration}", values.argmax(1)), 0)
    return pool


def exploit(game, tree, tables, weights):
    """OpenSpiel's exploitability of a mixture of `tables`."""
    from open_spiel.python import policy as policies
    from open_spiel.python.algorithms import exploitability

    reach = np.ones((len(tables), len(tree.names)))
    for infoset in range(len(tree.names)):  # a state's ancestors have smaller numbers
        if infoset in tree.before:
            last, action = tree.before[infoset]
            reach[:, infoset] = reach[:, last] * (tables[:, last] == action)
    tabular = policies.TabularPolicy(game)
    for infoset, name in enumerate(tree.names):
        played = np.array(weights)[:, None] * reach[:, [infoset]] * np.eye(2)[tables[:, infoset]]
        total = played.sum()
        row = tabular.action_probability_array[tabular.state_lookup[name]]
        row[:] = played.sum(0) / total if total > 0 else 0.5
    return exploitability.exploitability(game, tabular)


@pytest.fixture(scope="module")
def kuhn():
    game = pyspiel.load_game("kuhn_poker")
    return game, read_tree(game)


@pytest.mark.slow
def test_the_best_pure_strategy_is_exploitable_by_a_sixth(kuhn):
    game, tree = kuhn
    tables = np.array(list(itertools.product((0, 1), repeat=len(tree.names))))
    assert len(tables) == 4_096
    least = min(exploit(game, tree, table[None], [1.0]) for table in tables)
    assert least == pytest.approx(1 / 6, abs=1e-9)


@pytest.mark.parametrize(
    "mixture",
    [
        {"latest": 1.0},
        pytest.param({"uniform": 1.0}, marks=pytest.mark.slow),
        pytest.param({"latest": 0.5, "recent": 0.5}, marks=pytest.mark.slow),
        pytest.param({"latest": 0.35, "pfsp": 0.65}, marks=pytest.mark.slow),
        WITHOUT_BOTS,
    ],
    ids="_".join,
)
def test_mixtures_of_the_pool_are_hard_to_exploit_and_the_last_agent_is_not(
    kuhn, tmp_path, mixture
):
    game, tree = kuhn
    found = []
    for seed in range(3):
        pool = learn(tree, tmp_path / str(seed), mixture, seed)
        tables = np.array([pool.agent(member.number).actions for member in pool.members])
        even = np.full(len(tables), 1.0 / len(tables))
        found.append(exploit(game, tree, tables, even))
        assert exploit(game, tree, tables[-1:], [1.0]) >= 1 / 6 - 1e-9
    assert np.mean(found) <= 0.11, found
