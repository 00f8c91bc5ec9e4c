"""Exported agents choose the agent's actions on recorded observations, with and without torch."""

import json
import re
import runpy

import numpy as np
import pytest
import torch

from benchmarks import _networks
from marl_cair.checkpoint import load_network, save_agent
from marl_cair.cli import main
from marl_cair.cli.agent import export
from marl_cair.cli.agent.export import MASK_RULE, export_agent
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.league.agents.foreign import ForeignAgent
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.policies.config import QNetworkConfig
from tests.processes import ROOT, read_output
from tests.refusals import assert_refused

onnxruntime = pytest.importorskip("onnxruntime")
SCENARIO = "11x11"
RUNNER_FILE = ROOT / "examples" / "onnx_agent.py"
GAME = GAMES["deep_line_wars"]
SPEC = GAME.make_spec(GAME.scenario(SCENARIO))
SIZES = {
    "conv": {"body": "conv", "head": "plain", "hidden_width": 32},
    "capsule": {"body": "capsule"},
    "residual": {"body": "residual"},
    "thesis_capsule": {"body": "thesis_capsule", "head": "length"},
    "thesis_conv": {"body": "thesis_conv", "hidden_width": 32},
    "mlp": {"body": "mlp", "hidden_width": 32},
    "distances": {"body": "conv", "hidden_width": 32, "distances": True, "obstacle_planes": (0,)},
    "cell_values": {"body": "capsule", "cell_values": True},
    "naf": {"head": "naf", "hidden_width": 32},
    "rainbow": {"head": "quantile", "noisy": True, "hidden_width": 32, "num_quantiles": 8},
}


def save(folder, name):
    config = QNetworkConfig(**SIZES[name])
    config = config.with_actions(SPEC.action_cells.tolist(), SPEC.action_groups.tolist())
    representation = "planes"
    if name == "mlp":
        representation = "vector"
        bounds = SPEC.representations["vector"].bounds()
        low, high = (tuple(bound.tolist()) for bound in bounds)
        if all(one < other for one, other in zip(low, high, strict=True)):
            config = config.with_bounds(low, high)
    return _networks.save_network(folder / name, SCENARIO, representation, config, seed=3)


@pytest.fixture(scope="module")
def recorded():
    """1,000 observations of each kind and their masks, of random legal play."""
    engine = BatchedEngine(GAME, GAME.scenario(SCENARIO), 50)
    engine.reset(np.arange(50, dtype=np.uint64))
    rng = np.random.default_rng(0)
    seen, masks = {"planes": [], "vector": []}, []
    for _ in range(20):
        mask = engine.action_mask()
        for name, rows in seen.items():
            rows.append(engine.observe(name)[:, 0].copy())
        masks.append(mask[:, 0].copy())
        engine.step((rng.random(mask.shape) * mask).argmax(-1).astype(np.int32))
    return {name: np.concatenate(rows) for name, rows in seen.items()}, np.concatenate(masks)


SLOW = {*SIZES} - {"conv", "naf"}  # to export


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in SIZES]
)
def test_actions_equal_the_agents_on_1000_observations(name, recorded, tmp_path):
    agent_folder, file = save(tmp_path, name), tmp_path / "agent.onnx"
    written = export_agent(agent_folder, file)
    agent = load_agent(agent_folder)
    observation, mask = recorded[0][agent.representation], recorded[1]
    assert len(observation) == 1000
    session = onnxruntime.InferenceSession(file)
    given = {"observation": observation, "action_mask": mask}
    values, actions = session.run(["values", "action"], given)
    expected = agent.values(observation, mask)
    assert actions.dtype == np.int64
    np.testing.assert_array_equal(np.isneginf(values), ~mask)
    np.testing.assert_allclose(values[mask], expected[mask], atol=1e-5)
    chosen = agent.act(observation, mask)
    differing = np.flatnonzero(
        actions != chosen
    )  # only where two values are equal but for rounding
    rows = expected[differing]
    gaps = rows.max(1) - rows[np.arange(len(differing)), actions[differing]]
    assert len(differing) <= 2
    assert (gaps < 1e-6).all()
    one = session.run(["action"], {name: rows[:1] for name, rows in given.items()})[0]
    assert one[0] == actions[0]
    about = session.get_modelmeta().custom_metadata_map
    assert about == written
    assert (about["game"], about["scenario"]) == ("deep_line_wars", SCENARIO)
    assert about["representation"] == agent.representation
    assert json.loads(about["observation_shape"]) == list(observation.shape[1:])
    assert about["observation_dtype"] == observation.dtype.name
    assert tuple(json.loads(about["action_names"])) == SPEC.action_names
    assert about["mask_rule"] == MASK_RULE
    assert about["state_size"] == "0"


@pytest.mark.slow
@pytest.mark.parametrize("memory", ["lstm", "gru"])
def test_an_exported_memory_continues_from_the_state_it_returns(memory, recorded, tmp_path, capsys):
    config = QNetworkConfig(hidden_width=16, memory=memory, memory_width=8)
    folder = _networks.save_network(tmp_path / memory, SCENARIO, "planes", config, seed=3)
    assert main(["export", folder, str(tmp_path / "agent.onnx")]) == 0
    agent, printed = load_agent(folder), capsys.readouterr().out
    assert f"action_mask bool [N, A], state float32 [N, {agent.state_size}]\n" in printed
    assert f"action int64 [N], next_state float32 [N, {agent.state_size}];" in printed
    session = onnxruntime.InferenceSession(tmp_path / "agent.onnx")
    observation = recorded[0]["planes"].reshape(20, 50, *recorded[0]["planes"].shape[1:])
    mask = recorded[1].reshape(20, 50, -1)
    own = other = np.zeros((50, agent.state_size), np.float32)
    for seen, legal in zip(observation, mask, strict=True):
        expected = agent.values(seen, legal, own)
        actions, own = agent.act(seen, legal, own)
        given = {"observation": seen, "action_mask": legal, "state": other}
        values, chosen, other = session.run(["values", "action", "next_state"], given)
        np.testing.assert_allclose(values[legal], expected[legal], atol=1e-5)
        np.testing.assert_allclose(other, own, atol=1e-5)
        assert (chosen != actions).sum() <= 1  # of two values that are equal but for rounding
    assert np.abs(own).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["recurrent", "grid"])
def test_the_runner_of_the_examples_plays_the_agents_games(kind, tmp_path):
    if kind == "recurrent":
        game, name, options = GAME, SCENARIO, {"max_ticks": 300}
        config = QNetworkConfig(hidden_width=16, memory="lstm", memory_width=8)
    else:
        game, name = GAMES["deep_rts"], "1v1-15x15"
        options, config = {"actions": "grid", "max_ticks": 300}, QNetworkConfig(hidden_width=16)
    scenario = game.scenario(name, **options)
    spec = game.make_spec(scenario)
    config = config.with_actions([], [], spec.action_shape)
    folder = _networks.save_network(
        tmp_path / "agent", name, "planes", config, seed=3, rules=game.name, options=options
    )
    network, description = load_network(folder)
    if kind == "grid":
        torch.nn.init.normal_(network.head.values.weight)  # an untrained one has zeros
    else:
        for weight in network.memory.parameters():
            weight.data *= 4  # the past counts as much as the present
    save_agent(folder, network, description)
    about = export_agent(folder, tmp_path / "agent.onnx")
    assert (about["state_size"] == "0") == (kind == "grid")
    exported = runpy.run_path(str(RUNNER_FILE))["OnnxAgent"](tmp_path / "agent.onnx")
    foreign = ForeignAgent(exported, "exported", spec, "")
    bot, names = game.bot("random", scenario), ("agent", "random")
    matches = [
        play_match(agent, bot, game, scenario, 4, 0, names)
        for agent in (load_agent(folder), foreign)
    ]
    assert not matches[1].forfeits
    assert matches[1].results == matches[0].results  # with the hash of all actions


RUNNER = """
import runpy, sys
sys.argv = ["onnx_agent.py", "agent.onnx", "--games", "2"]
runpy.run_path({path!r}, run_name="__main__")
assert "torch" not in sys.modules
"""


@pytest.mark.slow
@pytest.mark.parametrize("alone", [False, True])
def test_the_command_and_the_runner_without_torch(tmp_path, capsys, alone):
    folder = str(tmp_path / "maze")
    if alone:
        config = QNetworkConfig(hidden_width=8)
        _networks.save_network(
            tmp_path / "maze", "9x9-stochastic", "planes", config, rules="deep_maze"
        )
    else:
        folder = save(tmp_path, "mlp")
    assert main(["export", folder, str(tmp_path / "agent.onnx")]) == 0
    assert "action_mask bool [N, A]" in capsys.readouterr().out
    output = read_output(tmp_path, "-c", RUNNER.format(path=str(RUNNER_FILE)))
    assert ("mean score" if alone else "against random") in output
    assert re.search(r"\b(of|in) 2 games", output)
    assert "forfeited" not in output


def test_a_missing_library_is_named_with_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(export, "find_spec", lambda name: None if name == "onnxscript" else name)
    message = "export needs onnxscript, which is not installed: pip install 'marl_cair[export]'"
    assert_refused(capsys, message, "export", str(tmp_path), str(tmp_path / "agent.onnx"))


def test_other_files_and_agents_are_refused(tmp_path, capsys):
    folder = save(tmp_path, "mlp")
    assert_refused(capsys, "must end with .onnx", "export", folder, str(tmp_path / "agent.pt"))
    assert_refused(
        capsys, "is no agent checkpoint", "export", str(tmp_path), str(tmp_path / "agent.onnx")
    )
