"""Training: collect with opponents, replay with generated transitions, learn, snapshot, resume."""
