"""Runs plans of training runs, side by side and resumable, and writes one table and one figure."""
