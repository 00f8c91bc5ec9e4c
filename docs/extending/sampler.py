r"""An opponent sampler: the past selves that win most often against the learner.

No change of marl_cair is needed. With this file in the current folder (`\:` is a colon in
a name, as Hydra reads it):

    marl-cair train 'opponent.mixture={latest: 0.5, sampler\:hardest: 0.5}'
"""

import numpy as np

NUM_HARDEST = 3


def hardest(standings, options):
    """Probabilities float64 [K] over opponents: the three past selves with the lowest win rate."""
    pool = standings.pool  # indices of frozen policies; empty before the first snapshot
    order = np.argsort(standings.win_rate[pool], kind="stable")
    chosen = pool[order[:NUM_HARDEST]]
    return standings.spread(chosen, np.ones(len(chosen)))
