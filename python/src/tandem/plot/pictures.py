# SPDX-License-Identifier: MIT
"""Plots of motions. Each function takes one or several results (`Result`, a file, or a `Solution`) and returns a figure of matplotlib.
If `axes` are given, it plots into them and returns None."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..motion import with_rows_between
from .data import chosen, listed, motions_of, positions, rate_unit, series_named
from .style import BLUE, COLOURS, GREEN, GREY, MOST_ENTRIES, ORANGE, RED, STYLES, in_style, label, legend, new_figure, shown

AXES = "xyz"


def drawn_of(given: Any) -> list:
    """Results with additional interpolated rows where rows are far apart, so that lines appear smooth."""
    return [with_rows_between(result) for result in motions_of(given)]


def style_of(i: int, k: int) -> dict:
    """Colour by the series, line style by the file."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": STYLES[k % len(STYLES)]}


def names_of_files(results: Sequence) -> list[str]:
    """Name of each result. If names are equal, stepper and tolerance are added."""
    names = [result.name for result in results]
    if len(set(names)) == len(names):
        return names
    solvers = [result.scene.get("solver", {}) for result in results]
    full = [f"{name}, {solver.get('stepper', '')} {control(solver)}".strip(", ") for name, solver in zip(names, solvers, strict=True)]
    return full if len(set(full)) == len(full) else [f"{name} ({i + 1})" for i, name in enumerate(full)]


def control(solver: dict) -> str:
    if solver.get("rtol"):
        rtol = solver["rtol"]
        return "rtol by coordinate" if isinstance(rtol, list) else f"rtol {rtol:g}"
    return f"h = {1e3 * solver['step']:g} ms" if solver.get("step") else ""


def missing(axes, what: str) -> None:
    axes.text(0.5, 0.5, f"{what}\nnot in the file", transform=axes.transAxes, ha="center", va="center", color=GREY)
    axes.set_axis_off()


def plane_of(points: Sequence[np.ndarray], plane: str | None) -> tuple[int, int]:
    """Axes of a track: those in `plane`, otherwise the two axes with the largest motion."""
    if plane:
        if len(plane) != 2 or any(axis not in AXES for axis in plane):
            raise ValueError(f"plane is {plane!r}: two of x, y and z, such as xy")
        return AXES.index(plane[0]), AXES.index(plane[1])
    sizes = np.max([np.ptp(values, axis=0) for values in points], axis=0)
    if len(sizes) == 2 or sizes[2] <= min(sizes[0], sizes[1]):
        return 0, 1
    return (0, 2) if sizes[0] >= sizes[1] else (1, 2)


def farthest(known: dict, most: int) -> list[str]:
    """Default tracks: those with the largest extent, at most `most`."""
    sizes = {name: float(np.ptp(values, axis=0).max()) for name, (values, _) in known.items()}
    largest = max(sizes.values(), default=0.0) or 1.0
    # Rounding prevents a selection by insignificant differences, as between the bodies of a falling robot.
    best = sorted(sizes, key=lambda name: -round(sizes[name]/largest, 1))[:most]
    return [name for name in known if name in best]


@in_style
def tracks(given: Any, names: Sequence[str] | None = None, *, plane: str | None = None, axes=None):
    """Tracks of points of sensors, otherwise of bodies, in a plane such as "xz"."""
    results = drawn_of(given)
    known = [positions(result) for result in results]
    wanted = listed(names) if names else farthest(known[0], MOST_ENTRIES - 1)
    for name in wanted:
        if name not in known[0]:
            raise KeyError(f"there is no track of {name!r}; valid names: {', '.join(known[0])}")
    figure = None
    if axes is None:
        figure, all_axes = new_figure(size=(6, 4.4))
        axes = all_axes[0, 0]
    if not wanted:
        missing(axes, "points")
        return figure
    drawn = [points[name][0] for points in known for name in wanted if name in points]
    a, b = plane_of(drawn, plane)
    if max(a, b) >= min(points.shape[1] for points in drawn):
        raise ValueError(f"these tracks are in the plane x, y, without {AXES[max(a, b)]}")
    titles = names_of_files(results)
    for k, points in enumerate(known):
        for i, name in enumerate(wanted):
            if name in points:
                values = points[name][0]
                axes.plot(values[:, a], values[:, b], **style_of(i, k))
                axes.plot(values[0, a], values[0, b], "o", markersize=3.5, color="black")
    low = np.min([points[:, [a, b]].min(axis=0) for points in drawn], axis=0)
    high = np.max([points[:, [a, b]].max(axis=0) for points in drawn], axis=0)
    width, height = high - low
    if max(width, height) < 8 * min(width, height):
        axes.set_aspect("equal", adjustable="datalim")
    elif min(width, height) < 1e-9 * max(width, height):
        # The limits of a straight line are set such that its rounding errors are not visible.
        setter, middle = (axes.set_ylim, low[1]) if height < width else (axes.set_xlim, low[0])
        setter(middle - 0.1 * max(width, height), middle + 0.1 * max(width, height))
    unit = known[0][wanted[0]][1]
    title = "track" if len(wanted) > 1 or wanted[0] == "track" or " over " in wanted[0] else f"track of {shown(wanted[0])}"
    axes.set(xlabel=label(axis_name(results[0], wanted, a), unit), ylabel=label(axis_name(results[0], wanted, b), unit), title=title)
    entries = entries_of(wanted if len(wanted) > 1 else [], titles if len(results) > 1 else [])
    if len(entries) < MOST_ENTRIES:
        entries.append((Line2D([], [], marker="o", linestyle="none", markersize=3.5, color="black"), "start"))
    legend(axes, entries, more=0 if names else len(known[0]) - len(wanted))
    return figure


def axis_name(result, wanted: list[str], axis: int) -> str:
    if len(wanted) == 1 and " over " in wanted[0]:
        return result.names[axis]
    if wanted == ["track"] and f"r{AXES[axis]}" in result.names:
        return f"r{AXES[axis]}"
    return AXES[axis]


@in_style
def coordinates(given: Any, names: Sequence[str] | None = None, *, axes=None):
    """Series against time: coordinates, `d(coordinate)`, diagnostics, `sensor what [axis]`, with one panel per unit."""
    results = drawn_of(given)
    wanted = listed(names) if names else chosen(results[0])
    by_unit: dict[str, list[str]] = {}
    for name in wanted:
        by_unit.setdefault(series_named(results[0], name)[1], []).append(name)
    figure = None
    if axes is None:
        figure, all_axes = new_figure(len(by_unit) or 1, 1, size=(7, 0.6 + 2.5 * max(1, len(by_unit))), sharex=True)
        panels = list(all_axes[:, 0])
    else:
        # A single panel shows only series with the most frequent unit.
        panels = [axes]
        unit = max(by_unit, key=lambda each: len(by_unit[each]))
        by_unit = {unit: by_unit[unit]}
    titles = names_of_files(results)
    for panel, (unit, group) in zip(panels, by_unit.items(), strict=True):
        for k, result in enumerate(results):
            for i, name in enumerate(group):
                panel.plot(result.time, series_named(result, name)[0], **style_of(i, k))
        panel.set(ylabel=label(group[0] if len(group) == 1 else "", unit).strip(), xlim=span_of(results))
        flat(panel)
        if axes is not None:
            axes.set_title(shown(group[0]) if len(group) == 1 and len(results) == 1 else "")
        legend(panel, entries_of(group if len(group) > 1 else [], titles if len(results) > 1 else []))
    panels[-1].set_xlabel("time [s]")
    return figure


def entries_of(names: Sequence[str], files: Sequence[str]) -> list[tuple[Line2D, str]]:
    """Entries of a legend: line styles of files and colours of series."""
    return [(Line2D([], [], color=GREY, linestyle=STYLES[k % len(STYLES)]), file) for k, file in enumerate(files)] \
        + [(Line2D([], [], color=COLOURS[i % len(COLOURS)]), name) for i, name in enumerate(names)]


def flat(axes) -> None:
    """Set the limits of a series that is constant within rounding, so that its rounding errors are not visible."""
    values = np.concatenate([line.get_ydata() for line in axes.lines]) if axes.lines else np.zeros(1)
    values = values[np.isfinite(values)]
    if values.size and np.ptp(values) < 1e-9 * max(1e-9, np.abs(values).max()):
        middle = float(values.mean())
        axes.set_ylim(middle - max(0.1 * abs(middle), 1e-9), middle + max(0.1 * abs(middle), 1e-9))


def span_of(results: Sequence) -> tuple[float, float]:
    first, last = min(result.time[0] for result in results), max(result.time[-1] for result in results)
    return (first, last) if last > first else (first, first + 1)


@in_style
def sensors(given: Any, names: Sequence[str] | None = None):
    """All series of sensors, with one panel per quantity."""
    results = drawn_of(given)
    groups: dict[tuple[str, str], list[str]] = {}
    wanted = listed(names) if names else list(results[0].sensors)
    for name in wanted:
        if name not in results[0].sensors:
            raise KeyError(f"there is no sensor {name!r}; valid names: {', '.join(results[0].sensors) or 'none'}")
        for what, one in results[0].sensors[name].items():
            if one.values.ndim == 1:
                groups.setdefault((what, one.unit), []).append(f"{name} {what}")
            else:
                groups[(f"{name} {what}", one.unit)] = [f"{name} {what} {axis}" for axis in one.names or AXES[:one.values.shape[1]]]
    if not groups:
        raise ValueError("the file has no sensors; add [sensor.NAME] to the scene")
    rows = (len(groups) + 1) // 2
    figure, all_axes = new_figure(rows, min(2, len(groups)), size=(9.5 if len(groups) > 1 else 6, 0.4 + 2.3 * rows), sharex=True)
    titles = names_of_files(results)
    for panel, ((what, unit), group) in zip(all_axes.flat, groups.items(), strict=False):
        for k, result in enumerate(results):
            for i, name in enumerate(group):
                panel.plot(result.time, series_named(result, name)[0], **style_of(i, k))
        panel.set(ylabel=label("", unit).strip(), title=shown(what), xlim=span_of(results))
        flat(panel)
        legend(panel, entries_of([name.split()[-1] if name.startswith(what) else name.split()[0] for name in group],
                                 titles if len(results) > 1 else []))
    for panel in all_axes.flat[len(groups):]:
        panel.set_axis_off()
    for panel in all_axes[-1]:
        panel.set_xlabel("time [s]")
    return figure


@in_style
def reactions(given: Any, names: Sequence[str] | None = None):
    """Forces and torques of joints and wheels that the file contains, with one panel per quantity, the largest first."""
    results = drawn_of(given)
    found: dict[tuple[str, str], list[str]] = {}
    for elements in results[0].groups.values():
        for name, quantities in elements.items():
            for what, one in quantities.items():
                if one.unit in ("N", "N m") and (not names or name in listed(names)):
                    found.setdefault((f"{what} of joints and bodies", one.unit), []).append(f"{name} {what}")
    for name, quantities in results[0].sensors.items():
        for what, one in quantities.items():
            if one.unit in ("N", "N m") and (not names or name in listed(names)):
                found.setdefault((what, one.unit), []).append(f"{name} {what}")
    if not found:
        raise ValueError("the file has no reactions: no series below /joints, /bodies or /sensors is in N or N m")
    figure, all_axes = new_figure(len(found), 1, size=(7.5, 0.5 + 2.5 * len(found)), sharex=True)
    titles = names_of_files(results)
    for panel, ((what, unit), group) in zip(all_axes[:, 0], found.items(), strict=True):
        group.sort(key=lambda name: -np.nan_to_num(series_named(results[0], name)[0]).max(initial=0))
        for k, result in enumerate(results):
            for i, name in enumerate(group[:len(COLOURS)]):
                panel.plot(result.time, series_named(result, name)[0], **style_of(i, k))
        panel.set(title=shown(f"{what}, magnitude"), ylabel=label("", unit).strip(), xlim=span_of(results))
        legend(panel, entries_of([name.split()[0] for name in group], titles if len(results) > 1 else []))
    all_axes[-1, 0].set_xlabel("time [s]")
    return figure


@in_style
def errors(given: Any, *, axes=None):
    """Constraint errors at the three levels, each on the natural scale of its row, and the tolerance."""
    result = motions_of([given])[0]
    figure = None
    if axes is None:
        figure, all_axes = new_figure(size=(6.5, 3.4))
        axes = all_axes[0, 0]
    at, entries = ends_of_steps(result), []
    for name, colour in ("position", BLUE), ("velocity", ORANGE), ("acceleration", GREEN):
        if f"{name}_error" in result.diagnostics:
            values = result.diagnostics[f"{name}_error"].values[at]
            line, = axes.semilogy(result.time[at], np.maximum(values, 1e-18), color=colour, linewidth=0.8,
                                  marker="." if len(at) < 100 else "", markersize=3)
            entries.append((line, name))
    if not entries:
        missing(axes, "constraint errors")
        return figure
    span = span_of([result])
    tolerance = result.scene.get("solver", {}).get("constraint_tolerance")
    if tolerance:
        axes.axhline(tolerance, color=RED, linewidth=1, linestyle="--")
        axes.text(span[1], tolerance, "tolerance", color=RED, ha="right", va="bottom", fontsize=8)
    axes.set(xlabel="time [s]", ylabel="part of the natural scale [1]", title="constraint errors", xlim=span)
    low, _ = axes.get_ylim()
    axes.set_ylim(max(low, 1e-18), (tolerance or 1e-12) * 30)
    legend(axes, entries)
    return figure


def energy_series(result, whole: bool = False) -> dict[str, np.ndarray]:
    """Kinetic and potential energy from the first source that contains both: the diagnostics, a sensor, the balance, or, unless `whole`
    is true, the sum over the bodies in the file."""
    parts = ("kinetic", "potential")
    known = [{name: result.diagnostics[f"{name}_energy"].values for name in parts if f"{name}_energy" in result.diagnostics}]
    for quantities in (*result.sensors.values(), *result.groups.get("balance", {}).values()):
        known.append({name: quantities[name].values for name in parts if name in quantities})
    for bodies in () if whole else (result.groups.get("bodies", {}), result.sensors):
        held = [quantities for quantities in bodies.values() if "kinetic_energy" in quantities]
        known.append({f"{name} of {len(held)} bod{'ies' if len(held) > 1 else 'y'}": sum(quantities[f"{name}_energy"].values for quantities in held)
                      for name in parts if held and all(f"{name}_energy" in quantities for quantities in held)})
    return max(known, key=len)


def work_series(result) -> np.ndarray | None:
    """Work of motions and forces since the start, if the file contains a balance."""
    for quantities in (*result.groups.get("balance", {}).values(), *result.sensors.values()):
        if "work_of_motions" in quantities and "work_of_forces" in quantities:
            return quantities["work_of_motions"].values + quantities["work_of_forces"].values
    return None


@in_style
def energies(given: Any, *, axes=None):
    """Energies against time; if `axes` are given, only the change of their sum."""
    results = motions_of(given)
    known = [energy_series(result, whole=axes is not None) for result in results]
    if axes is not None:
        if not known[0]:
            missing(axes, "energies")
            return None
        total = sum(known[0].values())
        if total[0] == 0:
            axes.plot(results[0].time, total, color=BLUE, linewidth=0.9)
            axes.set(xlabel="time [s]", ylabel="energy [J]", title="energy", xlim=span_of(results))
            return None
        axes.plot(results[0].time, (total - total[0]) / total[0], color=BLUE, linewidth=0.9)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
        axes.set(xlabel="time [s]", ylabel="(E - E(0)) / E(0) [1]", title=f"change of the energy, {total[0]:.6g} J at the start",
                 xlim=span_of(results))
        return None
    if not all(known):
        raise ValueError("the file has no energies: ask for [output] fields kinetic_energy and potential_energy, for a sensor, or for "
                         "[results] balance")
    figure, all_axes = new_figure(2, 1, size=(7, 5), sharex=True)
    titles, entries = names_of_files(results), ([], [])
    for k, (result, series) in enumerate(zip(results, known, strict=True)):
        parts = {**series, "total": sum(series.values())} if len(series) > 1 else dict(series)
        for i, (name, values) in enumerate(parts.items()):
            line, = all_axes[0, 0].plot(result.time, values, **style_of(i, k))
            entries[0].append((line, name if len(results) == 1 else f"{name}, {titles[k]}"))
        change = sum(series.values())
        change = change - change[0]
        line, = all_axes[1, 0].plot(result.time, change, **style_of(2, k))
        entries[1].append((line, titles[k] if len(results) > 1 else "E - E(0)"))
        work = work_series(result)
        if work is not None:
            name = f"less the work, {titles[k]}" if len(results) > 1 else "less the work"
            line, = all_axes[1, 0].plot(result.time, change - work, **style_of(3, k))
            entries[1].append((line, name))
    all_axes[0, 0].set(ylabel="energy [J]", title="energies", xlim=span_of(results))
    all_axes[1, 0].set(ylabel="E - E(0) [J]", xlabel="time [s]", title="change of the sum")
    legend(all_axes[0, 0], entries[0])
    legend(all_axes[1, 0], entries[1] if len(entries[1]) > 1 else [])
    return figure


@in_style
def phase(given: Any, names: Sequence[str] | None = None):
    """Phase portraits: velocity against coordinate, with one panel per coordinate."""
    results = drawn_of(given)
    wanted = listed(names) if names else [name for name in chosen(results[0]) if name in results[0].names] or results[0].names[:4]
    if results[0].qd is None:
        raise ValueError("the file has no velocities: the scene's [output] fields must have \"qd\"")
    columns = min(2, len(wanted))
    rows = -(-len(wanted) // columns)
    figure, all_axes = new_figure(rows, columns, size=(0.4 + 4.2 * columns, 0.2 + 3.2 * rows))
    titles = names_of_files(results)
    for panel, name in zip(all_axes.flat, wanted, strict=False):
        for k, result in enumerate(results):
            values, unit = series_named(result, name)
            rates = series_named(result, f"d({name})")[0]
            panel.plot(values, rates, **style_of(k, 0))
            panel.plot(values[0], rates[0], "o", markersize=3.5, color="black")
        panel.set(xlabel=label(name, unit), ylabel=label(f"d({name})/dt", rate_unit(unit)), title=f"phase portrait of {shown(name)}")
        lines = [line for line in panel.lines if len(line.get_xdata()) > 1]
        legend(panel, zip(lines, titles, strict=False) if len(results) > 1 else [])
    for panel in all_axes.flat[len(wanted):]:
        panel.set_axis_off()
    return figure


def ends_of_steps(result) -> np.ndarray:
    """Indices of the first row and of rows at the end of steps; of all rows if the file does not contain the steps."""
    if "step" not in result.diagnostics:
        return np.arange(len(result.time))
    ends = result.diagnostics["step"].values > 0
    ends[:1] = True
    return np.flatnonzero(ends)


def steps(result, axes) -> None:
    at = ends_of_steps(result)[1:]
    if "step" not in result.diagnostics or not len(at):
        missing(axes, "steps")
        return
    step = result.diagnostics["step"].values[at]
    axes.semilogy(result.time[at], step, ".", markersize=2.5 if len(at) > 100 else 5, color=BLUE)
    if step.max() < 3 * step.min():
        axes.set_ylim(step.min() / 3, step.max() * 3)
    axes.set(xlabel="time [s]", ylabel="step [s]", xlim=span_of([result]),
             title=f"{result.report.get('steps', '?')} steps, {result.report.get('rejected', '?')} rejected")


def charts(result, axes) -> None:
    if "chart" not in result.diagnostics:
        missing(axes, "charts")
        return
    axes.step(result.time, result.diagnostics["chart"].values, where="post", color=BLUE)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="time [s]", ylabel="number of the chart", title=f"{result.report.get('charts', '?')} charts", xlim=span_of([result]))


@in_style
def overview(given: Any, names: Sequence[str] | None = None, *, plane: str | None = None, title: str | None = None):
    """Overview of a result on one page: tracks, some series, constraint errors, energy, steps and charts. For several results, tracks and
    series are compared."""
    results = motions_of(given)
    result = results[0]
    several = len(results) > 1
    panels = [lambda axes: tracks(results, plane=plane, axes=axes), lambda axes: coordinates(results, listed(names) or chosen(result, 2 if several else 4), axes=axes)]
    if not several:
        if any(name.endswith("_error") for name in result.diagnostics):
            panels.append(lambda axes: errors(result, axes=axes))
        if energy_series(result, whole=True):
            panels.append(lambda axes: energies(result, axes=axes))
        if "step" in result.diagnostics:
            panels.append(lambda axes: steps(result, axes))
        if "chart" in result.diagnostics:
            panels.append(lambda axes: charts(result, axes))
    columns = 2 if len(panels) in (2, 4) else 3
    rows = -(-len(panels) // columns)
    figure, all_axes = new_figure(rows, columns, size=(3.67 * columns, 0.3 + 2.7 * rows + (0.6 if rows == 1 else 0)))
    for draw, axes in zip(panels, all_axes.flat, strict=False):
        draw(axes)
    for axes in all_axes.flat[len(panels):]:
        axes.set_axis_off()
    solver = result.scene.get("solver", {})
    words = [result.name, solver.get("stepper", ""), control(solver), f"chart {solver['chart']}" if "chart" in solver else ""]
    if result.status not in ("complete", "ok", ""):
        words.append(result.status)
    figure.suptitle(shown(title or (" and ".join(names_of_files(results)) if several else ", ".join(word for word in words if word))), fontsize=10)
    return figure


KINDS = {"overview": overview, "tracks": tracks, "coordinates": coordinates, "sensors": sensors, "reactions": reactions,
         "errors": errors, "energies": energies, "phase": phase}
