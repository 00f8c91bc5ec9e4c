"""Leagues of learners that train in seconds."""

from marl_cair.training.population.league_settings import build_league

NETWORK = {"policy": {"hidden_width": 8, "body": "mlp"}}
TRAINING = {
    **NETWORK,
    "torch_threads": 1,
    "synthetic_fraction": 0.0,
    "game": {
        "name": "last_standing",
        "scenario": "duel",
        "reward": "sparse",
        "representation": "vector",
    },
    "collector": {"num_worlds": 32, "steps_per_batch": 2},
    "replay": {"capacity_transitions": 1_000, "min_transitions": 64},
    "learner": {"batch_size": 16, "n_steps": 2},
    "generator": {"name": "none"},
    "evaluation": {"bots": []},
    "opponent": {"redraw_every_frames": 64},
    "checkpoint": {"every_frames": 128},
}


def make_league(out, **changes):
    values = {
        "out": str(out),
        "seed": 5,
        "total_frames": 768,
        "slice_frames": 384,
        "final_games": 0,
        "training": TRAINING,
        "main": {
            "learners": 2,
            "mixture": {"main_self_play": 0.4, "pfsp": 0.4, "forgotten": 0.2},
            "snapshot_every_frames": 192,
        },
        "main_exploiter": {"snapshot_every_frames": 320},
        "league_exploiter": {"snapshot_every_frames": 128, "reset_chance": 0.5},
    }
    return build_league({**values, **changes})
