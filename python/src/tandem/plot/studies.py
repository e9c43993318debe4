# SPDX-License-Identifier: MIT
"""Plots of precision studies (`tandem study precision`): error against run time and against evaluations."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from ..study import Study, read_study
from .style import GREY, STEPPERS, in_style, new_figure, shown

# The coordinates of a scene have different units; the largest error is in the unit of its coordinate.
ERROR = "largest error of a coordinate [m, rad or 1]"
NEEDED = ("scene", "stepper", "control", "value", "error_q", "cpu_seconds", "right_hand_sides", "status")


def setting(study: Study, row: int) -> str:
    """Stepper and step or tolerance of a run, abbreviated."""
    value = study.columns["value"][row]
    if study.columns["control"][row] == "rtol":
        return f"{study.columns['stepper'][row]}, rtol 1e{round(np.log10(value))}"
    return f"{study.columns['stepper'][row]}, h = {1e3 * value:g} ms"


def drawable(study: Study, abscissa: str = "cpu_seconds") -> np.ndarray:
    """True for rows that a logarithmic plot can show."""
    error, x = study.columns["error_q"], study.columns[abscissa]
    return np.isfinite(error) & (error > 0) & (x > 0)


def draw_series(axes, study: Study, abscissa: str) -> None:
    kept = drawable(study, abscissa)
    for stepper, control, rows in study.series():
        colour, marker = STEPPERS.get(stepper, (GREY, "x"))
        rows = rows[kept[rows]]
        fixed = control == "step"
        axes.loglog(study.columns[abscissa][rows], study.columns["error_q"][rows], "--" if fixed else "-", color=colour, marker=marker,
                    markersize=4.5, markerfacecolor="white" if fixed else colour, linewidth=0.9 if fixed else 1.3, zorder=3)


def tidy_ticks(axes) -> None:
    """Label only powers of ten if there is one within the limits of the abscissa."""
    low, high = axes.get_xlim()
    if np.floor(np.log10(high)) > np.log10(low):
        axes.xaxis.set_minor_formatter(NullFormatter())


def draw_floor(axes, study: Study) -> None:
    floor = study.attributes.get("floor_q", 0)
    low, high = axes.get_ylim()
    if floor > low:
        axes.axhspan(low, floor, color="#dddddd", zorder=0, linewidth=0)
        axes.text(0.01, floor, " below the accuracy of the reference", transform=axes.get_yaxis_transform(), ha="left", va="top",
                  fontsize=7.5, color="#555555")
        axes.set_ylim(low, high)


def draw_fastest(axes, study: Study, step: int = 2) -> None:
    """Mark and label the fastest runs for errors at intervals of `step` decades."""
    floor = max(study.attributes.get("floor_q", 0), 1e-14)
    named = set()
    for exponent in range(-1, -14, -step):
        if 10.0**exponent < floor:
            break
        row = study.fastest(10.0**exponent)
        if row is None or row in named or study.columns["error_q"][row] < floor:
            continue
        named.add(row)
        x, y = study.columns["cpu_seconds"][row], study.columns["error_q"][row]
        colour = STEPPERS.get(study.columns["stepper"][row], (GREY, ""))[0]
        axes.plot(x, y, "o", markersize=10, markerfacecolor="none", markeredgecolor=colour, zorder=4)
        axes.annotate(shown(setting(study, row)), (x, y), xytext=(-8, 0), textcoords="offset points", ha="right", va="center",
                      fontsize=7.5, color="black", zorder=5)


def legend_entries(studies: list[Study]) -> list[Line2D]:
    names = [name for name in STEPPERS if any(name in study.columns["stepper"] for study in studies)]
    entries = [Line2D([], [], color=STEPPERS[name][0], marker=STEPPERS[name][1], label=name) for name in names]
    entries.append(Line2D([], [], color=GREY, marker="o", label="error control (rtol)"))
    entries.append(Line2D([], [], color=GREY, linestyle="--", marker="o", markerfacecolor="white", label="fixed steps"))
    entries.append(Line2D([], [], color=GREY, linestyle="none", marker="o", markersize=10, markerfacecolor="none",
                          label="fastest for its error"))
    return entries


def make_room(axes) -> None:
    """Extend the abscissa to the left, to make room for labels."""
    low, high = axes.get_xlim()
    axes.set_xlim(low * (low / high) ** 0.33, high)


def limit_errors(axes, study: Study) -> None:
    errors = study.columns["error_q"][drawable(study)]
    low = max(errors.min(), study.attributes.get("floor_q", 0) / 30)
    axes.set_ylim(min(low, errors.max()) / 2, errors.max() * 3)


def title_of(study: Study) -> str:
    name = study.settings.get("scene", {}).get("name") or study.columns["scene"][0]
    end = study.settings.get("time", {}).get("end")
    return shown(str(name).replace("_", " ")) + (f", {end:g} s" if end is not None else "")


@in_style
def precision(given: Any, *, title: str | None = None):
    """Error against run time and against evaluations for every stepper of a study; for several studies, one panel each."""
    paths = given if isinstance(given, (list, tuple)) else [given]
    studies = [one if isinstance(one, Study) else read_study(one) for one in paths]
    for path, study in zip(paths, studies, strict=True):
        if any(name not in study.columns for name in NEEDED):
            raise ValueError(f"{path} is not a precision study; create one by tandem study precision SCENE")
        if not drawable(study).any():
            raise ValueError(f"{path} has no run with an error and a run time")
    if len(studies) == 1:
        study = studies[0]
        figure, grid = new_figure(1, 2, size=(10, 4.6), sharey=True, width_ratios=[1.25, 1])
        left, right = grid[0]
        draw_series(left, study, "cpu_seconds")
        draw_series(right, study, "right_hand_sides")
        limit_errors(left, study)
        make_room(left)
        draw_fastest(left, study)
        for axes in left, right:
            draw_floor(axes, study)
        left.set(xlabel="run time [s]", ylabel=ERROR, title=f"{shown(title) if title else title_of(study)}: error against run time")
        right.set(xlabel="evaluations of the equations of motion", title="error against evaluations")
    else:
        rows = -(-len(studies) // 2)
        figure, grid = new_figure(rows, 2, size=(10, 3.5 * rows))
        for axes, study in zip(grid.flat, studies, strict=False):
            draw_series(axes, study, "cpu_seconds")
            limit_errors(axes, study)
            make_room(axes)
            draw_fastest(axes, study)
            draw_floor(axes, study)
            axes.set(title=title_of(study))
        for axes in grid[-1]:
            axes.set_xlabel("run time [s]")
        for axes in grid[:, 0]:
            axes.set_ylabel(ERROR)
        for axes in grid.flat[len(studies):]:
            axes.set_visible(False)
        if title:
            figure.suptitle(shown(title))
    for axes in grid.flat[:max(2, len(studies))]:
        tidy_ticks(axes)
    figure.legend(handles=legend_entries(studies), loc="outside lower center", ncols=8, columnspacing=1.3, handletextpad=0.5)
    return figure
