"""Packs a few games of a league for the viewer, replayed from their seeds and verified."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from marl_cair.files import write_atomically
from marl_cair.games.game import NO_WINNER, Agent
from marl_cair.games.replays import Replay
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.league.agents.load import find_fingerprint, read_source
from marl_cair.league.play.arena import Load, Rules, torch_threads
from marl_cair.league.play.blocks import Entrant, make_chunk, seat_line_up
from marl_cair.league.play.playing import Step, line_up_seed, play_out, start_engine
from marl_cair.league.ratings.groups import ELO_PER_LOGIT
from marl_cair.league.ratings.rate import Rating
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import LeagueStore, StoredGames
from marl_cair.outside import CodeNotAllowedError
from marl_cair.stored import DamagedFileError
from marl_cair.viewer.game_data import FORMAT_VERSION
from marl_cair.viewer.page import make_element, read_game, write_viewer
from marl_cair.viewer.values import add_values

FOLDER = "replays"
MAX_BYTES = 1_500_000  # of one game: a report with three has less than 5 MB
MOST_SEATS = 2  # that are shown with the view of each
MAX_ACTION_BYTES = 256 << 20  # of the actions of one game, held while it is replayed


class ShownGame(NamedTuple):
    """One game of a report; `path` is None where it cannot be shown, and `note` says why."""

    title: str
    caption: str
    path: Path | None
    note: str = ""

    @property
    def element(self) -> str:
        """HTML of the viewer with the game; "" without one."""
        return "" if self.path is None else make_element(read_game(self.path))


class Choice(NamedTuple):
    """A game by its place among the stored ones, and why it was chosen."""

    title: str
    why: str
    place: int


class NotShownError(Exception):
    """A game cannot be shown; the message is the reason."""


class ReplayDiffersError(NotShownError):
    """A game that was played again is another."""

    def __init__(self) -> None:
        super().__init__(
            "The replay differs from the game, so it is not shown: an agent uses random numbers "
            "that do not come from its seed, or something that it depends on has changed."
        )


def choose_games(
    stored: StoredGames, names: Mapping[int, str], ratings: Sequence[Rating]
) -> list[Choice]:
    """Up to three games: of the best two, the greatest upset, the longest; all of them different.

    Games that repeat another or were forfeited are left out. ratings: best first, or none.
    """
    ids = {name: number for number, name in names.items()}
    elo = {ids[one.name]: one.elo for one in ratings}
    was_forfeited = np.array([bool(reason) for reason in stored.reasons], np.bool_)
    is_known = np.isin(stored.agents, list(names)).all(axis=1)
    left = np.flatnonzero(~stored.is_repeat & ~was_forfeited & is_known)
    choices: list[Choice] = []
    for title, find in (
        ("The best two", _find_best_pair),
        ("The greatest upset", _find_upset),
        ("The longest game", _find_longest),
    ):
        if found := find(stored, names, elo, left):
            choices.append(Choice(title, *found))
            left = left[left != found[1]]
    return choices


# Each finds a game among the places `left`; `elo` is by id, best first, and empty without a ladder.
_Found = tuple[str, int] | None  # why, and the place


def _find_best_pair(
    stored: StoredGames, names: Mapping[int, str], elo: Mapping[int, float], left: NDArray[np.int64]
) -> _Found:
    best_two = list(elo)[:2]
    if len(best_two) < 2:
        return None
    together = left[np.all([(stored.agents[left] == one).any(axis=1) for one in best_two], axis=0)]
    if not len(together):
        return None
    first = together[np.lexsort((stored.turns[together], stored.numbers[together]))[0]]
    players = " and ".join(names[one] for one in best_two)
    return f"The first game of the best two, {players}.", int(first)


def _find_upset(
    stored: StoredGames, names: Mapping[int, str], elo: Mapping[int, float], left: NDArray[np.int64]
) -> _Found:
    """The game whose winner had the smallest chance by the ratings."""
    if not elo or not len(left):
        return None
    strength = np.array([[elo[one] for one in row] for row in stored.agents[left].tolist()])
    chances = softmax(strength / ELO_PER_LOGIT, axis=1)
    is_won = (stored.ranks[left] == 1.0).sum(axis=1) == 1
    winner = stored.ranks[left].argmin(axis=1)
    own = chances[np.arange(len(left)), winner]
    own[~is_won | (own >= chances.max(axis=1))] = 1.0
    at = int(own.argmin())
    if own[at] == 1.0:
        return None
    name = names[int(stored.agents[left[at], winner[at]])]
    return f"{name} won it, to which the ratings give a chance of {own[at]:.1%}.", int(left[at])


def _find_longest(
    stored: StoredGames, names: Mapping[int, str], elo: Mapping[int, float], left: NDArray[np.int64]
) -> _Found:
    if not len(left):
        return None
    why = "It has the most decisions of all games not shown above."
    return why, int(left[stored.decisions[left].argmax()])


@dataclass(frozen=True)
class ReplayRenderer:
    """Replays games of one league.

    Attributes:
        store, stored: the league file, and its games.
        names: of the agents by id.
        folder: for their pages; existing pages are not made again.
        load: loads an agent: `load(source, game=..., scenario=...)`.
        allow_code: which code of the league file may run; see `allowed_code`.
    """

    store: LeagueStore
    stored: StoredGames
    names: Mapping[int, str]
    folder: Path
    load: Load
    allow_code: AllowCode

    @cached_property
    def _rules(self) -> Rules:
        return Rules.read(self.store.settings)

    @cached_property
    def _records(self) -> Mapping[int, AgentRecord]:
        return self.store.read_agents()

    def render(self, choice: Choice) -> ShownGame:
        """The chosen game, replayed unless there is a page of it."""
        caption = f"{choice.why} {self.describe(choice.place)}"
        try:
            return ShownGame(choice.title, caption, self._write_page(choice.place))
        except NotShownError as error:
            return ShownGame(choice.title, caption, None, str(error))

    def describe(self, place: int) -> str:
        """Players, winner and length of a game, in a sentence."""
        stored, spec = self.stored, self._rules.game.make_spec(self._rules.scenario)
        seats = "seat" if spec.num_teams == spec.num_players else "team"
        names = [self.names[one] for one in stored.agents[place].tolist()]
        players = " v ".join(f"{name} ({seats} {n})" for n, name in enumerate(names))
        first = np.flatnonzero(stored.ranks[place] == 1.0)
        ended = f"{names[first[0]]} won" if len(first) else "draw"
        limit = ", at the time limit" if stored.is_truncated[place] else ""
        return (
            f"{players}: {ended} after {stored.decisions[place]} decisions{limit} "
            f"(block {stored.numbers[place]}, game {stored.turns[place]})."
        )

    def _write_page(self, place: int) -> Path:
        rules, block, turn = self._rules, *self._find_block(place)
        prints = [self._records[agent].fingerprint for agent in self._find_line_up(place)]
        about = [prints, rules.seed, block, turn, self.stored.trajectories[place], FORMAT_VERSION]
        digest = hashlib.blake2b(json.dumps(about).encode(), digest_size=12).hexdigest()
        path = self.folder / f"{digest}.html"
        if _is_page(path):
            return path
        differs = path.with_suffix(".differs")  # so that it is not replayed at each report
        if not differs.is_file():
            try:
                _write_small(path, add_values(*self.play_again(place)))
            except ReplayDiffersError:
                write_atomically(differs, f"block {block}, game {turn}\n")
            else:
                return path
        raise ReplayDiffersError

    def _find_line_up(self, place: int) -> list[int]:
        """The agents of a game by entry."""
        block, turn = self._find_block(place)
        entries = self._rules.design(block)[turn]
        line_up = [0] * len(entries)
        for entry, agent in zip(entries.tolist(), self.stored.agents[place].tolist(), strict=True):
            line_up[entry] = agent
        return line_up

    def _find_block(self, place: int) -> tuple[int, int]:
        """The number of the game's block within its line-up, and of the game within the block."""
        return int(self.stored.numbers[place]), int(self.stored.turns[place])

    def play_again(self, place: int) -> tuple[Replay, Mapping[int, Agent]]:
        """The game, played again from its seed, and its agents by seat. Raises NotShownError."""
        rules, block, turn = self._rules, *self._find_block(place)
        line_up = self._find_line_up(place)
        version = str(self.store.settings["game_version"])
        if version != rules.game.version:
            raise NotShownError(
                f"It was played by version {version} of the rules, this is {rules.game.version}."
            )
        _check_size(rules, int(self.stored.decisions[place]))
        entrants = {number: self._load_entrant(number) for number in set(line_up)}
        seatings = seat_line_up([entrants[number] for number in line_up])
        number = block // rules.blocks_per_chunk
        teams = rules.game.make_spec(rules.scenario).team_of_seat
        chunk = make_chunk(number, rules.plan, teams)
        world = int(np.flatnonzero(chunk.blocks == block)[turn])
        actions: list[NDArray[np.int32]] = []

        def keep(step: Step) -> None:
            if step.running[world]:
                actions.append(step.actions[world].copy())

        map_seed = line_up_seed(rules.seed, [self._records[one].fingerprint for one in line_up])
        engine = start_engine(rules.game, rules.scenario, map_seed, (chunk,))
        with torch_threads(1):
            ended = play_out(engine, (chunk,), seatings, rules.seed, keep)
        if ended.trajectories[world] != self.stored.trajectories[place]:
            raise ReplayDiffersError
        winner = int(ended.winner[world])
        players = [int(self.stored.agents[place, team]) for team in teams]
        replay = Replay(
            rules.game.name,
            engine.scenario,
            rules.game.version,
            int(self.stored.map_seeds[place]),
            tuple(self.names[one] for one in players),
            np.array(actions, np.int32),
            None if winner == NO_WINNER else winner,
            is_complete=True,
            extra={"block": block, "game": turn},
        )
        return replay, {seat: entrants[one].agent for seat, one in enumerate(players)}

    def _load_entrant(self, number: int) -> Entrant:
        record, name, rules = self._records[number], self.names[number], self._rules
        if not (source := read_source(record)):
            raise NotShownError(f"The league file does not say where {name} is from.")
        try:  # by its source, whatever kind the file calls it
            require_allowed([source], self.allow_code, self.folder)
        except CodeNotAllowedError as error:
            raise NotShownError(
                f"{name} is foreign code, which is run only where games are played."
            ) from error
        try:
            agent = self.load(source, game=rules.game.name, scenario=rules.scenario)
        except (ValueError, OSError) as error:
            raise NotShownError(f"{name} cannot be loaded any more: {error}") from error
        if find_fingerprint(agent, rules.game) != record.fingerprint:
            raise NotShownError(f"{name} is no longer the agent that has played.")
        return Entrant(name, record.fingerprint, agent, str(source))


def _check_size(rules: Rules, num_decisions: int) -> None:
    """Refuse a game whose actions would take more than MAX_ACTION_BYTES of memory."""
    spec = rules.game.make_spec(rules.scenario)
    num_bytes = 4 * num_decisions * spec.num_players * math.prod(spec.action_shape)
    if num_bytes > MAX_ACTION_BYTES:
        raise NotShownError(
            f"It is too long to be shown: the actions of its {num_decisions:,} decisions take "
            f"{num_bytes >> 20:,} MiB, at most {MAX_ACTION_BYTES >> 20:,} MiB are replayed."
        )


def _is_page(path: Path) -> bool:
    try:
        read_game(path)
    except (DamagedFileError, FileNotFoundError):
        return False
    return True


def _write_small(path: Path, replay: Replay) -> None:
    """A page of at most MAX_BYTES; of games with many seats only the spectator's view."""
    views = None if len(replay.players) <= MOST_SEATS else [None]
    write_viewer(path, replay, max_bytes=MAX_BYTES, views=views)
