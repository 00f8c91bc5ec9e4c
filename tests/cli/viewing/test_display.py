"""`marl-cair play` on a real display (Xvfb), with the window's own loop and thread."""

import csv
import json
import os
import shutil
import subprocess
import sys

import pytest
from PIL import Image

LIMIT_SECONDS = 600  # a game takes up to thirty; other work may keep the machine busy
SIZE = (1280, 800)
# A person who plays until the game is over, takes a screenshot and leaves.
PERSON = """
import sys, threading, time, traceback
from pathlib import Path
import pygame
from marl_cair.cli import main
from marl_cair.window import window
from tests.window import persons

how, folder, *words = sys.argv[1:]
shown = []

class Shown(window.Window):
    def __init__(self, *rest):
        super().__init__(*rest)
        shown.append(self)

window.Window = Shown

def flap(person):
    while not person.window.moment.is_over:
        person.press(pygame.K_SPACE)
        time.sleep(0.05)

def play():
    while not shown or shown[0]._frames < 2:
        time.sleep(0.02)
    person = persons.PersonAtDisplay(shown[0])
    try:
        {"flap": flap, "line_wars": persons.win_line_wars, "rts": persons.win_skirmish}[how](person)
        person.wait()  # the last picture is drawn
        print(pygame.display.get_driver(), flush=True)
    except Exception:
        traceback.print_exc()
    person.press(pygame.K_F12, pygame.K_ESCAPE)

threading.Thread(target=play, daemon=True).start()
sys.exit(main(["play", *words, "--no-record", "--speed", "64", "--folder", folder]))
"""


@pytest.fixture
def display():
    """The name of a display of an X server that ends with the test."""
    is_needed = "MARL_CAIR_NEEDS_BROWSER" in os.environ  # set by .ci/run, which installs it
    program = shutil.which("Xvfb")
    if program is None and not is_needed:
        pytest.skip("Xvfb is missing: apt install xvfb")
    assert program, "Xvfb is missing"
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [program, "-displayfd", str(writing), "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as pipe:
            number = pipe.readline().strip()  # empty if the server ended
        if not number and not is_needed:
            pytest.skip("Xvfb does not start here")
        assert number, "Xvfb does not start"
        yield f":{number}"
    finally:
        server.terminate()
        server.wait(LIMIT_SECONDS)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("flap", ["flappy_bird", "--set", "max_ticks=40"]),
        ("line_wars", ["deep_line_wars", "--opponent", "random", "--set", "ticks_per_step=20"]),
        ("rts", ["deep_rts", "--opponent", "random", "--scenario", "Skirmish-15x15"]),
    ],
    ids=["flappy_bird", "deep_line_wars", "deep_rts"],
)
def test_a_game_is_played_to_its_end_on_a_display(display, tmp_path, how, words):
    """Events go through SDL's queue; games against `random` are won."""
    kept = {k: v for k, v in os.environ.items() if k not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", PERSON, how, str(tmp_path), *words],
        env=kept | {"DISPLAY": display, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=LIMIT_SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "x11", done.stderr
    (about,) = tmp_path.glob(f"{words[0]}-*.json")
    game = json.loads(about.read_text("utf-8"))
    assert game["is_over"]
    rows = list(csv.DictReader(about.with_suffix(".csv").read_text("utf-8").splitlines()))
    assert int(rows[-1]["step"]) == game["steps"] > 1
    if how == "flap":
        assert game["players"][0]["actions"]["flap"] > 0
    else:
        assert game["winner"] == 0
        assert game["ending"] == "you have won"
    with Image.open(tmp_path / "screenshot.png") as image:
        assert image.size == SIZE
        assert len(image.convert("RGB").getcolors(1 << 16)) > 20
