# SPDX-License-Identifier: MIT
"""Pictures of single runs: track and height, overview of a result file, and the paper's figures."""

import numpy as np
from tandem.plot import coordinates, overview
from tandem.result import read as read_result

from .style import BLUE, ORANGE, label, plt, save


def draw_track(axes, result, x, y):
    track_x, track_y = result[x], result[y]
    axes.plot(track_x, track_y, color=BLUE)
    axes.plot(track_x[0], track_y[0], "o", markersize=4, color="black", label="start")
    axes.legend(handletextpad=0)
    width, height = np.ptp(track_x), np.ptp(track_y)
    if max(width, height) < 5 * min(width, height):
        axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=label(x, result.unit(x)), ylabel=label(y, result.unit(y)), title="track")


def draw_against_time(axes, result, *names):
    coordinates(result, names, axes=axes)
    axes.set(xlabel="time [s]", title=f"{', '.join(names)} against time")


def draw_overview(path, picture, x, y, z):
    """Track, one coordinate, constraint errors, energy, steps and charts."""
    save(overview(read_result(path), [z]), picture)


def draw_two(path, picture, x, y, z):
    """Track and one coordinate."""
    result = read_result(path)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", width_ratios=[1, 1.8])
    draw_track(left, result, x, y)
    draw_against_time(right, result, z)
    save(figure, picture)


def draw_paper_2(paths, picture):
    """The vehicle's lane change: path of the front chassis and of the rear one."""
    result = read_result(paths[0])
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    left.plot(result["x1"], result["y1"], color=BLUE)
    left.set(xlabel="x of the front chassis [m]", ylabel="y of the front chassis [m]", title="lane change")
    right.plot(result.time, result["phi1"], color=BLUE, label="front chassis")
    right.plot(result.time, result["phi2"], "--", color=ORANGE, label="rear chassis")
    right.set(xlabel="time [s]", ylabel="heading [rad]", title="the rear chassis follows", xlim=(0, result.time[-1]))
    right.legend()
    save(figure, picture)


def draw_paper_4(paths, picture):
    """The disk's track and height."""
    result = read_result(paths[0])
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", width_ratios=[1, 1.8])
    draw_track(left, result, "ry", "rx")
    left.set(xlabel="y of the centre [m]", ylabel="x of the centre [m]")
    draw_against_time(right, result, "rz")
    right.set(ylabel="height of the centre [m]", title="height against time")
    save(figure, picture)


def draw_paper_6(paths, picture):
    """The lane changes of the two motorcycles."""
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained", sharey=True)
    for axes, path, name in zip(panels, paths, ("standard fork, 0.2 rad", "chopper fork, pi/4"), strict=True):
        result = read_result(path)
        axes.plot(result["ry"], result["rx"], color=BLUE)
        axes.set(xlabel="y of the centre [m]", title=f"{name}: changes lanes by {abs(result['rx'][-1]):.2f} m")
    panels[0].set_ylabel("x of the centre [m]")
    save(figure, picture)


PAPER = {"2": (draw_paper_2, 1), "4": (draw_paper_4, 1), "6": (draw_paper_6, 2)}
