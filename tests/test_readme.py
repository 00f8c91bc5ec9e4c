"""The programs of the README and the game pages run as they stand in a fresh clone, those of the
README only with fewer steps.
"""

import itertools
import re
import shlex
from pathlib import Path

import pytest

from docs.tables import PAGE as GAMES_PAGE
from docs.tables import find_table, make_table
from marl_cair.cli import main
from marl_cair.games import GAMES
from marl_cair.training.demo import DemoSettings, run_demo
from tests.processes import read_output

ROOT = Path(__file__).parents[1]


def find_programs(page):
    return re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)


PROGRAMS = find_programs(ROOT / "README.md")
PAGES_WITH_COMMANDS = (
    *(ROOT / name for name in ("README.md", "docs/getting_started.md", "docs/league.md")),
    ROOT / "agents/README.md",
)
MAX_README_LINES = 180
# Of the README's five commands: what makes each take seconds.
SHORTER = {
    "evaluate": "--games 2",
    "train": "total_frames=512 torch_threads=1 evaluation.games=2 collector.num_worlds=16 "
    "replay.min_transitions=128 learner.batch_size=16 generator=none",
    "league": "--games 2 --no-replays",
}


@pytest.mark.slow
def test_the_demo_writes_what_it_promises(tmp_path):
    """Cut short by its own options."""
    folder, short = tmp_path / "runs" / "demo", {"evaluation_games": 2, "num_worlds": 32}
    run_demo(DemoSettings(str(folder), score=0.0, frames=1_024, league_games=2, **short))
    for name in ("curves.png", "game.gif", "league/league.png", "league/ladder.csv"):
        assert (folder / name).stat().st_size > 0, name
    ladder = (folder / "league" / "ladder.txt").read_text("utf-8")
    assert "conv" in ladder
    assert "capsule" in ladder


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS, ids=range(len(PROGRAMS)))
def test_the_programs_of_the_readme_run(program, tmp_path):
    shorter = program.replace("range(100)", "range(2)").replace("256", "4")
    (tmp_path / "agents").symlink_to(ROOT / "agents")
    read_output(tmp_path, "-c", shorter)


def test_the_readme_is_short_and_its_five_commands_run(tmp_path, monkeypatch):
    page = (ROOT / "README.md").read_text("utf-8")
    assert len(page.splitlines()) <= MAX_README_LINES
    text = page.partition("## Five commands")[2]
    block = re.search(r"```sh\n(.*?)```", text, re.DOTALL)[1]
    commands = [shlex.split(line, comments=True)[1:] for line in block.splitlines()]
    assert [words[0] for words in commands] == ["games", "evaluate", "train", "curves", "league"]
    (tmp_path / "agents").symlink_to(ROOT / "agents")
    monkeypatch.chdir(tmp_path)
    for words in commands:
        shorter = " ".join(words).replace("--games 100", "").split()
        assert main([*shorter, *SHORTER.get(words[0], "").split()]) == 0, words
    assert (tmp_path / "runs/quick.png").stat().st_size > 0
    assert (tmp_path / "runs/league/report.html").stat().st_size > 0


def test_commands_name_only_folders_that_a_clone_has_or_that_a_command_before_makes():
    for page in PAGES_WITH_COMMANDS:
        made = set()
        for block in re.findall(r"```sh\n(.*?)```", page.read_text("utf-8"), re.DOTALL):
            for line in block.splitlines():
                words = shlex.split(line, comments=True)
                made |= {w.removeprefix("out=") for w in words if w.startswith("out=runs/")}
                made |= {b for a, b in itertools.pairwise(words) if a == "--out"}
                for word in words:
                    if word.startswith("agents/"):
                        assert (ROOT / word).is_dir(), line
                    if word.startswith("runs/") and page.name == "README.md":
                        assert any(word.startswith(one) for one in made), line


@pytest.mark.slow
def test_a_demo_that_has_not_learned_says_so(tmp_path):
    settings = DemoSettings(
        str(tmp_path), score=1.01, frames=512, evaluation_games=2, num_worlds=32
    )
    with pytest.raises(ValueError, match="conv network has not reached 101% .* --frames 1024"):
        run_demo(settings)


GAME_PROGRAMS = [
    pytest.param(program, id=f"{page.parent.name} {number}")
    for page in (
        *sorted(ROOT.glob("marl_cair/games/*/README.md")),
        *(ROOT / "docs" / name for name in ("clients.md", "games.md")),
    )
    for number, program in enumerate(find_programs(page))
]


def test_every_game_page_has_a_program():
    assert len(GAME_PROGRAMS) >= len(GAMES.load_own())


@pytest.mark.slow
@pytest.mark.parametrize("program", GAME_PROGRAMS)
def test_the_programs_of_the_game_pages_run(program, tmp_path):
    read_output(tmp_path, "-c", program)


def test_the_table_of_scenarios_is_what_is_registered():
    """`python docs/tables.py` writes it again."""
    table = make_table()
    assert find_table(GAMES_PAGE.read_text("utf-8")) == table
    for game in GAMES.load_own():
        assert (ROOT / f"docs/images/{game.name}.png").is_file()
        assert (ROOT / f"marl_cair/games/{game.name}/README.md").is_file()
        for name, scenario in game.scenarios.items():
            assert name in table
            assert game.make_spec(scenario).pays
