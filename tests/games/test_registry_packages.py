"""Packages with games that import one another in any order, and packages that are broken."""

import json

import pytest

from marl_cair.games import GAMES
from tests.games.test_registry import GAME_MODULE, install, list_games, run_python

BROKEN = "import no_such_module_anywhere"


def write_entry_points(folder, module, *lines):
    text = "\n".join(["[marl_cair.games]", *lines, ""])
    (folder / f"{module}-1.0.dist-info" / "entry_points.txt").write_text(text)


# --- the order of imports --------------------------------------------------------------------

LOOK_UP = """
import sys
import foreign_game
sys.stderr.write("looked up:")
import gymnasium
from marl_cair import GAMES
print(list(GAMES))
"""


def test_a_package_that_imports_ours_may_be_imported_first(tmp_path):
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE)
    play = "print(gymnasium.make('marl_cair/Foreign-duel-v0').unwrapped.engine.num_players)\n"
    done = run_python(tmp_path, "-c", f"{LOOK_UP}{play}print(GAMES['foreign'].title)")
    assert done.stdout == f"{[*GAMES, 'foreign']}\n2\nLast standing\n", done.stderr
    assert "BrokenGameWarning" not in done.stderr


def test_a_package_that_its_own_parts_import_late_may_be_imported_first(tmp_path):
    package = tmp_path / "foreign_pack"
    package.mkdir()
    (package / "__init__.py").write_text("import marl_cair\nNAMES = ('duel', 'ffa-3')\n")
    text = GAME_MODULE.replace('("duel", "ffa-3")', "foreign_pack.NAMES")
    (package / "game.py").write_text(f"import foreign_pack\n{text}")
    install(tmp_path, "foreign", "foreign_game", "import foreign_pack")
    write_entry_points(tmp_path, "foreign_game", "foreign = foreign_pack.game")
    done = run_python(tmp_path, "-c", LOOK_UP)
    assert done.stdout == f"{[*GAMES, 'foreign']}\n", done.stderr
    assert "BrokenGameWarning" not in done.stderr


def test_a_broken_package_that_is_imported_first_is_told_at_the_next_look_up(tmp_path):
    install(tmp_path, "foreign", "foreign_game", "import marl_cair\nSCENARIOS = {}")
    done = run_python(tmp_path, "-c", LOOK_UP)
    assert done.stdout == f"{list(GAMES)}\n", done.stderr
    before, after = done.stderr.split("looked up:")
    assert before == ""
    assert "foreign_game has no GYMNASIUM_PREFIX" in after


def test_a_package_may_look_our_games_up_while_it_is_imported(tmp_path):
    ask = """
from marl_cair import GAMES
import gymnasium
assert GAMES["deep_maze"].scenarios
assert "marl_cair/DeepMaze-9x9-stochastic-v0" in gymnasium.registry
"""
    install(tmp_path, "foreign", "foreign_game", ask + GAME_MODULE)
    listed, warned = list_games(tmp_path)
    assert list(listed) == [*GAMES, "foreign"]
    assert "BrokenGameWarning" not in warned


# --- broken packages -------------------------------------------------------------------------


def test_entry_points_that_cannot_be_read_keep_only_their_own_games_out(tmp_path):
    install(tmp_path, "malformed", "malformed_game", GAME_MODULE)
    write_entry_points(tmp_path, "malformed_game", "just words")
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE)
    listed, warned = list_games(tmp_path)
    assert list(listed) == [*GAMES, "foreign"]
    assert "BrokenGameWarning: the entry points of malformed_game cannot be read: " in warned


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (BROKEN, "No module named 'no_such_module_anywhere'"),
        ("class Panic(BaseException):\n    pass\nraise Panic('in Rust')", "Panic('in Rust')"),
    ],
)
@pytest.mark.parametrize("warnings", ["default", "error"])
def test_no_broken_package_keeps_ours_from_being_imported(tmp_path, text, why, warnings):
    install(tmp_path, "foreign", "foreign_game", text)
    done = run_python(
        tmp_path, "-W", warnings, "-c", "from marl_cair import GAMES; print([*GAMES])"
    )
    assert done.stdout == f"{list(GAMES)}\n", done.stderr
    assert "BrokenGameWarning: the game 'foreign' of foreign_game" in done.stderr
    assert why in done.stderr


def test_the_user_can_still_interrupt(tmp_path):
    install(tmp_path, "foreign", "foreign_game", "raise KeyboardInterrupt")
    done = run_python(tmp_path, "-c", "import marl_cair")
    assert done.returncode != 0
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")


ASK = """
from marl_cair import GAMES
try:
    GAMES["foreign"]
except ValueError as error:
    print(error, end="")
"""


def test_of_two_packages_with_one_name_the_fault_of_the_one_that_is_loaded_is_told(tmp_path):
    for module, prefix in (("a_game", "A"), ("b_game", "B")):
        text = GAME_MODULE.replace('"Foreign"', repr(prefix)) + "del GAME\n"
        install(tmp_path, "foreign", module, text)
    done = run_python(tmp_path, "-c", ASK)
    assert "of b_game (b_game) cannot be loaded: a_game has that name already" in done.stderr
    told = "the game 'foreign' of a_game (a_game) cannot be loaded: AttributeError("
    assert done.stdout.startswith(told)


def test_an_entry_point_that_names_no_module_is_told(tmp_path):
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE)
    write_entry_points(tmp_path, "foreign_game", "foreign = not a module!!")
    done = run_python(tmp_path, "-c", ASK)
    assert "its entry point is 'not a module!!', it must be a module (my_package" in done.stdout


CHANGED = "GAME = dataclasses.replace(GAME, {})\n"
FAILING = "def fail(scenario):\n    1 / 0\n"
LATE = """
def make_late(scenario):
    return last_standing.make_spec(scenario) if scenario.num_players == 2 else 1 / 0
"""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("class GAME:\n    name = 'foreign'\n", "it must be a marl_cair.games.game.Game"),
        (CHANGED.format("default_scenario='d'"), "it must be one of its scenarios: duel, ffa-3"),
        (FAILING + CHANGED.format("make_spec=fail"), "ZeroDivisionError('division by zero')"),
        (CHANGED.format("make_spec=len"), "TypeError("),
        (CHANGED.format("make_spec=str"), "it must return a GameSpec"),
    ],
)
def test_a_game_that_commands_cannot_use_is_left_out(tmp_path, text, why):
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE + text)
    done = run_python(tmp_path, "-c", f"{ASK}print(end='\\0')\nprint([*GAMES.load_all()])")
    told, loaded = done.stdout.split("\0")
    assert "the game 'foreign' of foreign_game (foreign_game) cannot be loaded: " in told
    assert why in told
    assert loaded == f"{list(GAMES)}\n"


COMPILE = """
from marl_cair.cli import compile, main
compile.compile_parts = lambda parts, workers: iter(parts)
raise SystemExit(main(["compile"]))
"""
COMPOSE = """
import json
from marl_cair.cli import main
assert main(["train", "--help"]) == 0
print(end="\\0")
from marl_cair.cli.compose import compose_config, list_games
compose_config(["game=flappy_bird"])
print(json.dumps([*list_games()]))
"""


def test_commands_do_without_broken_packages(tmp_path):
    texts = {
        "absent": BROKEN,
        "named": f"{GAME_MODULE}class GAME:\n    name = 'named'\n",
        "failing": GAME_MODULE + FAILING + CHANGED.format("make_spec=fail"),
        "vague": GAME_MODULE + CHANGED.format("bots=None, rewards=None"),
    }
    for name, text in texts.items():
        own = text.replace('"foreign"', f'"{name}"').replace('"Foreign"', f'"{name}"')
        install(tmp_path, name, f"{name}_game", own)
    done = run_python(tmp_path, "-c", COMPOSE)
    assert done.returncode == 0, done.stderr
    helped, names = done.stdout.split("\0")
    assert "deep_rts_duel" in helped
    assert json.loads(names) == [*GAMES]
    for name in texts:
        assert f"BrokenGameWarning: the game '{name}' of {name}_game" in done.stderr


@pytest.mark.parametrize("make", [FAILING.replace("fail", "make_late"), LATE])
def test_the_rules_of_all_other_games_are_compiled(tmp_path, make):
    text = GAME_MODULE + make + CHANGED.format("make_spec=make_late")
    install(tmp_path, "foreign", "foreign_game", text)
    done = run_python(tmp_path, "-c", COMPILE)
    assert done.stdout.startswith(f"compiled the rules of {', '.join(GAMES)} in "), done.stderr
    assert "foreign_game (foreign_game) cannot be loaded: ZeroDivisionError(" in done.stderr
    named = run_python(tmp_path, "-m", "marl_cair", "compile", "foreign")
    assert named.returncode != 0
    assert "foreign_game (foreign_game) cannot be loaded: ZeroDivisionError(" in named.stderr
    assert "Traceback" not in named.stderr
