"""Opponents of a learner: the pool of frozen players, samplers and win rates."""
