"""Training on an emulated GPU; `test_device.py` runs it in a process of its own."""

import dataclasses
import math

import pytest
import torch

from marl_cair.checkpoint import load_tensors
from marl_cair.games import GAMES
from marl_cair.generative import generator
from marl_cair.generative.gate import Acceptance, GateReport
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.settings import ThesisSize
from marl_cair.policies import NO_MEMORY
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.replay import load_dataset
from marl_cair.training.collecting.filling import complete_rows
from marl_cair.training.generating.generators import make_for_game, move_generator
from marl_cair.training.offline.generator_training import describe_game
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import EvaluationSettings
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.settings.learner import NfspSettings
from tests.emulated_gpu import GPU, GpuTensor, Machine
from tests.training.offline import datasets
from tests.training.runs import SMALL_GENERATOR, digest, fill_replays, small, tiny, train
from tests.training.test_combinations import LEARNING, collect, make

SMALL = dataclasses.replace(SMALL_GENERATOR, thesis=ThesisSize("code", hidden=4))
LENIENT = Acceptance(min_surety=-math.inf, certain=0.0, may_end=True, may_be_rare=True)
MIXED = {
    "sum": lambda gpu, cpu: gpu + cpu,
    "in place": lambda gpu, cpu: cpu.add_(gpu),
    "choice": lambda gpu, cpu: cpu[gpu > 0],
    "assignment": lambda gpu, cpu: cpu.__setitem__(cpu > 0, gpu),
    "layer": lambda gpu, cpu: torch.nn.Linear(3, 2)(gpu),
    "array": lambda gpu, cpu: gpu.numpy(),
    "random": lambda gpu, cpu: torch.rand(3, device=GPU, generator=torch.Generator()),
}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Data sets by representation; read without the GPU, as its emulation takes no memmaps."""
    loaded = {}
    for seen in ("planes", "gray"):
        place = tmp_path_factory.mktemp("data") / seen
        datasets.collect(place, 60, GAMES["deep_maze"], "7x7-deterministic", seen)
        loaded[seen] = load_dataset(place)
    return loaded


@pytest.fixture(autouse=True)
def machine(data):
    with Machine(), torch.autograd.set_multithreading_enabled(False):  # it is of this thread
        yield


@pytest.mark.parametrize("compute", MIXED.values(), ids=MIXED)
def test_the_emulated_gpu_refuses_what_cuda_refuses(compute):
    gpu, cpu = torch.ones(3).to(GPU), torch.ones(3)
    with pytest.raises(RuntimeError, match="same device|on the CPU|numpy"):
        compute(gpu, cpu)
    assert torch.equal((2.0 * gpu).cpu(), 2.0 * cpu)


def on_gpu(config):
    return dataclasses.replace(config, device="cuda", out=f"{config.out}_gpu")


def is_on_gpu(network):
    return all(isinstance(one, GpuTensor) for one in network.parameters())


def open_gate(own):
    own.last_report = GateReport(True, (), {}, LENIENT)
    return own.last_report


def test_a_run_has_the_same_bits_on_both_devices_and_resumes_on_the_other(tmp_path, monkeypatch):
    """Self-play against snapshots and a bot, generated rows, evaluations, states of resume."""
    monkeypatch.setattr(CCDNGenerator, "evaluate", open_gate)
    monkeypatch.setattr(generator, "find_broken_structure", lambda rows, spec: torch.zeros(1) > 0)
    config = tiny(tmp_path / "run", 640)
    rated = EvaluationSettings(every_frames=512, games=2)
    often = dataclasses.replace(config.generator, evaluate_every_frames=256, rows_per_refill=40)
    config = dataclasses.replace(config, generator=often, evaluation=rated)
    train(config)

    def watch(run):
        networks = [run.learner.network, run.learner.target, run.rated.network]
        networks += [run.generator.network, run.generator.average]
        opponents = [run.book.pool.agent(one.number) for one in run.book.pool.snapshots]
        assert all(map(is_on_gpu, [*networks, *(agent.network for agent in opponents)]))
        assert run.generator_is_on
        generated.append((len(opponents), len(run.replay.generated)))
        return True

    generated = []
    train(on_gpu(config), watch=watch)
    assert generated[-1] == (1, 40)
    assert digest(tmp_path / "run") == digest(tmp_path / "run_gpu")
    ends = []
    for folder in ("run", "run_gpu"):
        other = dataclasses.replace(config, out=str(tmp_path / folder), total_frames=768)
        other = dataclasses.replace(other, device="cuda" if folder == "run" else "cpu")
        assert train(other, resume=True).frames == 768
        ends.append(digest(tmp_path / folder))
    assert ends[0] == ends[1]


def choose_some(combinations):
    """A few, in which each choice occurs."""
    left, chosen = {choice for one in combinations for choice in enumerate(one)}, []
    while left:
        chosen.append(max(combinations, key=lambda one: len(left & {*enumerate(one)})))
        left -= {*enumerate(chosen[-1])}
    return chosen


@pytest.mark.slow
@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("combination", choose_some(LEARNING), ids="-".join)
def test_networks_losses_and_explorations_learn(tmp_path, combination):
    states = []
    config = make(tmp_path / "run", *combination)
    for own in (config, on_gpu(config)):
        run = TrainingRun(own)
        batch = collect(run)
        for _ in range(2):
            run.learner.update(batch)
        states.append([batch["td_error"], *run.learner.state_dict()["network"].values()])
        assert is_on_gpu(run.learner.behaviour) is (own.device == "cuda")
        run.close()
    # The cells of memories are emulated in other operations.
    tolerance = {} if combination[1] == NO_MEMORY else {"rtol": 1e-4, "atol": 1e-5}
    for one, other in zip(*states, strict=True):
        if tolerance:
            torch.testing.assert_close(one, other.cpu(), **tolerance)
        assert tolerance or torch.equal(one, other.cpu())


@pytest.mark.slow
# Not `distances`: within a backward pass of one's own, new tensors of this GPU cannot be made.
@pytest.mark.parametrize("change", [{"cell_values": True}, {"head": "naf"}])
def test_networks_that_read_the_board_learn(tmp_path, change):
    policy = QNetworkConfig(hidden_width=8, **change)
    config = tiny(tmp_path / "run", policy=policy, synthetic_fraction=0.0)
    states = []
    for own in (config, on_gpu(config)):
        run = TrainingRun(own)
        fill_replays(run)
        batch = run.replay.sample()
        run.learner.update(batch)
        states.append([batch["td_error"], *run.learner.state_dict()["network"].values()])
        run.close()
    assert all(torch.equal(one, other.cpu()) for one, other in zip(*states, strict=True))


@pytest.mark.slow
@pytest.mark.usefixtures("test_game")
def test_average_policies_and_demonstrations_learn(tmp_path):
    nfsp = NfspSettings(enabled=True, eta=0.5, min_rows=20, batch_size=16, frames_per_update=64)
    shown = DemonstrationSettings(bots=("idle",), share=0.5)
    config = small(tmp_path / "run", "duel", nfsp=nfsp, demonstration=shown)
    average = []
    for own in (config, on_gpu(config)):
        train(own)
        state = load_tensors(f"{own.out}/resume/state.pt")["average_policy"]
        average.append(state["network"])
        assert state["updates"] > 0
    assert all(torch.equal(average[0][name], average[1][name]) for name in average[0])


@pytest.mark.parametrize(("model", "seen"), [("ccgan", "planes"), ("ccdn_thesis", "gray")])
def test_generators_learn_and_predict(data, model, seen):
    spec, shown = describe_game(data[seen].about)
    rows = complete_rows(data[seen].train, torch.arange(12 if seen == "planes" else 2))
    found = []
    for device in (torch.device("cpu"), GPU):
        own = make_for_game(model, SMALL, shown, spec, spec.reward_bound, 0)
        move_generator(own, device)
        own.observe(rows)
        losses = own.update(rows)
        made = own.imagine(rows[:4], torch.Generator().manual_seed(0))
        assert is_on_gpu(own.network) is (device == GPU)
        found.append(([*losses.values(), *own.generate(rows, 2).keys()], made))
    assert found[0][0] == found[1][0]
    assert all(map(torch.equal, found[0][1], found[1][1]))
