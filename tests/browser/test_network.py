"""A trained agent on the page decides as it does in Python."""

import os

import numpy as np
import pytest

from marl_cair.browser import folder as folder_module
from marl_cair.browser.compiling import load_rules
from marl_cair.browser.runtime import find_runtime
from marl_cair.cli.viewing.browser_play import write_game
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.replays import hash_state
from marl_cair.league.agents.load import load_agent
from marl_cair.npm import InstallError
from tests.browser.conftest import open_page
from tests.test_architecture import ROOT

AGENT = str(ROOT / "agents" / "deep_line_wars_10x15")
STEPS, SEED, BOT = 200, 5, "counter"
# Through the page: a person gives a random legal order at each step; a new game follows an end.
PLAY = """async (steps) => {
  const games = [];
  let word = 1;
  for (let left = steps; left > 0; left--) {
    const mask = play.rules.legalActions(0).slice();
    const legal = [...mask.keys()].filter((action) => mask[action]);
    word = (Math.imul(word, 1664525) + 1013904223) >>> 0;
    play.controls.order(legal[word % legal.length], "");
    await play.stepOnce();
    if (!play.rules.isOver && left > 1) continue;
    games.push({ seed: play.seed, played: play.played, hash: await play.rules.hash() });
    play.seedNext = String(Number(play.seed) + 1);
    play.begin();
  }
  return games;
}"""


@pytest.fixture(scope="module")
def page_folder(tmp_path_factory):
    """What `marl-cair play deep_line_wars --browser` writes."""
    try:
        find_runtime()
    except InstallError as error:
        if "MARL_CAIR_NEEDS_BROWSER" in os.environ:  # set by .ci/run
            raise
        pytest.skip(f"needs onnxruntime-web ({error}) and the extra `export`")
    game, made = GAMES["deep_line_wars"], tmp_path_factory.mktemp("network") / "page"
    with pytest.MonkeyPatch.context() as patch:
        # The file that other tests have compiled: the same rules, with a bot that is not asked.
        load = lambda game, scenario, *_: load_rules(game, scenario, BOT, "")  # noqa: E731
        patch.setattr(folder_module, "load_rules", load)
        write_game(made, game, None, (), AGENT)
    return made


def test_a_network_on_the_page_plays_as_in_python(browser, page_folder):
    with open_page(browser, page_folder, search=f"?seed={SEED}") as page:
        games = page.evaluate(PLAY, STEPS)
    game, agent = GAMES["deep_line_wars"], load_agent(AGENT)
    engine = BatchedEngine(game, game.scenario())
    assert sum(len(one["played"]) for one in games) == STEPS
    for one in games:
        engine.reset(int(one["seed"]))
        for actions in one["played"]:
            seen, mask = engine.observe(agent.representation)[:, 1], engine.action_mask()[:, 1]
            (values,) = agent.values(seen.copy(), mask.copy())
            # Of actions with the same value to four digits it may choose another.
            assert values[actions[1]] >= values.max() - 1e-4
            engine.step(np.array([actions]))
        assert one["hash"].startswith(hash_state(engine).hex())
