"""The window in which a person plays and watches games, drawn with pygame-ce (extra `play`)."""
