"""A game in the browser and the same actions in Python: the same states, pictures and bots."""

import hashlib

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from tests.browser.conftest import open_page

# Games of random legal actions, kinds first, so that a kind with many cells does not crowd out all
# others; every tenth game is the bot's in all seats.
PLAY = """async ([first, count]) => {
  const { rules, game: { actions, opponent } } = play;
  let word = first + 1;
  const draw = (limit) => {
    word = (Math.imul(word, 1664525) + 1013904223) >>> 0;
    return Math.floor(word / 4294967296 * limit);
  };
  const choose = (mask) => {
    const legal = [...mask.keys()].filter((action) => mask[action]);
    const kinds = [...new Set(legal.map((action) => actions.groups[action]))];
    const kind = kinds[draw(kinds.length)];
    const members = legal.filter((action) => actions.groups[action] === kind);
    return members[draw(members.length)];
  };
  const games = [], seats = [...Array(rules.numPlayers).keys()];
  for (let seed = first; seed < first + count; seed++) {
    rules.reset(seed);
    rules.arrays.random[0] = BigInt(seed);
    const played = [];
    while (!rules.isOver) {
      let chosen;
      if (seed % 10 === 1) {
        rules.legalActions(0);
        rules.observe(opponent.representation, 0);
        rules.run("decide");
        chosen = Array.from(rules.arrays.decisions, Number);
      } else chosen = seats.map((seat) => choose(rules.legalActions(seat)));
      rules.step(chosen);
      played.push(...chosen);
    }
    games.push({ seed, played, hash: await rules.hash() });
  }
  return games;
}"""
PICTURES = """async ([seed, actions, seat, names]) => {
  const { rules } = play;
  rules.reset(seed);
  for (const chosen of actions) rules.step(chosen);
  const seen = names.map((name) => rules.observe(name, seat).slice());
  const hashes = await Promise.all(seen.map((one) => crypto.subtle.digest("SHA-256", one)));
  return hashes.map((one) => Array.from(new Uint8Array(one)));
}"""
QUICK = 20
# Scenario and number of games.
SLOW = {
    "deep_line_wars": (None, 1_000),
    "deep_maze": (None, 1_000),
    "deep_rts": (None, 1_000),
    "deep_rts-fog": ("1v1-15x15-fog", 100),
    "deep_rts-six": ("FFA-6-15x15", 100),
    "flappy_bird": (None, 1_000),
}


def hash_state(engine):
    """As `games.replays.hash_state`, whole."""
    state = engine.snapshot()
    arrays = (*state.world, *state.outcome)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def check_game(game, engine, bot):
    """The game has the browser's state at its end, and the bot decides as it did there."""
    actions = np.array(game["played"], np.int32).reshape(-1, engine.num_players)
    is_bots = game["seed"] % 10 == 1
    engine.reset(game["seed"])
    bot.seed(game["seed"])
    for row in actions:
        if is_bots:
            shown = engine.observe(bot.representation)[0]
            np.testing.assert_array_equal(bot.act(shown, engine.action_mask()[0]), row)
        engine.step(row[None])
    assert engine.terminated[0] or engine.truncated[0]
    assert hash_state(engine) == game["hash"], f"seed {game['seed']}"


def check_games(browser, folders, name, num_games, scenario_name=None):
    game = GAMES[name]
    scenario = game.scenario(scenario_name)
    engine, bot = BatchedEngine(game, scenario), game.bot([*game.bots][-1], scenario)
    with open_page(browser, folders(name, scenario_name)) as page:
        for first in range(0, num_games, QUICK):
            found = page.evaluate(PLAY, [first, QUICK])
            assert len(found) == QUICK
            for played in found:
                check_game(played, engine, bot)


# All games: slow, below. To compile the rules of Deep RTS takes minutes.
@pytest.mark.parametrize("name", ["deep_line_wars", "deep_maze", "flappy_bird"])
def test_games_end_in_the_state_of_python(browser, folders, name):
    check_games(browser, folders, name, QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("case", SLOW)
def test_a_thousand_games_end_in_the_state_of_python(browser, folders, case):
    scenario, num_games = SLOW[case]
    check_games(browser, folders, case.partition("-")[0], num_games, scenario)


def test_the_picture_is_that_of_python(browser, folders):
    game = GAMES["deep_line_wars"]
    engine = BatchedEngine(game, game.scenario())
    engine.reset(3)
    actions = []
    bot = game.bot("counter", engine.scenario)
    for _ in range(30):
        chosen = bot.act(engine.observe("planes")[0], engine.action_mask()[0])
        actions.append(chosen.tolist())
        engine.step(chosen[None])
    with open_page(browser, folders(game.name)) as page:
        for seat in range(engine.num_players):
            seen = page.evaluate(PICTURES, [3, actions, seat, ["picture", "vector"]])
            for found, shown in zip(seen, ("image", "vector"), strict=True):
                expected = engine.observe(shown)[0, seat].tobytes()
                assert bytes(found) == hashlib.sha256(expected).digest(), (shown, seat)


def test_the_state_between_two_steps_is_shown_and_forgotten(browser, folders):
    look = """async () => {
      const { rules } = play;
      rules.reset(1);
      rules.step([1, 1]);
      const hash = await rules.hash();
      const pictures = [0, 5, 10].map((ticks) => rules.glimpse([0, 0], ticks, 0)[0].join());
      const isKept = hash === await rules.hash();
      rules.step([0, 0]);
      return [isKept, pictures, rules.observe("picture", 0).join()];
    }"""
    with open_page(browser, folders("deep_line_wars")) as page:
        is_kept, (first, middle, last), after = page.evaluate(look)
    assert is_kept
    assert len({first, middle, last}) == 3
    assert last == after
