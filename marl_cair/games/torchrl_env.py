"""B worlds as one TorchRL environment of batch size [B]; players in the group "player".

Keys and numbers equal those of TorchRL's PettingZoo wrapper around our ParallelEnv, with the batch
in front, so a policy moves between them unchanged.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from marl_cair.games import make_engine
from marl_cair.games.checks.engine import check_count, check_seed
from marl_cair.games.checks.state import Range, check_arrays, check_outcome, check_range
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import EpisodeSeeds

GROUP = "player"  # as TorchRL's wrapper groups agents named player_0, player_1, ...
MOST_EPISODES = 2**62  # of one world
DONE_KEYS = ("done", "terminated", "truncated")
MAX_SPARE = 64  # unused arrays of one shape that `ArrayPool` keeps


class ArrayPool:
    """Uninitialised arrays whose memory returns here when the last view of them is gone.

    A batch of observations is megabytes. The operating system would take them back and clear them
    at every step, which costs more than writing the observations.
    """

    def __init__(self) -> None:
        self._spare: dict[tuple[Any, ...], list[NDArray[Any]]] = {}

    def take(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """An unused array; its content is arbitrary."""
        spare = self._spare.setdefault((shape, np.dtype(dtype)), [])
        memory = spare.pop() if spare else np.empty(shape, dtype)
        lent = memory.view()
        weakref.finalize(lent, _give_back, spare, memory).atexit = False
        return lent


def _give_back(spare: list[NDArray[Any]], memory: NDArray[Any]) -> None:
    if len(spare) < MAX_SPARE:
        spare.append(memory)


class LastStep(NamedTuple):
    """The results of the last step, kept beyond the reset that follows an end."""

    rewards: NDArray[np.float32]  # [B, P]
    ended: NDArray[np.bool_]  # [B]
    winner: NDArray[np.int8]  # [B] seat, or NO_WINNER


class LegalActions(Categorical):
    """Actions of which `rand` draws legal ones, uniformly, by the last action masks.

    So do its clones, which transforms, collectors and `RandomPolicy` hold. Before the first reset,
    and for another shape, it draws any action.
    """

    shown: dict[str, Tensor] | None = None  # "mask": bool [*shape, A]; one object for all clones

    def rand(self, shape: torch.Size | None = None) -> Tensor:
        mask = None if shape or self.mask is not None else (self.shown or {}).get("mask")
        if mask is None:
            drawn: Tensor = super().rand(shape)
            return drawn
        return torch.rand(mask.shape).masked_fill_(~mask, -1.0).argmax(-1)

    def clone(self) -> LegalActions:
        copied: LegalActions = super().clone()
        copied.shown = self.shown
        return copied


class BatchedGameEnv(EnvBase):
    """B worlds that step together.

    Args:
        game, scenario, num_worlds, num_threads, options: as `make_engine`.
        representation: what agents observe.
        extra_representations: further ones (or one), under their own names (bots that play seats
            observe `planes`, whatever the learner observes).
        seed: of the run; None draws one.

    Keys: ("player", "observation") [B, P, *shape], ("player", "action_mask") bool
    [B, P, *action_shape, A], ("player", "action") int64 [B, P, *action_shape],
    ("player", "reward") float32 [B, P, 1], ("player", "info", ...) float32 [B, P] where the game
    has numbers of its own (`Game.info`), and done, terminated, truncated bool [B, 1] at the root
    and [B, P, 1] in the group. The root is done when the world is over, and by that alone TorchRL
    resets. A seat that is out while others continue is terminated and done in the group from that
    step on: it can only play the no-op, and its later observations must not be learned from.
    `rand_action`, and a collector without a policy, draw legal actions (`LegalActions`). The engine
    writes into the returned tensors: nothing is copied, and steps share no memory.
    """

    def __init__(
        self,
        game: str,
        scenario: str | None = None,
        num_worlds: int = 1,
        *,
        representation: str = "planes",
        extra_representations: str | Sequence[str] = (),
        num_threads: int = 1,
        seed: int | None = None,
        **options: Any,
    ) -> None:
        num_worlds = check_count(game, "num_worlds", num_worlds)
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([num_worlds]))
        self.engine = make_engine(game, scenario, num_worlds, num_threads, **options)
        extra = extra_representations
        extra = (extra,) if isinstance(extra, str) else extra
        self._representations = {"observation": representation, **{name: name for name in extra}}
        self.group_map = {GROUP: [f"player_{seat}" for seat in range(self.engine.num_players)]}
        self.seeds = EpisodeSeeds(num_worlds, None if seed is None else check_seed(game, seed))
        self._pool = ArrayPool()
        self._shown: dict[str, Tensor] = {}  # see LegalActions
        self.last = LastStep(
            np.zeros((num_worlds, self.engine.num_players), np.float32),
            np.zeros(num_worlds, np.bool_),
            np.full(num_worlds, NO_WINNER, np.int8),
        )
        self._make_specs()

    def _make_specs(self) -> None:
        worlds, seats = (self.engine.num_worlds,), (self.engine.num_worlds, self.engine.num_players)

        def in_group(specs: dict[str, Any], **at_root: Any) -> Any:
            return Composite({GROUP: Composite(specs, shape=seats), **at_root}, shape=worlds)

        seen: dict[str, Any] = {
            key: self._make_observation_spec(name) for key, name in self._representations.items()
        }
        if numbers := self.engine.info():
            info = {name: Unbounded(seats, dtype=torch.float32) for name in numbers}
            seen["info"] = Composite(info, shape=seats)
        actions, places = self.engine.num_actions, (*seats, *self.engine.spec.action_shape)
        seen["action_mask"] = Binary(actions, shape=(*places, actions), dtype=torch.bool)
        action = LegalActions(actions, shape=torch.Size(places), dtype=torch.int64)
        action.shown = self._shown
        self.observation_spec = in_group(seen)
        self.action_spec = in_group({"action": action})
        self.reward_spec = in_group({"reward": Unbounded((*seats, 1), dtype=torch.float32)})
        of_seats, of_worlds = (
            {key: Binary(1, shape=(*shape, 1), dtype=torch.bool) for key in DONE_KEYS}
            for shape in (seats, worlds)
        )
        self.done_spec = in_group(of_seats, **of_worlds)

    def _make_observation_spec(self, name: str) -> Any:
        chosen = self.engine.representation(name)
        shape = (self.engine.num_worlds, self.engine.num_players, *chosen.shape)
        dtype = torch.uint8 if chosen.dtype is np.uint8 else torch.float32
        low, high = (torch.from_numpy(bound.copy()).expand(shape) for bound in chosen.bounds())
        return Bounded(low, high, shape=shape, dtype=dtype)

    def set_seed(self, seed: int | None = None, static_seed: bool = False) -> int | None:
        """Begin again at the first game of `seed`; returns the seed for a next environment. Raises
        ValueError unless the seed is a whole number.
        """
        if seed is not None:
            seed = check_seed(self.engine.game.name, seed)
        following: int | None = super().set_seed(seed, static_seed)
        return following

    def _set_seed(self, seed: int | None) -> None:
        self.seeds.restart(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        mask = self._read_reset_mask(tensordict)
        self.engine.check_reset(mask)
        self.engine.reset(self.seeds.next(mask), mask)
        # TorchRL reads only the worlds that were reset.
        return self._observe(None if mask is None or mask.all() else np.flatnonzero(mask))

    def _read_reset_mask(self, tensordict: TensorDictBase | None) -> NDArray[np.bool_] | None:
        """The worlds to restart; a world restarts when any of its seats is asked to."""
        if tensordict is None:
            return None
        for key in ("_reset", (GROUP, "_reset")):
            asked = tensordict.get(key, None)
            if asked is not None:
                mask: NDArray[np.bool_] = asked.reshape(self.engine.num_worlds, -1).any(-1).numpy()
                return mask
        return None

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        engine = self.engine
        engine.step(tensordict[GROUP, "action"].numpy())
        ended = engine.terminated | engine.truncated
        self.last = LastStep(engine.rewards.copy(), ended, engine.winner.copy())
        seen = self._observe()
        seen[GROUP, "reward"] = torch.from_numpy(self.last.rewards).unsqueeze(-1)
        return seen

    def key_of(self, representation: str) -> str:
        """The key in the group of a representation. Raises ValueError if it is not observed."""
        for key, name in self._representations.items():
            if name == representation:
                return key
        raise ValueError(
            f"{self.engine.game.name}: this environment does not give {representation!r}; name it "
            "in `extra_representations`"
        )

    def current(self) -> TensorDictBase:
        """The observations of all seats now, as `reset` returns them: for `load_game_state`."""
        return self._observe()

    def _observe(self, only: NDArray[np.int64] | None = None) -> TensorDictBase:
        """The observations of all seats; with `only`, of those worlds, and zeros for the others."""
        engine = self.engine
        worlds, players = engine.num_worlds, engine.num_players
        seats: dict[str, Any] = {}
        for key, name in self._representations.items():
            chosen = engine.representation(name)
            seen = self._pool.take((worlds, players, *chosen.shape), chosen.dtype)
            seats[key] = _fill(seen, partial(engine.observe, name), only)
        places = (worlds, players, *engine.spec.action_shape)
        legal = self._pool.take((*places, engine.num_actions), np.bool_)
        seats["action_mask"] = _fill(legal, engine.action_mask, only)
        everywhere = seats["action_mask"] if only is None else engine.action_mask()
        self._shown["mask"] = torch.as_tensor(everywhere)
        if numbers := engine.info():
            info = {name: _to_tensor(values, only) for name, values in numbers.items()}
            seats["info"] = TensorDict._new_unsafe(info, batch_size=torch.Size([worlds, players]))
        terminated = torch.from_numpy(engine.terminated).clone().unsqueeze(-1)
        truncated = torch.from_numpy(engine.truncated).clone().unsqueeze(-1)
        ended = dict(zip(DONE_KEYS, (terminated | truncated, terminated, truncated), strict=True))
        out = torch.from_numpy(engine.eliminated).unsqueeze(-1)
        for key, value in ended.items():
            of_seats = value.unsqueeze(1).expand(worlds, players, 1)
            seats[key] = of_seats.clone() if key == "truncated" else of_seats | out
        group = TensorDict._new_unsafe(seats, batch_size=torch.Size([worlds, players]))
        return TensorDict._new_unsafe({GROUP: group, **ended}, batch_size=self.batch_size)

    def game_state(self) -> dict[str, Any]:
        """All worlds and the seeding as plain arrays.

        Not named `state_dict`: TorchRL's collectors call that for another purpose.
        """
        return {
            "engine": self.engine.state_dict(),
            "seeds": self.seeds.state_dict(),
            "last": {name: value.copy() for name, value in self.last._asdict().items()},
        }

    def load_game_state(self, state: dict[str, Any]) -> None:
        """Continue from `game_state` of an environment with the same settings.

        Raises:
            ValueError: an array has another shape or type, or a value that no game has; nothing has
                changed then.
        """
        game = self.engine.game.name
        last = LastStep(**{name: np.array(state["last"][name]) for name in LastStep._fields})
        counts = np.array(state["seeds"]["episodes"])
        names, fields = (*LastStep._fields, "episodes"), (*self.last, self.seeds.episodes)
        check_arrays(game, names, fields, (*last, counts), self.engine.num_worlds)
        check_outcome(game, last, self.engine.num_players)
        check_range(game, "episodes", counts, Range(0, MOST_EPISODES))
        seed = check_seed(game, state["seeds"]["seed"])
        self.engine.load_state_dict(state["engine"])
        self.seeds.load_state_dict({"seed": seed, "episodes": counts})
        self.last = last


def _to_tensor(values: NDArray[Any], only: NDArray[np.int64] | None) -> Tensor:
    """A game's own numbers [B, P] as float32; of worlds that are left out, zeros."""
    shown = values.astype(np.float32)
    if only is not None:
        shown[np.setdiff1d(np.arange(len(values)), only)] = 0.0
    return torch.from_numpy(shown)


def _fill(
    out: NDArray[Any], read: Callable[..., NDArray[Any]], only: NDArray[np.int64] | None
) -> Tensor:
    """Write what `read` returns of all worlds, or of some and zeros for the others."""
    if only is None:
        return torch.from_numpy(read(out))
    out.fill(0)
    if len(only):
        out[only] = read(worlds=only)
    return torch.from_numpy(out)
