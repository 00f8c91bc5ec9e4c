"""An unknown name is answered with the nearest names and with all of them."""

import pytest

from marl_cair.lookup import UnknownNameError, find_by_name

GAMES = {"deep_line_wars": 1, "deep_rts": 2, "deep_maze": 3, "flappy_bird": None}
NEAREST = "nearest are 'deep_maze', 'deep_rts', 'deep_line_wars'"
MAZES = ["x9-loops", "9x9-stochastic", "9x9-random", "9x9-loops", "9x9-a"]
OPTIONS = ["out", "game.name", "game.size", "learner.gamma", "learner.algorithm", "replay.capacity"]


def test_known_names_give_their_entries():
    assert find_by_name("game", "deep_rts", GAMES) == 2
    assert find_by_name("game", "flappy_bird", GAMES) is None


@pytest.mark.parametrize(
    ("names", "name", "message"),
    [
        (GAMES, "deep_mase", f"'deep_mase': {NEAREST}; known are {str([*GAMES])[1:-1]}"),
        (["conv", "capsule"], "zzz", "'zzz': known are 'conv', 'capsule'"),
        ([], "x", "'x': known are none"),
        (["x"], "", "'': known are 'x'"),
        (["x"], None, "None: known are 'x'"),
        (["x"], 3, "3: known are 'x'"),
        (["x"], ["x"], "['x']: known are 'x'"),
    ],
)
def test_unknown_names_list_the_nearest_first_and_all_known(names, name, message):
    with pytest.raises(UnknownNameError) as raised:
        find_by_name("thing", name, dict.fromkeys(names))
    assert str(raised.value) == f"unknown thing {message}"
    assert isinstance(raised.value, ValueError)


@pytest.mark.parametrize(
    ("names", "name", "nearest"),
    [
        *((GAMES, other, "'deep_line_wars'") for other in ("linewars", "DEEP_LINE_WARS")),
        *((GAMES, other, "'deep_line_wars'") for other in ("deep-line-wars", "DeepLineWars")),
        # At most three; names that begin with the typed text come first, in the table's order.
        (MAZES, "9X9", "'9x9-stochastic', '9x9-random', '9x9-loops';"),
        # Of names with dots their ends are compared; those that begin so come first.
        (OPTIONS, "gama", "'learner.gamma', 'game.name'"),
        (OPTIONS, "game", "'game.name', 'game.size', 'learner.gamma'"),
        (OPTIONS, "learner.gama", "'learner.gamma'"),
        # The same name in another spelling comes before longer ones.
        (["cov", "conv-large", "conv"], "Conv", "'conv', 'conv-large', 'cov';"),
        (["agent_1", "agent_2", "agent_3", "agent_4"], "agent_9", "'agent_"),
    ],
)
def test_the_nearest_names_are_at_most_three_and_in_order(names, name, nearest):
    with pytest.raises(UnknownNameError) as raised:
        find_by_name("thing", name, dict.fromkeys(names))
    text = str(raised.value)
    assert f"nearest are {nearest}" in text
    assert text.partition(";")[0].partition("nearest are")[2].count("'") <= 3 * 2
