"""The generator of a training run: made, trained, evaluated, used, and drawn."""
