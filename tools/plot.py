#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws the track of a motion and one coordinate against time, from a result file of tandem.

Usage: tools/plot.py RESULT.h5 PICTURE [--track X,Y] [--against-time Z]

PICTURE ends in .png, .svg or .pdf. X, Y and Z are names of coordinates; without them, the first three of the file.
Needs h5py and matplotlib: pip install -r config/requirements-plot.txt
"""

import argparse

import h5py
import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def read(path):
    """Times and {coordinate name: (series, unit)}."""
    with h5py.File(path) as file:
        trajectory = file["trajectory"]
        q = trajectory["q"]
        names = [text(name) for name in q.attrs["names"]]
        units = [text(unit) for unit in q.attrs["units"]]
        values = q[:]
        return trajectory["time"][:], {name: (values[:, j], units[j]) for j, name in enumerate(names)}


def label(name, unit):
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("result")
    parser.add_argument("picture")
    parser.add_argument("--track", metavar="X,Y")
    parser.add_argument("--against-time", metavar="Z")
    arguments = parser.parse_args()

    time, coordinates = read(arguments.result)
    names = list(coordinates)
    x, y = arguments.track.split(",") if arguments.track else names[:2]
    z = arguments.against_time or names[2]
    for name in (x, y, z):
        if name not in coordinates:
            parser.error(f"there is no coordinate {name}; there are {', '.join(names)}")

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", width_ratios=[1, 1.8])
    track_x, track_y = coordinates[x][0], coordinates[y][0]
    left.plot(track_x, track_y, linewidth=1)
    left.plot(track_x[0], track_y[0], "o", markersize=4, color="black")
    left.annotate("start", (track_x[0], track_y[0]), xytext=(5, 5), textcoords="offset points")
    width, height = np.ptp(track_x), np.ptp(track_y)
    if max(width, height) < 5 * min(width, height):
        left.set_aspect("equal")
    left.set(xlabel=label(x, coordinates[x][1]), ylabel=label(y, coordinates[y][1]), title="track")
    right.plot(time, coordinates[z][0], linewidth=1)
    right.set(xlabel="time [s]", ylabel=label(z, coordinates[z][1]), title=f"{z} against time", xlim=(time[0], time[-1]))
    for axes in (left, right):
        axes.grid(linewidth=0.4, alpha=0.5)
    figure.savefig(arguments.picture, dpi=110)


if __name__ == "__main__":
    main()
