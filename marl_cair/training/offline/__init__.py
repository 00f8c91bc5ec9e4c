"""Training on data sets, without an environment."""
