"""Settings of a training run: dataclasses, recipes and `config.yaml`."""
