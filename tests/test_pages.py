"""The commands of docs/league.md and docs/self_play.md parse, and run, shortened, in order."""

import contextlib
import re
import shlex
from pathlib import Path

import pytest

from marl_cair.cli import exploit, main
from marl_cair.cli.compose import compose_config
from marl_cair.cli.league import make_parser
from marl_cair.cli.league_members import make_add_parser, make_mix_parser
from marl_cair.training.population.league_examples import EXAMPLES, PSRO_EXAMPLES

DOCS = Path(__file__).parents[1] / "docs"
LEAGUE, SELF_PLAY = ((DOCS / name).read_text("utf-8") for name in ("league.md", "self_play.md"))
(BOT,) = re.findall(r"as `(bots/\w+\.py)`:\n\n```python\n(.*?)```", LEAGUE, re.DOTALL)
SUBCOMMANDS = {"add": make_add_parser, "mix": make_mix_parser, "exploit": exploit.make_parser}
FOLDERS = ("status", "report", "export")  # sub-commands for the folder of a played league
EXAMPLES_OF = {"train": EXAMPLES, "psro": PSRO_EXAMPLES}
# Words that make an hour of training seconds.
SHORT = (
    *("torch_threads=1", "collector.steps_per_batch=8", "learner.batch_size=16"),
    *("policy.hidden_width=16", "max_ticks=60"),
)
SHORT_TRAINING = (
    *(*SHORT, "collector.num_worlds=16", "replay.min_transitions=200", "generator=none"),
    *("replay.capacity_transitions=3000", "evaluation.bots=[]"),
    *("opponent.snapshot_every_frames=256", "nfsp.min_rows=50"),
)
SHORT_EXPLOIT = (
    *("--budget", "256", "--seeds", "2", "--games", "2", "policy=mlp", "representation=vector"),
    *(*SHORT, "collector.num_worlds=8", "replay.min_transitions=64", "--out", "runs/exploit"),
)


def list_commands(page):
    """The words of each command of marl-cair on a page."""
    blocks = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
    lines = [shlex.split(line) for block in blocks for line in block.splitlines()]
    return [words[1:] for words in lines if words[:1] == ["marl-cair"]]


LEAGUE_COMMANDS = [words for words in list_commands(LEAGUE) if words[0] == "league"]
SELF_PLAY_COMMANDS = list_commands(SELF_PLAY)


@pytest.mark.parametrize("words", [*LEAGUE_COMMANDS, *SELF_PLAY_COMMANDS], ids=" ".join)
def test_the_command_is_understood(words):
    name, first, *others = words
    if name == "train":
        config = compose_config(words[1:])
        every = config.collector.num_worlds * config.collector.steps_per_batch
        # The snapshot that the page names is that of the first batch past its time.
        frames = -(-config.opponent.snapshot_every_frames // every) * every
        assert config.out != "runs/pool" or f"frames_{frames:010d}" in SELF_PLAY
    elif first in EXAMPLES_OF:
        is_file = others == ["league.yaml" if first == "train" else "psro.yaml"]
        assert is_file or others[1] in EXAMPLES_OF[first]
    elif first in FOLDERS:
        assert others[0] == "runs/first_league"
    elif first in SUBCOMMANDS:
        SUBCOMMANDS[first]().parse_args(others)
    else:
        make_parser().parse_args(words[1:])


def shorten(words):
    """The words of a command that runs for seconds."""
    if words[1] != "exploit":
        return words
    kept = list(words)
    for option in ("--budget", "--seeds"):
        del kept[(place := kept.index(option)) : place + 2]
    return [*kept, *SHORT_EXPLOIT]


@pytest.mark.slow
def test_the_commands_of_leagues_run_one_after_another(tmp_path, monkeypatch, capsys):
    """The page shows the ladder that the first of them prints."""
    monkeypatch.chdir(tmp_path)
    place, program = BOT
    Path(place).parent.mkdir()
    Path(place).write_text(program, "utf-8")
    for number, words in enumerate(LEAGUE_COMMANDS):
        assert main(shorten(words)) == 0, words
        printed = capsys.readouterr().out
        if number == 0:
            shown = re.search(r"```\n(economist is .*?)```", LEAGUE, re.DOTALL).group(1)
            rows = [row.split() for row in shown.splitlines() if row.strip()[:1].isdigit()]
            assert len(rows) == 4
            assert [row for row in map(str.split, printed.splitlines()) if row in rows] == rows
    assert Path("runs/first_league/report.html").is_file()
    assert Path("runs/after_mixing/ladder.csv").is_file()


@pytest.mark.slow
def test_the_commands_of_self_play_run_one_after_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command in SELF_PLAY_COMMANDS:
        words = [word.replace("0000051200", "0000000256") for word in command]
        words = ["total_frames=512" if w.startswith("total_frames=") else w for w in words]
        if words[0] == "train":
            words = [w for w in words if not w.startswith("opponent.snapshot_every")]
            words += SHORT_TRAINING
        words = ["2" if w == "20" else w for w in words]
        if ">" in words:
            *words, _, target = words
            with Path(target).open("w", encoding="utf-8") as file, contextlib.redirect_stdout(file):
                assert main(words) == 0, command
        else:
            assert main(words) == 0, command
    assert Path("runs/after_league/ladder.csv").is_file()
    assert Path("runs/after_psro/ladder.csv").is_file()
