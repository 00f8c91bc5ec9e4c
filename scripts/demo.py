"""The demonstration behind `make demo`: python scripts/demo.py [--out runs/demo] ..."""

import sys
from dataclasses import fields
from pathlib import Path

from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED, EXIT_REFUSED
from marl_cair.cli.parser import Parser
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import record_game
from marl_cair.training.demo import NEXT, DemoSettings, run_demo
from marl_cair.training.settings.options import read_comments
from marl_cair.viewer.page import write_viewer

AGENT = "agents/deep_line_wars_10x15"  # of the repository
SHOWN = """first a game of a trained agent, to watch while the demo runs: open {page}
play against it: .venv/bin/marl-cair play deep_line_wars --opponent {agent}"""


def show_agent(out: Path) -> None:
    """Write a game of the repository's agent as a page, and say where it is."""
    game, page = GAMES["deep_line_wars"], out / "watch.html"
    if not page.exists():
        scenario = game.scenario("10x15")
        agent = load_agent(Path(__file__).parents[1] / AGENT, game.name, scenario)
        bot = game.bot("counter", scenario)
        write_viewer(page, record_game(agent, bot, game, scenario, seed=0))
    print(SHOWN.format(page=page, agent=AGENT), flush=True)


def main() -> int:
    """Run it as the command line says; returns the exit code."""
    parser = Parser(description=__doc__)
    comments = read_comments(DemoSettings)
    for field in fields(DemoSettings):
        name, kind = field.name.replace("_", "-"), type(field.default)
        shown = f"{comments[field.name]} (default: {field.default})"
        parser.add_argument(f"--{name}", type=kind, default=field.default, help=shown)
    settings = DemoSettings(**vars(parser.parse_args()))
    try:
        show_agent(Path(settings.out))
        run_demo(settings)
    except KeyboardInterrupt:
        print(f"interrupted: run the same command again to go on in {settings.out}")
        return EXIT_INTERRUPTED
    except (ValueError, OSError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return EXIT_REFUSED
    print(NEXT.format(out=settings.out))
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main())
