"""Writes the report of a league: text, Markdown, HTML, CSV, figures and replays."""
