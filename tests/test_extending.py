"""The examples of docs/extending.md work: each is used as the page says."""

import dataclasses
import json
import re
import shlex
import shutil
import sys
import tomllib

import numpy as np
import pytest
import torch

from marl_cair.cli.compose import compose_config
from marl_cair.outside import CodeNotAllowedError
from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.self_play import samplers
from marl_cair.training.settings.config_file import build_config, load_config
from marl_cair.training.trainer import train
from tests.processes import ROOT, read_output
from tests.replay.streams import SMALL, make_rollout

MARL_CAIR = ("-m", "marl_cair")
FOLDER = ROOT / "docs" / "extending"
SAMPLER = (FOLDER / "sampler.py").read_text("utf-8")
EXPLORATION = (FOLDER / "exploration.py").read_text("utf-8")


@pytest.fixture(autouse=True)
def examples_found(monkeypatch, tmp_path):
    """The examples as modules that Python finds, as with PYTHONPATH."""
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.chdir(tmp_path)
    yield
    for name in ("sampler", "generator", "loss", "exploration", "replay_sampler"):
        sys.modules.pop(name, None)


def train_with(out, **changes):
    """The result of a training of seconds."""
    settings = {
        "total_frames": 1024,
        "torch_threads": 1,
        "synthetic_fraction": 0.0,
        "game": {"name": "deep_line_wars", "scenario": "11x11", "options": {"max_ticks": 100}},
        "policy": {"body": "conv", "hidden_width": 16},
        "generator": {"name": "none"},
        "collector": {"num_worlds": 16, "steps_per_batch": 8},
        "replay": {"capacity_transitions": 4000, "min_transitions": 128},
        "learner": {"batch_size": 16},
        "evaluation": {"bots": []},
    }
    config = build_config({**settings, "out": str(out), **changes})
    result = train(config, show_progress=False)
    assert result.frames >= config.total_frames
    return result


def test_the_page_names_every_example():
    page = (ROOT / "docs/extending.md").read_text("utf-8")
    for path in FOLDER.glob("*.py"):
        assert f"<!-- show docs/extending/{path.name} -->" in page
        assert f"(extending/{path.name})" in page


@pytest.mark.slow
def test_the_sampler_chooses_the_hardest(tmp_path):
    win_rate = np.array([0.5, 0.9, 0.1, 0.6, 0.2, 0.3])
    kinds, payoffs = ("learner", *["snapshot"] * 5), np.full((6, 6), 0.5)
    standings = samplers.Standings(np.arange(6), ("self", *"abcde"), kinds, win_rate, payoffs)
    mixed = samplers.mix({"sampler:hardest": 1.0}, standings, samplers.SamplerOptions())
    np.testing.assert_allclose(mixed, [0, 0, 1 / 3, 0, 1 / 3, 1 / 3])
    mixture = {"sampler:hardest": 0.5, "latest": 0.5}
    train_with(tmp_path / "run", opponent={"mixture": mixture, "snapshot_every_frames": 256})
    with pytest.raises(CodeNotAllowedError, match="sampler:hardest"):
        load_config(tmp_path / "run")
    assert load_config(tmp_path / "run", allow_code=True).opponent.mixture == mixture


def test_the_command_of_the_sampler_is_read():
    command = shlex.split(re.findall(r"marl-cair (train .*)$", SAMPLER, re.MULTILINE)[0])
    config = compose_config(command[1:])
    assert config.opponent.mixture == {"latest": 0.5, "sampler:hardest": 0.5}


def assert_resumes_where_allowed(run, name, updates):
    with pytest.raises(CodeNotAllowedError, match=name):
        load_config(run)
    longer = dataclasses.replace(load_config(run, allow_code=True), total_frames=2048)
    assert train(longer, resume=True, show_progress=False).updates > updates


@pytest.mark.slow
def test_the_loss_trains_and_its_run_resumes_where_it_is_allowed(tmp_path):
    learner = {"batch_size": 16, "algorithm": "loss:Mellowmax"}
    result = train_with(tmp_path / "run", learner=learner)
    assert np.isfinite(result.last_row["loss/all"])
    assert result.updates > 0
    assert_resumes_where_allowed(tmp_path / "run", "loss:Mellowmax", result.updates)


@pytest.mark.slow
def test_the_exploration_trains_and_its_run_resumes_where_it_is_allowed(tmp_path):
    words = re.findall(r"marl-cair (train .*)$", EXPLORATION, re.MULTILINE)[0].split()
    kind = compose_config(words[1:]).exploration.kind
    result = train_with(tmp_path / "run", exploration={"kind": kind, "anneal_frames": 2048})
    assert result.updates > 0
    assert_resumes_where_allowed(tmp_path / "run", "exploration:Boltzmann", result.updates)


@pytest.mark.slow
def test_the_replay_sampler_trains_and_its_run_resumes_where_it_is_allowed(tmp_path):
    text = (FOLDER / "replay_sampler.py").read_text("utf-8")
    words = re.findall(r"marl-cair (train .*)$", text, re.MULTILINE)[0].split()
    name = compose_config(words[1:]).replay.sampler
    replay = {"capacity_transitions": 4000, "min_transitions": 128, "sampler": name}
    result = train_with(tmp_path / "run", replay=replay)
    assert result.updates > 0
    assert_resumes_where_allowed(tmp_path / "run", name, result.updates)


def test_the_replay_sampler_prefers_newer_transitions():
    from replay_sampler import NewerFirst

    settings = ReplayConfig(capacity_transitions=200, make_sampler=lambda *_: NewerFirst(0))
    buffer = make_replay_buffer(settings, SMALL)
    rollout = make_rollout(np.random.default_rng(0), 100, 1, end_rate=0.0, learned_rate=1.1)
    slots = buffer.extend_rollout(rollout)
    chosen = buffer.sample(2_000)["index"]
    newer = torch.isin(chosen, slots[50:]).float().mean()
    assert float(newer) == pytest.approx(0.75, abs=0.04)


@pytest.mark.parametrize("name", ["newest", "replay_sampler:torch"])
def test_replay_samplers_that_are_none_are_refused(tmp_path, name):
    replay = {"capacity_transitions": 4000, "min_transitions": 128, "sampler": name}
    with pytest.raises(ValueError, match=name):
        train_with(tmp_path / "run", replay=replay)
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_the_generator_gives_labelled_rows(tmp_path):
    refills = {"evaluate_every_frames": 1024, "refill_every_frames": 512, "rows_per_refill": 64}
    generator = {"name": "generator:MemoryGenerator", **refills}
    out = tmp_path / "run"
    result = train_with(out, total_frames=4096, synthetic_fraction=0.2, generator=generator)
    assert result.last_row["replay/generated"] > 0


@pytest.mark.slow
def test_the_opponent_plays(monkeypatch, tmp_path):
    shutil.copy(FOLDER / "opponent.py", tmp_path / "opponent.py")
    commands = (FOLDER / "opponent.py").read_text("utf-8")
    assert "marl-cair match opponent:make_first_legal rusher" in commands
    words = ["match", "opponent:make_first_legal", "rusher", "--scenario", "11x11"]
    assert "make_first_legal" in read_output(tmp_path, *MARL_CAIR, *words, "--games", "4")


# --- the game --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The template as pip leaves it: the package and its metadata."""
    folder = tmp_path_factory.mktemp("site")
    template = FOLDER / "game_template"
    shutil.copytree(template / "tug_of_war", folder / "tug_of_war")
    project = tomllib.loads((template / "pyproject.toml").read_text("utf-8"))["project"]
    metadata = folder / f"{project['name']}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    points = project["entry-points"]["marl_cair.games"]
    lines = [f"{name} = {place}" for name, place in points.items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[marl_cair.games]", *lines, ""]))
    return folder


@pytest.mark.slow
def test_the_game_is_listed_and_the_command_of_the_page_runs(installed):
    assert "tug_of_war" in json.loads(read_output(installed, *MARL_CAIR, "games", "--json"))
    words = "train", "game=tug_of_war", "policy=mlp", "--cfg", "job"
    assert "representation: vector" in read_output(installed, *MARL_CAIR, *words)
    assert "flash, tug_of_war" in read_output(installed, *MARL_CAIR, "train", "--help")
    page = (ROOT / "docs/extending.md").read_text("utf-8")
    (command,) = re.findall(r"^marl-cair (match puller .*)$", page, re.MULTILINE)
    assert "puller" in read_output(installed, *MARL_CAIR, *command.split())


CONFORMANCE = """
import numpy as np
from pettingzoo.test import parallel_api_test, parallel_seed_test
import tug_of_war, marl_cair

parallel_api_test(tug_of_war.parallel_env(), num_cycles=100)
parallel_seed_test(tug_of_war.parallel_env, num_cycles=20)
engine = marl_cair.make_engine("tug_of_war", scenario="long", num_worlds=64)
alone = marl_cair.make_engine("tug_of_war", scenario="long", num_worlds=1)
seeds = np.arange(64, dtype=np.uint64)
engine.reset(seeds); alone.reset(seeds[40:41])
rng = np.random.default_rng(0)
for _ in range(60):
    actions = rng.integers(2, size=(64, 2))
    engine.step(actions); alone.step(actions[40:41])
    assert np.array_equal(engine.observe("vector")[40], alone.observe("vector")[0])
    assert np.array_equal(engine.rewards[40], alone.rewards[0])
assert (engine.terminated | engine.truncated).all()
assert engine.render(0).shape == (20, 180, 3)
print("conforms")
"""


@pytest.mark.slow
def test_the_game_conforms(installed):
    assert "conforms" in read_output(installed, "-c", CONFORMANCE)
