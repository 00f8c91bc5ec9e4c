"""Assigns the seats of all worlds to the learner, its opponents and demonstrators."""

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
from marl_cair.games.players.recurrent import call_agent, find_state_size, widen_states
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from marl_cair.league.agents.foreign import require_answers
from marl_cair.policies.actor import find_values, masked_argmax
from marl_cair.ranges import COUNT, MOST, NUMBER, Range, read_array, read_number, take_arrays
from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT
from marl_cair.self_play.samplers import LATEST_ID
from marl_cair.self_play.win_rates import OPPONENT
from marl_cair.training.collecting.average_policy import OwnPolicies
from marl_cair.training.collecting.demonstrations import NO_DEMONSTRATOR, Demonstrators
from marl_cair.training.collecting.metrics import Decisions, EpisodeStatistics, find_meetings
from marl_cair.training.collecting.opponents import OpponentBook, export_rng, import_rng


class SeatRouter(TensorDictModuleBase):
    """The policy of the collector: chooses the actions of all seats [B, P].

    When a game begins the learner's team is drawn evenly, and an opponent from the book for each
    rival team: a team acts as one, and in a free-for-all that is one draw for each seat. All hold
    until the game ends. The learner plays all seats of its team and those of `latest`, and learns
    from them; if there is one team, it plays every seat. A seat that is out plays the no-op. With
    NFSP each team of the learner also draws whether its Q-network or its average policy plays.

    Recurrent agents hold a state in each of their seats, 0 when a game begins. A recurrent learner
    follows the games that a demonstrator plays for it; a recurrent demonstrator remembers the steps
    since it began to play or to advise.

    Args:
        env: the worlds; its episode counts show when a game begins.
        own: the learner's policies.
        book: the opponents.
        demonstrators: play the learner's team in a share of the games.
        statistics: gets the learner's first value of each game.
        seed: of the teams.
        notes_best: whether to write "best_action".
    """

    def __init__(
        self,
        env: BatchedGameEnv,
        own: OwnPolicies,
        book: OpponentBook,
        demonstrators: Demonstrators,
        statistics: EpisodeStatistics,
        seed: int,
        notes_best: bool = False,
    ) -> None:
        super().__init__()
        self.in_keys = [(GROUP, "observation"), (GROUP, "action_mask"), (GROUP, "done")]
        written = ["action", "learned", "expert_action", "opponent"]
        written += ["best_action"] if notes_best else []
        written += ["answered"] if own.average is not None else []
        written += ["state"] if own.answer.state_size else []
        self.out_keys = [(GROUP, name) for name in written]
        worlds, self._players = env.engine.num_worlds, env.engine.num_players
        self._teams, self._noop = env.engine.spec.team_of_seat, env.engine.spec.noop_action
        self._env, self._book, self._notes_best = env, book, notes_best
        self._demonstrators, self._statistics = demonstrators, statistics
        # Not as an attribute of the module: the collector must not copy or count its parameters.
        self.__dict__["own"] = own
        self._rng = np.random.default_rng(seed)
        self.frames = 0
        seats, num_teams = (worlds, self._players), int(self._teams.max()) + 1
        self.taken = Decisions(
            actions=np.zeros((*seats, *env.engine.spec.action_shape), np.int64),
            owned=np.zeros(seats, np.bool_),
            shown=np.zeros(seats, np.bool_),
            assisted=np.zeros(seats, np.bool_),
            out=np.zeros(seats, np.bool_),
            team=np.zeros(worlds, np.int64),
            opponent=np.full(seats, LATEST_ID, np.int16),
        )
        self._met = np.full(worlds, NO_OPPONENT, np.int16)
        self._answering = np.ones((worlds, num_teams), np.bool_)  # the Q-network plays the team
        self._episode = np.full(worlds, -1, np.int64)
        self._game = np.zeros(worlds, np.int64)  # numbers that rise with the games' beginnings
        self._recurrent = np.zeros((2, *seats, 0), np.float32)  # of players and demonstrators
        self._ranges = {  # of saved arrays; those of bools need none
            "opponent": OPPONENT,
            "met": OPPONENT,
            "team": Range(0, num_teams - 1),
            "episode": Range(-1, MOST),
            "game": COUNT,
            "actions": Range(NO_ACTION, env.engine.spec.num_actions - 1),
        }

    @property
    def epsilon(self) -> float:
        """The chance of a random action at the current frame."""
        own: OwnPolicies = self.__dict__["own"]
        return own.exploration.epsilon_at(self.frames)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ("player", "action") int64, "learned" bool, "expert_action" int64 and "opponent"
        int16, each [B, P]; with NFSP "answered" bool too, the decisions of the Q-network.

        "best_action" int64 [B, P] is the learner's legal action of largest Q, the no-op where that
        was not computed.

        "expert_action" is the action of a demonstrator, or its advice, NO_ACTION elsewhere.
        "opponent" is the only one of the game, NO_OPPONENT if there are several or none. With a
        recurrent learner "state" float32 [B, P, S] too, before the step.
        """
        group, taken = tensordict.get(GROUP), self.taken
        if self.frames:
            meetings = find_meetings(taken, self._env.last, self._teams, self._game)
            self._statistics.note_step(taken, self._env.last, meetings)
            has_ended = self._env.seeds.episodes != self._episode
            running = np.where(has_ended, self._number_games(), self._game)
            self._book.note(meetings, self.frames, int(running.min()))
        starting = self._start_new_games()
        taken.owned[:] = taken.opponent == LATEST_ID
        taken.out[:] = group.get("done").squeeze(-1).numpy()
        before = self._demonstrators.telling.copy()
        self._demonstrators.draw(starting, self.frames)
        self._recurrent[0, starting] = 0.0
        self._recurrent[1, starting | (before != self._demonstrators.telling)] = 0.0
        # Against `latest` a demonstrator plays the seats of one team.
        shown = self._demonstrators.playing != NO_DEMONSTRATOR
        taken.shown[:] = shown[:, None] & (taken.team[:, None] == self._teams)
        taken.assisted[starting] = False
        taken.assisted[:] |= taken.shown
        learned = taken.owned & ~taken.out
        actions = torch.full(taken.actions.shape, self._noop, dtype=torch.int64)
        self._play_own(learned, starting, group, actions)
        self._play_opponents(group, actions)
        expert_actions = self._demonstrate(group, actions)
        taken.actions[:] = actions.numpy()
        if actions.ndim > learned.ndim:
            taken.actions[(group.get("action_mask").sum(-1) == 1).numpy()] = NO_ACTION
        group.set("action", actions)
        group.set("learned", torch.from_numpy(learned))
        group.set("expert_action", expert_actions)
        met = torch.from_numpy(self._met).unsqueeze(1).expand(-1, self._players)
        group.set("opponent", met.contiguous())
        self.frames += len(learned)
        return tensordict

    def _play_own(
        self,
        learned: NDArray[np.bool_],
        starting: NDArray[np.bool_],
        group: TensorDictBase,
        actions: Tensor,
    ) -> None:
        """Choose the actions of the seats `learned` [B, P] where no demonstrator plays, and note
        the Q-network's values of first steps, even if the average policy plays.
        """
        own: OwnPolicies = self.__dict__["own"]
        observation, mask = group.get("observation"), group.get("action_mask")
        chosen, size = learned & ~self.taken.shown, own.answer.state_size
        answering = self._answering[:, self._teams]
        valued = learned if size else chosen & (answering | starting[:, None])
        rows, state = torch.from_numpy(valued), torch.from_numpy(self._widen(size)[0])
        if size:
            group.set("state", state.clone())
        values, state[rows] = own.answer.step(observation[rows], state[rows])
        actions[rows] = own.explore(values, mask[rows], self.frames)
        if self._notes_best or starting.any():
            best_action = torch.full_like(actions, self._noop)
            best_action[rows] = best = masked_argmax(values, mask[rows])
            if starting.any():
                has_places = actions.ndim > learned.ndim
                found = find_values(values, best, mask[rows] if has_places else None)
                self._statistics.note_first_values(starting, valued, found.numpy())
            if self._notes_best:
                group.set("best_action", best_action)
        if own.average is not None:
            rows = torch.from_numpy(chosen & ~answering)
            actions[rows] = own.average.select_actions(observation[rows], mask[rows])
            group.set("answered", torch.from_numpy(chosen & answering))

    def _start_new_games(self) -> NDArray[np.bool_]:
        """Draw opponents and team of the worlds [B] whose game has just begun; returns which."""
        starting: NDArray[np.bool_] = self._env.seeds.episodes != self._episode
        count = int(starting.sum())
        if count:
            num_teams = self._answering.shape[1]
            teams = self._rng.integers(0, num_teams, count)
            drawn = self._book.draw(count * num_teams, self.frames).reshape(count, num_teams)
            self.taken.team[starting] = teams
            self._met[starting] = find_met(drawn, teams)
            drawn[np.arange(count), teams] = LATEST_ID
            self.taken.opponent[starting] = drawn[:, self._teams]
            self._episode[:] = self._env.seeds.episodes
            self._game[starting] = self._number_games()[starting]
            self._book.forget_unused(self.taken.opponent)
            own: OwnPolicies = self.__dict__["own"]
            self._answering[starting] = own.draw_answering(self._rng, count, num_teams)
        return starting

    def _demonstrate(self, group: TensorDictBase, actions: Tensor) -> Tensor:
        """Let demonstrators choose where they play; returns their actions and advice, [B, P]."""
        expert_actions, taken = torch.full_like(actions, NO_ACTION), self.taken
        advise = self._demonstrators.settings.advise
        helped = (taken.owned if advise else taken.shown) & ~taken.out
        for number, agent in enumerate(self._demonstrators.agents):
            advised = helped & (self._demonstrators.telling == number)[:, None]
            if advised.any():
                self._act(agent, 1, torch.from_numpy(advised), group, expert_actions)
        self._recurrent[1, ~(helped & (self._demonstrators.telling >= 0)[:, None])] = 0.0
        played = torch.from_numpy(taken.shown & ~taken.out)
        actions[played] = expert_actions[played]
        return expert_actions

    def _widen(self, size: int) -> NDArray[np.float32]:
        """The recurrent states of players and demonstrators [2, B, P, size], a view."""
        self._recurrent = widen_states(self._recurrent, size)
        return self._recurrent[..., :size]

    def _act(
        self, agent: Agent, role: int, rows: Tensor, group: TensorDictBase, actions: Tensor
    ) -> None:
        """Let `agent` choose the actions of `rows` bool [B, P]; its role is 0, a player, or 1, a
        demonstrator.

        Raises ForeignAgentError if it cannot.
        """
        seen, mask = group.get(self._env.key_of(agent.representation)), group.get("action_mask")
        states = self._widen(find_state_size(agent))[role]
        chosen = call_agent(agent, states, rows.numpy(), seen[rows].numpy(), mask[rows].numpy())
        require_answers(agent, chosen, "demonstration" if role else "opponent")
        actions[rows] = torch.from_numpy(chosen.astype(np.int64))

    def _play_opponents(self, group: TensorDictBase, actions: Tensor) -> None:
        theirs = ~self.taken.owned & ~self.taken.out
        for number in np.unique(self.taken.opponent[theirs]).tolist():
            rows = torch.from_numpy(theirs & (self.taken.opponent == number))
            self._act(self._book.pool.agent(number), 0, rows, group, actions)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        others = {"met": self._met, "episode": self._episode, "answering": self._answering}
        return {**self.taken._asdict(), **others, "game": self._game}

    def _number_games(self) -> NDArray[np.int64]:
        """Numbers [B] of games that begin now."""
        return self.frames * len(self._game) + np.arange(len(self._game))

    def export_state(self) -> dict[str, Any]:
        """Teams, opponents and random states as tensors and plain data."""
        own: OwnPolicies = self.__dict__["own"]
        return {
            "frames": self.frames,
            **{name: torch.from_numpy(held.copy()) for name, held in self._arrays().items()},
            "recurrent": torch.from_numpy(self._recurrent.copy()),
            "demonstrators": self._demonstrators.state_dict(),
            "rng": export_rng(self._rng),
            "exploration": own.state_dict(),
        }

    def import_state(self, state: Mapping[str, Any]) -> None:
        """Continue from `export_state`. Raises ValueError for a state that no games can have."""
        self.frames = read_number(state, "frames", COUNT)
        held = self._arrays()
        arrays = take_arrays(state, held, self._ranges)
        members = {*arrays["opponent"].ravel().tolist(), *arrays["met"].tolist()}
        self._book.pool.require_members(members - {LATEST_ID, NO_OPPONENT})
        for name, array in arrays.items():
            held[name][:] = array
        seats = self._recurrent.shape[:-1]
        saved = {"recurrent": np.zeros((*seats, 0), np.float32), **state}  # older ones have none
        shape = (*seats, saved["recurrent"].shape[-1])
        self._recurrent = read_array(saved, "recurrent", (np.float32, shape), NUMBER).copy()
        self._demonstrators.load_state_dict(state["demonstrators"])
        import_rng(self._rng, state["rng"])
        own: OwnPolicies = self.__dict__["own"]
        own.load_state_dict(state["exploration"])


def find_met(drawn: NDArray[np.int16], teams: NDArray[np.int64]) -> NDArray[np.int16]:
    """The one opponent of all rival teams, int16 [N], NO_OPPONENT if there are several or none.

    drawn: int16 [N, teams], the opponent of each. teams: int64 [N], the learner's.
    """
    num_teams = drawn.shape[1]
    if num_teams == 1:
        return drawn[:, 0].copy()
    rivals = drawn[np.arange(num_teams) != teams[:, None]].reshape(len(drawn), num_teams - 1)
    same = (rivals == rivals[:, :1]).all(1)
    met: NDArray[np.int16] = np.where(same, rivals[:, 0], np.int16(NO_OPPONENT))
    return met
