"""Scenarios that users add, and games of installed packages, whole and broken."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

import gymnasium
import numpy as np
import pytest

import marl_cair
from marl_cair.games import GAMES
from marl_cair.games.deep_line_wars import SCENARIOS, parallel_env
from marl_cair.lookup import UnknownNameError

ROOT = Path(__file__).parents[2]


@pytest.fixture
def _scenarios_kept():
    """What a test adds is gone after it."""
    tables = [gymnasium.registry, *(module.SCENARIOS for module in GAMES.modules.values())]
    before = [set(table) for table in tables]
    yield
    for table, names in zip(tables, before, strict=True):
        for name in set(table) - names:
            del table[name]


# --- scenarios -------------------------------------------------------------------------------


@pytest.mark.usefixtures("_scenarios_kept")
def test_a_users_scenario_is_known_wherever_one_is_named():
    made = marl_cair.register_scenario("deep_line_wars", "rush-8x9", rows=8, columns=9)
    assert made == "marl_cair/DeepLineWars-rush-8x9-v0"
    assert GAMES["deep_line_wars"].scenario("rush-8x9").rows == 8
    engine = marl_cair.make_engine("deep_line_wars", "rush-8x9", num_worlds=2)
    assert engine.spec.representations["planes"].shape[1:] == (8, 9)
    env = parallel_env("rush-8x9")
    env.reset(seed=0)
    assert env.observation_space("player_0").shape[1:] == (8, 9)
    observation, _ = gymnasium.make(made).reset(seed=0)
    assert np.shape(observation)[1:] == (8, 9)


@pytest.mark.usefixtures("_scenarios_kept")
def test_a_scenario_changes_the_one_it_is_based_on():
    marl_cair.register_scenario("deep_line_wars", "old", base="11x11", preset="2017")
    added = GAMES["deep_line_wars"].scenario("old")
    assert added == GAMES["deep_line_wars"].scenario("11x11", preset="2017")
    marl_cair.register_scenario("deep_line_wars", "first")
    first = next(iter(SCENARIOS))
    assert GAMES["deep_line_wars"].scenario("first") == GAMES["deep_line_wars"].scenario(first)


@pytest.mark.usefixtures("_scenarios_kept")
@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        (("deep_line_war", "a"), {}, UnknownNameError, "nearest are 'deep_line_wars'"),
        (("deep_line_wars", "a", "10x51"), {}, UnknownNameError, "nearest are '10x15'"),
        (("deep_line_wars", "a"), {"row": 8}, UnknownNameError, "nearest are 'rows'"),
        (("deep_line_wars", "a"), {"rows": 3}, ValueError, "rows is 3, it must be a whole number"),
        (("deep_line_wars", "10x15"), {}, ValueError, "has a scenario '10x15' already"),
        (("deep_line_wars", "a b"), {}, ValueError, "'a b' is no name of a scenario"),
        (("deep_line_wars", ""), {}, ValueError, "'' is no name of a scenario"),
    ],
)
def test_what_cannot_be_registered_is_refused_and_changes_nothing(
    arguments, options, error, message
):
    names, ids = list(SCENARIOS), set(gymnasium.registry)
    with pytest.raises(error, match=message):
        marl_cair.register_scenario(*arguments, **options)
    assert (list(SCENARIOS), set(gymnasium.registry)) == (names, ids)


IN_OTHER_PROCESSES = """
import gymnasium, marl_cair
added = marl_cair.register_scenario("deep_line_wars", "small", base="11x11", rows=8, columns=9)
spawn = {"context": "spawn"}
envs = gymnasium.make_vec(added, 2, vectorization_mode="async", vector_kwargs=spawn)
print(envs.reset(seed=0)[0].shape[2:])
envs.close()
"""


def test_a_users_scenario_is_known_to_processes_that_gymnasium_spawns(tmp_path):
    done = run_python(tmp_path, "-c", IN_OTHER_PROCESSES)
    assert done.stdout == "(8, 9)\n", done.stderr


@pytest.mark.usefixtures("_scenarios_kept")
def test_a_gymnasium_id_names_the_scenario_of_the_game_and_what_differs():
    marl_cair.register_scenario("deep_line_wars", "low", base="11x11", rows=8)
    added = marl_cair.register_scenario("deep_line_wars", "small", base="low", columns=9)
    told = {"game": "deep_line_wars", "scenario": "11x11", "rows": 8, "columns": 9}
    assert gymnasium.spec(added).kwargs == told
    spec = gymnasium.spec("marl_cair/DeepLineWars-11x11-v0")
    assert spec.kwargs == {"game": "deep_line_wars", "scenario": "11x11"}


@pytest.mark.usefixtures("_scenarios_kept")
def test_a_gymnasium_id_keeps_a_field_that_would_follow_another():
    """The time limit of a maze follows the board; this one is what that of the base is."""
    board = {"rows": 55, "columns": 55}
    own = marl_cair.register_scenario("deep_maze", "large", base="25x25-stochastic", **board)
    board["max_ticks"] = 1_000
    brief = marl_cair.register_scenario("deep_maze", "brief", base="25x25-stochastic", **board)
    limits = [gymnasium.make(made).unwrapped.engine.spec.max_ticks for made in (own, brief)]
    assert limits == [5_000, 1_000]
    assert gymnasium.spec(brief).kwargs.items() >= board.items()


def test_a_game_whose_scenarios_cannot_be_changed_says_so(monkeypatch):
    fixed = SimpleNamespace(SCENARIOS=MappingProxyType(SCENARIOS), GYMNASIUM_PREFIX="Fixed")
    monkeypatch.setitem(GAMES.modules, "fixed", fixed)
    with pytest.raises(ValueError, match="fixed takes no scenarios of its users, its SCENARIOS is"):
        marl_cair.register_scenario("fixed", "mine")


def test_the_default_scenario_of_our_games_comes_first():
    for game in GAMES.load_all().values():
        assert next(iter(game.scenarios)) == game.default_scenario


# --- games of other packages -----------------------------------------------------------------

GAME_MODULE = """
import dataclasses
from tests.games import last_standing
SCENARIOS = {name: last_standing.GAME.scenarios[name] for name in ("duel", "ffa-3")}
GYMNASIUM_PREFIX = "Foreign"
GAME = dataclasses.replace(
    last_standing.GAME, name="foreign", scenarios=SCENARIOS, gymnasium_prefix="Foreign",
    default_scenario="duel",
)
"""


def install(folder, name, module, text):
    """A package as pip leaves it: a module, and metadata with an entry point."""
    (folder / f"{module}.py").write_text(text)
    metadata = folder / f"{module}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[marl_cair.games]\n{name} = {module}\n")


def run_python(folder, *arguments, **settings):
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", **settings},
    )


def list_games(folder):
    """What `marl-cair games --json` tells, and what it warns of."""
    done = run_python(folder, "-c", "from marl_cair.cli import main; main(['games', '--json'])")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def test_a_package_adds_a_game_by_an_entry_point(tmp_path):
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE)
    listed, warned = list_games(tmp_path)
    assert set(listed) == set(GAMES) | {"foreign"}
    assert list(listed["foreign"]["scenarios"]) == ["duel", "ffa-3"]
    assert "BrokenGameWarning" not in warned
    program = """
import gymnasium, marl_cair
engine = marl_cair.make_engine("foreign", "ffa-3", num_worlds=2)
env = gymnasium.make("marl_cair/Foreign-duel-v0")
env.reset(seed=0)
print(engine.num_players, marl_cair.GAMES["foreign"].title)
"""
    done = run_python(tmp_path, "-c", program)
    assert done.stdout.split("\n")[0] == "3 Last standing", done.stderr


LIST_AND_ASK = """
from marl_cair import GAMES
from marl_cair.cli import main
assert main(["games", "--json"]) == 0
print(end="\\0")
try:
    GAMES["{name}"]
    print("there", end="")
except ValueError as error:
    print(type(error).__name__, error)
"""


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("foreign", "import no_such_module_anywhere", "No module named 'no_such_module_anywhere'"),
        ("foreign", "SCENARIOS = {}", "foreign_game has no GYMNASIUM_PREFIX"),
        ("deep_rts", GAME_MODULE, "marl_cair.games.deep_rts has that name already"),
        ("other", GAME_MODULE, "its GAME.name is 'foreign', the entry point's 'other'"),
        (
            "foreign",
            f"{GAME_MODULE}del GAME\ndef __getattr__(name):\n    1 / 0",
            "ZeroDivisionError",
        ),
    ],
)
def test_a_broken_package_is_told_and_keeps_no_other_game_from_loading(tmp_path, name, text, why):
    install(tmp_path, name, "foreign_game", text)
    done = run_python(tmp_path, "-c", LIST_AND_ASK.format(name=name))
    listed, asked = done.stdout.split("\0")
    assert set(json.loads(listed)) == set(GAMES)
    assert "BrokenGameWarning" in done.stderr
    assert f"the game '{name}' of foreign_game (foreign_game) cannot be loaded" in done.stderr
    assert why in done.stderr
    if name in GAMES:
        assert asked == "there"
    else:
        assert asked.startswith(f"GameLoadError the game '{name}' of foreign_game")


BROKEN = {
    "spaced": ("'My Game'", "{'a': 0}", "its GYMNASIUM_PREFIX is 'My Game', it must begin with a"),
    "numbered": ("7", "{'a': 0}", "its GYMNASIUM_PREFIX is 7, it must begin with a letter"),
    "misnamed": ("'Misnamed'", "{'a b': 0}", "its SCENARIOS has the name 'a b', a name must begin"),
    "counted": ("'Counted'", "{7: 0}", "its SCENARIOS has the name 7, a name must begin"),
    "none": ("'None'", "None", "its SCENARIOS is None, it must be a dict of scenarios"),
    "empty": ("'Empty'", "{}", "its SCENARIOS is {}, it must be a dict of scenarios"),
    "leaving": ("'Leaving'", "__import__('sys').exit(3)", "SystemExit(3)"),
    "twin": ("'DeepRTS'", "{'a': 0}", "'DeepRTS' would give it the Gymnasium ids of deep_rts"),
    "longer": ("'DeepRTS-1v1'", "{'15x15': 0}", "'DeepRTS-1v1' would give it the Gymnasium ids of"),
    "plain": ("'Plain'", "{'a': 0}", "its scenario 'a' is 0, it must be an object of a dataclass"),
    "fickle": (
        "'Fickle'",
        "type('Fickle', (dict,), {'__iter__': lambda self: 1 / 0})(a=Scenario())",
        "ZeroDivisionError",
    ),
}
PARTS = """
from tests.games.last_standing import Scenario
GYMNASIUM_PREFIX = {prefix}
SCENARIOS = {scenarios}
"""
IMPORT = """
import json, warnings
import gymnasium
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    import marl_cair
told = {str(warning.message).split("'")[1]: str(warning.message) for warning in caught}
entry = gymnasium.spec("marl_cair/DeepRTS-1v1-15x15-v0").kwargs["game"]
print(json.dumps([told, list(marl_cair.GAMES), entry]))
"""


def test_whatever_is_wrong_with_packages_ours_can_be_imported(tmp_path):
    for name, (prefix, scenarios, _) in BROKEN.items():
        install(tmp_path, name, f"{name}_game", PARTS.format(prefix=prefix, scenarios=scenarios))
    whole = PARTS.format(prefix="'Whole'", scenarios="{'a': Scenario()}")
    install(tmp_path, "whole", "whole_game", whole)
    done = run_python(tmp_path, "-c", IMPORT)
    assert done.returncode == 0, done.stderr
    told, games, entry = json.loads(done.stdout)
    assert games == [*GAMES, "whole"]
    assert entry == "deep_rts"
    assert set(told) == set(BROKEN)
    for name, (*_, why) in BROKEN.items():
        assert f"the game '{name}' of {name}_game ({name}_game) cannot be loaded" in told[name]
        assert why in told[name]


def test_a_game_that_cannot_be_described_is_left_out_of_the_list(tmp_path):
    make = "def fail(scenario):\n    1 / 0\nGAME = dataclasses.replace(GAME, make_spec=fail)\n"
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE + make)
    for form in ([], ["--markdown"], ["--json"]):
        done = run_python(tmp_path, "-m", "marl_cair", "games", *form)
        assert done.returncode == 0, done.stderr
        assert "foreign_game (foreign_game) cannot be loaded: ZeroDivisionError" in done.stderr
        assert "Last standing" not in done.stdout
        assert "Flappy Bird" in done.stdout
    assert set(json.loads(done.stdout)) == set(GAMES)
