"""Rules as WebAssembly give what they give in Python: sums, shares, arrays of all shapes."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from marl_cair.browser import compiling
from marl_cair.browser.compiling import load_rules
from marl_cair.games import GAMES
from marl_cair.games.deep_rts import scenarios
from marl_cair.games.deep_rts.maps import maps
from tests.browser import small_rules
from tests.chromium import watched_page

RUN = """async ([code, arrays]) => {
  const bytes = Uint8Array.from(atob(code), (letter) => letter.charCodeAt(0));
  const memory = new WebAssembly.Memory({ initial: 80 });
  const stack = new WebAssembly.Global({ value: "i32", mutable: true }, 4 << 20);
  const env = { __linear_memory: memory, __stack_pointer: stack, log2: Math.log2 };
  const { instance } = await WebAssembly.instantiate(bytes, { env });
  const status = instance.exports.run(3n);
  return [status, arrays.map(([at, size]) => Array.from(new Uint8Array(memory.buffer, at, size)))];
}"""


@pytest.fixture(scope="module")
def modules():
    """What small_rules.py prints: it changes numba in its process."""
    command = [sys.executable, small_rules.__file__]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", ["count", "divide", "fill", "flatten", "wrap"])
def test_a_rule_writes_what_it_writes_in_python(browser, modules, name):
    rule, arrays = small_rules.RULES[name]
    code, places = modules[name]
    expected = [array.copy() for array in arrays()]
    with np.errstate(over="ignore"):
        rule.py_func(*expected, 3)
    with watched_page(browser) as page:
        status, found = page.evaluate(RUN, [code, places])
    assert status == 0
    assert [bytes(content) for content in found] == [array.tobytes() for array in expected]


def test_a_rule_may_not_call_what_browsers_round_differently(modules):
    assert modules["logarithm"] == (
        "the rules call log2, whose last bit differs from one browser to another: write them "
        "without, or with a table"
    )


def test_a_rule_may_not_call_what_a_page_does_not_have(modules):
    expected = "the rules call sin, which WebAssembly does not have: write them without"
    assert modules["sine"] == expected


def test_without_the_compiler_nothing_is_compiled(monkeypatch):
    monkeypatch.setattr(compiling, "is_compiling", lambda: False)
    game = GAMES["flappy_bird"]
    with pytest.raises(ValueError, match="NUMBA_DISABLE_JIT is set.*unset it"):
        load_rules(game, game.scenario(), "oracle", "")


def test_a_compiler_without_webassembly_is_named(monkeypatch):
    monkeypatch.setattr(compiling.lowering, "TRIPLE", "pdp11-unknown-unknown")
    with pytest.raises(ValueError, match="cannot write WebAssembly.*pip install --upgrade numba"):
        compiling.require_compiler()


def test_what_is_compiled_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("MARL_CAIR_CACHE", str(tmp_path))
    game = GAMES["flappy_bird"]
    kept = tmp_path / "browser"
    kept.mkdir()
    name = compiling._digest(game, game.scenario(), "oracle", "")
    (kept / f"{name}.wasm").write_bytes(b"kept")
    assert load_rules(game, game.scenario(), "oracle", "features") == b"kept"
    others = [
        compiling._digest(game, game.scenario(), "reflex", ""),
        compiling._digest(game, game.scenario(pipe_gap=120), "oracle", ""),
    ]
    assert len({name, *others}) == 3


def test_another_map_in_the_same_file_is_compiled_again(tmp_path):
    game, path = GAMES["deep_rts"], tmp_path / "mine.txt"
    digests = []
    for name in ("15x15-2p-crossing", "21x21-2p-fords"):
        path.write_bytes((Path(maps.__file__).parent / "files" / f"{name}.txt").read_bytes())
        scenarios._load_maps.cache_clear()  # as in a new process
        digests.append(compiling._digest(game, game.scenario(map=str(path)), "rusher", ""))
    assert digests[0] != digests[1]


def test_rounded_logarithms_of_javascript_are_those_of_python(browser):
    """Deep RTS shows amounts on a scale of logarithms: each whole amount has the same level."""
    find = """(step) => {
      let sum = 0;
      for (let n = 0; n < 1 << 20; n++) {
        sum = (sum * 31 + Math.floor(step * Math.log2(1 + n) + 0.5)) % 1000003;
      }
      return sum;
    }"""
    from marl_cair.games.deep_rts.views.planes import LOG_STEP

    expected = 0
    for level in map(math.log2, range(1, (1 << 20) + 1)):
        expected = (expected * 31 + int(LOG_STEP * level + 0.5)) % 1_000_003
    with watched_page(browser) as page:
        assert page.evaluate(find, LOG_STEP) == expected
