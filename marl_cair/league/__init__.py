"""The league: agents play seat-balanced matches with common seeds and are rated."""
