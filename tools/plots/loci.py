# SPDX-License-Identifier: MIT
"""Root loci: real and imaginary parts of eigenvalues over a value, and the eigenvalues in their plane."""

import csv

import numpy as np

from .style import BLUE, GREY, ORANGE, plt, save


def read(path):
    """value, re, im and cause of each line."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    numbers = [np.array([float(row[name]) for row in rows]) for name in ("value", "re", "im")]
    return *numbers, np.array([row["cause"] for row in rows])


def draw(path, picture):
    value, re, im, cause = read(path)
    motion = cause == "motion"
    figure, (parts, plane) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    real = motion & (im == 0)
    parts.plot(value[real], re[real], ".", color=BLUE, markersize=3, label="real eigenvalues")
    parts.plot(value[motion & (im > 0)], re[motion & (im > 0)], ".", color=ORANGE, markersize=3, label="real parts of pairs")
    parts.plot(value[motion & (im > 0)], im[motion & (im > 0)], "+", color=GREY, markersize=3, label="imaginary parts")
    parts.axhline(0, color="black", linewidth=0.6)
    parts.set_xlabel("value")
    parts.set_ylabel("eigenvalue [1/s]")
    parts.legend()
    points = plane.scatter(re[motion], im[motion], c=value[motion], s=5, cmap="viridis")
    plane.axvline(0, color="black", linewidth=0.6)
    plane.set_xlabel("real part [1/s]")
    plane.set_ylabel("imaginary part [1/s]")
    figure.colorbar(points, ax=plane, label="value")
    save(figure, picture)
