"""An opponent sampler: the past selves that win most often against the learner.

Copy the function to `marl_cair/self_play/samplers.py` and add one line to `SAMPLERS` there:
`"hardest": hardest`. Then
`marl-cair train 'opponent.mixture={latest: 0.5, hardest: 0.5}'` uses it.
"""

import numpy as np

NUM_HARDEST = 3


def hardest(standings, options):
    """Probabilities float64 [K] over opponents: the three past selves with the lowest win rate."""
    pool = standings.pool  # indices of frozen policies; empty before the first snapshot
    order = np.argsort(standings.win_rate[pool], kind="stable")
    chosen = pool[order[:NUM_HARDEST]]
    return standings.spread(chosen, np.ones(len(chosen)))
