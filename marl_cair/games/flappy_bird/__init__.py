"""Flappy Bird: flap through the gaps between pipes. One player, or a race of two to eight."""

from __future__ import annotations

from marl_cair.games.flappy_bird.scenarios import GYMNASIUM_PREFIX, SCENARIOS
from marl_cair.games.game import Game
from marl_cair.games.game_package import make_environments
from marl_cair.lookup import import_when_used

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]

GAME: Game
__getattr__ = import_when_used(__name__, {"GAME": f"{__name__}.definition:GAME"})
parallel_env, env = make_environments(__name__, "classic")
