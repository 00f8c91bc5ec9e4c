"""`marl-cair match`: compare two agents in one scenario, and in variants of it.

In games with opponents A plays one seat (or team) and B all others, and every map seed is played
once with A in each: an agent as strong as B has the fair share of the points, 1 / seats (teams).
In games for one, each plays the same map seeds alone, and their scores are compared.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser
from marl_cair.games.checks.scenario import change_scenario
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents.load import find_fingerprint, find_scenario
from marl_cair.league.play.match import MatchResult, play_match
from marl_cair.league.play.sequential import ERROR_RATE, SequentialTest, find_elo, play_sequentially
from marl_cair.league.play.solo import Estimate, compare, play_alone

HELDOUT_MAP = "heldout_map"  # short for heldout.map
NO_DIFFERENCE = "The difference is not significant."


class Pairing(NamedTuple):
    """Two agents, and what they play."""

    agents: tuple[Agent, Agent]
    game: Game
    scenario: Any
    seed: int
    identities: tuple[str, str]  # fingerprints of the agents
    sources: tuple[str, str]
    record: str  # folder, or ""


def run(arguments: Sequence[str]) -> int:
    """Play and print each variant as soon as it is played; returns the exit code."""
    options = make_parser().parse_args(arguments)
    game, name, fields = find_scenario(options.agents, options.game, options.scenario)
    variants = read_variants(game, game.scenario(name, **fields), options.fields)
    width = max(map(len, [name, *variants]))
    first, second = options.agents
    load = shared.choose_load(options)
    for number, (label, scenario) in enumerate(variants.items()):
        agents = load(first, game.name, scenario), load(second, game.name, scenario)
        identities = find_fingerprint(agents[0], game), find_fingerprint(agents[1], game)
        more = (first, second), options.record
        pairing = Pairing(agents, game, scenario, options.seed, identities, *more)
        has_opponents = game.make_spec(scenario).num_teams > 1
        if options.sprt:
            test = read_test(options.sprt, has_opponents)
            head, line, verdict = decide_match(pairing, test, options.max_games)
        else:
            compare_agents = compare_opponents if has_opponents else compare_scores
            head, line, verdict = compare_agents(pairing, options.games)
        if number == 0:
            sys.stdout.write(f"A = {first}, B = {second} on {game.name} {name}\n")
        indent = " " * width
        sys.stdout.write(
            f"{label or name:{width}}  {head}\n{indent}  {line}\n{indent}  {verdict}\n"
        )
        sys.stdout.flush()
    return EXIT_DONE


def read_variants(game: Game, scenario: Any, words: Sequence[str]) -> dict[str, Any]:
    """The scenario as `--set field=value` changes it, under "", and by name each variant that
    `--set variant.field=value` makes.

    Raises:
        UnknownNameError: no such field; ValueError: no such value.
    """
    by_variant: dict[str, list[str]] = {"": []}
    for word in words:
        name, equals, value = word.partition("=")
        name = "heldout.map" if name == HELDOUT_MAP else name
        variant, _, field = name.rpartition(".")
        by_variant.setdefault(variant, []).append(f"{field}{equals}{value}")
    read = {name: shared.read_fields(game, scenario, words) for name, words in by_variant.items()}
    return {
        name: change_scenario(game.name, scenario, {**read[""], **values})
        for name, values in read.items()
    }


# --- each returns three lines: the conditions, the numbers and the verdict -----------------------


def compare_opponents(pairing: Pairing, num_games: int) -> tuple[str, str, str]:
    """Play a fixed number of games between A and B."""
    agents, game, scenario, seed, identities, sources, folder = pairing
    spec = game.make_spec(scenario)
    num_teams = spec.num_teams
    num_games = shared.round_games(num_games, spec)
    record = shared.choose_recording(folder, *sources)
    played = play_match(*agents, game, scenario, num_games, seed, identities, record)
    match = played.without_repeats()
    low, high = match.interval()
    place = "seat" if num_teams == spec.num_players else "team"
    others = "the other" if num_teams == 2 else f"the other {num_teams - 1}"
    points = f"{match.score:.1%} [{low:.1%}, {high:.1%}] of the points"
    verdict = _choose(low, high, match.fair_share, "A is stronger than B.", "A is weaker than B.")
    return (
        f"A in one {place}, B in {others}: {num_games // num_teams} map seeds, once in each",
        f"{_count_results(match)}: {points}, {match.fair_share:.1%} is fair",
        verdict + describe_doubts(num_games, match),
    )


def compare_scores(pairing: Pairing, num_games: int) -> tuple[str, str, str]:
    """Play a fixed number of games of A and of B alone."""
    _, game, scenario, seed, *_ = pairing
    first, second = (
        play_alone(
            agent,
            game,
            scenario,
            num_games,
            seed,
            identity,
            shared.choose_recording(pairing.record, source),
        )
        for agent, identity, source in zip(
            pairing.agents, pairing.identities, pairing.sources, strict=True
        )
    )
    gain = compare(first, second)
    verdict = _choose(gain.low, gain.high, 0.0, "A scores more than B.", "A scores less than B.")
    distinct = min(first.distinct_games, second.distinct_games)
    means = f"mean score of A {_format(first.estimate)}, of B {_format(second.estimate)}"
    return (
        f"each alone on the same {num_games} map seeds; a score is the sum of a game's rewards",
        f"{means}; A less B {_format(gain)}",
        verdict + warn_of_repeats(num_games, distinct),
    )


def read_test(text: str, has_opponents: bool) -> SequentialTest:
    """The test that `--sprt` names. Raises ValueError for other words, or a game for one."""
    try:
        lower, higher = map(float, text.split(","))
    except ValueError as error:
        raise ValueError(
            f"--sprt is {text!r}, it must be two numbers of Elo, for example 0,20"
        ) from error
    if not has_opponents:
        raise ValueError("--sprt needs a game with opponents: where each plays alone, leave it out")
    return SequentialTest(lower, higher)


def decide_match(pairing: Pairing, test: SequentialTest, max_games: int) -> tuple[str, str, str]:
    """Play games between A and B until a sequential test decides."""
    agents, game, scenario, seed, identities, sources, folder = pairing
    record = shared.choose_recording(folder, *sources)
    result = play_sequentially(agents, game, scenario, test, max_games, seed, identities, record)
    match, lower, higher = result.match, f"{test.lower:g}", f"{test.higher:g}"
    ends = [_format_elo(share, match.num_teams) for share in (match.score, *match.interval())]
    verdict = {
        "higher": f"A is stronger than B: {higher} Elo is likelier than {lower}",
        "lower": f"No such gain: {lower} Elo is likelier than {higher}",
        "undecided": f"Undecided between {lower} and {higher} Elo after {max_games} games",
        "repeats": "Undecided: from here on all games are repeats of others, move by move",
    }[result.verdict]
    errors = f"error rates of at most {ERROR_RATE:.0%}"
    elo = f"{ends[0]} Elo [{ends[1]}, {ends[2]}], exaggerated by the stopping rule"
    limits = f"limits {-test.limit:+.2f} and {test.limit:+.2f}"
    return (
        f"sequential test, {lower} against {higher} Elo, {errors}: {match.games} games",
        f"{_count_results(match)}: {elo}",
        f"{verdict} (log-likelihood ratio {result.ratio:+.2f}, {limits})."
        + _warn_of_forfeits(match.forfeits),
    )


def _choose(low: float, high: float, even: float, more: str, less: str) -> str:
    """The verdict of an interval, against the value at which A and B are equal."""
    return more if low > even else less if high < even else NO_DIFFERENCE


def _count_results(match: MatchResult) -> str:
    return f"A won {match.wins}, drew {match.draws}, lost {match.losses}"


def _format_elo(score: float, num_teams: int) -> str:
    elo = find_elo(score, num_teams)
    return ("beyond all limits" if elo is None else f"{elo:+.0f}") if score else "below all limits"


def _format(estimate: Estimate) -> str:
    return f"{estimate.mean:.4g} [{estimate.low:.4g}, {estimate.high:.4g}]"


def describe_doubts(num_games: int, match: MatchResult) -> str:
    """How many of `num_games` are left out of `match` as repeats, are equal, or were forfeited."""
    left_out, text = num_games - match.games, ""
    if left_out:
        text = f" {left_out} of {num_games} games repeat the others, move by move: not counted."
    text += warn_of_repeats(match.games, match.distinct_games)
    return text + _warn_of_forfeits(match.forfeits)


def warn_of_repeats(num_games: int, num_distinct: int) -> str:
    """A remark, if not all games differ."""
    if num_distinct == num_games:
        return ""
    return f" (only {num_distinct} of {num_games} games differ from one another)"


def _warn_of_forfeits(forfeits: Sequence[str]) -> str:
    return f" {len(forfeits)} games were forfeited: {forfeits[0]}." if forfeits else ""


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair match",
        description=__doc__,
        epilog="example: marl-cair match runs/a/latest economist --game deep_rts "
        "--scenario 1v1-15x15 --set map=train-15x15-2p --set heldout_map=test-15x15-2p --games 200",
    )
    help_of_agents = f"A and B, each: {shared.AGENT_HELP}"
    parser.add_argument("agents", nargs=2, metavar="AGENT", help=help_of_agents)
    shared.add_options(
        parser,
        *(*shared.MATCH_OPTIONS, "--record"),
        games_of="of each variant",
        games="%(default)s",
        more="; variant.field=value also plays that variant, and "
        f"{HELDOUT_MAP}=... is short for heldout.map=...",
    )
    parser.set_defaults(games=100)
    parser.add_argument(
        "--sprt",
        default="",
        metavar="ELO0,ELO1",
        help="play until a sequential probability ratio test on map seeds decides whether A is "
        "ELO0 or ELO1 above B, for example 0,20; --games has no effect then (default: no)",
    )
    parser.add_argument(
        "--max-games",
        type=int,
        default=20_000,
        help="number of games at which --sprt stops undecided (default: %(default)s)",
    )
    return parser
