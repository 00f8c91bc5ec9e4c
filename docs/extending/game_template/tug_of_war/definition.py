"""The definition of Tug of war: functions, actions, observation, picture and bots."""

import numpy as np

from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation
from tug_of_war import rules
from tug_of_war.scenarios import GYMNASIUM_PREFIX, REWARDS, SCENARIOS
from tug_of_war.state import allocate

ACTIONS = ("rest", "pull")


def make_spec(scenario):
    """What `scenario` offers to agents."""
    rope, stamina = float(scenario.rope_end), float(rules.MOST_STAMINA)
    vector = Representation(
        "vector",
        (3,),
        np.float32,
        (rope, stamina, stamina),
        ("rope", "own stamina", "other stamina"),
        rules.observe,
        low=(-rope, 0.0, 0.0),
    )
    return GameSpec(
        num_players=2,
        action_names=ACTIONS,
        action_groups=np.arange(2, dtype=np.int16),
        action_group_names=ACTIONS,
        action_cells=np.full(2, NO_CELL, np.int32),
        noop_action=rules.REST,
        representations={"vector": vector},
        static_planes=(),
        exclusive_planes=(),
        event_planes=(),
        resources=("stamina",),
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        reward_bound=1.0,
        pays=REWARDS["sparse"],
    )


def draw(worlds, rules, world, player):
    """The rope as a white square on a bar, uint8 [20, 20 (2 end + 1), 3]."""
    side = 20
    image = np.zeros((side, side * (2 * rules.rope_end + 1), 3), np.uint8)
    left = side * (rules.rope_end - int(worlds.rope[world]))
    image[:, left : left + side] = 255
    return image


class Puller:
    """A bot that pulls whenever it can."""

    name = "puller"
    representation = "vector"

    def __init__(self, scenario, spec):
        """Keeps nothing."""

    def seed(self, seed):
        """Draws nothing."""

    def act(self, observation, action_mask):
        """Observations [N, 3], masks [N, 2] -> actions [N]."""
        return action_mask[:, rules.PULL].astype(np.int64)

    def state_dict(self):
        return {}

    def load_state_dict(self, state):
        """Nothing to load."""


GAME = Game(
    name="tug_of_war",
    title="Tug of war",
    version="1",
    summary="Pull the rope to your side before your stamina runs out.",
    player_range=(2, 2),
    scenarios=SCENARIOS,
    default_scenario="short",
    make_rules=rules.make_rules,
    make_spec=make_spec,
    allocate=allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=rules.legal_actions,
    draw=draw,
    bots={"puller": Puller},
    rewards=REWARDS,
    hidden_fields=("random",),
    gymnasium_prefix=GYMNASIUM_PREFIX,
)
