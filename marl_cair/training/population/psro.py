"""Policy-space response oracles: trains best responses in rounds and mixes them into one agent."""

from __future__ import annotations

import dataclasses
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from marl_cair import checkpoint, files
from marl_cair.games import GAMES
from marl_cair.league.agents.load import find_distinct
from marl_cair.league.agents.mixtures import is_mixture, save_mixture
from marl_cair.league.league import LeagueConfig, play_league, run_league
from marl_cair.league.mixing import describe_mixture, mix_league, read_scores
from marl_cair.league.ratings.equilibrium import find_safest_mixture
from marl_cair.stored import read_json
from marl_cair.training.generating.generators import check_generator, take_over_generator
from marl_cair.training.initial_network import can_begin_as
from marl_cair.training.population.psro_settings import PsroSettings, fixed_options
from marl_cair.training.run import RESUME_FOLDER
from marl_cair.training.settings.config_file import write_settings
from marl_cair.training.trainer import train

SETTINGS_FILE, PLAN_FILE, REPORT_FILE = "psro.yaml", "plan.json", "report.txt"
ROUNDS, PLAYERS, EVALUATION, MIXTURE = "rounds", "players", "evaluation", checkpoint.MIXTURE_FOLDER


@dataclass(frozen=True)
class PsroResult:
    """The state of a PSRO run."""

    folder: Path
    rounds: int  # done so far
    is_done: bool  # all of them
    was_interrupted: bool
    text: str  # the report; empty before the end


class _Plan(NamedTuple):
    """A response's opponents and its first network."""

    met: dict[str, float]  # weights by name of an `Entrant`
    start: str | None  # name of one; None: a new network


class Entrant(NamedTuple):
    """An agent that takes part."""

    name: str  # of a response player_000, of an agent of `begin_with` begin_0, of a bot its own
    source: str  # as `load_agent` takes it
    fingerprint: str


def train_psro(settings: PsroSettings, show_progress: bool = True) -> PsroResult:
    """Train `rounds` best responses, rate them, and write the safest mixture of all networks.

    `weigh_opponents` chooses the opponents of a response; it begins as the network that scores
    most against them. The same call again resumes after an interrupt or a kill, and continues with
    more rounds from the end; the bits are those of a run that was never stopped.

    Raises:
        OutputFolderError: the folder holds something else, or a run of other settings.
        CheckpointError: one of `begin_with` that cannot be read, or is no greedy network.
        ValueError: agents of `begin_with` that have different representations.
        As `training.trainer.train`, and as `league.league.run_league`.
    """
    folder, minutes = Path(settings.out), settings.max_minutes
    _check_beginnings(settings)
    find_entrants(settings, 0)  # agents that cannot be loaded are refused before any writing
    with files.claim_output_folder(folder, checkpoint.PSRO, fixed_options(settings), resume=True):
        write_settings(settings, folder / SETTINGS_FILE)
        for name, source in _find_beginnings(settings).items():
            own = _find_player(settings, name)
            files.recover_folder(own)
            if not own.is_dir():
                files.copy_folder(source, own)
        deadline = None if minutes is None else time.monotonic() + 60 * minutes
        for number in range(settings.rounds):
            player = _find_player(settings, _name_player(number))
            files.recover_folder(player)
            if not player.is_dir():
                was_interrupted = _respond(settings, number, deadline, show_progress)
                if was_interrupted or not player.is_dir():
                    done = number + player.is_dir()
                    return PsroResult(folder, done, False, was_interrupted, "")
            # The state of a finished response: its replay is by far the largest file.
            shutil.rmtree(_find_run(settings, number) / RESUME_FOLDER, ignore_errors=True)
        return PsroResult(folder, settings.rounds, True, False, _report(settings, show_progress))


def _check_beginnings(settings: PsroSettings) -> None:
    """Raise an error if responses cannot begin as one of `begin_with`, or be mixed with all."""
    seen: dict[str, str] = {}
    config = settings.response_config(0, {}, None)
    for source in _find_beginnings(settings).values():
        if is_mixture(source) or not can_begin_as(source):
            raise checkpoint.CheckpointError(
                f"begin_with has {source}, which is no folder of a greedy network: give one (of a "
                "mixture its members, of a bot its name in `bots`)"
            )
        config = settings.response_config(0, {}, source)
        seen[checkpoint.read_description(source).representation] = source
    if len(seen) > 1:
        found = ", ".join(f"{source} has {name}" for name, source in seen.items())
        raise ValueError(
            f"agents of begin_with have different representations ({found}): members of a mixture "
            "must have the same"
        )
    check_generator(config)


def _respond(
    settings: PsroSettings, number: int, deadline: float | None, show_progress: bool
) -> bool:
    """Train response `number`, and freeze it at the end of its frames; returns whether it was
    interrupted.
    """
    plan, path = _find_plan(settings, number, show_progress), _find_plan_file(settings, number)
    left = None if deadline is None else (deadline - time.monotonic()) / 60
    if left is not None and left <= 0:
        return False
    sources = {one.name: one.source for one in find_entrants(settings, number)}
    if unknown := sorted({*plan.met, *([plan.start] if plan.start else [])} - sources.keys()):
        raise ValueError(
            f"{path} names unknown agents {', '.join(unknown)}; known are {', '.join(sources)}: "
            "delete the file, and the plan is made again"
        )
    met = {name: (sources[name], weight) for name, weight in plan.met.items()}
    start = None if plan.start is None else sources[plan.start]
    config = settings.response_config(number, met, start)
    run = _find_run(settings, number)
    config = dataclasses.replace(config, out=str(run), max_minutes=left)
    if number > 0:  # the generator is handed from response to response
        config = take_over_generator(config, _find_run(settings, number - 1))
    result = train(config, True, show_progress)
    if result.frames >= config.total_frames:
        player = _find_player(settings, _name_player(number))
        files.copy_folder(result.folder / checkpoint.LATEST_FOLDER, player)
    return result.was_interrupted


def _find_beginnings(settings: PsroSettings) -> dict[str, str]:
    """Sources of `begin_with` by name: their copies, if made, as the originals may have changed."""
    found = {f"begin_{number}": source for number, source in enumerate(settings.begin_with)}
    copies = {name: _find_player(settings, name) for name in found}
    return found | {name: str(copy) for name, copy in copies.items() if copy.is_dir()}


def _find_player(settings: PsroSettings, name: str) -> Path:
    return Path(settings.out).resolve() / PLAYERS / name


def _find_run(settings: PsroSettings, number: int) -> Path:
    return Path(settings.out) / ROUNDS / f"{number:03}" / "run"


def _find_plan_file(settings: PsroSettings, number: int) -> Path:
    return _find_run(settings, number).with_name(PLAN_FILE)


def _name_player(number: int) -> str:
    return f"player_{number:03}"


def _find_plan(settings: PsroSettings, number: int, show_progress: bool) -> _Plan:
    """The plan of a response: made once, then read from its file."""
    path = _find_plan_file(settings, number)
    if path.is_file():
        return _read_plan(path)
    entrants = find_entrants(settings, number)
    networks = _find_networks(entrants)
    if networks:
        play_league(_make_league(settings, entrants, networks), show_progress=show_progress)
        scores = _read_scores(settings, entrants)
        weights = weigh_opponents(scores, networks, settings.slack, settings.even_share)
        best = networks[int((scores @ weights).argmax())]
        names = [one.name for one in entrants]
        plan = _Plan(dict(zip(names, weights.tolist(), strict=True)), names[best])
    else:
        plan = _Plan(dict.fromkeys(settings.bots, 1.0 / len(settings.bots)), None)
    files.write_json(path, plan._asdict())
    if show_progress:
        tqdm.write(f"response {number} {_describe_plan(plan)}")
    return plan


def weigh_opponents(
    scores: NDArray[np.float64], networks: Sequence[int], slack: float, even_share: float
) -> NDArray[np.float64]:
    """A response's opponents: probabilities of N agents, float64 [N].

    The networks play one game with all agents, bots among them: they choose a mixture whose least
    score is the highest, the others one that leaves them the least. `even_share` of the games have
    all agents alike as opponents, so that none is forgotten; half of the rest have the first
    mixture, whose weaknesses a response finds, half the second, which teaches it what the networks
    cannot do yet. Among networks alone the two are the same.

    networks: places of K of the N agents; scores: [K, N], shares of points of these against all.
    """
    safest = np.zeros(scores.shape[1])
    safest[list(networks)] = find_safest_mixture(scores, slack)
    hardest = find_safest_mixture(1.0 - scores.T, slack)
    weights: NDArray[np.float64] = (1.0 - even_share) * (safest + hardest) / 2.0
    return weights + even_share / len(safest)


def _read_plan(path: Path) -> _Plan:
    try:
        read = read_json(path)
        return _Plan({n: float(part) for n, part in read["met"].items()}, read["start"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} cannot be read ({error!r}): delete it, and the plan is made again"
        ) from error


def _describe_plan(plan: _Plan) -> str:
    if plan.start is None:
        return "begins with a new network, against all bots alike"
    likely = sorted(((part, name) for name, part in plan.met.items()), reverse=True)[:5]
    opponents = ", ".join(f"{name} {part:.0%}" for part, name in likely)
    return f"begins as {plan.start}, against {opponents}"


def find_entrants(settings: PsroSettings, number: int) -> list[Entrant]:
    """All agents that take part before response `number`, each once: a response that has learned
    nothing is the agent that it began as.
    """
    game = GAMES[settings.game.name]
    sources = _find_beginnings(settings)
    players = [_name_player(n) for n in range(number)]
    sources |= {name: str(_find_player(settings, name)) for name in players}
    sources |= {bot: f"{game.name}/{bot}" for bot in settings.bots}
    names = {source: name for name, source in sources.items()}
    found = find_distinct(sources.values(), game, settings.game.rated_scenario)
    return [Entrant(names[source], source, fingerprint) for fingerprint, source in found.items()]


def _find_networks(entrants: Sequence[Entrant]) -> list[int]:
    """Places of the networks: responses begin as them, and mixtures consist of them."""
    return [n for n, one in enumerate(entrants) if can_begin_as(one.source)]


def _read_scores(settings: PsroSettings, entrants: Sequence[Entrant]) -> NDArray[np.float64]:
    """Scores of the networks against all, [K, N]."""
    fingerprints = [one.fingerprint for one in entrants]
    return read_scores(Path(settings.out) / EVALUATION, fingerprints, _find_networks(entrants))


def _make_league(
    settings: PsroSettings, entrants: Sequence[Entrant], playing: Sequence[int]
) -> LeagueConfig:
    """Games of the entrants at the places `playing` against all."""
    about = settings.game
    return LeagueConfig(
        agents=tuple(entrants[n].source for n in playing),
        ladder=tuple(one.source for n, one in enumerate(entrants) if n not in playing),
        game=about.name,
        scenario=about.scenario,
        scenario_options=about.options,
        games_per_pair=settings.games_per_pair,
        seed=settings.seed,
        out=str(Path(settings.out) / EVALUATION),
    )


def _report(settings: PsroSettings, show_progress: bool) -> str:
    """Rate all, write the mixture and the report; returns the report."""
    folder = Path(settings.out)
    entrants = find_entrants(settings, settings.rounds)
    league = _make_league(settings, entrants, range(len(entrants)))
    text = run_league(league, show_progress=show_progress).text
    scores = _read_scores(settings, entrants)
    among = {one.fingerprint for one in entrants}
    mixed = mix_league(folder / EVALUATION, slack=settings.slack, among=among)
    save_mixture(folder / MIXTURE, mixed.sources, mixed.weights)
    text += "\nScore of each response against its opponents, and of the agent that it began as:\n"
    places = {one.name: n for n, one in enumerate(entrants)}
    rows = {entrants[n].name: scores[row] for row, n in enumerate(_find_networks(entrants))}
    for number in range(settings.rounds):
        name, plan = _name_player(number), _find_plan(settings, number, show_progress)
        score = "has learned nothing"
        if name in rows:
            score = f"{_weigh(rows[name], plan, places):.1%}"
        if plan.start is not None:
            score += f" ({_weigh(rows[plan.start], plan, places):.1%})"
        text += f"  {name} {score}; it {_describe_plan(plan)}\n"
    text += f"\nAll of them as one agent, {folder / MIXTURE}: {describe_mixture(mixed)}"
    files.write_atomically(folder / REPORT_FILE, text)
    return text


def _weigh(scores: NDArray[np.float64], plan: _Plan, places: Mapping[str, int]) -> float:
    """Mean score against the opponents of a plan."""
    return sum(part * float(scores[places[name]]) for name, part in plan.met.items())
