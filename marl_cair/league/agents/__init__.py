"""Loads the agents that a league rates: checkpoints, mixtures, bots, foreign code."""
