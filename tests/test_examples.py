"""The scripts of examples/ run, shortened, and stay short."""

import pytest

from tests.processes import ROOT, read_output

EXAMPLES = ROOT / "examples"
MAX_LINES = 60
SHORT = {
    "random_play": "--games 2 --scenario 11x11",
    "sb3": "--steps 512 --games 1",
    "torchrl_dqn": "--steps 4 --num-envs 8",
    "self_play": "--frames 2048 --games 2 --out runs/example",
    "own_network": "--frames 4096 --games 2 --out runs/own",
    "league": "--games 2 --out runs/league",
    "plot_run": "seed_0 seed_1 --column win_rate/random --out curve.png",
}
SLOW = "sb3", "torchrl_dqn", "self_play", "own_network", "league"
PRINTED = {
    "random_play": "player_1: mean return",
    "sb3": "mean return in 1 games",
    "torchrl_dqn": "32 steps",
    "self_play": "score against counter",
    "own_network": "resumed to 4096",
    "league": "spender",
    "plot_run": "win_rate/random 0.750 after 200 steps",
}


def test_every_script_is_run():
    elsewhere = {"onnx_agent"}  # needs an exported agent: tests/cli/test_export.py
    assert {path.stem for path in EXAMPLES.glob("*.py")} - elsewhere == set(SHORT) == set(PRINTED)


@pytest.mark.parametrize("name", SHORT)
def test_it_is_short_and_on_the_page(name):
    path = EXAMPLES / f"{name}.py"
    assert len(path.read_text("utf-8").splitlines()) < MAX_LINES
    assert f"]({name}.py)" in (EXAMPLES / "README.md").read_text("utf-8")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in SHORT]
)
def test_it_runs(name, tmp_path):
    for seed, win_rate in enumerate((0.5, 1.0)):  # two logs for plot_run
        log = tmp_path / f"seed_{seed}" / "log.csv"
        log.parent.mkdir()
        log.write_text(f"frames,win_rate/random\n100.0,\n100.0,0.25\n200.0,{win_rate}\n", "utf-8")
    output = read_output(tmp_path, EXAMPLES / f"{name}.py", *SHORT[name].split())
    assert PRINTED[name] in output
