"""The commands of docs/self_play.md: each is understood, and runs, shortened, after the others."""

import contextlib
import re
import shlex
from pathlib import Path

import pytest

from marl_cair.cli import main
from marl_cair.cli.compose import compose_config
from marl_cair.cli.league import make_parser
from marl_cair.training.population.league_examples import EXAMPLES, PSRO_EXAMPLES

PAGE = (Path(__file__).parents[1] / "docs/self_play.md").read_text("utf-8")
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
    if line
]
SHORT = (
    "max_ticks=60",
    "torch_threads=1",
    "collector.num_worlds=16",
    "collector.steps_per_batch=8",
    "replay.min_transitions=200",
    "replay.capacity_transitions=3000",
    "learner.batch_size=16",
    "policy.hidden_width=16",
    "generator=none",
    "synthetic_fraction=0",
    "opponent.snapshot_every_frames=256",
    "evaluation.bots=[]",
    "nfsp.min_rows=50",
)


def words_of(command):
    words = shlex.split(command)
    assert words[0] == "marl-cair"
    return words[1:]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_command_is_understood(command):
    words = words_of(command)
    if words[0] == "train":
        config = compose_config(words[1:])
        every = config.collector.num_worlds * config.collector.steps_per_batch
        # The snapshot that the page names is that of the first batch past its time.
        name = -(-config.opponent.snapshot_every_frames // every) * every
        if config.out == "runs/pool":
            assert f"frames_{name:010d}" in PAGE
    elif words[:2] == ["league", "train"]:
        assert words[2:] == ["league.yaml"] or words[3] in EXAMPLES
    elif words[:2] == ["league", "psro"]:
        assert words[2:] == ["psro.yaml"] or words[3] in PSRO_EXAMPLES
    else:
        make_parser().parse_args(words[1:])


@pytest.mark.slow
def test_the_commands_run_one_after_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command in COMMANDS:
        words = words_of(command.replace("0000051200", "0000000256"))
        words = ["total_frames=512" if w.startswith("total_frames=") else w for w in words]
        if words[0] == "train":
            words = [w for w in words if not w.startswith("opponent.snapshot_every")]
            words += SHORT
        words = ["2" if w == "20" else w for w in words]
        if ">" in words:
            *words, _, target = words
            with Path(target).open("w", encoding="utf-8") as file, contextlib.redirect_stdout(file):
                assert main(words) == 0, command
        else:
            assert main(words) == 0, command
    assert Path("runs/after_league/ladder.csv").is_file()
    assert Path("runs/after_psro/ladder.csv").is_file()
