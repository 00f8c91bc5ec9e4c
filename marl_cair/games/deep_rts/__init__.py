"""Deep RTS: gather, build, train and fight on a board of tiles. One to eight players."""

from __future__ import annotations

from typing import TYPE_CHECKING

from marl_cair.games.deep_rts.scenarios import GYMNASIUM_PREFIX, SCENARIOS
from marl_cair.games.game_package import make_environments
from marl_cair.lookup import import_when_used

if TYPE_CHECKING:
    from marl_cair.games.game import Game

    GAME: Game

__all__ = ["GAME", "GYMNASIUM_PREFIX", "SCENARIOS", "env", "parallel_env"]

__getattr__ = import_when_used(__name__, {"GAME": f"{__name__}.definition:GAME"})
parallel_env, env = make_environments(__name__, "1v1-15x15")
