"""B worlds as one TorchRL environment of batch size [B]; players in the group "player".

Keys and numbers equal those of TorchRL's PettingZoo wrapper around our ParallelEnv, with the batch
in front, so a policy moves between them unchanged.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Mapping, Sequence
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
USED = frozenset({"next", "_reset"}), frozenset({"reward", "_reset"})  # root, group
SPECIAL = frozenset({"next", "_step"})  # inputs of a step beside actions
SMALL = 1 << 21  # bytes; smaller arrays are read for all worlds
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


class Reader(NamedTuple):
    """How the environment reads an array of all seats from the engine."""

    take: Callable[[], NDArray[Any]]  # makes an array to write to
    read: Callable[..., NDArray[Any]]  # writes to it; of some worlds as `engine.observe`
    is_small: bool

    def fill(self, only: NDArray[np.int64] | None, before: Tensor | None) -> Tensor:
        """Read all worlds, or `only` some; the others are as `before`."""
        out = self.take()
        if only is None or self.is_small:
            return torch.from_numpy(self.read(out))
        np.copyto(out, before.numpy())  # type: ignore[union-attr]  # given with `only`
        if len(only):
            out[only] = self.read(worlds=only)
        return torch.from_numpy(out)


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
    Random actions are legal (`LegalActions`). The engine writes into returned tensors, later steps
    do not; "next" and the next root may share them.
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
        self._seats = torch.Size((num_worlds, self.engine.num_players))
        self._shown: dict[str, Tensor] = {}  # see LegalActions
        self.last = LastStep(
            np.zeros((num_worlds, self.engine.num_players), np.float32),
            np.zeros(num_worlds, np.bool_),
            np.full(num_worlds, NO_WINNER, np.int8),
        )
        self._readers = {
            key: self._make_reader(partial(self.engine.observe, name), chosen.shape, chosen.dtype)
            for key, name in self._representations.items()
            for chosen in (self.engine.representation(name),)
        }
        legal = (*self.engine.spec.action_shape, self.engine.num_actions)
        self._readers["action_mask"] = self._make_reader(self.engine.action_mask, legal, np.bool_)
        self._make_specs()

    def _make_reader(
        self, read: Callable[..., NDArray[Any]], shape: tuple[int, ...], dtype: Any
    ) -> Reader:
        shape = (self.engine.num_worlds, self.engine.num_players, *shape)
        is_small = math.prod(shape) * np.dtype(dtype).itemsize < SMALL
        make: Callable[..., NDArray[Any]] = np.empty if is_small else self._pool.take
        return Reader(partial(make, shape, dtype), read, is_small)

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

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Free the worlds, for example their browsers."""
        self.engine.close()
        super().close(raise_if_closed=raise_if_closed)

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
        self._restart(mask)
        return self._pack(self._observe())  # of all worlds: transforms may read them

    def _restart(self, mask: NDArray[np.bool_] | None) -> NDArray[np.int64] | None:
        """Begin the next game of the worlds in `mask`; returns them, and None for all or most."""
        self.engine.reset(self.seeds.next(mask), mask)
        if mask is None or 2 * np.count_nonzero(mask) > len(mask):
            return None
        return np.flatnonzero(mask)

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
        return self._pack(self._play(tensordict))

    def _play(self, tensordict: TensorDictBase) -> dict[str, Any]:
        """Step the engine; returns the entries of "next"."""
        engine = self.engine
        engine.step(tensordict.get(GROUP)["action"].numpy())
        ended = engine.terminated | engine.truncated
        self.last = LastStep(engine.rewards.copy(), ended, engine.winner.copy())
        seen = self._observe()
        seen[GROUP]["reward"] = torch.from_numpy(self.last.rewards).unsqueeze(-1)
        return seen

    def step_and_maybe_reset(
        self, tensordict: TensorDictBase
    ) -> tuple[TensorDictBase, TensorDictBase]:
        """As TorchRL's own, with equal results, in a fraction of its time.

        It does not check what this class returns by itself, and copies the batch at most once.
        TorchRL's own does the rest: inputs with "_step" or "next", hooks, other containers.
        """
        if tensordict.device != self.device:
            tensordict = tensordict.to(self.device)
        known = type(tensordict) is TensorDict and tensordict.batch_size == self.batch_size
        if not known or self._post_step_mdp_hooks or not SPECIAL.isdisjoint(tensordict.keys()):
            return super().step_and_maybe_reset(tensordict)  # type: ignore[no-any-return]
        seen = self._play(tensordict)
        tensordict._set_str(
            "next", self._pack(seen), validated=True, inplace=False, non_blocking=False
        )
        ended, restarted = self.last.ended, None
        if ended.any():
            seen = self._observe(self._restart(ended), seen[GROUP])
            restarted = None if ended.all() else torch.from_numpy(ended)
        return tensordict, self._pack(_carry(tensordict, seen, restarted))

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
        """All seats' observations now, as `reset` returns them; random actions are legal there."""
        return self._pack(self._observe())

    def _observe(
        self, only: NDArray[np.int64] | None = None, before: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """The entries of all seats' observations.

        With `only`, large arrays are read of those worlds; the others are as in the group `before`.
        """
        engine, old = self.engine, before or {}
        group: dict[str, Any] = {
            key: reader.fill(only, old.get(key)) for key, reader in self._readers.items()
        }
        self._shown["mask"] = group["action_mask"]
        if numbers := engine.info(np.float32):
            group["info"] = {name: torch.from_numpy(values) for name, values in numbers.items()}
        ends = np.zeros((3, *self.batch_size, 1), np.bool_)  # in the order of DONE_KEYS
        of_seats = np.zeros((3, *self._seats, 1), np.bool_)
        ended = engine.terminated | engine.truncated
        if ended.any():
            ends[..., 0] = ended, engine.terminated, engine.truncated
            of_seats[:] = ends[:, :, None]
        if engine.eliminated.any():
            of_seats[:2, ..., 0] |= engine.eliminated
        group.update(zip(DONE_KEYS, torch.from_numpy(of_seats).unbind(), strict=True))
        at_root = zip(DONE_KEYS, torch.from_numpy(ends).unbind(), strict=True)
        return {GROUP: group, **dict(at_root)}

    def _pack(self, entries: dict[str, Any], *, depth: int = 0) -> TensorDictBase:
        packed = {
            key: self._pack(value, depth=depth + 1) if type(value) is dict else value
            for key, value in entries.items()
        }
        batch_size = self._seats if depth else self.batch_size
        return TensorDict._new_unsafe(packed, batch_size=batch_size, device=self.device)

    def game_state(self) -> dict[str, Any]:
        """All worlds (if the game has snapshots) and the seeding, as plain arrays. Not named
        `state_dict`: TorchRL's collectors call that for another purpose.
        """
        engine = self.engine.state_dict() if self.engine.game.has_snapshots else None
        return {
            "engine": engine,
            "seeds": self.seeds.state_dict(),
            "last": {name: value.copy() for name, value in self.last._asdict().items()},
        }

    def load_game_state(self, state: dict[str, Any]) -> None:
        """Continue from `game_state` of an environment with the same settings; a game without
        snapshots begins new games.

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
        if self.engine.game.has_snapshots:
            self.engine.load_state_dict(state["engine"])
            self._observe()  # so that random actions are legal now
        self.seeds.load_state_dict({"seed": seed, "episodes": counts})
        self.last = last
        if not self.engine.game.has_snapshots:
            everywhere = np.ones(self.engine.num_worlds, np.bool_)
            self.engine.reset(self.seeds.next(everywhere))


def _carry(
    old: TensorDictBase, new: dict[str, Any], restarted: Tensor | None, depth: int = 0
) -> dict[str, Any]:
    """The entries of `new` without rewards, and what only `old` has, 0 where `restarted` [B].

    So do TorchRL's `step_mdp` and `reset` with the action and what a policy has written.
    """
    entries = {key: value for key, value in new.items() if key != "reward"}
    for key, value in old.items():
        if type(entries.get(key)) is dict:
            entries[key] = _carry(value, entries[key], restarted, 1)
        elif key not in entries and key not in USED[depth]:
            entries[key] = _blank(value, restarted)
    return entries


def _blank(value: Any, restarted: Tensor | None) -> Any:
    if isinstance(value, Tensor):
        if restarted is None:
            return value
        return value.masked_fill(restarted.view(-1, *[1] * (value.ndim - 1)), 0)
    copied = value.copy()
    if restarted is not None:
        copied.where(~restarted, other=copied.empty(), out=copied, pad=0)
    return copied
