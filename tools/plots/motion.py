# SPDX-License-Identifier: MIT
"""Pictures of single runs: track and height, all that a result file tells, and the paper's figures."""

import numpy as np

from .files import read_result
from .style import BLUE, GREEN, GREY, ORANGE, RED, label, plt, save


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
    for name, colour in zip(names, (BLUE, ORANGE, GREEN), strict=False):
        axes.plot(result.time, result[name], color=colour, label=name)
    axes.set(xlabel="time [s]", ylabel=label(", ".join(names), result.unit(names[0])), title=f"{', '.join(names)} against time",
             xlim=(result.time[0], result.time[-1]))
    if len(names) > 1:
        axes.legend()


def draw_overview(path, picture, x, y, z):
    """Track, one coordinate, constraint errors, energy, steps and charts."""
    result = read_result(path)
    figure, axes = plt.subplots(2, 3, figsize=(11, 5.6), layout="constrained")
    span = (result.time[0], result.time[-1])
    draw_track(axes[0, 0], result, x, y)
    draw_against_time(axes[0, 1], result, z)
    draw_errors(axes[0, 2], result, span)
    draw_energy(axes[1, 0], result, span)
    draw_steps(axes[1, 1], result, span)
    draw_charts(axes[1, 2], result, span)
    solver, scene = result.scene.get("solver", {}), result.scene.get("scene", {})
    control = f"rtol {solver['rtol']:g}" if solver.get("rtol") else f"h = {1e3 * solver.get('step', 0):g} ms"
    figure.suptitle(f"{scene.get('name', path)}: {solver.get('stepper', '')}, {control}, chart {solver.get('chart', '')}",
                    fontsize=10)
    save(figure, picture)


def missing(axes, what):
    axes.text(0.5, 0.5, f"{what}\nnot in the file", transform=axes.transAxes, ha="center", va="center", color=GREY)
    axes.set_axis_off()


def draw_errors(axes, result, span):
    drawn = False
    for name, colour in ("position", BLUE), ("velocity", ORANGE), ("acceleration", GREEN):
        if f"{name}_error" in result.diagnostics:
            values = result.diagnostics[f"{name}_error"][0]
            axes.semilogy(result.time, np.maximum(values, 1e-18), color=colour, label=name, linewidth=0.8)
            drawn = True
    if not drawn:
        return missing(axes, "constraint errors")
    tolerance = result.scene.get("solver", {}).get("constraint_tolerance")
    if tolerance:
        axes.axhline(tolerance, color=RED, linewidth=1, linestyle="--")
        axes.text(span[1], tolerance, "tolerance", color=RED, ha="right", va="bottom", fontsize=8)
    axes.set(xlabel="time [s]", ylabel="part of the natural scale [1]", title="constraint errors", xlim=span)
    low, _ = axes.get_ylim()
    axes.set_ylim(max(low, 1e-18), (tolerance or 1e-12) * 30)
    axes.legend(loc="upper center", ncols=3, fontsize=8, columnspacing=1, handlelength=1.2)


def draw_energy(axes, result, span):
    energy = sum(result.diagnostics[name][0] for name in ("kinetic_energy", "potential_energy") if name in result.diagnostics)
    if isinstance(energy, int):
        return missing(axes, "energies")
    axes.plot(result.time, (energy - energy[0]) / energy[0], color=BLUE, linewidth=0.9)
    axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
    axes.set(xlabel="time [s]", ylabel="(E - E(0)) / E(0) [1]", title=f"change of the energy, {energy[0]:.6g} J at the start", xlim=span)


def draw_steps(axes, result, span):
    if "step" not in result.diagnostics:
        return missing(axes, "steps")
    step = result.diagnostics["step"][0][1:]
    axes.semilogy(result.time[1:], step, ".", markersize=2.5, color=BLUE)
    if step.max() < 3 * step.min():
        axes.set_ylim(step.min() / 3, step.max() * 3)
    report = result.report
    axes.set(xlabel="time [s]", ylabel="step [s]", xlim=span,
             title=f"{report['steps']} steps, {report['rejected']} rejected")


def draw_charts(axes, result, span):
    if "chart" not in result.diagnostics:
        return missing(axes, "charts")
    axes.step(result.time, result.diagnostics["chart"][0], where="post", color=BLUE)
    axes.set(xlabel="time [s]", ylabel="number of the chart", title=f"{result.report['charts']} charts", xlim=span)


def draw_two(path, picture, x, y, z):
    """Track and one coordinate."""
    result = read_result(path)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", width_ratios=[1, 1.8])
    draw_track(left, result, x, y)
    draw_against_time(right, result, z)
    save(figure, picture)


def draw_paper_2(paths, picture):
    """The vehicle's lane change: where the front chassis goes, and how the rear one follows."""
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
