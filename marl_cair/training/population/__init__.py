"""Trains populations of learners: leagues, PSRO and best responses (exploitability)."""
