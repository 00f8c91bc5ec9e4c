"""An opponent: any function that returns an object with `act`.

No change of marl_cair is needed. With this file in the current folder:

    marl-cair match opponent:make_first_legal rusher --scenario 11x11 --games 20
    marl-cair train scenario=11x11 'opponent.agents={first: opponent:make_first_legal}' \
        'opponent.mixture={first: 0.5, latest: 0.5}'
"""

import numpy as np


class FirstLegal:
    """Plays the legal action with the lowest number, other than the no-op if there is one."""

    name = "first legal"
    representation = "vector"  # what it observes; without this line the game's first one

    def __init__(self, noop_action):
        self.noop_action = noop_action

    def act(self, observation: np.ndarray, action_mask: np.ndarray) -> np.ndarray:
        """Observations [N, ...] and masks bool [N, A] of N games -> one legal action each, [N]."""
        others = action_mask.copy()
        others[:, self.noop_action] = False
        return np.where(others.any(1), others.argmax(1), self.noop_action)


def make_first_legal(scenario, spec):
    """Makes the opponent for a scenario."""
    return FirstLegal(spec.noop_action)
