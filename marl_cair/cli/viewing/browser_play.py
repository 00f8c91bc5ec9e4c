"""`marl-cair play GAME --browser`: write a game as a page and serve it on loopback."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.games.players.weak_bot import split_name
from marl_cair.lookup import find_by_name

INSTALL = "install"
# Trained agents of a source checkout, as `agents/README.md` lists them.
SHIPPED = Path(__file__).parents[3] / "agents"
DEFAULT_AGENTS = {
    "deep_line_wars": SHIPPED / "deep_line_wars_10x15",
    "deep_rts": SHIPPED / "deep_rts_1v1_15x15",
}


def run(arguments: Sequence[str]) -> int:
    """Fetch the runtime (`install`), or write the page and serve it until Ctrl-C; returns the
    exit code.
    """
    if list(arguments) == [INSTALL]:
        from marl_cair.browser.runtime import install_runtime

        sys.stdout.write(f"onnxruntime-web is in {install_runtime()}\n")
        return EXIT_DONE
    options = make_parser().parse_args(arguments)
    from marl_cair.browser.folder import PAGE_FILE

    folder = Path(options.out or f"runs/play_{options.game}")
    game = find_by_name("game", options.game, GAMES)
    write_game(folder, game, options.scenario, options.fields, options.opponent)
    if options.no_server:
        sys.stdout.write(f"{folder / PAGE_FILE} is the game: open it in a browser\n")
        return EXIT_DONE
    return serve(folder, options.port)


def write_game(
    folder: Path, game: Game, scenario: str | None, fields: Sequence[str], opponent: str | None
) -> None:
    """Write the folder; `opponent` is a bot, a checkpoint or None for the default.

    Raises ValueError and OSError as `browser.folder.write_folder`, and ValueError where the
    opponent plays another game.
    """
    from marl_cair.browser.folder import Opponent, check_playable, write_folder
    from marl_cair.league.agents.load import find_scenario

    source = opponent or choose_opponent(game, scenario, fields)
    bot = source.removeprefix(f"{game.name}/")
    is_bot = bot in game.bots and not Path(source).is_dir()
    plain, strength = split_name(bot)
    if is_bot and strength < 1:
        raise ValueError(f"the opponent is {bot!r}, but a page has full bots only: choose {plain}")
    agents = [] if is_bot else [source]
    _, name, trained = find_scenario(agents, game.name, scenario)
    chosen = game.scenario(name, **shared.change_fields(game, name, trained, fields))
    check_playable(game, chosen)
    if is_bot:
        if game.make_spec(chosen).num_players == 1:
            write_folder(folder, game, name, chosen, Opponent("none", bot="random"))
        else:
            write_folder(folder, game, name, chosen, Opponent(bot, bot=bot))
        return
    about, write_network = describe_network(source, game, chosen)
    write_folder(folder, game, name, chosen, about, write_network)


def choose_opponent(game: Game, scenario: str | None, fields: Sequence[str]) -> str:
    """The trained agent of a source checkout where the scenario is its own, else the last bot."""
    agent = DEFAULT_AGENTS.get(game.name)
    if agent is not None and agent.is_dir() and not fields:
        trained_on = agent.name.removeprefix(f"{game.name}_").replace("_", "-")
        if scenario in (None, trained_on):
            return str(agent)
    return [*game.bots][-1]


def describe_network(
    source: str, game: Game, scenario: Any
) -> tuple[Any, Callable[[Path], object]]:
    """The opponent of a checkpoint, and the function that writes its ONNX file."""
    from marl_cair.browser.folder import Opponent
    from marl_cair.browser.runtime import find_runtime
    from marl_cair.checkpoint import load_network
    from marl_cair.cli.agent.export import export_agent

    network, about = load_network(source)
    if about.game != game.name:
        raise ValueError(f"{source} plays {about.game}, not {game.name}: choose another opponent")
    find_runtime()  # before anything takes long
    spec = game.make_spec(scenario)
    seen = find_by_name("representation", about.representation, spec.representations)
    if (seen.shape, spec.action_names) != (about.observation_shape, about.action_names):
        raise ValueError(
            f"{source} was trained on {game.name} {about.scenario}, its observations or actions "
            "are others than those of the chosen scenario: leave --scenario and --set out"
        )
    opponent = Opponent(
        about.name,
        representation=about.representation,
        dtype=seen.dtype.__name__,
        state_size=network.state_size,
        plays=about.plays,
    )
    return opponent, partial(export_agent, source)


def serve(folder: Path, port: int) -> int:
    """Serve the folder on loopback until the command is interrupted."""
    from marl_cair.browser.serving import make_server

    with make_server(folder, port) as server:
        sys.stdout.write(f"Play at http://127.0.0.1:{server.server_port}/   (end with Ctrl-C)\n")
        sys.stdout.flush()
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            sys.stdout.write("\n")
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair play",
        description=__doc__,
        epilog="example: marl-cair play deep_line_wars --browser. `marl-cair play install` fetches "
        "onnxruntime-web, which plays trained agents in browsers",
    )
    parser.add_argument("game", help="a game of `marl-cair games`")
    parser.add_argument("--browser", action="store_true", required=True, help="play on a page")
    shared.add_options(parser, "--scenario", "--set")
    parser.add_argument(
        "--opponent",
        metavar="AGENT",
        help="a bot, or the folder of a checkpoint (default: the trained agent of this repository "
        "for the scenario, else the game's last bot)",
    )
    parser.add_argument("--out", metavar="FOLDER", help="folder to write (default: runs/play_GAME)")
    parser.add_argument("--port", type=int, default=0, help="to serve on (default: a free one)")
    parser.add_argument(
        "--no-server", action="store_true", help="write the page only: it opens from disk"
    )
    return parser
