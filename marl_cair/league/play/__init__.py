"""Plays games between agents: blocks on common map seeds, matches, schedules, workers."""
