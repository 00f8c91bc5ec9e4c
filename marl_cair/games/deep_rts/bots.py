"""Scripted opponents of Deep RTS. They see what an agent sees: planes and action mask."""

BOTS = {}
