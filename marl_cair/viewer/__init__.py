"""Shows recorded games in a browser: one HTML file with everything in it."""
