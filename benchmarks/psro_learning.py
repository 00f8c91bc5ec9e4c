"""Best responses in rounds, rated; and how far the mixture of them can be exploited.

    python -m benchmarks.psro_learning [--game deep_line_wars] [--begin AGENT ...]
        [--psro psro.yaml] [--games 200] [--budget 20m] [--workers 2] [--out runs/psro_<game>]
        [--picture <out>/psro.png] [option=value ...]

The rounds are the ready-made ones of the game (`marl-cair league psro --example`), or `--psro`;
`--begin` takes the place of the file's `begin_with`. The mixture, all responses, those they began
with and the bots are one ladder, `--games` of each pair; a best response to the mixture is rated by
`marl-cair league exploit` (options with `=` go to it) on map seeds that nothing else has seen. The
same command again goes on where it was stopped. Writes <out>/results.csv and the picture, and
prints the table as Markdown.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from benchmarks._ladders import (
    EXPLOIT,
    LADDER,
    Traced,
    exploit,
    format_least,
    format_response,
    format_scores,
    read_ladder,
    read_scores,
    run,
    show,
    trained_minutes,
)
from marl_cair.checkpoint import read_description
from marl_cair.cli.league_train import format_options
from marl_cair.files import write_atomically
from marl_cair.training.population.league_examples import PSRO_EXAMPLES
from marl_cair.training.population.psro import MIXTURE, ROUNDS, find_entrants
from marl_cair.training.population.psro_settings import PsroSettings, build_psro, load_psro
from marl_cair.training.settings.config_file import CONFIG_FILE

FOLDER = "rounds"


def play(options: argparse.Namespace, settings: PsroSettings, out: Path) -> list[Path]:
    """The rounds, the ladder of all, and the best response; returns the players' folders."""
    file, folder = out / "psro.yaml", out / FOLDER
    write_atomically(file, format_options(settings))
    run(["league", "psro", str(file), "--out", str(folder)])
    here = dataclasses.replace(settings, out=str(folder))
    entrants = find_entrants(here, settings.rounds)  # each once
    everyone = [str(folder / MIXTURE), *(one.source for one in entrants)]
    words = ["--games", str(options.games), "--workers", str(options.workers)]
    run(["league", *everyone, *words, "--out", str(out / LADDER)])
    exploit(folder / MIXTURE, options, out / EXPLOIT)
    return [Path(one.source) for one in entrants if one.name.startswith("player_")]


def trace(ladder: Path, players: list[Path]) -> Traced:
    """The responses by the decisions of all so far, and what their mixture scores."""
    others, decisions, progress = read_ladder(ladder), 0, []
    for player in players:
        decisions += read_description(player).frames
        progress.append((decisions, others.pop(player.name)))
    return Traced(progress, others, read_scores(ladder, MIXTURE))


def main() -> None:
    """Train, play, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", choices=tuple(PSRO_EXAMPLES), default="deep_line_wars")
    parser.add_argument("--begin", nargs="*", help="agents (default: as the file says)")
    parser.add_argument("--psro", type=Path, help="YAML (default: the example of the game)")
    parser.add_argument(
        "--games", type=int, default=200, help="of each pair; the best response's twice"
    )
    parser.add_argument("--budget", default="20m", help="of the best response")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="default: runs/psro_<game>")
    parser.add_argument("--picture", type=Path, help="default: <out>/psro.png")
    options, words = parser.parse_known_args()
    options.words = words
    out = options.out or Path("runs") / f"psro_{options.game}"
    settings = load_psro(options.psro) if options.psro else build_psro(PSRO_EXAMPLES[options.game])
    if options.begin is not None:
        settings = dataclasses.replace(settings, begin_with=tuple(options.begin))
    players = play(options, settings, out)
    ladder = out / LADDER
    traced = trace(ladder, players)
    rows = [
        *format_scores("mixture", ladder, MIXTURE),
        *(format_least(ladder, player.name) for player in players),
        format_response(out / EXPLOIT, options.budget, MIXTURE),
    ]
    titles = "Best responses, one after the other", "Their mixture"
    runs = (out / FOLDER / ROUNDS).glob(f"*/run/{CONFIG_FILE}")
    minutes = sum(trained_minutes(path.parent) for path in runs)
    decisions = max((at for at, _ in traced.progress), default=0)
    title = f"{minutes:.0f} minutes of training, {decisions:,} decisions"
    show(traced, rows, titles, title, out, options.picture or out / "psro.png")


if __name__ == "__main__":
    main()
