"""Renders a few games of a league as GIFs, replayed from their seeds and verified."""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax
from tqdm import tqdm

from marl_cair.files import write_atomically
from marl_cair.league.agents.allowed_code import AllowCode, CodeNotAllowedError, require_allowed
from marl_cair.league.agents.load import find_fingerprint, read_source
from marl_cair.league.play.arena import Load, Rules, one_torch_thread
from marl_cair.league.play.blocks import Entrant, make_chunk, seat_line_up
from marl_cair.league.play.film import SMALL, film_game, write_film
from marl_cair.league.play.playing import Step, line_up_seed, map_seeds, play_out, start_engine
from marl_cair.league.ratings.groups import ELO_PER_LOGIT
from marl_cair.league.ratings.rate import Rating
from marl_cair.league.store.records import AgentRecord
from marl_cair.league.store.store import StoredGames

FOLDER = "replays"
MAX_BYTES = 1_100_000  # of one film: three of them, as text, are below 5 MB
MAX_ACTION_BYTES = 256 << 20  # of the actions of one game, held while it is played again


class Replay(NamedTuple):
    """One game of a report; `path` is None where it cannot be shown, and `note` says why."""

    title: str
    caption: str
    path: Path | None
    note: str = ""

    @property
    def source(self) -> str:
        """The film as the address of a picture that holds it; "" without one."""
        if self.path is None:
            return ""
        return f"data:image/gif;base64,{base64.b64encode(self.path.read_bytes()).decode()}"


class Choice(NamedTuple):
    """A game by its place among the stored ones, and why it was chosen."""

    title: str
    why: str
    place: int


@dataclass(frozen=True)
class ReplayContext:
    """What replaying games of one league needs.

    Attributes:
        rules: of the league; `version`: of the game's rules when it was played.
        records, names: of the agents by id.
        folder: for the films; those that are there are not made again.
        load: how to get an agent: `load(source, game=..., scenario=...)`.
        allow_code: which code of the league file may run; see `allowed_code`.
    """

    rules: Rules
    version: str
    records: Mapping[int, AgentRecord]
    names: Mapping[int, str]
    folder: Path
    load: Load
    allow_code: AllowCode


class _NotShownError(Exception):
    """A game cannot be shown; the message is the reason."""


class _Candidates(NamedTuple):
    """The games to choose from."""

    stored: StoredGames
    names: Mapping[int, str]
    elo: Mapping[int, float]  # by id, best first; empty without a ladder


def choose_games(
    stored: StoredGames, names: Mapping[int, str], ratings: Sequence[Rating]
) -> list[Choice]:
    """Up to three games: of the best two, the greatest upset, the longest; all of them different.

    Games that repeat another or were forfeited are left out. ratings: best first, or none.
    """
    ids = {name: number for number, name in names.items()}
    candidates = _Candidates(stored, names, {ids[one.name]: one.elo for one in ratings})
    was_given_up = np.array([bool(reason) for reason in stored.reasons], np.bool_)
    is_ours = np.isin(stored.agents, list(names)).all(axis=1)
    left = np.flatnonzero(~stored.is_repeat & ~was_given_up & is_ours)
    choices: list[Choice] = []
    for find in (_find_best_pair, _find_upset, _find_longest):
        if len(left) and (choice := find(candidates, left)):
            choices.append(choice)
            left = left[left != choice.place]
    return choices


def _find_best_pair(candidates: _Candidates, left: NDArray[np.int64]) -> Choice | None:
    stored, names, elo = candidates
    if len(elo) < 2:
        return None
    best, second = list(elo)[:2]
    agents = stored.agents[left]
    together = left[(agents == best).any(axis=1) & (agents == second).any(axis=1)]
    if not len(together):
        return None
    first = together[np.lexsort((stored.turns[together], stored.numbers[together]))[0]]
    why = f"The first game of the best two, {names[best]} and {names[second]}."
    return Choice("The best two", why, int(first))


def _find_upset(candidates: _Candidates, left: NDArray[np.int64]) -> Choice | None:
    """The game whose winner had the smallest chance by the ratings."""
    stored, names, elo = candidates
    if not elo:
        return None
    strength = np.array([[elo[one] for one in row] for row in stored.agents[left].tolist()])
    chances = softmax(strength / ELO_PER_LOGIT, axis=1)
    is_won = (stored.ranks[left] == 1.0).sum(axis=1) == 1
    winner = stored.ranks[left].argmin(axis=1)
    rows = np.arange(len(left))
    own = chances[rows, winner]
    own[~is_won | (own >= chances.max(axis=1))] = 1.0
    at = int(own.argmin())
    if own[at] == 1.0:
        return None
    name = names[int(stored.agents[left[at], winner[at]])]
    why = f"{name} won it, to which the ratings give a chance of {own[at]:.1%}."
    return Choice("The greatest upset", why, int(left[at]))


def _find_longest(candidates: _Candidates, left: NDArray[np.int64]) -> Choice:
    place = int(left[candidates.stored.decisions[left].argmax()])
    why = "Of the games not shown above it has the most decisions."
    return Choice("The longest game", why, place)


def make_replays(
    context: ReplayContext,
    stored: StoredGames,
    choices: Sequence[Choice],
    show_progress: bool = False,
) -> tuple[Replay, ...]:
    """The chosen games, played again where no film of them is there yet."""
    replays = []
    for choice in tqdm(choices, "replays", unit=" games", disable=not show_progress):
        caption = f"{choice.why} {_describe_game(context, stored, choice.place)}"
        try:
            path = _film(context, stored, choice.place)
            replays.append(Replay(choice.title, caption, path))
        except _NotShownError as error:
            replays.append(Replay(choice.title, caption, None, str(error)))
    return tuple(replays)


def _describe_game(context: ReplayContext, stored: StoredGames, place: int) -> str:
    spec = context.rules.game.make_spec(context.rules.scenario)
    seats = "seat" if spec.num_teams == spec.num_players else "team"
    players = " v ".join(
        f"{context.names[one]} ({seats} {number})"
        for number, one in enumerate(stored.agents[place].tolist(), start=1)
    )
    first = np.flatnonzero(stored.ranks[place] == 1.0)
    ended = "draw"
    if len(first):
        ended = f"{context.names[int(stored.agents[place, first[0]])]} won"
    limit = ", at the time limit" if stored.is_truncated[place] else ""
    return (
        f"{players}: {ended} after {stored.decisions[place]} decisions{limit} "
        f"(block {stored.numbers[place]}, game {stored.turns[place]})."
    )


def _film(context: ReplayContext, stored: StoredGames, place: int) -> Path:
    rules, block, turn = context.rules, int(stored.numbers[place]), int(stored.turns[place])
    entries = rules.design(block)[turn]
    line_up = [0] * len(entries)
    for entry, agent in zip(entries.tolist(), stored.agents[place].tolist(), strict=True):
        line_up[entry] = agent
    prints = [context.records[agent].fingerprint for agent in line_up]
    about = json.dumps([prints, rules.seed, block, turn, stored.trajectories[place], *SMALL])
    digest = hashlib.blake2b(about.encode(), digest_size=12).hexdigest()
    path = context.folder / f"{digest}.gif"
    if path.is_file():
        return path
    differs = path.with_suffix(".differs")  # so that it is not played again for nothing
    if not differs.is_file():
        actions = _play_again(context, stored, place, line_up)
        if actions is not None:
            _write_small(path, rules, int(stored.map_seeds[place]), actions)
            return path
        write_atomically(differs, f"block {block}, game {turn}\n")
    raise _NotShownError(
        "Played again it went another way, so it is not shown: an agent draws from elsewhere than "
        "its seed, or something that it depends on has changed."
    )


def _play_again(
    context: ReplayContext, stored: StoredGames, place: int, line_up: Sequence[int]
) -> NDArray[np.int32] | None:
    """The actions [T, P, ...] of a game; None where it differs from the stored one."""
    rules, block, turn = context.rules, int(stored.numbers[place]), int(stored.turns[place])
    if context.version != rules.game.version:
        raise _NotShownError(
            f"It was played by version {context.version} of the rules, this is "
            f"{rules.game.version}."
        )
    _check_size(rules, int(stored.decisions[place]))
    entrants = {number: _load(context, number) for number in set(line_up)}
    seatings = seat_line_up([entrants[number] for number in line_up])
    number = block // rules.blocks_per_chunk
    teams = rules.game.make_spec(rules.scenario).team_of_seat
    chunk = make_chunk(number, rules.design, rules.blocks_per_chunk, teams)
    world = int(np.flatnonzero(chunk.blocks == block)[turn])
    actions: list[NDArray[np.int32]] = []

    def keep(step: Step) -> None:
        if step.running[world]:
            actions.append(step.actions[world].copy())

    map_seed = line_up_seed(rules.seed, [context.records[one].fingerprint for one in line_up])
    if map_seeds(map_seed, np.array([block]))[0] != stored.map_seeds[place]:
        map_seed = rules.seed  # as all line-ups had it before each had map seeds of its own
    engine = start_engine(rules.game, rules.scenario, map_seed, (chunk,))
    with one_torch_thread():
        ended = play_out(engine, (chunk,), seatings, rules.seed, keep)
    is_same = ended.trajectories[world] == stored.trajectories[place]
    return np.array(actions, np.int32) if is_same else None


def _check_size(rules: Rules, num_decisions: int) -> None:
    """Refuse a game whose actions would take more than MAX_ACTION_BYTES of memory."""
    spec = rules.game.make_spec(rules.scenario)
    num_bytes = 4 * num_decisions * spec.num_players * math.prod(spec.action_shape)
    if num_bytes > MAX_ACTION_BYTES:
        raise _NotShownError(
            f"It is too long to be shown: the actions of its {num_decisions:,} decisions take "
            f"{num_bytes >> 20:,} MiB, at most {MAX_ACTION_BYTES >> 20:,} MiB are played again."
        )


def _load(context: ReplayContext, number: int) -> Entrant:
    record, name = context.records[number], context.names[number]
    if not (source := read_source(record)):
        raise _NotShownError(f"The league file does not say where {name} is from.")
    try:  # by its source, whatever kind the file calls it
        require_allowed([source], context.allow_code, context.folder)
    except CodeNotAllowedError as error:
        raise _NotShownError(
            f"{name} is foreign code, which is run only where games are played."
        ) from error
    rules = context.rules
    try:
        agent = context.load(source, game=rules.game.name, scenario=rules.scenario)
    except (ValueError, OSError) as error:
        raise _NotShownError(f"{name} cannot be loaded any more: {error}") from error
    if find_fingerprint(agent, rules.game) != record.fingerprint:
        raise _NotShownError(f"{name} is no longer the agent that has played.")
    return Entrant(name, record.fingerprint, agent, str(source))


def _write_small(path: Path, rules: Rules, map_seed: int, actions: NDArray[np.int32]) -> None:
    """A film of at most MAX_BYTES: a larger one is written again with half the frames."""
    images = film_game(rules.game, rules.scenario, map_seed, actions, SMALL)
    write_film(path, images, SMALL)
    while path.stat().st_size > MAX_BYTES and len(images) > 1:
        images = [*images[:-1:2], images[-1]] if len(images) > 2 else images[-1:]
        write_film(path, images, SMALL)
