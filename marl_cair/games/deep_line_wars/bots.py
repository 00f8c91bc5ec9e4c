"""Scripted opponents of Deep Line Wars. They see what an agent sees: planes and action mask."""

BOTS = {}
