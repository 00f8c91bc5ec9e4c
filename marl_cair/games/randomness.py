"""The only source of randomness in rules: counter-based 64-bit words held in the state.

Each word is splitmix64 (Steele, Lea, Flood 2014): the state is a counter, the output a hash of it,
so a world draws the same numbers alone, in a batch, on any thread and after a restore.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled

GOLDEN_STEP = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30, _SHIFT_27, _SHIFT_31, _SHIFT_32 = (np.uint64(n) for n in (30, 27, 31, 32))


@compiled
def mix(word: Any) -> Any:
    """Hash one uint64 (scalar or array) to another, a bijection."""
    word = (word ^ (word >> _SHIFT_30)) * _MIX_1
    word = (word ^ (word >> _SHIFT_27)) * _MIX_2
    return word ^ (word >> _SHIFT_31)


@compiled
def draw_below(random: Any, index: int, limit: int) -> int:
    """A uniform integer in 0..limit-1 from the word `random[index]`, which it advances.

    The bias of the multiply-shift is below limit / 2**32.
    """
    random[index] += GOLDEN_STEP
    high = mix(random[index]) >> _SHIFT_32
    return int(np.int64((high * np.uint64(limit)) >> _SHIFT_32))


def episode_seeds(
    seed: int, worlds: NDArray[np.int64], episodes: NDArray[np.int64]
) -> NDArray[np.uint64]:
    """Seeds uint64 [N] of the `episodes[i]`-th game of world `worlds[i]` under a run's `seed`.

    A world's seed does not depend on how many worlds there are.
    """
    with np.errstate(over="ignore"):
        plain_mix = getattr(mix, "py_func", mix)
        word = plain_mix(np.uint64(int(seed) % 2**64) + GOLDEN_STEP)
        word = plain_mix(word ^ (worlds.astype(np.uint64) + np.uint64(1)) * GOLDEN_STEP)
        mixed: NDArray[np.uint64] = plain_mix(
            word ^ (episodes.astype(np.uint64) + np.uint64(1)) * _MIX_1
        )
    return mixed


class EpisodeSeeds:
    """Counts the episodes of B worlds and gives each episode its seed.

    Args:
        num_worlds: B.
        seed: of the run; None draws one from the operating system.
    """

    def __init__(self, num_worlds: int, seed: int | None = None) -> None:
        self._worlds = np.arange(num_worlds)
        self.restart(seed)

    def restart(self, seed: int | None) -> None:
        """Begin again at episode 0 of every world."""
        self.seed = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
        self.episodes = np.zeros(len(self._worlds), np.int64)

    def next(self, mask: NDArray[np.bool_] | None = None) -> NDArray[np.uint64]:
        """Seeds uint64 [B] of the next episodes; advances only the worlds in `mask`."""
        seeds = episode_seeds(self.seed, self._worlds, self.episodes)
        self.episodes += 1 if mask is None else mask
        return seeds

    def state_dict(self) -> dict[str, Any]:
        """The seed and the counts as plain data."""
        return {"seed": self.seed, "episodes": self.episodes.copy()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue where `state_dict` was taken."""
        self.seed, self.episodes = int(state["seed"]), np.array(state["episodes"], np.int64)
