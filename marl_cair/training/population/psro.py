"""`train_psro`: best responses, one after the other, and a mixture of them as one agent."""

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

from marl_cair.checkpoint import (
    LATEST_FOLDER,
    MIXTURE_FOLDER,
    PSRO,
    CheckpointError,
    read_description,
)
from marl_cair.files import (
    claim_output_folder,
    copy_folder,
    recover_folder,
    write_atomically,
    write_json,
)
from marl_cair.games import GAMES
from marl_cair.league.agents.load import find_distinct
from marl_cair.league.agents.mixtures import is_mixture, save_mixture
from marl_cair.league.league import LeagueConfig, play_league, run_league
from marl_cair.league.mixing import describe_mixture, mix_league, read_scores
from marl_cair.league.ratings.equilibrium import find_safest_mixture
from marl_cair.stored import read_json
from marl_cair.training.generators import check_generator, take_over_generator
from marl_cair.training.initial_network import can_begin_as
from marl_cair.training.population.psro_settings import PsroSettings, fixed_options
from marl_cair.training.run import RESUME_FOLDER
from marl_cair.training.settings.config_file import write_settings
from marl_cair.training.trainer import train

SETTINGS_FILE, PLAN_FILE, REPORT_FILE = "psro.yaml", "plan.json", "report.txt"
ROUNDS, PLAYERS, EVALUATION, MIXTURE = "rounds", "players", "evaluation", MIXTURE_FOLDER


@dataclass(frozen=True)
class PsroResult:
    """Where it stands."""

    folder: Path
    rounds: int  # done so far
    is_done: bool  # all of them
    was_interrupted: bool
    text: str  # the report; empty before the end


class _Plan(NamedTuple):
    """Whom a response meets, and what it begins as."""

    met: dict[str, float]  # weights by name of an `Entrant`
    start: str | None  # name of one; None: it begins anew


class Entrant(NamedTuple):
    """An agent that takes part."""

    name: str  # of a response player_000, of an agent of `begin_with` begin_0, of a bot its own
    source: str  # as `load_agent` takes it
    fingerprint: str


def train_psro(settings: PsroSettings, show_progress: bool = True) -> PsroResult:
    """Train `rounds` best responses, rate them, and write the safest mixture of all networks.

    Whom each meets says `weigh_opponents`; it begins as the network that scores most against them.
    The same call again goes on where an interrupt or a kill stopped it, and with more rounds from
    where it had ended; the bits are those of a run that was never stopped.

    Raises:
        OutputFolderError: the folder holds something else, or a run of other settings.
        CheckpointError: one of `begin_with` that cannot be read, or is no greedy network.
        ValueError: agents of `begin_with` that look at different representations.
        As `training.trainer.train`, and as `league.league.run_league`.
    """
    folder = Path(settings.out)
    _check_beginnings(settings)
    find_entrants(settings, 0)  # what cannot be loaded is refused before anything is written
    with claim_output_folder(folder, PSRO, fixed_options(settings), resume=True):
        write_settings(settings, folder / SETTINGS_FILE)
        for name, source in _find_beginnings(settings).items():
            own = _find_player(settings, name)
            recover_folder(own)
            if not own.is_dir():
                copy_folder(source, own)
        minutes = settings.max_minutes
        deadline = None if minutes is None else time.monotonic() + 60 * minutes
        for number in range(settings.rounds):
            player = _find_player(settings, _name_player(number))
            recover_folder(player)
            if not player.is_dir():
                was_interrupted = _respond(settings, number, deadline, show_progress)
                if was_interrupted or not player.is_dir():
                    done = number + player.is_dir()
                    return PsroResult(folder, done, False, was_interrupted, "")
            # What it would go on from: its replay is by far the largest of all that was written.
            shutil.rmtree(_find_run(settings, number) / RESUME_FOLDER, ignore_errors=True)
        return PsroResult(folder, settings.rounds, True, False, _report(settings, show_progress))


def _check_beginnings(settings: PsroSettings) -> None:
    """Whether responses can begin as each of `begin_with`, and be mixed with all of them."""
    seen: dict[str, str] = {}
    config = settings.response_config(0, {}, None)
    for source in _find_beginnings(settings).values():
        if is_mixture(source) or not can_begin_as(source):
            raise CheckpointError(
                f"begin_with has {source}, which is no folder of a greedy network: give one (of a "
                "mixture its members, of a bot its name in `bots`)"
            )
        config = settings.response_config(0, {}, source)
        seen[read_description(source).representation] = source
    if len(seen) > 1:
        told = ", ".join(f"{source} at {name}" for name, source in seen.items())
        raise ValueError(
            f"agents of begin_with look at different representations ({told}): what is mixed must "
            "look at the same"
        )
    check_generator(config)


def _respond(
    settings: PsroSettings, number: int, deadline: float | None, show_progress: bool
) -> bool:
    """Train response `number`, and freeze it once it has had its frames; returns whether it was
    interrupted.
    """
    plan = _find_plan(settings, number, show_progress)
    left = None if deadline is None else (deadline - time.monotonic()) / 60
    if left is not None and left <= 0:
        return False
    sources = {one.name: one.source for one in find_entrants(settings, number)}
    if unknown := sorted({*plan.met, *([plan.start] if plan.start else [])} - sources.keys()):
        path = _find_run(settings, number).with_name(PLAN_FILE)
        raise ValueError(
            f"{path} names unknown agents {', '.join(unknown)}; known are "
            f"{', '.join(sources)}: delete the file, and the plan is made again"
        )
    met = {name: (sources[name], weight) for name, weight in plan.met.items()}
    start = None if plan.start is None else sources[plan.start]
    config = dataclasses.replace(
        settings.response_config(number, met, start),
        out=str(_find_run(settings, number)),
        max_minutes=left,
    )
    if number > 0:  # what generates goes on from response to response
        config = take_over_generator(config, _find_run(settings, number - 1))
    result = train(config, True, show_progress)
    if result.frames >= config.total_frames:
        copy_folder(result.folder / LATEST_FOLDER, _find_player(settings, _name_player(number)))
    return result.was_interrupted


def _find_beginnings(settings: PsroSettings) -> dict[str, str]:
    """Sources of `begin_with` by name: the copies, once they are there, as what they are of may
    have changed.
    """
    found = {f"begin_{number}": source for number, source in enumerate(settings.begin_with)}
    for name in found:
        if (own := _find_player(settings, name)).is_dir():
            found[name] = str(own)
    return found


def _find_player(settings: PsroSettings, name: str) -> Path:
    return Path(settings.out).resolve() / PLAYERS / name


def _find_run(settings: PsroSettings, number: int) -> Path:
    return Path(settings.out) / ROUNDS / f"{number:03}" / "run"


def _name_player(number: int) -> str:
    return f"player_{number:03}"


def _find_plan(settings: PsroSettings, number: int, show_progress: bool) -> _Plan:
    """Decided once, and kept for who goes on."""
    path = _find_run(settings, number).with_name(PLAN_FILE)
    if path.is_file():
        return _read_plan(path)
    entrants = find_entrants(settings, number)
    networks = _find_networks(entrants)
    if networks:
        play_league(_make_league(settings, entrants, False), show_progress=show_progress)
        scores = _read_scores(settings, entrants)
        weights = weigh_opponents(scores, networks, settings.slack, settings.even_share)
        best = networks[int((scores @ weights).argmax())]
        names = [one.name for one in entrants]
        plan = _Plan(dict(zip(names, weights.tolist(), strict=True)), names[best])
    else:
        plan = _Plan(dict.fromkeys(settings.bots, 1.0 / len(settings.bots)), None)
    write_json(path, plan._asdict())
    if show_progress:
        tqdm.write(f"response {number} {_describe_plan(plan)}")
    return plan


def weigh_opponents(
    scores: NDArray[np.float64], networks: Sequence[int], slack: float, even_share: float
) -> NDArray[np.float64]:
    """How often a response meets each of N agents, float64 [N] in sum 1.

    The networks play one game with all agents, bots among them: they choose a mixture whose least
    score is the highest, the others one that leaves them the least. `even_share` of the games are
    against all agents alike, so that nobody is forgotten; half of the rest are against the first
    mixture, in which a response finds what is wrong with it, half against the second, from which it
    learns what the networks lack. Among networks alone the two are the same.

    networks: places of K of the N agents; scores: [K, N], shares of points of these against all.
    """
    safest = np.zeros(scores.shape[1])
    safest[list(networks)] = find_safest_mixture(scores, slack)
    hardest = find_safest_mixture(1.0 - scores.T, slack)
    weights: NDArray[np.float64] = (1.0 - even_share) * (safest + hardest) / 2.0
    return weights + even_share / len(safest)


def _read_plan(path: Path) -> _Plan:
    try:
        told = read_json(path)
        return _Plan({n: float(part) for n, part in told["met"].items()}, told["start"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} cannot be read ({error!r}): delete it, and the plan is made again"
        ) from error


def _describe_plan(plan: _Plan) -> str:
    if plan.start is None:
        return "begins anew, against all bots alike"
    likely = sorted(((part, name) for name, part in plan.met.items()), reverse=True)[:5]
    told = ", ".join(f"{name} {part:.0%}" for part, name in likely)
    return f"begins as {plan.start}, against {told}"


def find_entrants(settings: PsroSettings, number: int) -> list[Entrant]:
    """All that take part before response `number`, each once: one that has learned nothing is
    whom it began as.
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
    """Places of those that mixtures are made of, and responses begin as."""
    return [n for n, one in enumerate(entrants) if can_begin_as(one.source)]


def _read_scores(settings: PsroSettings, entrants: Sequence[Entrant]) -> NDArray[np.float64]:
    """What the networks score against all, [K, N]."""
    fingerprints = [one.fingerprint for one in entrants]
    return read_scores(Path(settings.out) / EVALUATION, fingerprints, _find_networks(entrants))


def _make_league(
    settings: PsroSettings, entrants: Sequence[Entrant], is_final: bool
) -> LeagueConfig:
    """Games of the networks against all, in the end of all against all."""
    about = settings.game
    playing = range(len(entrants)) if is_final else _find_networks(entrants)
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
    """Rate all, write the mixture, and tell."""
    folder = Path(settings.out)
    entrants = find_entrants(settings, settings.rounds)
    text = run_league(
        _make_league(settings, entrants, is_final=True), show_progress=show_progress
    ).text
    fingerprints = [one.fingerprint for one in entrants]
    scores = _read_scores(settings, entrants)
    mixed = mix_league(folder / EVALUATION, slack=settings.slack, among=set(fingerprints))
    save_mixture(folder / MIXTURE, mixed.sources, mixed.weights)
    text += "\nEach response against whom it met, and who it began as against the same:\n"
    places = {one.name: n for n, one in enumerate(entrants)}
    rows = {entrants[n].name: scores[row] for row, n in enumerate(_find_networks(entrants))}
    for number in range(settings.rounds):
        name, plan = _name_player(number), _find_plan(settings, number, show_progress)
        told = "has learned nothing"
        if name in rows:
            told = f"{_weigh(rows[name], plan, places):.1%}"
        if plan.start is not None:
            told += f" ({_weigh(rows[plan.start], plan, places):.1%})"
        text += f"  {name} {told}; it {_describe_plan(plan)}\n"
    text += f"\nAll of them as one agent, {folder / MIXTURE}: {describe_mixture(mixed)}"
    write_atomically(folder / REPORT_FILE, text)
    return text


def _weigh(scores: NDArray[np.float64], plan: _Plan, places: Mapping[str, int]) -> float:
    """Mean score against whom a plan says."""
    return sum(part * float(scores[places[name]]) for name, part in plan.met.items())
