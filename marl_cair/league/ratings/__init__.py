"""Rating mathematics: likelihood, bootstrap, payoffs, equilibria, diagnostics."""
