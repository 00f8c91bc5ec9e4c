"""Runs that are killed, or whose terminal closes, are resumed by the same command."""

import dataclasses
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from marl_cair.files import OutputFolderError
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.training.population.league_run import train_league
from marl_cair.training.settings.config_file import load_config
from tests.training.leagues import make_league
from tests.training.runs import small, train

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="kills a forked process"),
    pytest.mark.usefixtures("test_game"),
]


def run_killed(act, number):
    """Call `act` in a process that is killed before its rename `number`; whether it was."""
    child = os.fork()
    if child == 0:
        left = [number]

        def killed(rename):
            def count(self, target):
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                return rename(self, target)

            return count

        Path.replace, Path.rename = killed(Path.replace), killed(Path.rename)
        try:
            act()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def resume(folder):
    """The user's next command after a kill: the same, or the one that its error advises."""
    config = small(folder, "duel", frames=128)
    try:
        return train(config)
    except OutputFolderError:  # it advises resume=
        return train(dataclasses.replace(load_config(folder), total_frames=128), resume=True)


@pytest.mark.slow
def test_training_killed_at_any_write_can_be_resumed(tmp_path):
    number, was_killed = 0, True
    while was_killed:
        folder = tmp_path / f"{number}"
        config = small(folder, "duel", frames=128)
        was_killed = run_killed(lambda config=config: train(config), number)
        if number == 1:  # between the marker and the configuration
            assert (folder / "run.json").exists()
            assert not (folder / "config.yaml").exists()
        assert resume(folder).frames == 128, f"killed before write {number}"
        number += 1 if number < 4 else 4  # the first writes make the folder a run
    assert number > 5


@pytest.mark.parametrize(
    "number", [0, *(pytest.param(number, marks=pytest.mark.slow) for number in (1, 3, 5))]
)
def test_a_league_in_training_is_resumed(tmp_path, number):
    settings = make_league(tmp_path / "a", total_frames=64, slice_frames=64)
    run_killed(lambda: train_league(settings, show_progress=False), number)
    assert train_league(settings, show_progress=False).is_done


@pytest.mark.parametrize(
    "number", [0, 2, *(pytest.param(number, marks=pytest.mark.slow) for number in (1, 3))]
)
def test_a_league_is_resumed(tmp_path, number):
    config = LeagueConfig(
        ("last_standing/idle", "last_standing/random"),
        game="last_standing",
        scenario="duel",
        games_per_pair=2,
        replays=False,
        out=str(tmp_path / "a"),
    )
    run_killed(lambda: run_league(config, show_progress=False), number)
    assert run_league(config, show_progress=False).text


PROGRAM = """
import sys
from marl_cair.cli import main
words = "train scenario=11x11 policy.hidden_width=8 generator=none " \\
    "collector.num_worlds=8 replay.capacity_transitions=2000 replay.min_transitions=100 " \\
    "torch_threads=1 evaluation.bots=[] total_frames=1e9 opponent=random " \\
    "opponent.snapshot_every_frames=4000"
sys.exit(main([*words.split(), f"out={sys.argv[1]}"]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hang up", signal.SIGTERM])
def test_a_signal_saves_before_the_end(tmp_path, kind):
    main_end, terminal = pty.openpty()
    out = tmp_path / "a"
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(out)],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        preexec_fn=_own_terminal,  # noqa: PLW1509  # one thread
    ) as process:
        os.close(terminal)
        deadline = time.monotonic() + 120
        while not any(out.glob("snapshots/frames_*")) and time.monotonic() < deadline:
            time.sleep(0.1)
        if kind == "hang up":
            os.close(main_end)  # as a closed window: SIGHUP, and nothing can be printed any more
        else:
            process.send_signal(kind)
        assert process.wait(60) == 130
    assert (out / "resume" / "state.pt").is_file()
    assert (out / "latest" / "agent.json").is_file()


def _own_terminal():
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
