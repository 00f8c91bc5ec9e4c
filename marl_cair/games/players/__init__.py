"""Players that games share: the random one, scripted ones, mixtures."""
