"""One world of Deep Line Wars that a test sets up by hand and plays tick by tick."""

from __future__ import annotations

from typing import Any

from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.rulebook import Rules
from marl_cair.games.deep_line_wars.state import NO_TARGET, World


class Board:
    """One world; a step is one tick unless `ticks_per_step` says otherwise.

    Rows and columns are in the owner's own view. With the 2018 numbers shots hit at once.
    """

    def __init__(self, scenario: str = "10x15", seed: int = 0, **options: Any) -> None:
        chosen = {"preset": "2018", "ticks_per_step": 1} | options
        self.engine = make_engine("deep_line_wars", scenario, **chosen)
        self.engine.reset(seed)
        # Views: what is written here is what the engine plays on.
        self.world = World(*(field[0] for field in self.engine._worlds))
        self.rules: Rules = self.engine._rules
        self.noop = self.engine.spec.noop_action

    def action(self, name: str) -> int:
        return self.engine.spec.action_names.index(name)

    def play(self, first: str = "noop", second: str = "noop") -> None:
        """One decision by the names of both players' actions."""
        self.engine.step([[self.action(first), self.action(second)]])

    def wait(self, num_decisions: int) -> None:
        for _ in range(num_decisions):
            self.engine.step([[self.noop, self.noop]])

    def read(self, *fields: str) -> list[list[int]]:
        """Both players' values of fields of the world."""
        return [getattr(self.world, field).tolist() for field in fields]

    def is_legal(self, player: int, name: str) -> bool:
        return bool(self.engine.action_mask()[0, player, self.action(name)])

    def put_unit(
        self, player: int, kind: int, row: int, column: int, progress: int = 0, health: int = 0
    ) -> int:
        """Add a unit as if it had been bought now; its slot. Health 0: that of its kind."""
        world = self.world
        slot = int(world.first_unit[player] + world.num_units[player])
        world.num_units[player] += 1
        world.unit_kind[player, slot] = kind
        world.unit_health[player, slot] = health or self.rules.unit_health[kind]
        world.unit_row[player, slot] = row
        world.unit_column[player, slot] = column
        world.unit_progress[player, slot] = progress
        return slot

    def put_tower(self, player: int, kind: int, row: int, column: int) -> int:
        """Add a tower that is ready to fire; its slot."""
        world = self.world
        slot = int(world.num_towers[player])
        world.num_towers[player] += 1
        world.tower_kind[player, slot] = kind
        world.tower_row[player, slot] = row
        world.tower_column[player, slot] = column
        world.tower_ready[player, slot] = world.tick[0]
        world.tower_spare[player, slot] = 0
        world.shot_target[player, slot] = NO_TARGET
        world.tower_at[player, row, column - 1] = kind
        return slot

    def mirrored(self, column: int) -> int:
        """A column of one player's view in the other's."""
        return self.rules.columns - 1 - column
