"""Examples of leagues and of PSRO by name, as `--example` of their commands writes them."""

from __future__ import annotations

from typing import Any

# The league is rated against the bots, and no learner plays like them: main agents play those bots
# often that they do not beat yet. In an evening two cores have time for one kind of exploiter, and
# for a generator that learns half as often as usual.
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

# As the recipe deep_rts_duel: games are long, and bots demonstrate how to win. A main agent plays
# bots more often than elsewhere, as it learns little without them at first.
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

# Ends within a minute, to try the commands; it learns nothing.
_TINY: dict[str, Any] = {
    "out": "runs/league_tiny",
    "total_frames": 1_024,
    "slice_frames": 512,
    "final_games": 2,
    "main": {"snapshot_every_frames": 256},
    "main_exploiter": {"snapshot_every_frames": 512},
    "league_exploiter": {"snapshot_every_frames": 256},
    "training": {
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

EXAMPLES = {"deep_line_wars": _DEEP_LINE_WARS, "deep_rts": _DEEP_RTS, "tiny": _TINY}

# Learning rates fall to 0 in each round: agents frozen at a constant rate scatter widely. A row
# takes as long to generate as to learn from: half as many, each used twice as often.
PSRO_EXAMPLES: dict[str, dict[str, Any]] = {
    "deep_line_wars": {
        "out": "runs/psro_deep_line_wars",
        "bots": _DEEP_LINE_WARS["final_bots"],
        "training": {
            "game": _DEEP_LINE_WARS["training"]["game"],
            "learner": {"learning_rate_end": 0.0},
            "generator": {"refill_every_frames": 8_000},
            "evaluation": {"every_frames": 100_000, "bots": ["random", "counter", "economist"]},
        },
    },
    "deep_rts": {
        "out": "runs/psro_deep_rts",
        "bots": _DEEP_RTS["final_bots"],
        "training": {
            **_DEEP_RTS["training"],
            "learner": {**_DEEP_RTS["training"]["learner"], "learning_rate_end": 0.0},
            "evaluation": {"every_frames": 100_000, "bots": ["random", "mixed"]},
        },
    },
    "tiny": {
        "out": "runs/psro_tiny",
        "rounds": 2,
        "round_frames": 512,
        "first_round_frames": 512,
        "games_per_pair": 2,
        "training": _TINY["training"],
    },
}
