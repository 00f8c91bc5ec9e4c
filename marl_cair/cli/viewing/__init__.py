"""Commands that show games: replays, films."""
