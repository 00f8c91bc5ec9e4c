"""Scripted opponents: legal on every board, repeatable, memoryless, and as strong as they say."""

import itertools

import numpy as np
import pytest

from benchmarks._matches import play_match
from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.bot_sight import blow_table, chord_table, placement_order
from marl_cair.games.deep_line_wars.bots import BOTS
from marl_cair.games.deep_line_wars.observation import ENEMY_GOLD, OWN_GOLD
from marl_cair.games.deep_line_wars.rulebook import make_rules
from marl_cair.games.deep_line_wars.scenarios import Scenario
from marl_cair.games.deep_line_wars.tables import BASIC, FASTER, GRUNT, MILITIA
from marl_cair.games.randomness import episode_seeds
from tests.games.bot_play import (
    assert_answers_each_row_on_its_own,
    assert_leaves_what_it_sees,
    assert_repeats_and_continues,
    find_positions,
    make_bot,
    play,
)

SCRIPTED = [name for name in BOTS if name != "random"]
CASES = [
    ("10x15", {}),
    ("10x15", {"actions": "classic"}),
    ("11x11", {"preset": "2017"}),
    ("30x11", {"preset": "2018", "actions": "classic"}),
    ("10x15", {"rows": 6, "columns": 6}),
]


def make_game(num_worlds=4, scenario="10x15", **options):
    engine = make_engine("deep_line_wars", scenario, num_worlds, **options)
    worlds = np.arange(num_worlds)
    engine.reset(episode_seeds(3, worlds, np.zeros(num_worlds, np.int64)))
    return engine


@pytest.fixture(scope="module")
def positions():
    """Planes and masks of both seats in games of `random`, after 60 decisions."""
    engine = make_game(16)
    bots = [make_bot(engine, "random", seed) for seed in (1, 2)]
    return find_positions(engine, bots, 60)


@pytest.mark.parametrize(("scenario", "options"), CASES)
@pytest.mark.parametrize("name", BOTS)
def test_every_bot_only_gives_legal_actions(name, scenario, options):
    engine = make_game(2, scenario, **options)
    for _, mask, actions in play(engine, [make_bot(engine, name), make_bot(engine, "random")], 120):
        assert np.take_along_axis(mask, actions[:, :, None], 2).all()
    assert (engine.illegal_actions == 0).all()


@pytest.mark.parametrize("name", SCRIPTED)
def test_every_scripted_bot_builds_and_sends_with_the_classic_cursor(name):
    engine = make_game(2, actions="classic")
    groups = np.array(engine.spec.action_group_names)
    bots = [make_bot(engine, name), make_bot(engine, "random")]
    taken = {str(groups[a[0, 0]]) for _, _, a in play(engine, bots, 150)}
    assert {kind.partition("_")[0] for kind in taken} >= {"buy", "build", "cursor"}


@pytest.mark.parametrize("name", BOTS)
def test_a_bot_repeats_continues_and_leaves_what_it_sees(name, positions):
    assert_repeats_and_continues(name, positions)
    assert_leaves_what_it_sees(name, positions)
    if name == "random":  # draws for the rows of a batch one after another
        assert (positions.answers("random", 1) != positions.answers("random", 2)).any()
    else:
        assert_answers_each_row_on_its_own(name, positions)


@pytest.mark.slow
def test_random_draws_kinds_evenly_and_then_actions_of_the_kind_evenly():
    engine = make_game(1)
    planes = np.repeat(engine.observe("planes")[:, 0], 40_000, 0)
    mask = np.repeat(engine.action_mask()[:, 0], 40_000, 0)
    actions = make_bot(engine, "random").act(planes, mask)
    kinds = np.bincount(engine.spec.action_groups[actions], minlength=8)
    # Eight kinds are legal: 5,000 of each expected, standard deviation 66.
    assert (abs(kinds - 5_000) < 330).all()
    fast = actions[engine.spec.action_groups[actions] == 6]
    cells = np.bincount(fast, minlength=185)[65:125]
    assert (cells > 0).all()
    assert cells.sum() == len(fast)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTED)
def test_every_bot_beats_random_in_nine_games_of_ten_and_counter_beats_every_other(name):
    engine = make_game(200)
    bot = make_bot(engine, name)
    result = play_match(engine, bot, make_bot(engine, "random"), seed=11)
    assert result.wins >= 0.9 * result.games
    if name != "counter":
        result = play_match(engine, make_bot(engine, "counter"), bot, seed=12)
        assert result.wins >= 0.75 * result.games


def test_counter_does_not_look_at_the_enemys_gold(positions):
    # Not a rule but a property that a change of plan should notice: it reckons with the board.
    engine, planes, mask = positions
    bot = make_bot(engine, "counter")
    expected = bot.act(planes, mask)
    richer = planes.copy()
    richer[:, ENEMY_GOLD] = 255
    np.testing.assert_array_equal(bot.act(richer, mask), expected)
    poor = planes.copy()
    poor[:, OWN_GOLD] = 0
    assert (bot.act(poor, mask) == engine.spec.noop_action).all()


def test_a_tower_covers_the_columns_that_lie_in_its_circle():
    # Range 2 at row 1, board column 3: row 1 columns 1..5, rows 0 and 2 columns 2..4, row 3 one.
    chords = chord_table(rows=5, build_columns=4, columns=10, reach=2)
    assert chords[1 * 4 + 2].tolist() == [3, 5, 3, 1, 0]


def test_the_placement_order_holds_each_cell_once_and_covers_all_rows_early():
    chords = chord_table(rows=10, build_columns=6, columns=15, reach=3)
    order = placement_order(chords)
    assert sorted(order.tolist()) == list(range(60))
    assert (chords[order[:2]].sum(0) > 0).all()


def test_blows_count_armour_and_the_waste_of_the_last_shot():
    rules = make_rules(Scenario(preset="2018"))
    blows = blow_table(rules)
    # Basic: mean roll 3, penetration 2 against armour 2: 14 shots for 40 health, 0.3 a tick.
    assert blows[BASIC, MILITIA] == pytest.approx(40 / 14 * 0.3)
    # Faster: rolls 4..6, penetration 3 against armour 4: mean 4, 35 shots for 140, 0.5 a tick.
    assert blows[FASTER, GRUNT] == pytest.approx(140 / 35 * 0.5)


@pytest.mark.plain_python
@pytest.mark.parametrize("name", BOTS)
@pytest.mark.parametrize("actions", ["spatial", "classic"])
def test_a_short_game_of_each_bot_ends_where_plain_python_ends(name, actions):
    engine = make_game(1, actions=actions)
    bots = [make_bot(engine, name, 1), make_bot(engine, "random", 2)]
    taken = [a[0].tolist() for _, _, a in play(engine, bots, 25)]
    assert digest_of(taken) == GOLDEN[name][actions]


def digest_of(actions):
    """A short number that changes with any action."""
    value = 0
    for action in itertools.chain.from_iterable(actions):
        value = (value * 1_000_003 + action) % 2**31
    return value


# Of compiled play; a change of plans or of the balanced numbers changes them.
GOLDEN = {
    "random": {"spatial": 773_837_346, "classic": 2_048_226_798},
    "rusher": {"spatial": 1_305_756_925, "classic": 1_041_381_599},
    "turtle": {"spatial": 1_374_712_283, "classic": 555_344_938},
    "economist": {"spatial": 861_996_470, "classic": 478_028_906},
    "zigzag": {"spatial": 2_099_152_103, "classic": 259_867_088},
    "counter": {"spatial": 475_453_331, "classic": 1_936_841_593},
}


def test_a_bot_that_is_shown_another_representation_says_which_it_reads():
    engine = make_game(2)
    bot, mask = make_bot(engine, "counter"), engine.action_mask()[:, 0]
    with pytest.raises(ValueError, match="'counter' reads the representation 'planes', not float"):
        bot.act(np.zeros((2, 10), np.float32), mask)
