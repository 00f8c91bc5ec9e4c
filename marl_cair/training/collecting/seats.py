"""`SeatRouter`, the one policy of the collector: learner and opponents share the seats."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from marl_cair.games.game import Agent
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from marl_cair.league.agents.foreign import require_answers
from marl_cair.ranges import COUNT, MOST, Range, read_number, take_arrays
from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT
from marl_cair.self_play.samplers import LATEST_ID
from marl_cair.self_play.win_rates import OPPONENT
from marl_cair.training.collecting.demonstrations import NOBODY, Demonstrators
from marl_cair.training.collecting.metrics import Decisions, EpisodeStatistics, find_meetings
from marl_cair.training.collecting.opponents import OpponentBook, export_rng, import_rng
from marl_cair.training.collecting.own_play import OwnPolicies


class SeatRouter(TensorDictModuleBase):
    """Chooses the actions of all seats [B, P].

    When a game begins the learner's team is drawn evenly, and an opponent from the book for each
    rival team: a team acts as one, and where everybody plays for itself that is one draw for each
    seat. All hold until the game ends. The learner plays all seats of its team and those of
    `latest`, and learns from them; where there is but one team it plays every seat. A seat that is
    out is nobody's: its action is the no-op. With NFSP it is drawn too, for each team, whether the
    learner's Q-network plays it, or its average policy.

    Args:
        env: the worlds; its episode counts tell when a game begins.
        own: how the learner plays.
        book: the opponents.
        demonstrators: who play the learner's team in a share of the games.
        statistics: hears the learner's first value of each game.
        seed: of the teams.
    """

    def __init__(
        self,
        env: BatchedGameEnv,
        own: OwnPolicies,
        book: OpponentBook,
        demonstrators: Demonstrators,
        statistics: EpisodeStatistics,
        seed: int,
    ) -> None:
        super().__init__()
        self.in_keys = [(GROUP, "observation"), (GROUP, "action_mask"), (GROUP, "done")]
        self.out_keys = [
            (GROUP, "action"),
            (GROUP, "learned"),
            (GROUP, "expert_action"),
            (GROUP, "opponent"),
        ]
        if own.average is not None:
            self.out_keys.append((GROUP, "answered"))
        worlds, self._players = env.engine.num_worlds, env.engine.num_players
        self._teams, self._noop = env.engine.spec.team_of_seat, env.engine.spec.noop_action
        self._env, self._book = env, book
        self._demonstrators = demonstrators
        self._statistics = statistics
        # Out of the module's parameters: the collector must not copy or count them.
        self.__dict__["own"] = own
        self._rng = np.random.default_rng(seed)
        self.frames = 0
        self.opponent = np.full((worlds, self._players), LATEST_ID, np.int16)  # who plays the seat
        self._met = np.full(worlds, NO_OPPONENT, np.int16)
        self._team = np.zeros(worlds, np.int64)
        num_teams = int(self._teams.max()) + 1
        self._answering = np.ones((worlds, num_teams), np.bool_)  # the Q-network plays the team
        self._episode = np.full(worlds, -1, np.int64)
        self._owned = np.zeros((worlds, self._players), np.bool_)
        self._out = np.zeros((worlds, self._players), np.bool_)
        self._shown = np.zeros((worlds, self._players), np.bool_)
        self._assisted = np.zeros((worlds, self._players), np.bool_)  # at any time of the game
        self._actions = np.zeros((worlds, self._players), np.int64)
        self._ranges = {  # of saved arrays; those of bools need none
            "opponent": OPPONENT,
            "met": OPPONENT,
            "team": Range(0, num_teams - 1),
            "episode": Range(-1, MOST),
            "actions": Range(0, env.engine.spec.num_actions - 1),
        }

    @property
    def epsilon(self) -> float:
        """The chance of exploration at the current frame."""
        own: OwnPolicies = self.__dict__["own"]
        return own.exploration.epsilon_at(self.frames)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ("player", "action") int64, "learned" bool, "expert_action" int64 and "opponent"
        int16, each [B, P]; with NFSP "answered" bool too, the decisions of the Q-network.

        "expert_action" is what a demonstrator does or would do, NO_ACTION elsewhere. "opponent" is
        the one that is met, NO_OPPONENT where there are several or none.
        """
        group = tensordict.get(GROUP)
        if self.frames:
            self._note_step()
        starting = self._start_new_games()
        self._owned = self.opponent == LATEST_ID
        self._out = group.get("done").squeeze(-1).numpy().copy()
        self._demonstrators.draw(starting, self.frames)
        self._shown = self._find_shown()
        self._assisted[starting] = False
        self._assisted |= self._shown
        learned = self._owned & ~self._out
        actions = torch.full(learned.shape, self._noop, dtype=torch.int64)
        self._play_own(learned & ~self._shown, starting, group, actions)
        mask = group.get("action_mask")
        self._play_opponents(group, mask, actions)
        expert_actions = self._demonstrate(group, mask, actions)
        self._actions = actions.numpy().copy()
        group.set("action", actions)
        group.set("learned", torch.from_numpy(learned))
        group.set("expert_action", expert_actions)
        met = torch.from_numpy(self._met).unsqueeze(1).expand(-1, self._players)
        group.set("opponent", met.contiguous())
        self.frames += len(self.opponent)
        return tensordict

    def _play_own(
        self,
        chosen: NDArray[np.bool_],
        starting: NDArray[np.bool_],
        group: TensorDictBase,
        actions: Tensor,
    ) -> None:
        """Choose the actions of the seats `chosen` [B, P], and note the values of first decisions,
        which are the Q-network's whoever plays.
        """
        own: OwnPolicies = self.__dict__["own"]
        observation, mask = group.get("observation"), group.get("action_mask")
        answering = self._answering[:, self._teams]
        valued = chosen & (answering | starting[:, None])
        rows = torch.from_numpy(valued)
        values = own.answer.compute_values(observation[rows])
        actions[rows] = own.answer.exploration(values, mask[rows], self.epsilon)
        if starting.any():
            best = values.masked_fill(~mask[rows], -torch.inf).amax(-1).numpy()
            self._statistics.note_first_values(starting, valued, best)
        if own.average is not None:
            rows = torch.from_numpy(chosen & ~answering)
            actions[rows] = own.average.select_actions(observation[rows], mask[rows])
            group.set("answered", torch.from_numpy(chosen & answering))

    def _note_step(self) -> None:
        """Tell what the last decision brought, and book games that it ended to who played them."""
        taken = Decisions(
            self._actions,
            self._owned,
            self._shown,
            self._assisted,
            self._out,
            self._team,
            self.opponent,
        )
        meetings = find_meetings(taken, self._env.last, self._teams)
        self._statistics.note_step(taken, self._env.last, meetings)
        self._book.note(meetings, self.frames)

    def _start_new_games(self) -> NDArray[np.bool_]:
        """Draw opponent and team of the worlds [B] whose game has just begun; returns which."""
        starting: NDArray[np.bool_] = self._env.seeds.episodes != self._episode
        count = int(starting.sum())
        if count:
            num_teams = self._answering.shape[1]
            teams = self._rng.integers(0, num_teams, count)
            drawn = self._book.draw(count * num_teams, self.frames).reshape(count, num_teams)
            self._team[starting] = teams
            self._met[starting] = find_met(drawn, teams)
            drawn[np.arange(count), teams] = LATEST_ID
            self.opponent[starting] = drawn[:, self._teams]
            self._episode = self._env.seeds.episodes.copy()
            self._book.forget_unused(self.opponent)
            own: OwnPolicies = self.__dict__["own"]
            self._answering[starting] = own.draw_answering(self._rng, count, num_teams)
        return starting

    def _find_shown(self) -> NDArray[np.bool_]:
        """The seats [B, P] that a demonstrator plays: against `latest`, those of one team."""
        shown = self._demonstrators.playing != NOBODY
        found: NDArray[np.bool_] = shown[:, None] & (self._team[:, None] == self._teams)
        return found

    def _demonstrate(self, group: TensorDictBase, mask: Tensor, actions: Tensor) -> Tensor:
        """Let demonstrators choose where they play; returns what they do, or would do, [B, P]."""
        expert_actions = torch.full_like(actions, NO_ACTION)
        advise = self._demonstrators.settings.advise
        helped = (self._owned if advise else self._shown) & ~self._out
        for number, agent in enumerate(self._demonstrators.agents):
            told = helped & (self._demonstrators.telling == number)[:, None]
            if told.any():
                self._act(agent, torch.from_numpy(told), group, mask, expert_actions)
        played = torch.from_numpy(self._shown & ~self._out)
        actions[played] = expert_actions[played]
        return expert_actions

    def _act(
        self, agent: Agent, rows: Tensor, group: TensorDictBase, mask: Tensor, actions: Tensor
    ) -> None:
        """Let `agent` choose the actions of `rows` bool [B, P].

        Raises ForeignAgentError where it cannot.
        """
        seen = group.get(self._env.key_of(agent.representation))
        chosen = np.asarray(agent.act(seen[rows].numpy(), mask[rows].numpy()), np.int64)
        require_answers(agent, chosen)
        actions[rows] = torch.from_numpy(chosen)

    def _play_opponents(self, group: TensorDictBase, mask: Tensor, actions: Tensor) -> None:
        theirs = ~self._owned & ~self._out
        for number in np.unique(self.opponent[theirs]).tolist():
            agent = self._book.pool.agent(number)
            rows = torch.from_numpy(theirs & (self.opponent == number))
            self._act(agent, rows, group, mask, actions)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        return {
            "opponent": self.opponent,
            "met": self._met,
            "team": self._team,
            "episode": self._episode,
            "owned": self._owned,
            "out": self._out,
            "shown": self._shown,
            "assisted": self._assisted,
            "actions": self._actions,
            "answering": self._answering,
        }

    def export_state(self) -> dict[str, Any]:
        """Teams, opponents and random states as tensors and plain data."""
        own: OwnPolicies = self.__dict__["own"]
        return {
            "frames": self.frames,
            **{name: torch.from_numpy(held.copy()) for name, held in self._arrays().items()},
            "demonstrators": self._demonstrators.state_dict(),
            "rng": export_rng(self._rng),
            "exploration": own.state_dict(),
        }

    def import_state(self, state: Mapping[str, Any]) -> None:
        """Continue from `export_state`. Raises ValueError for what no games can be."""
        self.frames = read_number(state, "frames", COUNT)
        arrays = take_arrays(state, self._arrays(), self._ranges)
        members = {*arrays["opponent"].ravel().tolist(), *arrays["met"].tolist()}
        self._book.pool.require_members(members - {LATEST_ID, NO_OPPONENT})
        self.opponent, self._met = arrays["opponent"], arrays["met"]
        self._team, self._episode = arrays["team"], arrays["episode"]
        self._owned, self._out = arrays["owned"], arrays["out"]
        self._shown, self._assisted = arrays["shown"], arrays["assisted"]
        self._actions, self._answering = arrays["actions"], arrays["answering"]
        self._demonstrators.load_state_dict(state["demonstrators"])
        import_rng(self._rng, state["rng"])
        own: OwnPolicies = self.__dict__["own"]
        own.load_state_dict(state["exploration"])


def find_met(drawn: NDArray[np.int16], teams: NDArray[np.int64]) -> NDArray[np.int16]:
    """The one opponent of all rival teams, int16 [N], NO_OPPONENT where there are several or none.

    drawn: int16 [N, teams], who was drawn for each. teams: int64 [N], the learner's.
    """
    num_teams = drawn.shape[1]
    if num_teams == 1:
        return drawn[:, 0].copy()
    rivals = drawn[np.arange(num_teams) != teams[:, None]].reshape(len(drawn), num_teams - 1)
    same = (rivals == rivals[:, :1]).all(1)
    met: NDArray[np.int16] = np.where(same, rivals[:, 0], np.int16(NO_OPPONENT))
    return met
