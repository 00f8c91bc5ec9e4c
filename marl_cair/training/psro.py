"""`train_psro`: best responses, one after the other, and a mixture of them as one agent."""

from __future__ import annotations

import dataclasses
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from omegaconf import OmegaConf
from tqdm import tqdm

from marl_cair.files import (
    claim_output_folder,
    recover_folder,
    replaced_folder,
    write_atomically,
)
from marl_cair.games import GAMES
from marl_cair.league.agents import find_fingerprint, load_agent
from marl_cair.league.equilibrium import find_safest_mixture
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.mixing import describe_mixture, mix_league, read_scores
from marl_cair.league.mixtures import save_mixture
from marl_cair.training.config_file import to_plain
from marl_cair.training.initial_network import can_begin_as
from marl_cair.training.psro_settings import PsroSettings, fixed_options
from marl_cair.training.run import LATEST_FOLDER, RESUME_FOLDER
from marl_cair.training.trainer import TrainResult, train

RUN_KIND = "policy-space response oracles"
SETTINGS_FILE, PLAN_FILE, REPORT_FILE = "psro.yaml", "plan.json", "report.txt"
ROUNDS, PLAYERS, EVALUATION, MIXTURE = "rounds", "players", "evaluation", "mixture"


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

    met: dict[str, tuple[str, float]]  # source and weight by name; empty: all bots alike
    start: str | None  # folder of an agent


class _Entrant(NamedTuple):
    """An agent that takes part."""

    name: str  # of a response player_000, of an agent of the beginning begin_0, of a bot its own
    source: str  # as `load_agent` takes it
    fingerprint: str


def train_psro(settings: PsroSettings, show_progress: bool = True) -> PsroResult:
    """Train `rounds` best responses, rate them, and write the safest mixture of all networks.

    Whom each meets says `weigh_opponents`; it begins as the network that scores most against them.
    The same call again goes on where an
    interrupt or a kill stopped it, and with more rounds from where it had ended; the bits are those
    of a run that was never stopped.

    Raises:
        OutputFolderError: the folder holds something else, or a run of other settings.
        CheckpointError: an agent of `begin_with` that cannot be read; or is no network to begin as.
        As `training.trainer.train`, and as `league.league.run_league`.
    """
    folder = Path(settings.out)
    _find_entrants(settings, 0)  # what cannot be loaded is refused before anything is written
    with claim_output_folder(folder, RUN_KIND, fixed_options(settings), resume=True):
        text = OmegaConf.to_yaml(OmegaConf.create(to_plain(dataclasses.asdict(settings))))
        write_atomically(folder / SETTINGS_FILE, text)
        begun = time.monotonic()
        for number in range(settings.rounds):
            recover_folder(_find_player(settings, number))
            if _find_player(settings, number).is_dir():
                continue
            left = None
            if settings.max_minutes is not None:
                left = settings.max_minutes - (time.monotonic() - begun) / 60
                if left <= 0:
                    return PsroResult(folder, number, False, False, "")
            result = _respond(settings, number, left, show_progress)
            if result.was_interrupted or not _find_player(settings, number).is_dir():
                done = number + _find_player(settings, number).is_dir()
                return PsroResult(folder, done, False, result.was_interrupted, "")
        return PsroResult(folder, settings.rounds, True, False, _report(settings, show_progress))


def _respond(
    settings: PsroSettings, number: int, minutes: float | None, show_progress: bool
) -> TrainResult:
    """Train response `number`, and freeze it once it has had its frames."""
    plan = _find_plan(settings, number, show_progress)
    config = settings.response_config(number, plan.met, plan.start)
    result = train(dataclasses.replace(config, max_minutes=minutes), True, show_progress)
    if result.frames >= config.total_frames:
        with replaced_folder(_find_player(settings, number)) as fresh:
            shutil.copytree(result.folder / LATEST_FOLDER, fresh, dirs_exist_ok=True)
        # What it would go on from: its replay is by far the largest of all that was written.
        shutil.rmtree(result.folder / RESUME_FOLDER, ignore_errors=True)
    return result


def _find_player(settings: PsroSettings, number: int) -> Path:
    return Path(settings.out) / PLAYERS / f"player_{number:03}"


def _find_plan(settings: PsroSettings, number: int, show_progress: bool) -> _Plan:
    """Decided once, and kept for who goes on."""
    path = Path(settings.out) / ROUNDS / f"{number:03}" / PLAN_FILE
    if path.is_file():
        return _read_plan(path)
    entrants = _find_entrants(settings, number)
    networks = _find_networks(entrants)
    if networks:
        _play(settings, entrants, show_progress)
        scores = _read_scores(settings, entrants)
        weights = weigh_opponents(scores, networks, settings.slack, settings.even_share)
        best = networks[int((scores @ weights).argmax())]
        met = {
            one.name: (one.source, float(weight))
            for one, weight in zip(entrants, weights, strict=True)
        }
        plan = _Plan(met, entrants[best].source)
    else:
        plan = _Plan({}, None)
    write_atomically(path, json.dumps(plan._asdict(), indent=1) + "\n")
    if show_progress:
        tqdm.write(f"response {number} {_describe_plan(plan)}")
    return plan


def weigh_opponents(
    scores: NDArray[np.float64], networks: Sequence[int], slack: float, even_share: float
) -> NDArray[np.float64]:
    """How often a response meets each of N agents, float64 [N] in sum 1.

    The networks play one game with all agents, bots among them: they choose a mixture whose least
    score is the highest, the others one that leaves them the least. Half the games are against the
    first, in which a response finds what is wrong with it, half against the second, from which it
    learns what the networks lack. Among networks alone the two are the same. `even_share` of the
    games are against all agents alike, so that nobody is forgotten.

    networks: places of K of the N agents; scores: [K, N], shares of points of these against all.
    """
    safest = np.zeros(scores.shape[1])
    safest[list(networks)] = find_safest_mixture(scores, slack)
    hardest = find_safest_mixture(1.0 - scores.T, slack)
    weights: NDArray[np.float64] = (1.0 - even_share) * (safest + hardest) / 2.0
    return weights + even_share / len(safest)


def _read_plan(path: Path) -> _Plan:
    try:
        told = json.loads(path.read_text("utf-8"))
        met = {name: (str(source), float(part)) for name, (source, part) in told["met"].items()}
        return _Plan(met, told["start"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} cannot be read ({error!r}): delete it, and it is decided anew"
        ) from error


def _describe_plan(plan: _Plan) -> str:
    if plan.start is None:
        return "begins anew, against all bots alike"
    names = {source: name for name, (source, _) in plan.met.items()}
    likely = sorted(((part, name) for name, (_, part) in plan.met.items()), reverse=True)[:5]
    told = ", ".join(f"{name} {part:.0%}" for part, name in likely)
    return f"begins as {names[plan.start]}, against {told}"


def _find_entrants(settings: PsroSettings, number: int) -> list[_Entrant]:
    """All that take part before response `number`, each once: one that has learned nothing is
    whom it began as.
    """
    about = settings.response_config(0, {}, None).game
    game = GAMES[about.name]
    scenario = game.scenario(about.scenario, **{**about.options, "reward": game.rated_reward})
    sources = {f"begin_{n}": source for n, source in enumerate(settings.begin_with)}
    sources |= {f"player_{n:03}": str(_find_player(settings, n)) for n in range(number)}
    sources |= {bot: f"{game.name}/{bot}" for bot in settings.bots}
    found: dict[str, _Entrant] = {}
    for name, source in sources.items():
        agent = load_agent(source, game=game.name, scenario=scenario)
        fingerprint = find_fingerprint(agent, game)
        found.setdefault(fingerprint, _Entrant(name, source, fingerprint))
    return list(found.values())


def _find_networks(entrants: Sequence[_Entrant]) -> list[int]:
    """Places of those that mixtures are made of, and responses begin as."""
    return [n for n, one in enumerate(entrants) if can_begin_as(one.source)]


def _read_scores(settings: PsroSettings, entrants: Sequence[_Entrant]) -> NDArray[np.float64]:
    """What the networks score against all, [K, N]."""
    fingerprints = [one.fingerprint for one in entrants]
    return read_scores(Path(settings.out) / EVALUATION, fingerprints, _find_networks(entrants))


def _play(
    settings: PsroSettings, entrants: list[_Entrant], show_progress: bool, is_final: bool = False
) -> str:
    """Let the networks play all, and in the end all play all, what has been played aside; returns
    the league's tables.
    """
    about = settings.response_config(0, {}, None).game
    playing = range(len(entrants)) if is_final else _find_networks(entrants)
    result = run_league(
        LeagueConfig(
            agents=tuple(entrants[n].source for n in playing),
            ladder=tuple(one.source for n, one in enumerate(entrants) if n not in playing),
            game=about.name,
            scenario=about.scenario,
            scenario_options=about.options,
            games_per_pair=settings.games_per_pair,
            seed=settings.seed,
            out=str(Path(settings.out) / EVALUATION),
            replays=is_final,
        ),
        show_progress=show_progress,
    )
    return result.text


def _report(settings: PsroSettings, show_progress: bool) -> str:
    """Rate all, write the mixture, and tell."""
    folder = Path(settings.out)
    entrants = _find_entrants(settings, settings.rounds)
    text = _play(settings, entrants, show_progress, is_final=True)
    fingerprints = [one.fingerprint for one in entrants]
    scores = _read_scores(settings, entrants)
    mixed = mix_league(folder / EVALUATION, slack=settings.slack, among=set(fingerprints))
    save_mixture(folder / MIXTURE, mixed.sources, mixed.weights)
    text += "\nEach response against whom it met (50 % is what an equal has):\n"
    place = {one.source: n for n, one in enumerate(entrants)}
    rows = {entrants[n].source: row for row, n in enumerate(_find_networks(entrants))}
    for number in range(settings.rounds):
        plan = _find_plan(settings, number, show_progress)
        met = plan.met or {
            one.name: (one.source, 1 / len(settings.bots))
            for one in entrants
            if one.name in settings.bots
        }
        row = rows.get(str(_find_player(settings, number)))
        told = "has learned nothing"
        if row is not None:
            score = sum(part * scores[row, place[source]] for source, part in met.values())
            told = f"{score:.1%}"
        text += f"  response {number} {told}; it {_describe_plan(plan)}\n"
    text += f"\nAll of them as one agent, {folder / MIXTURE}: {describe_mixture(mixed)}"
    write_atomically(folder / REPORT_FILE, text)
    return text
