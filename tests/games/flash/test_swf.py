"""Our Flash games: reproducible builds, scenes, rules of multitask and duel."""

import random
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from marl_cair.games.flash import bots
from marl_cair.games.flash.browser.server import FlashServer, KeyEvent, MouseEvent
from tests.games.flash.browser.flash_files import SIZE, need_flash

SWF = Path(bots.__file__).parent / "swf"
NAMES = ["multitask", "duel"]
TICKS_PER_STEP = 4
DUEL_CHOICES = [
    [set(), {"w"}, {"s"}, {"d"}, {"a"}, {"w", "d"}, {"s", "d"}],
    [set(), {"up"}, {"down"}, {"left"}, {"right"}, {"up", "left"}, {"down", "left"}],
]
MIRROR = dict(zip("wsda", ["up", "down", "left", "right"], strict=True))
MIRROR |= {theirs: ours for ours, theirs in MIRROR.items()}


class Player:
    """Holds keys, and reads the state of a game."""

    def __init__(self, name):
        need_flash()
        self.server = FlashServer(SWF / f"{name}.swf", SIZE, 30, mode="lockstep")
        self.server.watch("getState")
        self.reset(1)

    def reset(self, seed):
        self.held = set()
        self.server.reset(seed)
        self.server.step(2, (), None)

    @property
    def state(self):
        return self.server.values["getState"]

    def hold(self, keys, num_frames=1, picture=None):
        keys = set(keys)
        events = [KeyEvent(key, False) for key in sorted(self.held - keys)]
        events += [KeyEvent(key, True) for key in sorted(keys - self.held)]
        self.held = keys
        return self.server.step(num_frames, events, picture)

    def click(self, x, y):
        self.server.step(1, [MouseEvent(x, y), MouseEvent(x, y, True), MouseEvent(x, y)], None)

    def start(self, seed):
        self.reset(seed)
        self.hold({"enter"})
        self.hold(set(), 0)
        assert self.state["scene"] == "stage"

    def play(self, policy, max_ticks=10_000):
        """Plays to the end, with a choice of keys every few ticks; returns the last state."""
        while not self.state["done"] and self.state["tick"] < max_ticks:
            self.hold(policy(self.state), TICKS_PER_STEP)
        return self.state


@pytest.fixture(scope="module", params=NAMES)
def game(request):
    player = Player(request.param)
    yield player
    player.server.close()


@pytest.fixture(scope="module")
def multitask():
    player = Player("multitask")
    yield player
    player.server.close()


@pytest.fixture(scope="module")
def duel():
    player = Player("duel")
    yield player
    player.server.close()


def test_source_builds_the_same_bytes(tmp_path):
    if shutil.which("haxe") is None:
        pytest.skip("haxe is missing: apt install haxe")
    source = shutil.copytree(SWF / "source", tmp_path / "source")
    subprocess.run(["haxe", "build.hxml"], cwd=source, check=True)
    for name in NAMES:
        assert (tmp_path / f"{name}.swf").read_bytes() == (SWF / f"{name}.swf").read_bytes()


# --- scenes -----------------------------------------------------------------------------------


def test_click_on_play_starts_a_game(game):
    game.reset(1)
    game.click(30, 330)
    assert game.state["scene"] == "menu"
    game.click(240, 190)
    assert game.state["scene"] == "stage"


def test_over_stays_until_enter(game):
    game.reset(1)
    game.click(240, 190)  # the button that has the focus disappears: keys must work all the same
    game.play(lambda state: set())
    over = game.state
    assert over["scene"] == "over"
    game.hold({"left"}, 30)
    assert game.state == over
    game.hold({"enter"}, 5)  # a key that is held counts once
    assert game.state["scene"] == "menu"
    assert game.state["tick"] == 0


def test_over_stays_until_click(game):
    game.start(1)
    game.play(lambda state: set())
    game.click(5, 5)
    assert game.state["scene"] == "menu"


def test_menu_shows_the_mouse_cursor(game):
    game.reset(1)
    game.server.step(1, [MouseEvent(40, 300)], None)
    before = game.server.step(0, (), SIZE)
    after = game.server.step(1, [MouseEvent(400, 320)], SIZE)
    assert before[295:340, 38:60].max() > 200 > after[295:340, 38:60].max()


def test_equal_seeds_give_equal_games(game):
    def play_and_record(seed):
        game.start(seed)
        keys = random.Random(7)
        names = ["left", "right", "up", "down", "w", "s", "d", "a"]
        states = []
        for _ in range(30):
            game.hold(keys.sample(names, 2), 2)
            states.append(game.state)
        return states

    assert play_and_record(5) == play_and_record(5)
    assert play_and_record(5) != play_and_record(6)


# --- multitask --------------------------------------------------------------------------------


def test_ball_rolls_off_if_nobody_steers(multitask):
    for seed in range(5):
        multitask.start(seed)
        state = multitask.play(lambda state: set())
        assert 50 < state["tick"] < 120
        assert (state["failed"], state["score"]) == ("balance", state["tick"])


def test_keys_tilt_the_paddle(multitask):
    multitask.start(3)
    multitask.hold({"right"}, 10)
    right = multitask.state["balance"]["angle"]
    multitask.hold({"a"}, 20)  # the same as the left arrow
    assert multitask.state["balance"]["angle"] < 0 < right


@pytest.mark.slow
def test_scripted_player_keeps_four_tasks_going(multitask):
    multitask.start(2)
    stages = {}

    def policy(state):
        stages.setdefault(state["stage"], state["tick"])
        return bots.play_multitask(state)

    state = multitask.play(policy, max_ticks=2400)
    assert not state["done"]
    assert {"balance", "dodge", "jump", "hover"} <= set(state)
    starts = [0, 300, 900, 1800]
    assert all(stages[i + 1] - starts[i] <= TICKS_PER_STEP for i in range(4))


def test_random_player_fails_early(multitask):
    keys = random.Random(1)
    pairs = [(), *[(key,) for key in MIRROR.values()][:4]]
    ticks = []
    for seed in range(10):
        multitask.start(seed)
        ticks.append(multitask.play(lambda state: keys.choice(pairs))["tick"])
    assert 20 < np.mean(ticks) < 120


# --- duel -------------------------------------------------------------------------------------


def play_random_keys(duel, seed, mirrored, picture=None):
    """States and last picture of a game of random keys; `mirrored` exchanges the players' keys."""
    keys = random.Random(3)
    duel.start(seed)
    states = []
    shown = None
    while not duel.state["done"]:
        chosen = set().union(*(keys.choice(choices) for choices in DUEL_CHOICES))
        shown = duel.hold({MIRROR[key] for key in chosen} if mirrored else chosen, 4, picture)
        states.append(duel.state)
        if picture is not None and duel.state["tick"] > 150:
            break
    return states, shown


def mirror(state):
    bolts = [
        {**bolt, "x": -bolt["x"], "vx": -bolt["vx"], "owner": 1 - bolt["owner"]}
        for bolt in state["bolts"]
    ]
    return {
        **state,
        "score": -state["score"],
        "scores": state["scores"][::-1],
        "players": state["players"][::-1],
        "winner": state["winner"] if state["winner"] < 0 else 1 - state["winner"],
        "bolts": sorted(bolts, key=str),
    }


def test_mirrored_keys_give_the_mirrored_game(duel):
    for seed in range(3):
        ours, _ = play_random_keys(duel, seed, mirrored=False)
        theirs, _ = play_random_keys(duel, seed, mirrored=True)
        assert [mirror(state) for state in ours] == [
            {**state, "bolts": sorted(state["bolts"], key=str)} for state in theirs
        ]


def test_mirrored_game_looks_mirrored_in_grey(duel):
    grey = [0.299, 0.587, 0.114]
    ours, theirs = (
        play_random_keys(duel, 4, mirrored, SIZE)[1] @ grey for mirrored in (False, True)
    )
    assert np.abs(ours[:, ::-1] - theirs).mean() < 0.5
    assert np.abs(ours - theirs).mean() > 2


def test_scripted_player_beats_random_from_both_sides(duel):
    keys = random.Random(5)
    for player in (0, 1):
        for seed in range(3):
            duel.start(seed)
            state = duel.play(
                lambda state, player=player: (
                    bots.play_duel(state, player) | keys.choice(DUEL_CHOICES[1 - player])
                )
            )
            assert state["winner"] == player
            assert state["scores"][player] >= 3


def test_nobody_fires_and_the_game_is_a_draw(duel):
    duel.start(1)
    state = duel.play(lambda state: set())
    assert (state["tick"], state["winner"], state["scores"]) == (1800, -1, [0, 0])


def test_walls_close_in(duel):
    duel.start(1)
    walls = []
    duel.play(lambda state: walls.append(state["wall"]) or set())
    assert (walls[0], walls[-1]) == (160, 60)
    assert all(after <= before for before, after in pairwise(walls))


def test_shield_throws_a_bolt_back(duel):
    duel.start(1)
    duel.hold({"s", "down"}, 26)  # both below the block
    duel.hold({"d"}, 1)
    duel.hold({"right"}, 30)
    assert [bolt["owner"] for bolt in duel.state["bolts"]] == [1]
    duel.hold(set(), 30)
    assert duel.state["scores"] == [0, 1]
