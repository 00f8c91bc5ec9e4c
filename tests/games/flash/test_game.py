"""Flash as a game like the others: determinism, and all environments, in real browsers."""

import dataclasses
import json
import os
import re
import runpy
import tomllib
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from PIL import Image
from torchrl.envs.utils import check_env_specs

import marl_cair
from marl_cair.games import flash
from marl_cair.games.engine import NoSnapshotError
from marl_cair.games.flash import rules
from marl_cair.games.flash.browser.server import FlashError
from marl_cair.games.flash.description import FOLDER, find_description
from marl_cair.games.replays import ReplayWriter, read_replay, replay_steps
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import play_alone
from tests.games.flash.browser.flash_files import change_page, need_flash

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # PettingZoo's own, of its example games
    from pettingzoo.test import parallel_api_test


@pytest.fixture(scope="module", autouse=True)
def _needs_browsers():
    need_flash()


def play(engine, seeds, num_steps):
    """Observations, rewards and numbers of random play, as bytes for each world."""
    engine.reset(np.array(seeds, np.uint64))
    rngs = [np.random.default_rng(seed) for seed in seeds]
    seen = [[] for _ in seeds]
    for _ in range(num_steps):
        shown = engine.observe("gray_stack"), engine.observe("rgb84"), engine.observe("vector")
        for world, parts in enumerate(seen):
            parts += [values[world].tobytes() for values in (*shown, engine.rewards)]
        actions = [rng.integers(0, engine.num_actions, engine.num_players) for rng in rngs]
        engine.step(np.array(actions))
    return [b"".join(parts) for parts in seen]


@pytest.mark.parametrize("scenario", ["multitask", "duel"])
def test_a_seed_gives_the_same_game_in_any_world_and_again(scenario):
    engine = marl_cair.make_engine("flash", scenario, num_worlds=2)
    first = play(engine, [5, 9], 40)
    assert first[0] != first[1]
    assert play(engine, [9, 5], 40) == first[::-1]
    engine.close()


def test_both_transports_show_the_same_game():
    shown = []
    for transport in ("bridge", "vnc"):
        engine = marl_cair.make_engine("flash", "multitask", transport=transport)
        shown.append(play(engine, [3], 20))
        engine.close()
    assert shown[0] == shown[1]


def test_the_transport_numbers_shows_the_same_game():
    """From the first step to the end of a game, with all hits, and with its first pictures."""
    shown = []
    for transport in ("bridge", "numbers"):
        engine = marl_cair.make_engine("flash", "duel", transport=transport, reward="lead")
        engine.reset(np.array([3], np.uint64))
        rng, parts = np.random.default_rng(0), []
        while not engine.terminated.any():
            engine.step(rng.integers(0, engine.num_actions, (1, 2)))
            parts += [engine.observe("vector").tobytes(), engine.rewards.tobytes()]
            if len(parts) < 200:
                parts.append(engine.render(0).tobytes())
        shown.append((parts, engine.winner.tolist(), engine.render(0).tobytes()))
        engine.close()
    assert shown[0] == shown[1]
    assert list(engine.spec.representations) == ["vector"]


def describe(path, **entries):
    """A description of multitask with some entries changed."""
    shipped = tomllib.loads((FOLDER / "multitask.toml").read_text("utf-8"))
    entries = {**shipped, "swf": str(FOLDER / "multitask.swf"), **entries}
    values = {name: json.dumps(value).replace('": ', '" = ') for name, value in entries.items()}
    path.write_text("".join(f"{name} = {value}\n" for name, value in values.items()), "utf-8")
    return str(path)


def test_webgl_draws_the_same_game(tmp_path):
    """Its edges are smoothed otherwise."""
    own = describe(tmp_path / "own.toml", renderer="webgl")
    pictures, states = [], []
    for description in ("multitask", own, own):
        engine = marl_cair.make_engine("flash", description=description)
        engine.reset(np.array([3], np.uint64))
        for action in (1, 2, 0):
            engine.step(np.array([[action]]))
        shown = engine.observe("rgb84")[0, 0].transpose(1, 2, 0), engine.render(0), engine.render(0)
        pictures.append([picture.astype(int) for picture in shown])
        states.append(engine.observe("vector").tobytes())
        engine.close()
    assert len(set(states)) == 1
    canvas, webgl, again = pictures
    for one, other, repeated in zip(canvas, webgl, again, strict=True):
        assert 0 < np.abs(one - other).mean() < 0.5
        assert (other == repeated).all()
    assert (webgl[1] == webgl[2]).all()


@pytest.mark.parametrize("transport", ["bridge", "vnc"])
def test_a_game_is_started_by_the_mouse(tmp_path, transport):
    own = describe(tmp_path / "own.toml", start=[], mouse_grid=[3, 9])
    engine = marl_cair.make_engine("flash", description=own, actions="mouse", transport=transport)
    assert engine.num_actions == 1 + 27
    engine.reset(0)
    scores = []
    for name in ("click 0 0", "noop", "click 1 4", "noop", "noop"):  # PLAY is in the middle
        engine.step(np.array([[engine.spec.action_names.index(name)]]))
        scores.append(engine.info()["score"][0, 0])
    assert scores[1] == 0 < scores[3] < scores[4]
    engine.close()


def test_a_scenario_has_the_actions_that_its_description_has(tmp_path):
    with pytest.raises(ValueError, match="multitask has no mouse_grid"):
        marl_cair.make_engine("flash", actions="mouse")
    own = describe(tmp_path / "own.toml", start=[], keys=[[]], mouse_grid=[3, 9])
    with pytest.raises(ValueError, match="has no keys: take actions=mouse"):
        marl_cair.make_engine("flash", description=own)


@pytest.mark.parametrize("done", [{"picture": "end.png", "region": [0, 0, 480, 360]}, "done"])
def test_a_game_that_needs_pictures_has_no_transport_numbers(tmp_path, done):
    Image.new("RGB", (480, 360)).save(tmp_path / "end.png")
    own = describe(tmp_path / "own.toml", done=done, numbers=[])
    assert "vector" not in marl_cair.make_engine("flash", description=own).spec.representations
    with pytest.raises(ValueError, match="transport is 'numbers'"):
        marl_cair.make_engine("flash", description=own, transport="numbers")


def take_pictures(engine, seed):
    """The pictures of a game without keys, of the start and after each step."""
    engine.reset(np.array([seed], np.uint64))
    shown = [engine.render(0)]
    while not engine.terminated[0]:
        engine.step(np.zeros((1, 1), np.int64))
        shown.append(engine.render(0))
    return shown


def test_the_classifier_of_the_page_ends_games_of_other_seeds(tmp_path, monkeypatch):
    page = (Path(__file__).parents[3] / "docs/flash.md").read_text("utf-8")
    program, line = re.search(
        r"### Example: the end as a scene.*?```python\n(.*?)```.*?```toml\n(.*?)```",
        page,
        re.DOTALL,
    ).groups()
    engine = marl_cair.make_engine("flash", "multitask")
    for seed in range(3):
        *stage, over = take_pictures(engine, seed)
        for number, picture in enumerate(stage[::10]):
            Image.fromarray(picture).save(tmp_path / f"stage-{seed}{number}.png")
        Image.fromarray(over).save(tmp_path / f"over-{seed}.png")
    reported = [len(take_pictures(engine, seed)) for seed in (7, 8)]
    engine.close()
    monkeypatch.chdir(tmp_path)
    Path("train.py").write_text(program, "utf-8")
    runpy.run_path("train.py")
    text = (FOLDER / "multitask.toml").read_text("utf-8").partition("numbers = [")[0]
    text = text.replace('"multitask.swf"', f'"{FOLDER / "multitask.swf"}"')
    (tmp_path / "own.toml").write_text(text.replace('done = "done"', line), "utf-8")
    engine = marl_cair.make_engine("flash", description=str(tmp_path / "own.toml"))
    assert [len(take_pictures(engine, seed)) for seed in (7, 8)] == reported
    engine.close()


def test_a_recorded_game_is_played_again(tmp_path):
    """Without states: the hashes are of rewards and endings."""
    engine = marl_cair.make_engine("flash", "multitask")
    engine.reset(np.array([5], np.uint64))
    rng, shown = np.random.default_rng(0), []
    path = tmp_path / "a.replay"
    with ReplayWriter(path, engine, map_seeds=[5], players=[["a"]]) as recorder:
        for _ in range(60):
            actions = rng.integers(0, engine.num_actions, (1, 1))
            engine.step(actions)
            recorder.add(actions)
            shown.append((engine.rewards[0, 0], engine.observe("rgb84").tobytes()))
            if engine.terminated[0]:
                break
    engine.close()
    steps = replay_steps(read_replay(path))
    next(steps)
    assert shown == [(one.rewards[0, 0], one.observe("rgb84").tobytes()) for one in steps]


def test_games_end_and_their_score_is_paid():
    engine = marl_cair.make_engine("flash", "multitask")
    engine.reset(0)
    total = 0.0
    while not engine.terminated[0]:
        engine.step(np.zeros((1, 1), np.int64))
        total += engine.rewards[0, 0]
    score = engine.info()["score"][0, 0]
    assert 0 < total <= score  # the score of the frames before the first step is not paid
    assert score - total <= 5
    engine.close()


def test_the_second_player_of_duel_sees_the_game_from_its_side():
    engine = marl_cair.make_engine("flash", "duel")
    engine.reset(0)
    own, other = engine.observe("rgb84")[0]
    assert (own == other[:, :, ::-1]).all()
    for _ in range(20):  # the first player moves and fires
        engine.step(np.array([[engine.spec.action_names.index("w+d"), 0]]))
    named = engine.spec.representations["vector"].plane_names
    first, second = (
        dict(zip(named, row.tolist(), strict=True)) for row in engine.observe("vector")[0]
    )
    assert (first["player"], second["player"]) == (0, 1)
    assert first["players.0.y"] == second["players.1.y"] != second["players.0.y"]
    assert first["bolts.0.x"] == -second["bolts.0.x"] != 0
    assert (first["bolts.0.owner"], second["bolts.0.owner"]) == (0, 1)
    assert first["bolts.0.y"] == second["bolts.0.y"] != 0
    assert first["bolts.7.owner"] == second["bolts.7.owner"] == 0  # of no bolt
    engine.close()


def test_the_reward_lead_pays_hits_to_one_and_takes_them_from_the_other():
    engine = marl_cair.make_engine("flash", "duel", num_worlds=2, reward="lead")
    engine.reset(np.array([1, 2], np.uint64))
    rng, paid = np.random.default_rng(0), 0.0
    bot = engine.game.bot("duelist", engine.scenario)
    while not engine.terminated[0]:
        seen = engine.observe("vector")[:, 0], engine.action_mask()[:, 0]
        engine.step(np.stack([bot.act(*seen), rng.integers(0, engine.num_actions, 2)], 1))
        assert (engine.rewards[:, 0] == -engine.rewards[:, 1]).all()
        paid += engine.rewards[0, 0]
    score = engine.info()["score"][0]
    assert paid == score[0] - score[1] > 0
    engine.close()


def test_what_needs_a_snapshot_says_so():
    engine = marl_cair.make_engine("flash", "duel")
    engine.reset(0)
    for ask in (engine.snapshot, engine.state_dict):
        with pytest.raises(NoSnapshotError, match="flash"):
            ask()
    engine.close()


def test_a_browser_that_dies_truncates_its_game_alone():
    engine = marl_cair.make_engine("flash", "multitask", num_worlds=2)
    engine.reset(np.array([1, 2], np.uint64))
    actions = np.zeros((2, 1), np.int64)
    engine.step(actions)
    engine._rules.server(0).close()
    engine.step(actions)
    assert engine.truncated.tolist() == [True, False]
    engine.reset(np.array([1, 2], np.uint64), np.array([True, False]))
    engine.step(actions)
    assert not engine.truncated.any()
    engine.close()


def test_a_picture_of_another_size_truncates_its_game(tmp_path, monkeypatch):
    rules.close_spare_browsers()
    short = "return copy.canvas.count++ < 3 ? rgb : rgb.subarray(3);"
    change_page(tmp_path, monkeypatch, "return rgb;", f"copy.canvas.count ??= 0; {short}")
    engine = marl_cair.make_engine("flash", "multitask")
    for _ in range(2):  # each game has a new browser
        engine.reset(0)
        for is_truncated in (False, False, True):
            engine.step(np.zeros((1, 1), np.int64))
            assert engine.truncated[0] == is_truncated
    engine.close()
    assert not any(rules._spare.values())


def test_the_environments_accept_it():
    env = flash.parallel_env("duel", representation="gray_stack")
    parallel_api_test(env, num_cycles=10)
    env.close()
    alone = gymnasium.make("marl_cair/Flash-multitask-v0", representation="gray_stack")
    check_env(alone.unwrapped, skip_render_check=True)
    alone.close()
    batched = marl_cair.make_torchrl_env(
        "flash", "duel", num_worlds=2, representation="gray_stack", seed=0
    )
    check_env_specs(batched, break_when_any_done="both")
    batched.engine.close()


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "bot"), [("duel", "duelist")])
def test_the_bot_beats_random_in_a_match(scenario, bot):
    game, chosen = marl_cair.GAMES["flash"], marl_cair.GAMES["flash"].scenario(scenario)
    result = play_match(game.bot(bot, chosen), game.bot("random", chosen), game, chosen, 8, 0)
    assert result.score >= 0.75


def test_a_browser_within_a_step_is_not_kept():
    engine = marl_cair.make_engine("flash", "multitask")
    engine.reset(0)
    busy = engine._rules.server(0)
    busy.begin_step(1)
    engine.close()
    engine.reset(0)
    assert engine._rules.server(0) is not busy
    engine.step(np.zeros((1, 1), np.int64))
    assert not engine.truncated[0]
    engine.close()
    with pytest.raises(FlashError, match="closed"):
        busy.end_step()


def test_a_game_goes_on_after_an_interrupt_and_after_the_end_of_waiting_browsers():
    rules.close_spare_browsers()
    engine = marl_cair.make_engine("flash", "multitask", num_worlds=4)
    seeds = np.arange(4, dtype=np.uint64)
    engine.reset(seeds)
    for world in range(4):
        engine._rules.server(world).begin_step(1)  # as Ctrl-C within a step leaves them
    engine.reset(seeds)
    engine.step(np.zeros((4, 1), np.int64))
    assert not engine.truncated.any()
    servers = [engine._rules.server(world) for world in range(4)]
    engine.close()
    for server in servers:
        server.close()
    engine = marl_cair.make_engine("flash", "multitask")
    engine.reset(0)
    assert engine._rules.server(0) not in servers
    engine.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_has_browsers_of_its_own():
    engine = marl_cair.make_engine("flash", "multitask")
    engine.reset(0)
    engine.close()
    assert rules._spare
    child = os.fork()
    if child == 0:
        os._exit(len(rules._spare))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_many_games_are_played_in_four_browsers():
    rules.close_spare_browsers()
    game = marl_cair.GAMES["flash"]
    short = dataclasses.replace(game.scenario("multitask"), max_ticks=8)
    assert play_alone(game.bot("random", short), game, short, 9, 0).games == 9
    assert len(rules._spare[find_description("multitask"), "bridge"]) == 4


def test_a_browser_is_kept_for_the_same_description_alone(tmp_path):
    engine = marl_cair.make_engine("flash", "multitask")
    engine.reset(0)
    kept = engine._rules.server(0)
    engine.close()
    small = describe(tmp_path / "small.toml", size=[240, 180])
    other = marl_cair.make_engine("flash", "multitask", description=small)
    other.reset(0)
    assert other.render(0).shape == (180, 240, 3)
    assert other._rules.server(0).size == (240, 180)
    again = marl_cair.make_engine("flash", "multitask")
    again.reset(0)
    assert again._rules.server(0) is kept
    other.close()
    again.close()
