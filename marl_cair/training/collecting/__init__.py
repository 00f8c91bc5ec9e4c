"""Collects experience: seats of learner and opponents, demonstrations, rollouts."""
