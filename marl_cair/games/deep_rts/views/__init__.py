"""Observations of Deep RTS."""
