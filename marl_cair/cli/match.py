"""`marl-cair match`: two agents compared in one scenario, and in variants of it side by side.

Where there are rivals, A plays one seat (or team) and B all others, and every map seed is played
once with A in each: an agent as strong as B has the fair share of the points, 1 / seats (teams).
Where there are none, each plays the same map seeds alone, and their scores are compared.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.match_options import (
    add_fields,
    add_match_options,
    choose_load,
    read_fields,
    round_games,
    update_words,
)
from marl_cair.cli.parser import Parser
from marl_cair.games.checks.scenario import change_scenario
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents.load import find_fingerprint, find_scenario
from marl_cair.league.play.match import MatchResult, play_match
from marl_cair.league.play.sequential import ERROR_RATE, SequentialTest, find_elo, play_sequentially
from marl_cair.league.play.solo import Estimate, SoloResult, compare, play_alone

HELDOUT_MAP = "heldout_map"  # short for heldout.map


def run(arguments: Sequence[str]) -> int:
    """Play and print, each variant as soon as it is played; returns the exit code."""
    options = make_parser().parse_args(update_words("match", arguments))
    game, name, fields = find_scenario(options.agents, options.game, options.scenario)
    variants = read_variants(game, game.scenario(name, **fields), options.fields)
    width = max(map(len, [name, *variants]))
    first, second = options.agents
    load = choose_load(options)
    for number, (label, scenario) in enumerate(variants.items()):
        agents = load(first, game.name, scenario), load(second, game.name, scenario)
        has_rivals = game.make_spec(scenario).num_teams > 1
        if options.sprt:
            test = read_test(options.sprt, has_rivals)
            told = decide_rivals(agents, game, scenario, test, options.max_games, options.seed)
        else:
            tell = compare_rivals if has_rivals else compare_scores
            told = tell(agents, game, scenario, options.games, options.seed)
        head, line, verdict = told
        if number == 0:
            sys.stdout.write(f"A = {first}, B = {second} on {game.name} {name}\n")
        sys.stdout.write(f"{label or name:{width}}  {head}\n{'':{width}}  {line}\n")
        sys.stdout.write(f"{'':{width}}  {verdict}\n")
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
    read = {
        variant: read_fields(game, scenario, changes) for variant, changes in by_variant.items()
    }
    return {
        variant: change_scenario(game.name, scenario, {**read[""], **values})
        for variant, values in read.items()
    }


def compare_rivals(
    agents: tuple[Agent, Agent], game: Game, scenario: Any, num_games: int, seed: int
) -> tuple[str, str, str]:
    """What is played, the numbers, and the verdict, a line each."""
    spec = game.make_spec(scenario)
    num_teams = spec.num_teams
    num_games = round_games(num_games, spec)
    played = play_match(*agents, game, scenario, num_games, seed, _identify(agents, game))
    match = played.without_repeats()
    low, high = match.interval()
    place = "seat" if num_teams == spec.num_players else "team"
    others = "the other" if num_teams == 2 else f"the other {num_teams - 1}"
    fair = f"{match.fair_share:.1%}"
    points = f"{match.score:.1%} [{low:.1%}, {high:.1%}] of the points"
    if low > match.fair_share:
        verdict = "A is stronger than B."
    elif high < match.fair_share:
        verdict = "A is weaker than B."
    else:
        verdict = "They cannot be told apart."
    return (
        f"A in one {place}, B in {others}: {num_games // num_teams} map seeds, once in each",
        f"A won {match.wins}, drew {match.draws}, lost {match.losses}: {points}, {fair} is fair",
        verdict + tell_repeats(num_games, match) + _warn_of_forfeits(match.forfeits),
    )


def read_test(text: str, has_rivals: bool) -> SequentialTest:
    """The test that `--sprt` names. Raises ValueError for other words, or where nobody rivals."""
    try:
        lower, higher = map(float, text.split(","))
    except ValueError as error:
        raise ValueError(
            f"--sprt is {text!r}, it must be two numbers of Elo, for example 0,20"
        ) from error
    if not has_rivals:
        raise ValueError("--sprt needs rivals: where each plays alone, leave it out")
    return SequentialTest(lower, higher)


def decide_rivals(
    agents: tuple[Agent, Agent],
    game: Game,
    scenario: Any,
    test: SequentialTest,
    max_games: int,
    seed: int,
) -> tuple[str, str, str]:
    """What is played, the numbers, and the verdict, a line each."""
    result = play_sequentially(
        agents, game, scenario, test, max_games, seed, _identify(agents, game)
    )
    match, numbers = result.match, (test.lower, test.higher)
    low, high = match.interval()
    ends = [_format_elo(share, match.num_teams) for share in (match.score, low, high)]
    verdicts = {
        "higher": "A is stronger than B: {1:g} Elo is likelier than {0:g}",
        "lower": "No such gain: {0:g} Elo is likelier than {1:g}",
        "undecided": f"Undecided between {{0:g}} and {{1:g}} Elo after {max_games} games",
        "repeats": "Undecided: from here on all games are repeats of others, move by move",
    }
    head = (
        f"sequential test on map seeds, {test.lower:g} against {test.higher:g} Elo, at most "
        f"{ERROR_RATE:.0%} wrong either way: {match.games} games"
    )
    line = (
        f"A won {match.wins}, drew {match.draws}, lost {match.losses}: {ends[0]} Elo "
        f"[{ends[1]}, {ends[2]}], which the stopping exaggerates"
    )
    verdict = (
        f"{verdicts[result.verdict].format(*numbers)} (log-likelihood ratio {result.ratio:+.2f}, "
        f"limits {-test.limit:+.2f} and {test.limit:+.2f})."
    )
    return head, line, verdict + _warn_of_forfeits(match.forfeits)


def _format_elo(score: float, num_teams: int) -> str:
    elo = find_elo(score, num_teams)
    return ("beyond all limits" if elo is None else f"{elo:+.0f}") if score else "below all limits"


def tell_repeats(num_games: int, match: MatchResult) -> str:
    """Of `num_games`, which are left out in `match`, and which of those in it are the same."""
    left_out, told = num_games - match.games, ""
    if left_out:
        told = f" {left_out} of {num_games} games repeat others, move by move, and do not count."
    return told + _warn_of_repeats(match.games, match.distinct_games)


def _warn_of_forfeits(forfeits: Sequence[str]) -> str:
    return f" {len(forfeits)} games were forfeited: {forfeits[0]}." if forfeits else ""


def compare_scores(
    agents: tuple[Agent, Agent], game: Game, scenario: Any, num_games: int, seed: int
) -> tuple[str, str, str]:
    """What is played, the numbers, and the verdict, a line each."""
    names = _identify(agents, game)
    results: list[SoloResult] = [
        play_alone(agent, game, scenario, num_games, seed, identity)
        for agent, identity in zip(agents, names, strict=True)
    ]
    gain = compare(*results)
    if gain.low > 0.0:
        verdict = "A scores more than B."
    elif gain.high < 0.0:
        verdict = "A scores less than B."
    else:
        verdict = "They cannot be told apart."
    distinct = min(result.distinct_games for result in results)
    scores = (_format(result.estimate) for result in results)
    return (
        f"each alone on the same {num_games} map seeds; a score is the sum of a game's rewards",
        "mean score of A {}, of B {}; ".format(*scores) + f"A less B {_format(gain)}",
        verdict + _warn_of_repeats(num_games, distinct),
    )


def _identify(agents: tuple[Agent, Agent], game: Game) -> tuple[str, str]:
    return find_fingerprint(agents[0], game), find_fingerprint(agents[1], game)


def _format(estimate: Estimate) -> str:
    return f"{estimate.mean:.4g} [{estimate.low:.4g}, {estimate.high:.4g}]"


def _warn_of_repeats(num_games: int, num_distinct: int) -> str:
    if num_distinct == num_games:
        return ""
    return f" (only {num_distinct} of {num_games} games differ: the interval is too narrow)"


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair match",
        description=__doc__,
        epilog="example: marl-cair match runs/a/latest economist --game deep_rts "
        "--scenario 1v1-15x15 --set map=train-15x15-2p --set heldout_map=test-15x15-2p --games 200",
    )
    parser.add_argument(
        "agents",
        nargs=2,
        metavar="AGENT",
        help="A and B: folders of checkpoints (runs/a/latest), of runs (runs/a: its `latest`) or "
        "of mixtures, bots (`marl-cair games`), functions that make an agent (module:function), or "
        "commands that speak JSON lines (process:COMMAND)",
    )
    add_fields(
        parser,
        f"; variant.field=value plays that variant too, {HELDOUT_MAP}=... is for heldout.map=...",
    )
    add_match_options(parser, 100, "of each variant", "first checkpoint", "bots alone")
    parser.add_argument(
        "--sprt",
        default="",
        metavar="ELO0,ELO1",
        help="play until it is clear whether A is ELO0 or ELO1 above B, for example 0,20: the "
        "sequential probability ratio test on map seeds; --games does not count then (default: no)",
    )
    parser.add_argument(
        "--max-games",
        type=int,
        default=20_000,
        help="at which --sprt gives up (default: %(default)s)",
    )
    return parser
