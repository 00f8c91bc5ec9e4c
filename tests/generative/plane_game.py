"""A small game on planes, batched in NumPy, similar to Deep Line Wars, and rows of its transitions.

Enemy units appear on random rows of the right column and walk left, a cell a step; towers that the
player builds wound those beside them; a unit that reaches the left column costs health. Own units
walk right. Gold comes at intervals; towers and units cost gold.
"""

import numpy as np
import torch
from tensordict import TensorDict

from marl_cair.generative.settings import GeneratorSpec
from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT

ROWS, COLUMNS, BUILD_COLUMNS = 5, 7, 3
TOWER, OWN_UNITS, ENEMY_UNITS, TERRAIN = range(4)
HEALTH, ENEMY_HEALTH, GOLD, TIME_TO_INCOME = range(4)
NUM_SPATIAL, NUM_UNIFORM = 4, 4
NOOP, BUY_UNIT, FIRST_TOWER = range(3)
NUM_ACTIONS = FIRST_TOWER + ROWS * BUILD_COLUMNS
START_HEALTH, START_GOLD, INTERVAL, INCOME = 5, 30, 6, 25
UNIT_COST, TOWER_COST = 10, 20
FULL_UNIT, DAMAGE = 64, 24
SPAWN_ODDS = 0.6
SHAPING = 0.05

SPEC = GeneratorSpec(
    observation_shape=(NUM_SPATIAL + NUM_UNIFORM, ROWS, COLUMNS),
    num_actions=NUM_ACTIONS,
    num_uniform=NUM_UNIFORM,
    noop_action=NOOP,
    action_kinds=(0, 1, *(2,) * (ROWS * BUILD_COLUMNS)),
    action_cells=(
        -1,
        -1,
        *(r * COLUMNS + 1 + c for r in range(ROWS) for c in range(BUILD_COLUMNS)),
    ),
    static_planes=(TERRAIN,),
    exclusive_plane_groups=((TOWER, TERRAIN),),
)


def pack_rows(now, action, later, reward, ended, masks=None) -> TensorDict:
    """One-step transitions, numbered from 0.

    now, later: observations [N, ...]; action: int64 [N]; reward: float32 [N]; ended: bool [N];
    masks: of legal actions now and later, bool [N, A] both; None: there are two, always legal.
    """
    num = len(action)
    every, no = torch.ones(num, 2, dtype=torch.bool), torch.zeros(num, 1, dtype=torch.bool)
    mask, next_mask = masks or (every, every)
    following = {
        "observation": later,
        "action_mask": next_mask,
        "reward": reward[:, None],
        "terminated": ended[:, None],
        "done": ended[:, None].clone(),
    }
    return TensorDict(
        {
            "observation": now,
            "action_mask": mask,
            "action": action,
            "next": TensorDict(following, [num]),
            "steps_to_next_obs": torch.ones(num, 1, dtype=torch.int64),
            "is_generated": no,
            "expert_action": torch.full((num,), NO_ACTION, dtype=torch.int64),
            "opponent": torch.full((num,), NO_OPPONENT, dtype=torch.int16),
            "index": torch.arange(num),
        },
        [num],
    )


class PlaneGame:
    """`num_worlds` games."""

    def __init__(self, num_worlds: int, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.num_worlds = num_worlds
        shape = (num_worlds, ROWS, COLUMNS)
        self.tower = np.zeros(shape, bool)
        self.units = np.zeros((num_worlds, 2, ROWS, COLUMNS), np.int64)
        self.health = np.zeros((num_worlds, 2), np.int64)
        self.gold = np.zeros(num_worlds, np.int64)
        self.clock = np.zeros(num_worlds, np.int64)
        self.terrain = np.zeros(shape, np.uint8)
        self.reset(np.ones(num_worlds, bool))

    def reset(self, mask):
        self.tower[mask] = False
        self.units[mask] = 0
        self.health[mask] = START_HEALTH
        self.gold[mask] = START_GOLD
        self.clock[mask] = INTERVAL
        rocks = self.random.integers(0, ROWS, int(mask.sum()))
        self.terrain[mask] = 0
        self.terrain[np.flatnonzero(mask), rocks, 0] = 200

    def observe(self):
        planes = np.zeros((self.num_worlds, *SPEC.observation_shape), np.uint8)
        planes[:, TOWER] = self.tower * 255
        planes[:, OWN_UNITS] = self.units[:, 0].clip(0, 255)
        planes[:, ENEMY_UNITS] = self.units[:, 1].clip(0, 255)
        planes[:, TERRAIN] = self.terrain
        scalars = np.stack(
            [
                self.health[:, 0].clip(0) * 51,
                self.health[:, 1].clip(0) * 51,
                self.gold.clip(0, 255),
                self.clock * 255 // INTERVAL,
            ],
            1,
        )
        planes[:, NUM_SPATIAL:] = scalars[:, :, None, None]
        return planes

    def action_mask(self):
        mask = np.zeros((self.num_worlds, NUM_ACTIONS), bool)
        mask[:, NOOP] = True
        mask[:, BUY_UNIT] = self.gold >= UNIT_COST
        free = ~self.tower[:, :, 1 : 1 + BUILD_COLUMNS].reshape(self.num_worlds, -1)
        mask[:, FIRST_TOWER:] = free & (self.gold >= TOWER_COST)[:, None]
        return mask

    def step(self, actions):
        """Rewards float32 [B] and ends bool [B]."""
        worlds = np.arange(self.num_worlds)
        before = self.health[:, 0] - self.health[:, 1]
        self.units[:, 0, :, 1:] = self.units[:, 0, :, :-1].copy()
        self.units[:, 0, :, 0] = 0
        self.units[:, 1, :, :-1] = self.units[:, 1, :, 1:].copy()
        self.units[:, 1, :, -1] = 0
        buys = worlds[actions == BUY_UNIT]
        self.gold[buys] -= UNIT_COST
        self.units[buys, 0, self.random.integers(0, ROWS, buys.size), 0] = FULL_UNIT
        builds = worlds[actions >= FIRST_TOWER]
        place = actions[builds] - FIRST_TOWER
        self.gold[builds] -= TOWER_COST
        self.tower[builds, place // BUILD_COLUMNS, 1 + place % BUILD_COLUMNS] = True
        spawns = worlds[self.random.random(self.num_worlds) < SPAWN_ODDS]
        self.units[spawns, 1, self.random.integers(0, ROWS, spawns.size), -1] = FULL_UNIT
        self._shoot()
        self.health[:, 0] -= (self.units[:, 1, :, 0] > 0).sum(-1)
        self.units[:, 1, :, 0] = 0
        self.health[:, 1] -= (self.units[:, 0, :, -1] > 0).sum(-1)
        self.units[:, 0, :, -1] = 0
        self.clock -= 1
        paid = self.clock == 0
        self.gold[paid] += INCOME
        self.clock[paid] = INTERVAL
        return self._reward(before)

    def _shoot(self):
        beside = np.zeros_like(self.units[:, 1])
        beside[:, 1:] += self.tower[:, :-1]
        beside[:, :-1] += self.tower[:, 1:]
        beside[:, :, 1:] += self.tower[:, :, :-1]
        beside[:, :, :-1] += self.tower[:, :, 1:]
        self.units[:, 1] = (self.units[:, 1] - DAMAGE * beside).clip(0)

    def _reward(self, before):
        lost, won = self.health[:, 0] <= 0, self.health[:, 1] <= 0
        change = self.health[:, 0] - self.health[:, 1] - before
        terminated = lost | won
        rewards = np.where(terminated, won.astype(float) - lost, SHAPING * change)
        return rewards.astype(np.float32), terminated


def play_randomly(num_worlds: int, num_steps: int, seed: int) -> TensorDict:
    """Transitions [num_worlds * num_steps] of random legal play; index counts them from 0."""
    game = PlaneGame(num_worlds, seed)
    steps = []
    for _ in range(num_steps):
        observation, mask = game.observe(), game.action_mask()
        # No-op and unit as often as all the towers together: else gold is always spent at once.
        odds = mask * np.r_[8.0, 8.0, np.ones(NUM_ACTIONS - 2)]
        levels = game.random.random((num_worlds, 1)) * odds.sum(1, keepdims=True)
        actions = (odds.cumsum(1) <= levels).sum(1)
        rewards, terminated = game.step(actions)
        steps.append(
            pack_rows(
                torch.from_numpy(observation),
                torch.from_numpy(actions),
                torch.from_numpy(game.observe()),
                torch.from_numpy(rewards),
                torch.from_numpy(terminated),
                (torch.from_numpy(mask), torch.from_numpy(game.action_mask())),
            )
        )
        game.reset(terminated)
    rows = torch.cat(steps)
    rows["index"] = torch.arange(rows.shape[0])
    return rows
