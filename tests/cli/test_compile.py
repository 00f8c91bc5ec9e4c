"""`marl-cair compile`: afterwards no use of a game compiles anything."""

import os

import pytest
from numba import typeof

from marl_cair.cli import main
from marl_cair.games import GAMES
from marl_cair.games import engine as engine_module
from marl_cair.games.precompile import Part, compile_part, list_parts
from tests.games.cases import DEFAULT_CASES, IN_PROCESS
from tests.games.test_registry import install, run_python
from tests.refusals import assert_refused

# A game of a package, of which one function is a compiled rule.
GAME_MODULE = """
import dataclasses
from marl_cair.games.compiled import compiled
from tests.games import last_standing

@compiled
def allow_all(worlds, rules, out, first, last):
    out[first:last] = True

SCENARIOS = {"duel": last_standing.GAME.scenarios["duel"]}
GYMNASIUM_PREFIX = "Foreign"
GAME = dataclasses.replace(
    last_standing.GAME, name="foreign", scenarios=SCENARIOS, gymnasium_prefix="Foreign",
    default_scenario="duel", legal_actions=allow_all,
)
"""
COUNT_COMPILED = """
from numba.core import event
with event.install_recorder("numba:compile") as compiled:
    import marl_cair
    engine = marl_cair.make_engine("{game}", {scenario!r}, num_worlds=3, num_threads=2)
    engine.reset(engine.action_mask()[:, 0, 0].astype("uint64"))
    engine.step(engine.action_mask().argmax(-1))
    for representation in engine.spec.representations:
        engine.observe(representation)
    for name in engine.game.bots:
        bot = engine.game.bot(name, engine.scenario)
        bot.act(engine.observe(bot.representation)[:, 1], engine.action_mask()[:, 1])
    engine.render()
print(len(compiled.buffer))
"""


def run(folder, cache, *arguments):
    """What a process prints that finds packages in `folder` and has a compiler cache of its own."""
    settings = {"MARL_CAIR_CACHE": str(cache), "NUMBA_DISABLE_JIT": "0"}
    done = run_python(folder, *arguments, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("game", "scenario"), [("foreign", "duel"), ("flappy_bird", "race-4-windy")]
)
def test_after_it_nothing_is_compiled_any_more(tmp_path, game, scenario):
    install(tmp_path, "foreign", "foreign_game", GAME_MODULE)
    cache, play = tmp_path / "cache", COUNT_COMPILED.format(game=game, scenario=scenario)
    shown = run(tmp_path, cache, "-m", "marl_cair", "compile", game, "--workers", "2")
    assert shown.startswith(f"compiled the rules of {game} in ")
    assert shown.endswith(f" s: {cache}\n")
    assert run(tmp_path, cache, "-c", play) == "0\n"
    assert int(run(tmp_path, tmp_path / "empty", "-c", play)) > 0


def test_every_way_of_use_of_every_game_is_compiled_and_resets_first():
    parts = list_parts(list(GAMES))  # games in browsers have no rules to compile
    assert len(set(parts)) == len(parts)
    assert {part.use for part in parts[: len(IN_PROCESS)]} == {"reset"}
    assert {part.game for part in parts} == set(IN_PROCESS)
    for name in IN_PROCESS:
        game = GAMES[name]
        uses = {part.use for part in parts if part.game == name}
        specs = [game.make_spec(scenario) for scenario in game.scenarios.values()]
        seen = {name for spec in specs for name in spec.representations}
        assert uses == {"reset", "step", "bots", "picture"} | seen


@pytest.mark.parametrize("case", DEFAULT_CASES, ids=str)
def test_a_step_with_every_kind_of_actions_is_compiled(case, monkeypatch):
    """Of what the kernels are given only the types count, so nothing needs to run here."""
    given = set()

    def note(kernel, *arguments):
        given.add((kernel, tuple(map(typeof, arguments))))
        return lambda *_: None

    monkeypatch.setattr(engine_module, "settled", note)
    compile_part(Part(case.game, "step"))
    ahead = given.copy()
    engine = case.engine()
    engine.reset(0)
    engine.step(engine.action_mask().argmax(-1))
    assert len(ahead) >= 3
    assert given == ahead


def test_it_refuses_with_one_line(capsys, monkeypatch):
    assert_refused(capsys, "nearest are 'flappy_bird'", "compile", "flapy_bird")
    words = ("flappy_bird", "--workers", "0")
    assert_refused(capsys, "num_workers is 0, it must be at least 1", "compile", *words)
    monkeypatch.setattr("marl_cair.cli.compile.is_compiling", lambda: False)
    assert_refused(capsys, "NUMBA_DISABLE_JIT is set", "compile")


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs sched_setaffinity")
def test_by_default_there_are_as_many_workers_as_cores_that_it_may_use(monkeypatch):
    asked = []
    monkeypatch.setattr(
        "marl_cair.cli.compile.compile_parts", lambda _, num: asked.append(num) or []
    )
    before = os.sched_getaffinity(0)
    try:
        for cores in ({min(before)}, before):
            os.sched_setaffinity(0, cores)
            main(["compile", "flappy_bird"])
    finally:
        os.sched_setaffinity(0, before)
    assert asked == [1, len(before)]
