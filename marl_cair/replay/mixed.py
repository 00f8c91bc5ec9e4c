"""Generated transitions: a ring of them, and batches that mix an exact share into real ones.

TorchRL's ReplayBufferEnsemble takes its shares as probabilities, which hold on average only; its
buffers would write ring slots into "index", where generated rows hold NO_INDEX.
"""

import os
from collections.abc import Mapping
from pathlib import Path

import torch
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.ranges import COUNT, FLAG, NUMBER, Range, read_array, read_number
from marl_cair.replay import MOST_STEPS, transition
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.buffer import EpisodeReplayBuffer
from marl_cair.replay.sampler import draw_integers, restore_generator
from marl_cair.replay.sequences import find_sequence_errors
from marl_cair.replay.transition import EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS, Key, TransitionSpec

_STORED_KEYS: tuple[Key, ...] = (*EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS)


class GeneratedReplay:
    """Ring of the newest `capacity` generated transitions, sampled uniformly.

    spec: shapes of a transition. seed: of the sampling. Memory is paged in as the ring fills.
    Raises ValueError for a capacity below 1.
    """

    def __init__(self, spec: TransitionSpec, capacity: int = 20_000, seed: int = 0) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}, expected 1 or more")
        self.spec = spec
        self.capacity = capacity
        self._generator = torch.Generator().manual_seed(seed)
        self._num_written = 0
        fields = spec.fields()
        self._ring = {
            key: torch.from_numpy(transition.make_array(capacity, *fields[key]))
            for key in _STORED_KEYS
        }

    def __len__(self) -> int:
        """Transitions in the ring."""
        return min(self._num_written, self.capacity)

    def extend(self, transitions: TensorDict) -> None:
        """Overwrite the oldest transitions by `transitions` [N], of more than `capacity` the last.

        They need EXPERIENCE_KEYS; "steps_to_next_obs" is 1 by default; other keys are ignored.
        Raises ValueError as `check_transitions` does.
        """
        given = STEPS_TO_NEXT_OBS in transitions.keys(include_nested=True)
        keys = _STORED_KEYS if given else EXPERIENCE_KEYS
        transition.check_transitions(transitions, self.spec, keys)
        transitions = transitions[-self.capacity :]
        first = self._num_written
        slots = torch.arange(first, first + len(transitions)) % self.capacity
        self._ring[STEPS_TO_NEXT_OBS][slots] = 1
        for key in keys:
            self._ring[key][slots] = transitions[key].detach()
        self._num_written += len(transitions)

    def clear(self) -> None:
        """Remove all transitions."""
        self._num_written = 0

    def sample(self, batch_size: int) -> TensorDict:
        """Return TensorDict [batch_size] with all transition keys, "is_generated" true.

        Raises RuntimeError while the ring is empty.
        """
        if len(self) == 0:
            raise RuntimeError("no generated transition to sample yet: extend the ring first")
        slots = draw_integers(len(self), batch_size, self._generator)
        rows = {key: field.index_select(0, slots) for key, field in self._ring.items()}
        return _add_labels(rows, self.spec.num_others)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the ring to folder `path` and replace an older one; no pickle."""
        arrays = {_file_name(key): field[: len(self)].numpy() for key, field in self._ring.items()}
        arrays["generator"] = self._generator.get_state().numpy()
        with replaced_folder(path) as folder:
            facts = {**self._layout(), "num_written": self._num_written}
            save_arrays(folder / "ring", arrays, facts)

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read a folder that `save` wrote. Raises ValueError if the layout differs."""
        arrays, facts = load_arrays(Path(path) / "ring")
        require_layout(facts, self._layout(), "generated replay")
        num_written = read_number(facts, "num_written", COUNT)
        size = min(num_written, self.capacity)
        saved = {}
        for key, field in self._ring.items():
            own = field.numpy()
            allowed = NUMBER if field.is_floating_point() else None
            if key == STEPS_TO_NEXT_OBS:
                allowed = Range(1, MOST_STEPS)
            like = own.dtype, (size, *own.shape[1:])
            array = read_array(arrays, _file_name(key), like, allowed)
            saved[key] = torch.from_numpy(array.copy())
        transition.check_transitions(_add_labels(saved), self.spec, _STORED_KEYS)
        restore_generator(self._generator, arrays)
        self._num_written = num_written
        for key, field in self._ring.items():
            field[:size] = saved[key]

    def _layout(self) -> dict[str, object]:
        return {
            "capacity": self.capacity,
            "observation_shape": list(self.spec.observation_shape),
            "observation_dtype": str(self.spec.observation_dtype),
            "num_actions": self.spec.num_actions,
        }


def _add_labels(rows: Mapping[Key, torch.Tensor], num_others: int = 0) -> TensorDict:
    """TensorDict [N] of generated rows with all labels. rows: fields [N, ...] of _STORED_KEYS."""
    num_rows = len(rows[transition.ACTION])
    unknown = torch.full((num_rows, num_others), transition.UNKNOWN_ACTION)
    return transition.make_tensordict(
        {
            **rows,
            transition.IS_GENERATED: torch.ones(num_rows, 1, dtype=torch.bool),
            transition.EXPERT_ACTION: torch.full((num_rows,), transition.NO_ACTION),
            transition.OPPONENT: torch.full((num_rows,), transition.NO_OPPONENT, dtype=torch.int16),
            transition.INDEX: torch.full((num_rows,), transition.NO_INDEX),
            **({transition.OTHER_ACTIONS: unknown} if num_others else {}),
        }
    )


def _file_name(key: Key) -> str:
    return key if isinstance(key, str) else "_".join(key)


class MixedReplay:
    """Real and generated transitions, mixed by exact numbers of rows.

    A batch of n rows holds round(n * fraction) generated ones (Python's round: half to even). While
    `generated_open` is false (the generator has not passed its gate), or no transition was
    generated yet, batches are all real; with a fraction of 1 there are none then (`can_sample`).

    weight: of generated rows in the loss, 0..1; real ones have 1.
    """

    def __init__(
        self,
        real: EpisodeReplayBuffer,
        generated: GeneratedReplay,
        fraction: float = 0.2,
        weight: float = 1.0,
        *,
        generated_open: bool = True,
    ) -> None:
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f"fraction is {fraction}, expected 0..1")
        self.real = real
        self.generated = generated
        self.fraction, self.weight = fraction, weight
        self.generated_open = generated_open

    def sample(self, batch_size: int | None = None) -> TensorDict:
        """Return TensorDict [batch_size] with the transition keys: real rows, then generated ones.

        With `replay.priority_alpha` or a weight below 1 also "priority_weight" float32
        [batch_size].
        Raises RuntimeError while no transition can be sampled (`can_sample`).
        """
        num_rows = self.real.batch_size if batch_size is None else batch_size
        num_generated = round(num_rows * self.fraction) if self._has_generated else 0
        if not self.can_sample:
            raise RuntimeError("all rows are to be generated, and there are none yet")
        if num_generated == num_rows:
            return self.generated.sample(num_rows)
        batch: TensorDict = self.real.sample(num_rows - num_generated)
        if not num_generated:
            return batch
        weights = batch.pop("priority_weight", None)
        batch = _join_rows(batch, self.generated.sample(num_generated))
        if weights is None and self.weight < 1.0:
            weights = torch.ones(num_rows - num_generated)
        if weights is not None:  # generated rows keep their share of the loss
            mean = (self.weight * weights.mean()).expand(num_generated)
            batch["priority_weight"] = torch.cat([weights, mean])
        return batch

    @property
    def can_sample(self) -> bool:
        """Whether batches can be made; it is false only while all rows are to be generated and
        there are none.
        """
        return self.fraction < 1.0 or self._has_generated

    def sample_generated(self, num_real: int) -> TensorDict | None:
        """Generated transitions that make their share of a batch with `num_real` real ones; None
        while there are none.
        """
        count = round(num_real * self.fraction / (1.0 - self.fraction))
        return self.generated.sample(count) if count and self._has_generated else None

    @property
    def _has_generated(self) -> bool:
        return self.generated_open and len(self.generated) > 0

    def note_errors(self, batch: TensorDict, done: float) -> None:
        """Set the priorities of a batch's real rows from their TD errors.

        batch: from `sample`, with "td_error" [batch_size], or [N, T] of sequences; done: share of
        the run, 0..1.
        """
        index, errors = batch["index"], batch["td_error"]
        if batch.ndim == 2:
            index, errors = index[:, 0], find_sequence_errors(errors, batch["learned"])
        real = index != transition.NO_INDEX
        self.real.update_priority(index[real], errors[real], done)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write both rings to folder `path` and replace an older one; no pickle."""
        with replaced_folder(path) as folder:
            self.real.save(folder / "real")
            self.generated.save(folder / "generated")
            save_arrays(folder / "mixture", {}, {"generated_open": self.generated_open})

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read a folder that `save` wrote. Raises ValueError if a layout differs."""
        self.real.load(Path(path) / "real")
        self.generated.load(Path(path) / "generated")
        facts = load_arrays(Path(path) / "mixture")[1]
        self.generated_open = read_number(facts, "generated_open", FLAG)


def _join_rows(real: TensorDict, generated: TensorDict) -> TensorDict:
    """Concatenate field by field: in a third of the time of torch.cat on the TensorDicts."""
    joined = {
        key: _join_rows(value, generated[key])
        if isinstance(value, TensorDict)
        else torch.cat([value, generated[key]])
        for key, value in real.items()
    }
    return TensorDict(joined, [len(real) + len(generated)])
