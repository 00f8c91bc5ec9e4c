"""Commands about one trained agent: export and explain."""
