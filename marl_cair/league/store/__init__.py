"""Stores the games of a league in one SQLite file, checks the file and exports it."""
