"""Notices where the compiler takes more than a second."""

import pytest

from marl_cair.games import compiled as announcing
from marl_cair.games import make_engine
from marl_cair.games.compiled import announce_nothing, calling, compiling
from tests.games.cases import replace_kernels
from tests.games.test_compiled import run_python

NOTICE = "marl_cair: compiling the rules of chess (once for each version) ...\n"


@pytest.fixture
def waits(monkeypatch):
    """The seconds of all timers; each is over at once."""
    seconds: list[float] = []

    class Timer:
        def __init__(self, interval, tell, arguments):
            seconds.append(interval)
            self.start = lambda: tell(*arguments)

        def cancel(self):
            """It is over."""

    monkeypatch.setattr(announcing.threading, "Timer", Timer)
    monkeypatch.setattr(announcing, "_announced_games", set())
    return seconds


def test_compiling_is_announced_once_for_each_game(waits, capsys):
    for game in ("chess", "chess", "go"):
        with calling(game), compiling():
            pass
    assert capsys.readouterr().err == NOTICE + NOTICE.replace("chess", "go")
    assert waits == [announcing.ANNOUNCE_AFTER_SECONDS] * 3


def test_a_first_call_that_compiles_nothing_says_nothing_however_long_it_takes(waits, capsys):
    with calling("chess"):
        pass
    assert (waits, capsys.readouterr().err) == ([], "")


def test_a_rule_that_is_of_no_game_is_compiled_without_a_word(waits, capsys):
    with calling("chess"):
        pass
    with compiling():
        pass
    assert (waits, capsys.readouterr().err) == ([], "")


def test_a_game_that_is_left_out_is_not_announced(waits, capsys):
    announce_nothing(["chess"])
    with calling("chess"), compiling():
        pass
    assert capsys.readouterr().err == ""


CALL_AT_ONCE = """
import sys
sys.stderr = sys.stdout
from marl_cair.games import compiled
compiled.ANNOUNCE_AFTER_SECONDS = 0.0
import marl_cair
marl_cair.make_engine("flappy_bird").reset(0)
"""


@pytest.mark.slow
def test_rules_that_were_compiled_before_are_read_without_a_word(tmp_path):
    shown = run_python(CALL_AT_ONCE, tmp_path, NUMBA_DISABLE_JIT="0")
    assert " ".join(shown) == NOTICE.replace("chess", "flappy_bird").strip()
    assert run_python(CALL_AT_ONCE, tmp_path, NUMBA_DISABLE_JIT="0") == []


def test_a_picture_is_of_the_game_that_draws_it():
    """What drawing compiles is announced as of that game."""
    called = []

    def draw(*arguments):
        called.append(announcing._called.get())

    replace_kernels(make_engine("flappy_bird"), draw=draw).render()
    assert called == ["flappy_bird"]
    assert announcing._called.get() == ""
