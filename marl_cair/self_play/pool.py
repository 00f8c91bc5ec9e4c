"""The pool of frozen opponents of a run: bots, foreign agents and snapshots on disk."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair import checkpoint
from marl_cair.checkpoint import AgentDescription, CheckpointError, save_agent
from marl_cair.files import recover_folder
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents.load import find_fingerprint
from marl_cair.policies import PLAYS
from marl_cair.ranges import COUNT, FLAG, Range, read_number
from marl_cair.self_play.shared_folder import MAIN, LeagueSeat, Player
from marl_cair.self_play.win_rates import EVEN, Evidence, read_evidence
from marl_cair.stored import check_plain_name

if TYPE_CHECKING:
    import torch

    from marl_cair.policies.actor import PolicyActor
    from marl_cair.policies.q_network import QNetwork

BOT, FOREIGN, LIVE, SNAPSHOT = "bot", "foreign", "live", "snapshot"
FIRST_NUMBERS = {BOT: 1, FOREIGN: 500, LIVE: 900, SNAPSHOT: 1_000}  # 0 is the learner itself
_SNAPSHOT_NUMBERS = Range(FIRST_NUMBERS[SNAPSHOT], 2**15 - 1)  # int16 in replay
_SUPPORT = 0.01  # least share of the Nash mixture of a snapshot that it needs


@dataclass(frozen=True)
class Member:
    """One frozen opponent."""

    number: int  # in games and records
    name: str  # of a bot, a foreign agent, or a snapshot's folder within the pool's
    kind: str  # BOT, FOREIGN, LIVE (another learner's current policy) or SNAPSHOT
    frames: int = 0  # the learner's when the snapshot was frozen; else 0
    fingerprint: str = ""  # of a snapshot's network, `league.agents.load.find_fingerprint`
    met: Mapping[int, Evidence] = field(default_factory=dict)  # the learner's results before
    is_retired: bool = False  # whether it is no longer sampled
    owner: str = ""  # in a league: its learner
    role: str = ""  # in a league: the learner's, of `shared_folder.ROLES`


class Pool:
    """Frozen opponents; snapshots are agents in `folder`, each written atomically.

    The run's state (`state_dict`) says which of them are in play: after a crash the folder may hold
    a snapshot that the state does not name. A network is read when it is first needed, and refused
    if it is not the one that was frozen.

    With more than `capacity` snapshots in play, one retires (`choose_retired`); its folder stays,
    as an agent for leagues, and for a resumed run. Bots and foreign agents stay.

    Args:
        folder: created with the first snapshot.
        game, scenario: of the run.
        representation: of the snapshots.
        capacity: most snapshots in play; 1 or more, else raises ValueError.
        prior_games: even games that are added to each estimate of `payoff`.
        seat: in a league; snapshots are then players in its folder.
        device: of the snapshots' networks.
    """

    def __init__(
        self,
        folder: Path,
        game: Game,
        scenario: Any,
        representation: str,
        capacity: int,
        prior_games: float = 2.0,
        seat: LeagueSeat | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        if capacity < 1:
            raise ValueError(f"the pool's capacity is {capacity}, it must be 1 or more")
        self.folder = folder if seat is None else seat.folder / checkpoint.PLAYERS
        self.capacity, self.seat = capacity, seat
        self._game, self._prior_games, self._device = game, prior_games, device
        self._representation = representation
        self._groups = game.make_spec(scenario).action_groups
        self._members: dict[int, Member] = {}
        self._agents: dict[int, Agent] = {}  # bots, foreign agents, and the snapshots in use
        self._unread: dict[int, Any] = {}  # random states of snapshots that are not loaded yet

    # --- members -----------------------------------------------------------------------------

    @property
    def members(self) -> list[Member]:
        """Members that can be sampled, in the order in which they were added."""
        return [member for member in self._members.values() if not member.is_retired]

    @property
    def snapshots(self) -> list[Member]:
        """Snapshots in play, oldest first."""
        return [member for member in self.members if member.kind == SNAPSHOT]

    def name(self, number: int) -> str:
        """Name of a member, retired or not. Raises ValueError if there is none of that number."""
        return self._find(number).name

    def is_snapshot(self, number: int) -> bool:
        """Whether `number` is of a snapshot, in play or retired."""
        return number >= FIRST_NUMBERS[SNAPSHOT]

    def add(
        self, kind: str, agent: Agent, seed: int, met: Mapping[int, Evidence] | None = None
    ) -> int:
        """Add a bot or a foreign agent, and seed it; returns its number.

        met: its results against earlier members, by number. Raises ValueError if a member has that
        name.
        """
        if any(member.name == agent.name for member in self._members.values()):
            raise ValueError(f"the pool has a member {agent.name!r} already: give another name")
        number = self._next_number(kind)
        agent.seed(seed + number)
        self._members[number] = Member(number, agent.name, kind, met=met or {})
        self._agents[number] = agent
        return number

    def add_live(self, place: int, owner: str, agent: Agent) -> None:
        """Add another main agent's current policy, by its place among the league's."""
        number = FIRST_NUMBERS[LIVE] + place
        agent.name = owner
        self._members[number] = Member(number, owner, LIVE, owner=owner, role=MAIN)
        self._agents[number] = agent

    def adopt(self, player: Player) -> bool:
        """Add a player that another learner has frozen; returns whether it is new."""
        numbers = {member.name: number for number, member in self._members.items()}
        if player.name in numbers:
            return False
        number = self._next_number(SNAPSHOT)
        met = {numbers[name]: kept for name, kept in player.met.items() if name in numbers}
        about = player.frames, player.fingerprint, met, False, player.owner, player.role
        self._members[number] = Member(number, player.name, SNAPSHOT, *about)
        self._retire_one()
        return True

    def add_snapshot(
        self, network: QNetwork, about: AgentDescription, met: Mapping[int, Evidence]
    ) -> Member:
        """Freeze a copy of `network`, and retire a snapshot if there are too many.

        about: its description; `about.frames` names the folder. met: the learner's results.
        """
        number, seat = self._next_number(SNAPSHOT), self.seat
        kept = {other: evidence for other, evidence in met.items() if evidence.games > 0}
        name, owner, role, more = f"frames_{about.frames:010d}", "", "", {}
        age = about.frames
        if seat is not None:
            age += seat.frames_before
            name, owner, role = seat.name_player(about.frames), seat.owner, seat.role
            actor = self._make_actor(network, about, name)
            named = {self._members[other].name: evidence for other, evidence in kept.items()}
            more = seat.describe(age, find_fingerprint(actor, self._game), named)
        save_agent(self.folder / name, network, about, more)
        # Read back, so that it shares nothing with the learner and is the agent on disk.
        agent = self._load(name)
        fingerprint = find_fingerprint(agent, self._game)
        member = Member(number, name, SNAPSHOT, age, fingerprint, kept, owner=owner, role=role)
        self._members[number], self._agents[number] = member, agent
        self._retire_one()
        return member

    def _retire_one(self) -> None:
        if len(self.snapshots) > self.capacity:
            retiring = self._choose_retired()
            self._members[retiring.number] = replace(retiring, is_retired=True)

    def _choose_retired(self) -> Member:
        """A snapshot of the learner that has most in play, so that none loses all of its own."""
        snapshots = self.snapshots
        from marl_cair.league.ratings.equilibrium import maximum_entropy_nash

        share = maximum_entropy_nash(self.payoff([kept.number for kept in snapshots]) - EVEN)
        owners = [kept.owner for kept in snapshots]
        most = max(sorted(set(owners)), key=owners.count)
        theirs = [place for place, owner in enumerate(owners) if owner == most]
        needed = [n for n, place in enumerate(theirs) if share[place] > _SUPPORT]
        frames = [snapshots[place].frames for place in theirs]
        return snapshots[theirs[choose_retired(frames, needed)]]

    def _next_number(self, kind: str) -> int:
        numbers = [member.number for member in self._members.values() if member.kind == kind]
        return max(numbers, default=FIRST_NUMBERS[kind] - 1) + 1

    def require_members(self, numbers: Collection[int]) -> None:
        """Raise ValueError if one of `numbers` is not of a member, retired or not."""
        for number in numbers:
            self._find(number)

    def _find(self, number: int) -> Member:
        if number not in self._members:
            raise ValueError(f"the pool has no member {number}, only {sorted(self._members)}")
        return self._members[number]

    # --- agents ------------------------------------------------------------------------------

    def agent(self, number: int) -> Agent:
        """The member's agent; a snapshot's network is read from disk if it is not in memory.

        Raises ValueError if no member has that number, and CheckpointError if the snapshot cannot
        be read, or is not the one that was frozen.
        """
        if number not in self._agents:
            member = self._find(number)
            agent = self._load(member.name)
            found = find_fingerprint(agent, self._game)
            if found != member.fingerprint:
                raise CheckpointError(
                    f"{self.folder / member.name} is not the network that was frozen (its "
                    f"fingerprint is {found}, expected {member.fingerprint}): bring the folder "
                    "back, or start a new run"
                )
            if number in self._unread:
                agent.load_state_dict(self._unread.pop(number))
            self._agents[number] = agent
        return self._agents[number]

    def release(self, in_use: Collection[int]) -> None:
        """Remove the networks of snapshots other than `in_use` from memory."""
        for number in self._agents.keys() - {*in_use}:
            if self._members[number].kind == SNAPSHOT:
                del self._agents[number]
        self._unread = {n: state for n, state in self._unread.items() if n in in_use}

    def _load(self, name: str) -> PolicyActor:
        network, about = checkpoint.load_network(self.folder / name)
        network.requires_grad_(False)
        return self._make_actor(network.to(self._device), about, name)

    def _make_actor(self, network: QNetwork, about: AgentDescription, name: str) -> PolicyActor:
        from marl_cair.policies.actor import PolicyActor

        exploration = PLAYS[about.plays](seed=about.frames, action_groups=self._groups)
        return PolicyActor(network, name, self._representation, exploration)

    # --- payoffs -----------------------------------------------------------------------------

    def payoff(self, numbers: Sequence[int]) -> NDArray[np.float64]:
        """Expected scores in 0..1 of row against column, float64 [K, K]; 1/2 is even.

        A snapshot has the learner's score against earlier members before it was frozen.
        """
        payoff = np.full((len(numbers), len(numbers)), EVEN)
        places = {number: place for place, number in enumerate(numbers)}
        for row, number in enumerate(numbers):
            for other, evidence in self._find(number).met.items():
                if (column := places.get(other)) is not None:
                    payoff[row, column] = score = evidence.estimate(self._prior_games)
                    payoff[column, row] = 1.0 - score
        return payoff

    def best_snapshot(self) -> Member | None:
        """The snapshot with the highest mean score against the others; of equals the newest."""
        snapshots = self.snapshots
        if not snapshots:
            return None
        means = self.payoff([kept.number for kept in snapshots]).mean(1)
        return snapshots[int(np.flatnonzero(means >= means.max() - 1e-12)[-1])]

    # --- saved with the run ------------------------------------------------------------------

    def state_dict(self) -> dict[str, Any]:
        """All snapshots, and the states of all agents in play, as plain data. The caller adds bots
        and foreign agents again.
        """
        rows = [dict(vars(one)) for one in self._members.values() if one.kind == SNAPSHOT]
        for row in rows:
            del row["kind"]
            row["met"] = {str(number): list(kept) for number, kept in row["met"].items()}
        states = {number: agent.state_dict() for number, agent in self._agents.items()}
        return {"snapshots": rows, "agents": {**states, **self._unread}}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore `state_dict`. Raises KeyError if a bot or foreign agent is missing, ValueError
        for a snapshot's entry that cannot be.
        """
        saved = dict(state["agents"])
        for number in [number for number in saved if not self.is_snapshot(number)]:
            self._agents[number].load_state_dict(saved.pop(number))
        others = {n: kept for n, kept in self._members.items() if kept.kind != SNAPSHOT}
        snapshots = {
            row["number"]: Member(
                read_number(row, "number", _SNAPSHOT_NUMBERS),
                check_plain_name(row["name"], "the snapshot"),
                SNAPSHOT,
                read_number(row, "frames", COUNT),
                str(row["fingerprint"]),
                {int(number): kept for number, kept in read_evidence(row["met"]).items()},
                read_number(row, "is_retired", FLAG),
                str(row.get("owner", "")),
                str(row.get("role", "")),
            )
            for row in state["snapshots"]
        }
        # A snapshot is loaded when it plays.
        self._members, self._unread = others | snapshots, saved
        self._agents = {n: agent for n, agent in self._agents.items() if n in others}
        for member in snapshots.values():
            if self.seat is None or member.owner == self.seat.owner:  # others may be writing
                recover_folder(self.folder / member.name)


def choose_retired(frames: Sequence[int], needed: Collection[int] = ()) -> int:
    """The index of the snapshot that retires, of one or more; `frames` [K] are sorted.

    Not the oldest or the newest, nor one of `needed` (the support of the Nash mixture) unless no
    other is left. Of the others the one that leaves the smallest gap in training.
    """
    inner = range(1, len(frames) - 1)
    if not inner:
        return 0
    free = [index for index in inner if index not in needed] or inner
    return min(free, key=lambda index: (frames[index + 1] - frames[index - 1], index))
