"""Times of frames in real time: even, so that no picture of a game is left out."""

import numpy as np

from marl_cair.games.flash.browser.server import FlashServer
from tests.games.flash.browser.flash_files import PROBE, SIZE, change_page, need_flash
from tests.games.flash.browser.vnc_servers import wait_until

NOTE_TIMES = """
const seen = []; // times of the display's frames, and the game's frames until then
function note(time) {
  seen.push([time, call(["getState"]).frames]);
  requestAnimationFrame(note);
}
function call([name, ...values]) {
  if (name === "note") return requestAnimationFrame(note);
  if (name === "seen") return seen;
"""


def test_each_frame_of_the_display_shows_a_frame_of_a_game_of_60(tmp_path, monkeypatch):
    need_flash()
    change_page(tmp_path, monkeypatch, "function call([name, ...values]) {", NOTE_TIMES)
    with FlashServer(PROBE, SIZE, 60) as server:
        server.call("note")
        wait_until(lambda: len(server.call("seen")) > 90, 60)
        times, frames = np.diff(server.call("seen"), axis=0).T
    ticks = times * 60 / 1000
    assert np.mean(np.abs(ticks - ticks.round()) < 1e-4) > 0.9
    assert np.mean(frames == 0) < 0.05
