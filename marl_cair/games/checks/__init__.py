"""Checks arguments, scenarios and saved states before compiled rules see them."""
