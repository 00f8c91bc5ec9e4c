"""Selects the agents of training runs that take part in a league."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from marl_cair import checkpoint
from marl_cair.checkpoint import LEAGUE_TRAINING, TRAINING, CheckpointError
from marl_cair.files import find_folder, read_run_kind
from marl_cair.games import GAMES
from marl_cair.league.agents.load import find_fingerprint, is_checkpoint, load_agent
from marl_cair.league.agents.mixtures import is_mixture
from marl_cair.lookup import find_by_name

MOST_SNAPSHOTS = 8  # of a run: enough for a curve of ratings, and few enough games


class Expansion(NamedTuple):
    """Agents of sources."""

    agents: dict[str, tuple[str, ...]]  # by source; a source that is no run has itself
    notes: tuple[str, ...]  # a line for each run

    def list_agents(self, sources: Sequence[str]) -> tuple[str, ...]:
        """The agents of these sources, in their order."""
        return tuple(agent for source in sources for agent in self.agents[source])


def expand_runs(sources: Sequence[str]) -> Expansion:
    """Agents of each source: of a training run its newest agent and some of its snapshots, of a
    league's training the newest agent of each learner. Other sources stay as they are (a run of
    best responses is the agent that `checkpoint.find_agent` finds).

    Identical agents are taken once; a run's agents give way to the other sources.

    Raises CheckpointError: a run holds no agent yet, or a damaged one.
    """
    runs = {source: found for source in sources if (found := _list_agents(source)) is not None}
    alone = [one for one in sources if runs and one not in runs and is_checkpoint(one)]
    taken = {_identify(one) for one in alone if not is_mixture(one)}
    agents: dict[str, tuple[str, ...]] = {}
    notes = []
    for source in dict.fromkeys(sources):
        if source not in runs:
            agents[source] = (source,)
            continue
        num_snapshots, places = runs[source]
        chosen = []
        for place in places:
            if (identity := _identify(place)) not in taken:
                taken.add(identity)
                chosen.append(place)
        agents[source] = tuple(chosen)
        notes.append(_describe_choice(source, chosen, len(places) - len(chosen), num_snapshots))
    return Expansion(agents, tuple(notes))


def _list_agents(source: str) -> tuple[int, list[str]] | None:
    """The number of a run's snapshots, and the folders of its agents, the newest first; None if
    `source` is no run.
    """
    kind = read_run_kind(source) if is_checkpoint(source) else ""
    if kind not in (TRAINING, LEAGUE_TRAINING):
        return None
    folder = Path(source)
    if kind == LEAGUE_TRAINING:
        live = folder / checkpoint.SHARED / checkpoint.LIVE_FOLDER
        num_snapshots, places = 0, list_checkpoints(live)
    else:
        snapshots = list_checkpoints(folder / checkpoint.SNAPSHOT_FOLDER)
        num_snapshots, newest = len(snapshots), folder / checkpoint.LATEST_FOLDER
        places = [newest] if _holds_agent(newest) else []
        places += _choose_evenly(snapshots)
    if not places:
        raise CheckpointError(f"{source} is a run ({kind}) that holds no agent yet: train on")
    return num_snapshots, [str(place) for place in places]


def list_checkpoints(folder: Path) -> list[Path]:
    """Checkpoints in `folder` by name (snapshots: by age), without those of killed processes."""
    entries = folder.iterdir() if folder.is_dir() else ()
    return sorted(one for one in entries if one.name[0] != "." and _holds_agent(one))


def _holds_agent(folder: Path) -> bool:
    return (find_folder(folder) / checkpoint.DESCRIPTION_FILE).is_file()


def _choose_evenly(places: list[Path]) -> list[Path]:
    """The first, the last and evenly spaced others, at most MOST_SNAPSHOTS; the newest first."""
    at = np.linspace(len(places) - 1, 0, min(MOST_SNAPSHOTS, len(places))).round().astype(int)
    return [places[place] for place in at.tolist()]


def _identify(source: str) -> str:
    game = find_by_name("game", checkpoint.read_description(source).game, GAMES)
    return find_fingerprint(load_agent(source), game)


def _describe_choice(source: str, chosen: list[str], num_same: int, num_snapshots: int) -> str:
    names = ", ".join(str(Path(one).relative_to(source).as_posix()) for one in chosen) or "none"
    of_all = f" (of {num_snapshots} snapshots)" if num_snapshots > MOST_SNAPSHOTS else ""
    same = f"; {num_same} left out, as the same agents are there already" if num_same else ""
    return f"{source} is a run, of which the league takes {names}{of_all}{same}"
