"""A name that a table lacks is answered with the nearest names and with all of them."""

import pytest

from marl_cair.lookup import UnknownNameError, find_by_name

GAMES = {"deep_line_wars": 1, "deep_rts": 2, "deep_maze": 3, "flappy_bird": None}


def test_known_name_gives_its_entry():
    assert find_by_name("game", "deep_rts", GAMES) == 2


def test_entry_that_is_none_is_found():
    assert find_by_name("game", "flappy_bird", GAMES) is None


def test_unknown_name_lists_the_nearest_first_and_all_known():
    with pytest.raises(UnknownNameError) as raised:
        find_by_name("game", "deep_mase", GAMES)
    assert str(raised.value) == (
        "unknown game 'deep_mase': nearest are 'deep_maze', 'deep_rts', 'deep_line_wars'; "
        "known are 'deep_line_wars', 'deep_rts', 'deep_maze', 'flappy_bird'"
    )


@pytest.mark.parametrize(
    "spelling", ["linewars", "DEEP_LINE_WARS", "deep-line-wars", "DeepLineWars"]
)
def test_other_spellings_find_their_game(spelling):
    with pytest.raises(UnknownNameError, match="nearest are 'deep_line_wars'"):
        find_by_name("game", spelling, GAMES)


def test_name_like_no_other_gets_no_hint():
    with pytest.raises(UnknownNameError) as raised:
        find_by_name("network", "zzz", {"conv": 1, "capsule": 2})
    assert str(raised.value) == "unknown network 'zzz': known are 'conv', 'capsule'"


def test_empty_table_says_that_none_are_known():
    with pytest.raises(UnknownNameError, match="^unknown sampler 'x': known are none$"):
        find_by_name("sampler", "x", {})


@pytest.mark.parametrize("name", [None, 3, ["deep_rts"]])
def test_name_that_is_no_text_is_refused(name):
    with pytest.raises(UnknownNameError, match="^unknown game .*: known are 'deep_line_wars'"):
        find_by_name("game", name, GAMES)


def test_at_most_three_names_are_near():
    table = dict.fromkeys(["agent_1", "agent_2", "agent_3", "agent_4"], 0)
    with pytest.raises(UnknownNameError) as raised:
        find_by_name("agent", "agent_9", table)
    nearest = str(raised.value).split(";")[0]
    assert nearest.count("agent_") == 1 + 3


def test_names_that_begin_with_what_was_typed_come_first_in_the_tables_order():
    table = dict.fromkeys(["x9-loops", "9x9-stochastic", "9x9-random", "9x9-loops", "9x9-a"], 0)
    with pytest.raises(UnknownNameError) as raised:
        find_by_name("scenario", "9X9", table)
    nearest = str(raised.value).split(";")[0]
    assert nearest.endswith("nearest are '9x9-stochastic', '9x9-random', '9x9-loops'")


def test_the_same_name_in_another_spelling_comes_before_longer_ones():
    with pytest.raises(UnknownNameError, match="nearest are 'conv', 'conv-large', 'cov'"):
        find_by_name("network", "Conv", dict.fromkeys(["cov", "conv-large", "conv"], 0))


def test_no_name_begins_with_nothing():
    with pytest.raises(UnknownNameError, match="^unknown sampler '': known are 'x'$"):
        find_by_name("sampler", "", {"x": 1})


def test_error_is_a_value_error():
    assert issubclass(UnknownNameError, ValueError)
