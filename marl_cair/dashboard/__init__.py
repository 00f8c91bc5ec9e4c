"""Shows training runs on a local page while they train, and exports the page as one HTML file."""
