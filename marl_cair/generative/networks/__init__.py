"""Networks of the CCDN generator and their distributions."""
