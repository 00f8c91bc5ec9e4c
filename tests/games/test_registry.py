"""The table of games: scenarios that users add, and games of installed packages."""

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
        (("deep_line_wars", "a b"), {}, ValueError, "'a b' is not a valid scenario name"),
        (("deep_line_wars", ""), {}, ValueError, "'' is not a valid scenario name"),
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


@pytest.mark.slow
def test_a_users_scenario_is_known_to_processes_that_gymnasium_spawns(tmp_path):
    done = run_python(tmp_path, "-c", IN_OTHER_PROCESSES)
    assert done.stdout == "(8, 9)\n", done.stderr


@pytest.mark.usefixtures("_scenarios_kept")
def test_a_gymnasium_id_names_the_scenario_of_the_game_and_what_differs():
    marl_cair.register_scenario("deep_line_wars", "low", base="11x11", rows=8)
    added = marl_cair.register_scenario("deep_line_wars", "small", base="low", columns=9)
    shown = {"game": "deep_line_wars", "scenario": "11x11", "rows": 8, "columns": 9}
    assert gymnasium.spec(added).kwargs == shown
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
    with pytest.raises(ValueError, match="SCENARIOS is a mappingproxy"):
        marl_cair.register_scenario("fixed", "mine")


# --- all games ---------------------------------------------------------------------------------


def test_games_can_be_listed_and_have_titles():
    assert len(GAMES) == len(list(GAMES)) > 0
    for name, game in GAMES.items():
        assert game.name == name
        assert game.title
        assert game.summary
        assert next(iter(game.scenarios)) == game.default_scenario


LIST_MODULES = """
import sys
import gymnasium
print(*(name for name in gymnasium.registry if name.startswith("marl_cair/")))
import marl_cair
print(*sys.modules)
print(*(name for name in gymnasium.registry if name.startswith("marl_cair/")))
"""


@pytest.mark.slow
def test_importing_the_package_registers_ids_and_loads_no_rules(tmp_path):
    done = run_python(tmp_path, "-c", LIST_MODULES)
    before, modules, ids = (line.split() for line in done.stdout.split("\n")[:3])
    assert before == []
    assert len(ids) == len(set(ids)) == sum(len(game.scenarios) for game in GAMES.values())
    ours = {name for name in modules if name.startswith("marl_cair")}
    assert {f"marl_cair.games.{game}" for game in GAMES} < ours
    for part in ("definition", "rules", "state", "observation"):
        assert not ours & {f"marl_cair.games.{game}.{part}" for game in GAMES}
    assert not {"numba", "torch"} & set(modules)


def test_unknown_attributes_are_named():
    for module in (marl_cair, GAMES.modules["deep_line_wars"]):
        with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
            module.nothing  # noqa: B018


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
    """What `marl-cair games --json` prints, and its warnings."""
    done = run_python(folder, "-c", "from marl_cair.cli import main; main(['games', '--json'])")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.mark.slow
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


BROKEN = "import no_such_module_anywhere"
CHANGED = "GAME = dataclasses.replace(GAME, {})\n"
FAILING = "def fail(scenario):\n    1 / 0\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("foreign", BROKEN, "No module named 'no_such_module_anywhere'"),
        ("foreign", "SCENARIOS = {}", "has no attribute 'GYMNASIUM_PREFIX'"),
        ("deep_rts", GAME_MODULE, "a game 'deep_rts' already"),
        ("other", GAME_MODULE, "GAME.name is 'foreign', the entry point's 'other'"),
        ("foreign", GAME_MODULE + FAILING + CHANGED.format("make_spec=fail"), "ZeroDivisionError"),
        ("foreign", GAME_MODULE.replace('"Foreign"', "'DeepRTS'"), "'DeepRTS'"),
        ("foreign", GAME_MODULE.replace('"Foreign"', "'My Game'"), "'My Game' is not a valid name"),
        ("foreign", f"{GAME_MODULE}SCENARIOS = {{'a': 0}}", "the scenario 'a' is 0"),
        (
            "foreign",
            f"{GAME_MODULE}del GAME\ndef __getattr__(name):\n    1 / 0",
            "ZeroDivisionError",
        ),
    ],
)
def test_a_broken_package_is_left_out_with_a_warning(tmp_path, name, text, why):
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


@pytest.mark.slow
@pytest.mark.parametrize("warnings", ["default", "error"])
def test_a_broken_package_does_not_keep_ours_from_being_imported(tmp_path, warnings):
    install(tmp_path, "foreign", "foreign_game", BROKEN)
    done = run_python(
        tmp_path, "-W", warnings, "-c", "from marl_cair import GAMES; print([*GAMES])"
    )
    assert done.stdout == f"{list(GAMES)}\n", done.stderr
    assert "BrokenGameWarning: the game 'foreign' of foreign_game" in done.stderr


@pytest.mark.slow
def test_a_package_may_be_imported_before_ours(tmp_path):
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE)
    program = """
import foreign_game, gymnasium
from marl_cair import GAMES
print([*GAMES], gymnasium.make("marl_cair/Foreign-duel-v0").unwrapped.engine.num_players)
"""
    done = run_python(tmp_path, "-c", program)
    assert done.stdout == f"{[*GAMES, 'foreign']} 2\n", done.stderr
    assert "BrokenGameWarning" not in done.stderr


@pytest.mark.slow
def test_a_package_may_look_games_up_while_it_is_imported(tmp_path):
    ask = "from marl_cair import GAMES\nassert GAMES['deep_maze'].scenarios\n"
    install(tmp_path, "foreign", "foreign_game", ask + GAME_MODULE)
    listed, warned = list_games(tmp_path)
    assert list(listed) == [*GAMES, "foreign"]
    assert "BrokenGameWarning" not in warned


@pytest.mark.slow
def test_a_game_that_cannot_be_described_is_left_out_of_the_list(tmp_path):
    text = GAME_MODULE + FAILING + CHANGED.format("make_spec=fail")
    install(tmp_path, "foreign", "foreign_game", text)
    for form in ([], ["--json"]):
        done = run_python(tmp_path, "-m", "marl_cair", "games", *form)
        assert done.returncode == 0, done.stderr
        assert "foreign_game (foreign_game) cannot be loaded: ZeroDivisionError" in done.stderr
        assert "Last standing" not in done.stdout
        assert "Flappy Bird" in done.stdout
    assert set(json.loads(done.stdout)) == set(GAMES)


LATE = """
def make_late(scenario):
    return last_standing.make_spec(scenario) if scenario.num_players == 2 else 1 / 0
"""


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


@pytest.mark.slow
def test_commands_leave_out_broken_packages(tmp_path):
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


@pytest.mark.slow
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


TRAIN = """
from marl_cair.cli import main
raise SystemExit(main(["train", "game=foreign", "total_frames=2_048", "out=run"]))
"""


@pytest.mark.slow
def test_a_game_without_a_random_bot_trains_at_defaults(tmp_path):
    only_idle = GAME_MODULE + CHANGED.format("bots={'idle': last_standing.GAME.bots['idle']}")
    install(tmp_path, "foreign", "foreign_game", only_idle)
    done = run_python(tmp_path, "-c", TRAIN)
    assert done.returncode == 0, done.stderr
    saved = json.loads((tmp_path / "run" / "latest" / "agent.json").read_text("utf-8"))
    assert saved["game"] == "foreign"
