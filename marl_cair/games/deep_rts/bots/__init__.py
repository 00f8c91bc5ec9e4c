"""Scripted players of Deep RTS."""
