"""Reads the logs of runs (several seeds of one setting) and plots their mean and range."""

import argparse
import csv
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def read_column(folder, name):
    """Steps and values of one column of `log.csv`, where it has a value."""
    with (Path(folder) / "log.csv").open(encoding="utf-8") as file:
        lines = (line for line in file if not line.startswith("#"))
        rows = [row for row in csv.DictReader(lines) if row.get(name)]
    return np.array([[float(row["frames"]), float(row[name])] for row in rows]).reshape(-1, 2).T


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", help="folders of runs, one for each seed")
    parser.add_argument("--column", default="win_rate/random")
    parser.add_argument("--out", default="runs/example.png")
    options = parser.parse_args()
    curves = [read_column(run, options.column) for run in options.runs]
    curves = [curve for curve in curves if curve.shape[1]]
    if not curves:
        parser.error(f"no run has values of {options.column}")
    steps = np.unique(np.concatenate([curve[0] for curve in curves]))
    steps = steps[steps <= min(curve[0].max() for curve in curves)]
    values = np.array([np.interp(steps, *curve) for curve in curves])
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    axes.plot(steps, values.mean(0), marker=".", label=f"mean of {len(curves)}")
    axes.fill_between(steps, values.min(0), values.max(0), alpha=0.25, label="range")
    axes.set(xlabel="environment steps", ylabel=options.column)
    axes.legend(frameon=False)
    figure.savefig(options.out, dpi=150)
    print(f"{options.out}: {options.column} {values[:, -1].mean():.3f} after {steps[-1]:.0f} steps")


if __name__ == "__main__":
    main()
