"""Networks, heads, samplers and generators from outside: found and checked; files run none."""

import json
import os
import sys

import numpy as np
import pytest
import torch
from torch import nn

from marl_cair import outside, policies
from marl_cair.checkpoint import AgentDescription, CheckpointError, load_network, save_agent
from marl_cair.cli.compose import compose_config
from marl_cair.league.agents.allowed_code import require_allowed
from marl_cair.lookup import LazyTable, UnknownNameError
from marl_cair.outside import CodeNotAllowedError, OutsideCodeError
from marl_cair.policies.body import Body
from marl_cair.policies.config import QNetworkConfig
from marl_cair.policies.q_network import make_q_network
from marl_cair.self_play import samplers
from marl_cair.training.generating.generators import check_generator
from marl_cair.training.settings.config_file import build_config
from tests.damage import forget_checksums
from tests.processes import run_python

SHAPE, NUM_ACTIONS = (3, 8, 8), 5
MODULE = """
import pathlib
import torch
from torch import nn
from marl_cair.policies.body import Body

pathlib.Path("imported").touch()

class Mean(Body):
    DEFAULT_HIDDEN_WIDTH = 4
    def __init__(self, shape, config):
        super().__init__(shape, config)
        self.layer = nn.Linear(shape[0], self.num_features)
    def forward(self, planes):
        return self.layer(planes.mean((2, 3)))

class Wide(Mean):
    def forward(self, planes):
        return super().forward(planes).repeat(1, 2)

class Double(Mean):
    def forward(self, planes):
        return super().forward(planes).double()

class Endless(Mean):
    def forward(self, planes):
        return super().forward(planes) / 0

class Nothing(Mean):
    def forward(self, planes):
        pass

class Counting(Mean):
    calls = 0
    def forward(self, planes):
        self.calls += 1
        return super().forward(planes) + self.calls

class Crashing(Mean):
    def forward(self, planes):
        raise KeyError("lost")

class Signature(Body):
    def __init__(self):
        pass

class Module(nn.Module):
    pass

class Head(nn.Module):
    def __init__(self, num_features, num_actions, embedding_size):
        super().__init__()
        self.layer = nn.Linear(num_features, num_actions)
    def forward(self, features):
        return self.layer(features)

class OneValue(Head):
    def forward(self, features):
        return super().forward(features)[:, :1]

number = 3
def even(standings, options):
    return [1.0] * len(standings.numbers)
def short(standings, options):
    return [1.0]
def negative(standings, options):
    return [-1.0] * len(standings.numbers)
def crash(standings, options):
    return 1 / 0
def half(config, spec):
    return Module()
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A current folder with the module `mine`, which leaves a file `imported`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv(outside.ALLOWED, "")
    monkeypatch.setenv("MARL_CAIR_IMPORTED_CODE", "")
    (tmp_path / "mine.py").write_text(MODULE, "utf-8")
    yield tmp_path
    sys.modules.pop("mine", None)


def make(body="mine:Mean", head="dueling"):
    return make_q_network(QNetworkConfig(body=body, head=head), SHAPE, NUM_ACTIONS, seed=0)


def test_a_body_and_a_head_of_a_module_work_with_equal_bits():
    config = QNetworkConfig(body="mine:Mean", head="mine:Head")
    assert "mine" not in sys.modules  # settings import nothing
    torch.manual_seed(3)
    before = torch.get_rng_state()
    first, second = (make_q_network(config, SHAPE, NUM_ACTIONS, seed=7) for _ in range(2))
    assert torch.equal(torch.get_rng_state(), before)
    assert first.training
    rows = torch.rand(6, *SHAPE)
    assert first(rows).shape == (6, NUM_ACTIONS)
    assert torch.equal(first(rows), second(rows))
    assert first.body.num_features == 4


def test_a_recipe_trains_a_body_of_a_module_and_its_layers_fit_no_mlp():
    policy = compose_config(["recipe=pqn", "policy.body=mine:Mean"]).policy
    assert (policy.body, policy.norm) == ("mine:Mean", "layer")
    make_q_network(policy, SHAPE, NUM_ACTIONS, seed=0)
    compose_config(["policy=small_frames", "policy.body=mine:Mean"])  # channels without strides
    with pytest.raises(ValueError, match=r"set it and conv_strides to \[\]"):
        compose_config(["recipe=pqn", "policy.body=mlp"])


def test_a_body_of_a_module_may_have_a_memory():
    config = QNetworkConfig(body="mine:Mean", memory="lstm", memory_width=4)
    network = make_q_network(config, SHAPE, NUM_ACTIONS, seed=0)
    assert network(torch.rand(6, *SHAPE), torch.zeros(6, network.state_size)) is not None


@pytest.mark.parametrize(
    ("body", "head", "message"),
    [
        ("mine:Wide", "dueling", r"mine:Wide gave torch.float32 of shape \[2, 8\]"),
        ("mine:Double", "dueling", r"gave torch.float64 .* torch.float32 of shape \[2, 4\]"),
        ("mine:Endless", "dueling", "mine:Endless gave numbers that are not finite"),
        ("mine:Nothing", "dueling", "mine:Nothing gave a NoneType"),
        ("mine:Crashing", "dueling", "mine:Crashing failed on observations .*KeyError: 'lost'"),
        ("mine:Counting", "dueling", "mine:Counting gave other values in a second call"),
        ("mine:Signature", "dueling", "mine:Signature failed when it was made: TypeError"),
        ("mine:Module", "dueling", "mine:Module is .* a subclass of marl_cair.policies.body.Body"),
        ("mine:number", "dueling", "mine:number is 3, it must be a subclass"),
        ("mine:Absent", "dueling", "mine.py has no 'Absent'"),
        ("absent.module:Body", "dueling", "No module named 'absent'.*put its folder on PYTHONPATH"),
        ("mine:Mean", "mine:OneValue", r"mine:OneValue gave torch.float32 of shape \[2, 1\]"),
    ],
)
def test_a_wrong_class_is_refused_with_its_name(body, head, message):
    with pytest.raises(OutsideCodeError, match=message):
        make(body, head)


@pytest.mark.parametrize("name", ["a b:c", "mine", ":Mean", "mine:", "mine:a.b"])
def test_other_names_are_unknown(name):
    with pytest.raises(UnknownNameError):
        QNetworkConfig(body=name)


def test_a_crashing_body_is_refused_before_training_collects(here):
    settings = {
        "out": str(here / "run"),
        "game": {"name": "deep_line_wars", "scenario": "11x11"},
        "policy": {"body": "mine:Wide"},
    }
    from marl_cair.training.trainer import train

    with pytest.raises(OutsideCodeError, match="mine:Wide gave"):
        train(build_config(settings), show_progress=False)


# --- samplers and generators -----------------------------------------------------------------


def mix(name):
    numbers, kinds = np.arange(3), ("learner", "snapshot", "snapshot")
    found = samplers.Standings(numbers, ("self", "a", "b"), kinds, np.full(3, 0.5), np.eye(3))
    return samplers.mix({name: 1.0}, found, samplers.SamplerOptions())


def test_a_sampler_is_normalised_and_checked():
    np.testing.assert_allclose(mix("mine:even"), 1 / 3)
    with pytest.raises(OutsideCodeError, match=r"mine:short returned .* of shape \[3\]"):
        mix("mine:short")
    with pytest.raises(OutsideCodeError, match="mine:negative returned"):
        mix("mine:negative")
    with pytest.raises(OutsideCodeError, match="mine:crash failed .*ZeroDivisionError"):
        mix("mine:crash")
    with pytest.raises(UnknownNameError, match="unknown opponent 'zzz'"):
        mix("zzz")


def test_a_generator_without_methods_is_refused():
    config = build_config({"generator": {"name": "mine:half"}, "synthetic_fraction": 0.2})
    with pytest.raises(OutsideCodeError, match="mine:half gave Module without last_report, obs"):
        check_generator(config)


# --- entry points ----------------------------------------------------------------------------


def install(folder, monkeypatch, **places):
    """A package `theirs` with entry points of networks, as pip leaves it."""
    metadata = folder / "site" / "theirs-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    lines = [f"{name} = {place}" for name, place in places.items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[marl_cair.networks]", *lines, ""]))
    monkeypatch.syspath_prepend(str(folder / "site"))
    monkeypatch.syspath_prepend(str(folder))
    table = LazyTable(
        policies.NETWORKS._places, "marl_cair.networks", "marl_cair.policies.body:Body"
    )
    monkeypatch.setattr(policies, "NETWORKS", table)
    return table


NAMES = ["conv", "capsule", "mlp", "residual", "thesis_capsule", "thesis_conv"]


def test_entry_points_add_names_and_a_broken_one_harms_no_other(here, monkeypatch):
    table = install(here, monkeypatch, pooled="mine:Mean", broken="nowhere:Body")
    assert list(table) == [*NAMES, "broken", "pooled"]
    assert len(table) == len(NAMES) + 2
    assert "mine" not in sys.modules
    assert make("pooled").body.num_features == 4
    with pytest.raises(
        OutsideCodeError, match=r"'broken' .* in theirs .*No module named 'nowhere'"
    ):
        make("broken")
    with pytest.raises(UnknownNameError, match="nearest are 'pooled'"):
        QNetworkConfig(body="poled")


def test_an_entry_point_does_not_replace_an_own_name(here, monkeypatch):
    table = install(here, monkeypatch, conv="mine:Mean")
    with pytest.warns(UserWarning, match="'conv' of marl_cair.networks in theirs .*rename it"):
        assert list(table) == NAMES
    assert table["conv"].__module__ == "marl_cair.policies.conv"


# --- files run no code -----------------------------------------------------------------------


def save(folder, network):
    about = AgentDescription(
        *("mine", "deep_maze", "1", "9x9", {}, "planes", SHAPE, tuple("abcde")),
        network=network.config.to_dict(),
        frames=0,
        updates=0,
        seed=0,
    )
    save_agent(folder, network, about)


def load_in_a_process(folder, **environment):
    code = f"from marl_cair.checkpoint import load_network; load_network({str(folder)!r})"
    environment["MARL_CAIR_IMPORTED_CODE"] = ""  # by this process: workers inherit it
    return run_python(folder.parent, "-c", code, **environment)


@pytest.mark.slow
def test_a_checkpoint_names_its_class_and_runs_it_only_if_allowed(here):
    network = make()
    save(here / "agent", network)
    assert json.loads((here / "agent/agent.json").read_text())["network"]["body"] == "mine:Mean"
    loaded, _ = load_network(here / "agent")  # imported by this process: the user's
    rows = torch.rand(2, *SHAPE)
    assert torch.equal(loaded(rows), network.eval()(rows))
    (here / "imported").unlink()
    refused = load_in_a_process(here / "agent", MARL_CAIR_ALLOW_CODE="")
    assert "names code, which runs only if you allow it: mine:Mean" in refused.stderr
    assert not (here / "imported").exists()
    allowed = load_in_a_process(here / "agent", MARL_CAIR_ALLOW_CODE="mine:Mean")
    assert allowed.returncode == 0, allowed.stderr
    assert (here / "imported").exists()
    (here / "mine.py").unlink()
    missing = load_in_a_process(here / "agent", MARL_CAIR_ALLOW_CODE="mine:Mean")
    assert "needs code that is not in marl_cair" in missing.stderr
    assert "put its folder on PYTHONPATH" in missing.stderr


def test_a_file_makes_no_other_class_of_an_imported_module(here):
    save(here / "agent", make_q_network(QNetworkConfig(), SHAPE, NUM_ACTIONS, seed=0))
    path = here / "agent/agent.json"
    record = json.loads(path.read_text())
    record["network"]["body"] = "subprocess:Popen"
    path.write_text(json.dumps(record))
    forget_checksums(here)
    with pytest.raises(CheckpointError, match="must be a subclass of marl_cair.policies.body.Body"):
        load_network(here / "agent")
    record["network"]["body"] = "this:Popen"
    path.write_text(json.dumps(record))
    forget_checksums(here)
    with pytest.raises(CodeNotAllowedError, match="this:Popen"):
        load_network(here / "agent")
    assert "this" not in sys.modules


def test_allowed_names_are_kept_once(monkeypatch):
    outside.allow_code("a:B", "c:D")
    outside.allow_code("a:B")
    assert os.environ[outside.ALLOWED] == "a:B,c:D"
    require_allowed(["c:D"], False, "config.yaml")  # in every file
    assert issubclass(Body, nn.Module)
