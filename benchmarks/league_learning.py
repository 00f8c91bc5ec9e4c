"""Train a league, an agent against random play alone, and best responses; rate them: the self-play
results of the README.

    python -m benchmarks.league_learning [--game deep_line_wars] [--league league.yaml]
        [--alone-frames 150000] [--games 200] [--past-games 40] [--budget 20m] [--workers 2]
        [--out runs/self_play_<game>] [--picture docs/images/self_play_<game>.png]
        [option=value ...]

The league is the ready-made one of the game (`marl-cair league train --example`), or `--league`.
`--games` of the main agent and of the league's mixture against each bot and against the agent that
met random play alone, and `--past-games` of each past self against everybody, are one ladder; best
responses to both are rated by `marl-cair league exploit` (options with `=` go to it) on map seeds
that nothing else has seen. The same command again goes on where it was stopped. Writes
<out>/results.csv and the picture, and prints the table as Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks._ladders import (
    ALONE,
    EXPLOIT,
    LADDER,
    MAIN,
    exploit,
    format_response,
    format_scores,
    read_decisions,
    run,
    show,
    trace_learner,
    trained_minutes,
)
from marl_cair.checkpoint import LATEST_FOLDER, LIVE_FOLDER, PLAYERS, SHARED, read_description
from marl_cair.cli.league_train import format_options
from marl_cair.files import write_atomically
from marl_cair.training.population.league_examples import EXAMPLES
from marl_cair.training.population.league_run import MEMBERS, MIXTURE
from marl_cair.training.population.league_settings import build_league, load_league
from marl_cair.training.settings.config_file import CONFIG_FILE


def list_options(settings: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Nested settings as words of `marl-cair train`."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from list_options(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            yield f"{prefix}{name}=[{','.join(map(str, value))}]"
        else:
            yield f"{prefix}{name}={value}"


def train_all(options: argparse.Namespace, out: Path) -> tuple[Path, Path]:
    """The league, then the agent against random play alone; returns the folders of both agents."""
    file = options.league or out / "league.yaml"
    if not file.exists():
        write_atomically(file, format_options(build_league(EXAMPLES[options.game])))
    league = load_league(file)
    folder = out / "league"
    run(["league", "train", str(file), "--out", str(folder)])
    training = dict(league.training)
    training.pop("game", None)
    game = league.learner_config("main").game
    words = [f"game={game.name}", f"scenario={game.scenario}", *list_options(training)]
    words += [f"representation={game.representation}", *list_options(game.options)]
    limits = ["opponent.mixture={random: 1}", f"total_frames={options.alone_frames}"]
    alone = out / ALONE
    begins = not (alone / CONFIG_FILE).exists()
    limits += ["checkpoint.include_replay=false"]
    run(["train", *([f"out={alone}", *words, *limits] if begins else [f"resume={alone}"])])
    return folder, alone


def play(options: argparse.Namespace, out: Path, league: Path, alone: Path) -> Path:
    """The ladder of all, and the best responses; returns the ladder's folder."""
    best = league / SHARED / LIVE_FOLDER / MAIN
    ladder, workers = out / LADDER, ["--workers", str(options.workers)]
    bots = [str(name) for name in EXAMPLES[options.game]["final_bots"]]
    now = [str(best), str(league / MIXTURE), str(alone / LATEST_FOLDER), *bots]
    players = sorted((league / SHARED / PLAYERS).iterdir())
    now_at = read_description(best).frames  # frozen too, at the end of the league
    past = [str(path) for path in players if read_decisions(path.name) not in (None, now_at)]
    where = ["--out", str(ladder), *workers]
    run(["league", *now, "--games", str(options.games), "--no-replays", *where])
    run(["league", *past, "--ladder", *now, "--games", str(options.past_games), *where])
    for name, agent in ((MAIN, best), (MIXTURE, league / MIXTURE)):
        exploit(agent, options, out / EXPLOIT / name)
    return ladder


def main() -> None:
    """Train, play, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", choices=("deep_line_wars", "deep_rts"), default="deep_line_wars")
    parser.add_argument("--league", type=Path, help="YAML (default: the example of the game)")
    parser.add_argument("--alone-frames", type=int, default=150_000, help="against random alone")
    parser.add_argument(
        "--games",
        type=int,
        default=200,
        help="of each pair of today's agents; a best response's twice",
    )
    parser.add_argument("--past-games", type=int, default=40, help="of each pair of past selves")
    parser.add_argument("--budget", default="20m", help="of the best response")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="default: runs/self_play_<game>")
    parser.add_argument("--picture", type=Path, help="default: <out>/self_play.png")
    options, words = parser.parse_known_args()
    options.words = words
    out = options.out or Path("runs") / f"self_play_{options.game}"
    league, alone = train_all(options, out)
    ladder = play(options, out, league, alone)
    decisions = read_description(league / SHARED / LIVE_FOLDER / MAIN).frames
    rows = [
        *format_scores("main agent", ladder, MAIN),
        *format_scores("mixture", ladder, MIXTURE),
        *(format_response(out / EXPLOIT / name, options.budget, name) for name in (MAIN, MIXTURE)),
    ]
    titles = "The main agent and its past selves", "The main agent"
    minutes = sum(
        trained_minutes(path.parent) for path in (league / MEMBERS).glob(f"*/*/{CONFIG_FILE}")
    )
    title = f"{minutes:.0f} minutes of the league, {decisions:,} decisions of the main agent"
    picture = options.picture or out / "self_play.png"
    show(trace_learner(ladder, decisions), rows, titles, title, out, picture)


if __name__ == "__main__":
    main()
