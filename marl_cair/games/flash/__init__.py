"""Flash games in a browser, frame by frame: multitask, duel, and SWF files of users."""

from __future__ import annotations

from typing import TYPE_CHECKING

from marl_cair.games.flash.scenarios import GYMNASIUM_PREFIX, SCENARIOS
from marl_cair.games.game_package import make_environments
from marl_cair.lookup import import_when_used

if TYPE_CHECKING:
    from marl_cair.games.game import Game

    GAME: Game

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]

__getattr__ = import_when_used(__name__, {"GAME": f"{__name__}.definition:GAME"})
parallel_env, env = make_environments(__name__, "multitask")
