"""The commands of docs/league.md: each is understood, and runs, shortened, after the others."""

import re
import shlex
from pathlib import Path

import pytest

from marl_cair.cli import exploit, main
from marl_cair.cli.league import make_parser
from marl_cair.cli.league_members import make_add_parser, make_mix_parser

PAGE = (Path(__file__).parents[1] / "docs/league.md").read_text("utf-8")
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
    if line.startswith("marl-cair league ")
]
(BOT,) = re.findall(r"as `(bots/\w+\.py)`:\n\n```python\n(.*?)```", PAGE, re.DOTALL)
SUBCOMMANDS = {"add": make_add_parser, "mix": make_mix_parser, "exploit": exploit.make_parser}
FOLDERS = ("status", "report", "export")  # sub-commands of a folder that was played
# What takes an hour as it stands on the page takes seconds with these behind it.
SHORT = {
    "exploit": (
        "--budget 256 --seeds 2 --games 2 policy=mlp representation=vector policy.hidden_width=16 "
        "replay.min_transitions=64 collector.num_worlds=8 collector.steps_per_batch=8 "
        "learner.batch_size=16 torch_threads=1 max_ticks=60 --out runs/exploit"
    )
}


def words_of(command):
    words = shlex.split(command)
    assert words[0] == "marl-cair"
    return words[1:]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_command_is_understood(command):
    _, first, *others = words_of(command)
    if first in FOLDERS:
        assert others[0] == "runs/first"
        return
    parser, words = SUBCOMMANDS.get(first), others
    if parser is None:
        parser, words = make_parser, [first, *others]
    parser().parse_args(words)


@pytest.mark.slow
def test_the_commands_run_one_after_another(tmp_path, monkeypatch, capsys):
    """The page shows the ladder that the first of them prints."""
    monkeypatch.chdir(tmp_path)
    place, program = BOT
    Path(place).parent.mkdir()
    Path(place).write_text(program, "utf-8")
    for number, command in enumerate(COMMANDS):
        words = words_of(command)
        words += shlex.split(SHORT.get(words[1], ""))
        assert main(words) == 0, command
        told = capsys.readouterr().out
        if number == 0:
            shown = re.search(r"```\n(economist is .*?)```", PAGE, re.DOTALL).group(1)
            rows = [row.split() for row in shown.splitlines() if row.strip()[:1].isdigit()]
            assert len(rows) == 4
            assert [row for row in map(str.split, told.splitlines()) if row in rows] == rows
    assert Path("runs/first/report.html").is_file()
    assert Path("runs/after_mixing/ladder.csv").is_file()
