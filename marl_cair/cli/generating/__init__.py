"""Commands of data sets and generators."""
