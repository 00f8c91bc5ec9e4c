"""Turns the keys and clicks of a person into the actions of a game."""
