"""Recipes: settings that are known to work on a scenario, as words of `marl-cair train`."""

from __future__ import annotations

from typing import NamedTuple


class Recipe(NamedTuple):
    """Words of the command line, and what they are for. Words that a user gives go before them."""

    about: str
    words: tuple[str, ...]


# The way to a goal may be longer than any stack of kernels reaches, so the networks measure
# distances; plane 0 is walls.
_MAZE = (
    "game=deep_maze",
    "policy.distances=true",
    "policy.obstacle_planes=[0]",
    "exploration.anneal_frames=15000",
    "learner.learning_rate=1e-3",
    "learner.n_steps=3",
    "learner.frames_per_update=32",
    "learner.double=false",
    "collector.num_worlds=64",
    "replay.min_transitions=2000",
    "generator.evaluate_every_frames=10000",
    "evaluation.bots=[oracle]",
    "checkpoint.every_frames=1000000",
)

# A move too many costs a fiftieth, which is lost in what a new network says by chance: the oracle
# shows every second game, and rewards are scaled. With `classic` one way in 250 stayed a circle.
# What `distance` pays only a generator can know that measures distances itself.
_LARGE_MAZE = (
    "learner.learning_rate_end=0",
    "game.reward=distance",
    "generator.model.size.distances=true",
    "generator.model.size.obstacle_planes=[0]",
    "learner.gamma=0.99",
    "learner.reward_scale=5",
    "learner.batch_size=32",
    "demonstration.bots=[oracle]",
    "demonstration.share=0.5",
    "demonstration.margin=0.2",
    "evaluation.every_frames=20480",
    "evaluation.games=16",
)

# The oracle takes turns, and so shows what to do wherever the learner has come to. How much is
# learned goes by the number of updates, not by that of decisions.
_FLAPPY = (
    "learner.double=false",
    "demonstration.bots=[oracle]",
    "demonstration.share=0.5",
    "learner.frames_per_update=8",
    "exploration.epsilon_start=0.1",
    "exploration.epsilon_end=0.002",
    "collector.num_worlds=64",
    "evaluation.bots=[reflex]",
    "checkpoint.every_frames=1000000",
)

_DEEP_RTS_TEACHER = "marl_cair.games.deep_rts.teacher:make_teacher"

_LINE_WARS_EVALUATION = (
    "evaluation.every_frames=100000",
    "evaluation.games=40",
    "evaluation.bots=[random,rusher,turtle,economist,zigzag,counter]",
)

RECIPES = {
    "deep_line_wars_self_play": Recipe(
        "Deep Line Wars: a pool of past selves, and the bots that are not beaten yet",
        (
            "game=deep_line_wars",
            "scenario=10x15",
            "total_frames=1000000",
            "opponent.mixture={latest: 0.35, pfsp: 0.25, uniform: 0.05, pfsp_bots: 0.35}",
            "opponent.warmup_frames=30000",
            "generator.refill_every_frames=8000",
            *_LINE_WARS_EVALUATION,
        ),
    ),
    # At the defaults, which explore much and learn fast, an agent forgets within 50,000 decisions
    # what it knows.
    "deep_line_wars_further": Recipe(
        "Deep Line Wars: on from an agent, at a low rate (with initial_agent=...)",
        (
            "game=deep_line_wars",
            "scenario=10x15",
            "total_frames=1300000",
            "opponent.mixture={latest: 0.45, pfsp: 0.35, uniform: 0.05, pfsp_bots: 0.15}",
            "opponent.warmup_frames=0",
            "exploration.epsilon_start=0.05",
            "exploration.epsilon_end=0.01",
            "replay.min_transitions=25000",
            "learner.learning_rate=1.5e-4",
            "learner.learning_rate_end=0",
            "generator.refill_every_frames=8000",
            *_LINE_WARS_EVALUATION,
        ),
    ),
    # A game lasts up to 1,000 decisions: at a discount of 0.99 its end is worth nothing at first,
    # and the shaping cancels out of every choice once learned: nothing is left to choose by.
    "deep_rts_duel": Recipe(
        "Deep RTS, two players: beats random within minutes and keeps to it",
        (
            "game=deep_rts",
            "scenario=1v1-15x15",
            "learner.gamma=0.997",
            "learner.n_steps=16",
            "demonstration.bots=[mixed,rusher]",
            "opponent.mixture={random: 0.4, bots: 0.4, latest: 0.2}",
            "evaluation.every_frames=25000",
            "evaluation.bots=[random,mixed]",
        ),
    ),
    # What another does is learned in far fewer decisions than finding it out takes. The advice
    # stays to the end: without it all was lost again within 50,000 decisions.
    "deep_rts_self_play": Recipe(
        "Deep RTS, two players: a teacher's advice, the bots that are not beaten yet, and itself",
        (
            "game=deep_rts",
            "scenario=1v1-15x15",
            "total_frames=1000000",
            "policy.cell_values=true",
            "learner.gamma=0.997",
            "learner.n_steps=16",
            "learner.learning_rate_end=0",
            f"demonstration.agents={{teacher: {_DEEP_RTS_TEACHER}}}",
            "demonstration.share=0.2",
            "demonstration.turn_decisions=50",
            "demonstration.advise=true",
            "opponent.mixture={pfsp_bots: 0.7, latest: 0.3}",
            "evaluation.every_frames=50000",
            "evaluation.games=32",
            "evaluation.bots=[random,mixed,rusher,economist,archers,boomer,turtle]",
        ),
    ),
    "deep_rts_economy": Recipe(
        "Deep RTS, one player: the highest score in 600 seconds",
        (
            "game=deep_rts",
            "scenario=Economy-15x15",
            "demonstration.bots=[economist]",
            "evaluation.every_frames=25000",
            "evaluation.games=16",
            "evaluation.bots=[random,economist]",
        ),
    ),
    "deep_maze_9x9": Recipe(
        "Deep Maze 9x9, a new maze in each game: the shortest way",
        (
            *_MAZE,
            "scenario=9x9-stochastic",
            "total_frames=80000",
            "learner.gamma=0.96",
            "learner.batch_size=64",
            "evaluation.every_frames=20480",
            "evaluation.games=200",
        ),
    ),
    "deep_maze_25x25_fixed": Recipe(
        "Deep Maze 25x25, one maze, any start and goal: the shortest way",
        (
            *_MAZE,
            "scenario=25x25-deterministic",
            "total_frames=150000",
            *_LARGE_MAZE,
        ),
    ),
    "deep_maze_25x25": Recipe(
        "Deep Maze 25x25, a new maze in each game: the shortest way",
        (
            *_MAZE,
            "scenario=25x25-stochastic",
            "total_frames=100000",
            *_LARGE_MAZE,
        ),
    ),
    "flappy_bird_features": Recipe(
        "Flappy Bird from numbers: flies on for a thousand pipes",
        (
            "game=flappy_bird",
            "representation=features",
            "policy.body=mlp",
            "game.reward=alive",
            *_FLAPPY,
            "max_ticks=4000",
            # In shorter games most pass all pipes, which tells no good agents apart.
            "evaluation.options.max_ticks=40000",
            "total_frames=400000",
            # At a constant rate good agents come and go again.
            "learner.learning_rate_end=5e-5",
            # A crash is the end of some seconds' flight: what is later need not be foreseen.
            "learner.gamma=0.97",
            "exploration.anneal_frames=100000",
            "evaluation.every_frames=25000",
            # A greedy bird dies by a single wrong choice: its weights are averaged for longer.
            "learner.average_decay=0.9995",
            "demonstration.turn_decisions=50",
            # To begin with alone: a margin is wrong between two actions that are as good.
            "demonstration.until_frames=10000",
            "demonstration.margin=0",
            "generator.evaluate_every_frames=10000",
            "learner.batch_size=256",
            "replay.capacity_transitions=500000",
            "evaluation.games=32",
        ),
    ),
    "flappy_bird_gray": Recipe(
        "Flappy Bird from four grey frames, fifteen decisions a second: a hundred pipes",
        (
            "game=flappy_bird",
            "representation=gray_stack",
            "game.reward=alive",
            *_FLAPPY,
            "max_ticks=1000",
            "total_frames=150000",
            "evaluation.options.max_ticks=6000",
            # What one of thirty decisions a second is worth is lost in what frames leave unsure; at
            # ten a second hardly a way leads from a high gap to a low one.
            "game.options.ticks_per_step=2",
            "learner.gamma=0.946",
            "exploration.anneal_frames=75000",
            "evaluation.every_frames=25000",
            "policy.frame_differences=true",
            # Most is learned from what follows where the learner has led: short turns, and what the
            # oracle would do in the learner's own.
            "demonstration.turn_decisions=18",
            "demonstration.advise=true",
            "demonstration.margin=0.2",
            "demonstration.margin_weight=3",
            "learner.n_steps=3",
            "learner.batch_size=64",
            "learner.learning_rate=1e-3",
            "learner.learning_rate_end=0",
            # Of an end in two hundred rows each network must see many to know a crash by its look.
            "generator.model.num_members=2",
            "generator.model.rare_share=0.5",
            "generator.batch_size=32",
            "generator.frames_per_update=96",
            "generator.evaluate_every_frames=20000",
            "generator.rows_per_refill=500",
            "generator.model.heldout_capacity=1024",
            "generator.model.rare_capacity=1024",
            "replay.capacity_transitions=50000",
            "evaluation.games=32",
        ),
    ),
}
