"""`marl-cair play` on a real display (Xvfb), with the window's own loop and thread."""

import csv
import json
import os
import shutil
import subprocess
import sys

import pytest
from PIL import Image

LIMIT_SECONDS = 120  # it takes six; other work may keep the machine busy
# A person who flaps until the game is over, takes a screenshot and leaves.
PERSON = """
import sys, threading, time
from pathlib import Path
import pygame
from marl_cair.cli import main

folder = Path(sys.argv[1])

def post(key):
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key, mod=0))

def play():
    while not pygame.display.get_surface():
        time.sleep(0.02)
    while not list(folder.glob("*.json")):
        post(pygame.K_SPACE)
        time.sleep(0.05)
    time.sleep(0.2)  # the last picture is drawn
    print(pygame.display.get_driver(), flush=True)
    post(pygame.K_F12)
    post(pygame.K_ESCAPE)

threading.Thread(target=play, daemon=True).start()
sys.exit(main(["play", "flappy_bird", "--set", "max_ticks=40", "--size", "640x480",
               "--folder", str(folder)]))
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
        [program, "-displayfd", str(writing), "-screen", "0", "800x600x24", "-nolisten", "tcp"],
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


def test_a_game_is_played_to_its_end_on_a_display(display, tmp_path):
    kept = {k: v for k, v in os.environ.items() if k not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", PERSON, str(tmp_path)],
        env=kept | {"DISPLAY": display},
        capture_output=True,
        text=True,
        timeout=LIMIT_SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "x11"
    (about,) = tmp_path.glob("flappy_bird-*.json")
    game = json.loads(about.read_text("utf-8"))
    assert game["is_over"]
    assert game["players"][0]["actions"]["flap"] > 0
    rows = list(csv.DictReader(about.with_suffix(".csv").read_text("utf-8").splitlines()))
    assert int(rows[-1]["step"]) == game["steps"] > 1
    with Image.open(tmp_path / "screenshot.png") as image:
        assert image.size == (640, 480)
        assert len(image.convert("RGB").getcolors(1 << 16)) > 20
