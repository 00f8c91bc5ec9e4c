"""The rules of Deep RTS, one file for each phase; `step` runs them in order."""
