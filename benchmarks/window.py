"""How many frames the window shows in a second, without a display.

    python -m benchmarks.window [--game deep_rts] [--scenario FFA-6-31x31] [--seconds 10]

Bots play in a window of 1280 x 800 that draws as often as it can, at the game's own speed and as
fast as it goes. Prints a Markdown table: frames in a second, the time within which 99 % of them
followed the frame before, the processor time of one in the thread that draws, and ticks in a
second.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame

from marl_cair.games import GAMES
from marl_cair.window.display import open_display
from marl_cair.window.hotkeys import SPEEDS
from marl_cair.window.session import Session
from marl_cair.window.window import Window

SIZE = (1280, 800)
WARM_UP_SECONDS = 2.0


def measure(session: Session, speed: float, seconds: float) -> tuple[float, ...]:
    """Frames in a second, milliseconds of the 99th percentile, processor milliseconds of a frame,
    ticks in a second.
    """
    window = Window(session, open_display(SIZE, "benchmark"), speed=speed)
    durations, first_step, processor = list[float](), 0, time.thread_time()
    before = time.perf_counter()
    end = before + WARM_UP_SECONDS + seconds
    last = before
    while last < end:
        pygame.event.pump()
        window.update(time.perf_counter() - before)
        before = time.perf_counter()
        window.draw()
        pygame.display.flip()
        now = time.perf_counter()
        if now < end - seconds:
            first_step, processor = window.moment.step, time.thread_time()
        else:
            durations.append(now - last)
        last = now
        if window.moment.is_over:
            break
    processor = time.thread_time() - processor
    window.shut_down()
    ticks = (window.moment.step - first_step) * session.spec.ticks_per_step
    whole = sum(durations)
    longest = 1_000 * float(np.percentile(durations, 99))
    return len(durations) / whole, longest, 1_000 * processor / len(durations), ticks / whole


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", default="deep_rts")
    parser.add_argument("--scenario", default="FFA-6-31x31")
    parser.add_argument("--bot", default="mixed")
    parser.add_argument("--seconds", type=float, default=10.0)
    words = parser.parse_args()
    game = GAMES[words.game]
    scenario = game.scenario(words.scenario)
    print("| game | speed | frames/s | 99 % within ms | processor ms a frame | ticks/s |")
    print("|---|---|---|---|---|---|", flush=True)
    for speed in (1.0, SPEEDS[-1]):
        bots = [game.bot(words.bot, scenario) for _ in range(game.make_spec(scenario).num_players)]
        measured = measure(Session(game, scenario, bots), speed, words.seconds)
        frames, longest, processor, ticks = measured
        title = f"| {words.game} {words.scenario} | {speed:g} "
        row = f"| {frames:.0f} | {longest:.1f} | {processor:.2f} | {ticks:.0f} |"
        print(title + row, flush=True)


if __name__ == "__main__":
    main()
