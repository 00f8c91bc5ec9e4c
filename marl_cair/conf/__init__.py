"""Hydra configuration of `marl-cair train`: groups and recipes as YAML files to copy."""
