"""Players of all games: random play, mixtures of agents, and the opponent of a learner."""
