"""A generator that knows the rules of Deep Maze: what a perfect generator would do for a learner.

marl-cair experiment synthetic --only deep_maze one_step_real perfect_20 perfect_50

Its variants show what of a perfect generator matters: when it begins, and whether it knows goals.
"""

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from docs.extending.generator import MemoryGenerator
from marl_cair.games.deep_maze import observation as seen
from marl_cair.games.deep_maze import tables as t
from marl_cair.generative.gate import GateReport
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.replay.transition import mark_generated

LATE_ROWS, TAUGHT_ENDS = 4_000, 5


class PerfectMazeGenerator(MemoryGenerator):
    """Exact transitions of one player in a fully seen maze, from observed states with a random
    legal action. The plane of the time that is left falls at the right rate, not in the right move.

    Raises ValueError for other games and scenarios.
    """

    def __init__(self, config: GeneratorConfig, spec: GeneratorSpec) -> None:
        planes, rows, columns = spec.observation_shape
        if planes != len(seen.PLANE_NAMES) or rows != columns or rows not in t.MAX_TICKS_OF_SIZE:
            raise ValueError(
                f"observations of {tuple(spec.observation_shape)} are no planes of a maze: use "
                f"game=deep_maze with a size of {', '.join(map(str, t.MAX_TICKS_OF_SIZE))}"
            )
        super().__init__(config, spec)  # type: ignore[no-untyped-call]
        self._max_ticks = t.MAX_TICKS_OF_SIZE[rows]

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """Return `num_rows` transitions; none while the gate is shut."""
        num = num_rows if self._is_open else 0
        begun = starts[torch.randint(len(starts), (num,), generator=self._random)]
        if num:
            legal = begun["action_mask"].float()
            begun["action"] = torch.multinomial(legal, 1, generator=self._random)[:, 0]
        return self.predict(begun)[0]

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """Return the true transition from each of `starts`, and that all are accepted."""
        rows = make_empty_transitions(self.spec, len(starts))
        for key in ("observation", "action_mask", "action"):
            rows[key] = starts[key]
        place, came_from, is_end = _walk(rows["observation"], rows["action"])
        later = rows["observation"].clone()
        later[:, seen.SELF], later[:, seen.CAME_FROM] = place, came_from
        chance = torch.rand(len(rows), 1, 1, generator=self._random)
        falls = (seen.FULL / self._max_ticks + chance).to(torch.uint8)
        later[:, seen.TIME_LEFT] -= torch.minimum(falls, later[:, seen.TIME_LEFT])
        rows["next", "observation"] = later
        rows["next", "action_mask"] = _list_legal(later, is_end)
        rows["next", "reward"] = torch.where(is_end, t.GOAL_REWARD, t.STEP_REWARD)[:, None]
        rows["next", "terminated"] = rows["next", "done"] = is_end[:, None]
        mark_generated(rows)
        return rows, torch.full((len(rows),), self._is_open)


class LateMazeGenerator(PerfectMazeGenerator):
    """The same, but its gate opens after 4,000 transitions, about when that of `ccdn` does."""

    _num_seen = 0

    def observe(self, batch: TensorDict) -> None:
        """Remember and count real transitions."""
        super().observe(batch)  # type: ignore[no-untyped-call]
        self._num_seen += len(batch)

    def evaluate(self) -> GateReport:
        """Open the gate if enough was seen."""
        missing = LATE_ROWS - self._num_seen
        reasons = (f"{missing} transitions are missing",) if missing > 0 else ()
        self.last_report = GateReport(passed=not reasons, reasons=reasons)
        return self.last_report


class EndlessMazeGenerator(PerfectMazeGenerator):
    """The same, without the transitions that reach a goal."""

    _may_end = False

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """As the base class; ends are not accepted while `_may_end` is false."""
        rows, accepted = super().predict(starts)
        return rows, accepted & (~rows["next", "terminated"][:, 0] | self._may_end)


class TaughtMazeGenerator(EndlessMazeGenerator):
    """The same, which may reach a goal once players have reached it five times."""

    _num_ends = 0

    def observe(self, batch: TensorDict) -> None:
        """Remember real transitions, and count their ends."""
        super().observe(batch)  # type: ignore[no-untyped-call]
        self._num_ends += int(batch["next", "terminated"].sum())
        self._may_end = self._num_ends >= TAUGHT_ENDS


def _shift(player: Tensor, move: int) -> Tensor:
    """The player's plane [N, H, W] one cell on, all 0 where that is outside of the board."""
    rows, columns = player.shape[1:]
    top, left = 1 - t.ROW_STEP[move], 1 - t.COLUMN_STEP[move]
    return nn.functional.pad(player, (1, 1, 1, 1))[:, top : top + rows, left : left + columns]


def _find_free(board: Tensor, move: int) -> Tensor:
    """Whether the player of `board` [N, C, H, W] can make the move, bool [N]."""
    ahead = _shift(board[:, seen.SELF], move)
    return ((ahead > 0) & (board[:, seen.WALLS] == 0)).flatten(1).any(1)


def _walk(now: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where the player is after its move and where it came from, uint8 [N, H, W], and whether the
    goal is reached, bool [N].
    """
    place, came_from = now[:, seen.SELF].clone(), now[:, seen.CAME_FROM].clone()
    for move in range(t.NUM_MOVES):
        moved = (action == move) & _find_free(now, move)
        came_from[moved], place[moved] = place[moved], _shift(place[moved], move)
    is_end = ((place > 0) & (now[:, seen.GOALS] > 0)).flatten(1).any(1)
    return place, came_from, is_end


def _list_legal(later: Tensor, is_end: Tensor) -> Tensor:
    """Legal actions after the move, bool [N, A]."""
    moves = [_find_free(later, move) & ~is_end for move in range(t.NUM_MOVES)]
    return torch.stack([*moves, torch.ones_like(is_end)], dim=1)
