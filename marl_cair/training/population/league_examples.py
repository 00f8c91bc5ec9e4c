"""Leagues to begin with, by name: `--example` of `marl-cair league train` and of `marl-cair league
psro` writes them as YAML.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# The bots are what the league is rated against and what nobody in it plays by itself, so a main
# agent meets those often that it does not beat yet. Two cores have time for one kind of exploiter
# in an evening, and for a generator that learns half as often as usual.
_DEEP_LINE_WARS: dict[str, Any] = {
    "out": "runs/league_deep_line_wars",
    "total_frames": 500_000,
    "slice_frames": 50_000,
    "final_bots": ["random", "rusher", "turtle", "economist", "zigzag", "counter"],
    "main": {
        "mixture": {
            "main_self_play": 0.2,
            "pfsp": 0.3,
            "forgotten": 0.1,
            "bots": 0.1,
            "pfsp_bots": 0.3,
        },
        "snapshot_every_frames": 50_000,
    },
    "league_exploiter": {"learners": 0},
    "training": {
        "game": {"name": "deep_line_wars", "scenario": "10x15"},
        "learner": {"learning_rate_end": 0.0},
        "generator": {"frames_per_update": 128, "refill_every_frames": 8_000},
        "evaluation": {"every_frames": 50_000, "bots": ["random", "counter", "economist"]},
    },
}

# As the recipe deep_rts_duel: games are long, and bots show how they are won at all. A main agent
# meets bots more often than elsewhere, without whom it learns little to begin with.
_DEEP_RTS: dict[str, Any] = {
    "out": "runs/league_deep_rts",
    "total_frames": 600_000,
    "slice_frames": 50_000,
    "final_bots": ["random", "mixed", "rusher"],
    "main": {
        "mixture": {
            "main_self_play": 0.25,
            "pfsp": 0.35,
            "forgotten": 0.1,
            "bots": 0.2,
            "random": 0.1,
        }
    },
    "training": {
        "game": {"name": "deep_rts", "scenario": "1v1-15x15"},
        "learner": {"gamma": 0.997, "n_steps": 16},
        "demonstration": {"bots": ["mixed", "rusher"]},
        "evaluation": {"every_frames": 50_000, "bots": ["random", "mixed"]},
    },
}

# Ends within a minute, so that the whole way can be seen; it learns nothing.
_TINY: dict[str, Any] = {
    "out": "runs/league_tiny",
    "total_frames": 1_024,
    "slice_frames": 512,
    "final_games": 2,
    "main": {"snapshot_every_frames": 256},
    "main_exploiter": {"snapshot_every_frames": 512},
    "league_exploiter": {"snapshot_every_frames": 256},
    "training": {
        "torch_threads": 1,
        "synthetic_fraction": 0.0,
        "game": {"scenario": "11x11", "options": {"max_ticks": 60}},
        "policy": {"hidden_width": 16},
        "collector": {"num_worlds": 16, "steps_per_batch": 8},
        "replay": {
            "capacity_transitions": 3_000,
            "generated_capacity_transitions": 300,
            "min_transitions": 200,
        },
        "learner": {"batch_size": 16},
        "generator": {"name": "none"},
        "evaluation": {"bots": []},
    },
}

# Rates fall to 0 in each round: what is frozen at a constant rate is one of a wide scatter. To
# generate rows takes as long as to learn from them: half as many, each learned from twice as often.
_PSRO_DEEP_LINE_WARS: dict[str, Any] = {
    "out": "runs/psro_deep_line_wars",
    "bots": ["random", "rusher", "turtle", "economist", "zigzag", "counter"],
    "training": {
        "game": {"name": "deep_line_wars", "scenario": "10x15"},
        "learner": {"learning_rate_end": 0.0},
        "generator": {"refill_every_frames": 8_000},
        "evaluation": {"every_frames": 100_000, "bots": ["random", "counter", "economist"]},
    },
}

_PSRO_DEEP_RTS: dict[str, Any] = {
    "out": "runs/psro_deep_rts",
    "bots": _DEEP_RTS["final_bots"],
    "training": {
        **_DEEP_RTS["training"],
        "learner": {**_DEEP_RTS["training"]["learner"], "learning_rate_end": 0.0},
        "evaluation": {"every_frames": 100_000, "bots": ["random", "mixed"]},
    },
}

_PSRO_TINY: dict[str, Any] = {
    "out": "runs/psro_tiny",
    "rounds": 2,
    "round_frames": 512,
    "first_round_frames": 512,
    "games_per_pair": 2,
    "training": _TINY["training"],
}

EXAMPLES: Mapping[str, dict[str, Any]] = {
    "deep_line_wars": _DEEP_LINE_WARS,
    "deep_rts": _DEEP_RTS,
    "tiny": _TINY,
}

PSRO_EXAMPLES: Mapping[str, dict[str, Any]] = {
    "deep_line_wars": _PSRO_DEEP_LINE_WARS,
    "deep_rts": _PSRO_DEEP_RTS,
    "tiny": _PSRO_TINY,
}
