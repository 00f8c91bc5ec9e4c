"""How many examples of an end `ccdn` needs: recall of held-out ends after training on few of them.

marl-cair dataset collect --game deep_maze --scenario 9x9-stochastic --rows 60000 --out data/maze
python -m benchmarks.ends data/maze --ends 5 15 50 --seeds 0 1 2
"""

from __future__ import annotations

import argparse
from typing import cast

import torch
from tensordict import TensorDict

from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.networks import outcome
from marl_cair.generative.quality import find_auc
from marl_cair.generative.settings import GeneratorConfig
from marl_cair.replay.dataset import DatasetDescription, load_dataset
from marl_cair.training.collecting.filling import complete_rows
from marl_cair.training.generating.generators import make_for_game
from marl_cair.training.offline.generator_training import describe_game

TRAIN_ROWS, OTHER_ROWS = 12_000, 1_200
LEAST_HELDOUT = 1e-6  # of the training rows: the test rows are of other episodes


def measure(
    about: DatasetDescription,
    train: TensorDict,
    tested: TensorDict,
    num_ends: int,
    seed: int,
    updates: int,
) -> dict[str, float]:
    """Train on 12,000 transitions with `num_ends` ends; recognise the ends of the `tested` ones.

    Raises ValueError for too few ends.
    """
    spec, seen = describe_game(about)
    config = GeneratorConfig(seed=seed, heldout_share=LEAST_HELDOUT, heldout_ends=LEAST_HELDOUT)
    others = about.num_players - 1
    made = make_for_game("ccdn", config, seen, spec, spec.reward_bound, others)
    generator = cast(CCDNGenerator, made)
    ends = train["next", "terminated"][:, 0]
    if int(ends.sum()) < num_ends:
        raise ValueError(f"{int(ends.sum())} ends are there to train on, {num_ends} are wanted")
    going_on = (~ends).nonzero()[:TRAIN_ROWS, 0]
    rows = train[torch.cat([going_on, ends.nonzero()[:num_ends, 0]])]
    generator.observe(rows)
    draws = torch.Generator().manual_seed(seed)
    for _ in range(updates):
        generator.update(rows[torch.randint(len(rows), (128,), generator=draws)])
    is_end = tested["next", "terminated"][:, 0]
    step = max(1, int((~is_end).sum()) // OTHER_ROWS)
    of_ends = generator.imagine(tested[is_end]).end
    of_others = generator.imagine(tested[~is_end][::step]).end
    certainty = torch.cat([of_ends, of_others])
    return {
        "recall": float((of_ends > 0.5).float().mean()),
        "false alarms": float((of_others > 0.5).float().mean()),
        "AUC": find_auc(certainty, torch.arange(len(certainty)) < len(of_ends)) or 0.0,
    }


def main() -> None:
    """Print one line for each number of ends, with and without the planes that meet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset")
    parser.add_argument("--ends", type=int, nargs="+", default=[5, 15, 50])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--updates", type=int, default=600)
    options = parser.parse_args()
    torch.set_num_threads(1)
    data = load_dataset(options.dataset)
    train = complete_rows(data.train, torch.arange(len(data.train)))
    tested = complete_rows(data.heldout, torch.arange(len(data.heldout)))
    usual = outcome.MEETING_GAIN
    for num_ends in options.ends:
        for gain in (usual, 0.0):
            outcome.MEETING_GAIN = gain
            found = [
                measure(data.about, train, tested, num_ends, seed, options.updates)
                for seed in options.seeds
            ]
            text = ", ".join(
                f"{name} {' '.join(f'{one[name]:.3f}' for one in found)}" for name in found[0]
            )
            print(f"{num_ends} ends, {'with' if gain else 'without'} meetings: {text}", flush=True)


if __name__ == "__main__":
    main()
