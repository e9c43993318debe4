# SPDX-License-Identifier: MIT
"""Error against run time and against evaluations, from studies of precision."""

import numpy as np
from matplotlib.lines import Line2D

from .files import read_study
from .style import GREY, STEPPERS, plt, save

# The coordinates of a scene have several units; the largest error is one of them in its own.
ERROR = "largest error of a coordinate [m, rad or 1]"


def setting(study, row):
    """What a run was, in a few letters."""
    value = study.columns["value"][row]
    if study.columns["control"][row] == "rtol":
        return f"{study.columns['stepper'][row]}, rtol 1e{round(np.log10(value))}"
    return f"{study.columns['stepper'][row]}, h = {1e3 * value:g} ms"


def draw_series(axes, study, abscissa):
    for stepper, control, rows in study.series():
        colour, marker = STEPPERS.get(stepper, (GREY, "x"))
        error, x = study.columns["error_q"][rows], study.columns[abscissa][rows]
        kept = np.isfinite(error) & (error > 0) & (x > 0)
        fixed = control == "step"
        axes.loglog(x[kept], error[kept], "--" if fixed else "-", color=colour, marker=marker, markersize=4.5,
                    markerfacecolor="white" if fixed else colour, linewidth=0.9 if fixed else 1.3, zorder=3)


def draw_floor(axes, study):
    floor = study.attributes.get("floor_q", 0)
    low, high = axes.get_ylim()
    if floor > low:
        axes.axhspan(low, floor, color="#dddddd", zorder=0, linewidth=0)
        axes.text(0.01, floor, " errors not known so exactly", transform=axes.get_yaxis_transform(), ha="left", va="top",
                  fontsize=7.5, color="#555555")
        axes.set_ylim(low, high)


def draw_fastest(axes, study, step=2):
    """Ring and name the fastest run at errors that are `step` decades apart: the way along the lower left."""
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
        axes.annotate(setting(study, row), (x, y), xytext=(-8, 0), textcoords="offset points", ha="right", va="center",
                      fontsize=7.5, color="black", zorder=5)


def legend_entries(studies):
    names = [name for name in STEPPERS if any(name in study.columns["stepper"] for study in studies)]
    entries = [Line2D([], [], color=STEPPERS[name][0], marker=STEPPERS[name][1], label=name) for name in names]
    entries.append(Line2D([], [], color=GREY, marker="o", label="error control (rtol)"))
    entries.append(Line2D([], [], color=GREY, linestyle="--", marker="o", markerfacecolor="white", label="fixed steps"))
    entries.append(Line2D([], [], color=GREY, linestyle="none", marker="o", markersize=10, markerfacecolor="none",
                          label="fastest for its error"))
    return entries


def make_room(axes):
    """Room at the left for the names."""
    low, high = axes.get_xlim()
    axes.set_xlim(low * (low / high) ** 0.33, high)


def limit_errors(axes, study):
    errors = study.columns["error_q"]
    errors = errors[np.isfinite(errors) & (errors > 0)]
    low = max(errors.min(), study.attributes.get("floor_q", 0) / 30)
    axes.set_ylim(low / 2, errors.max() * 3)


def title(study):
    scene = study.settings
    return f"{scene['scene']['name'].replace('_', ' ')}, {scene['time']['end']:g} s"


def draw(paths, picture):
    """One study: error against time and against evaluations. Several: error against time, a panel each."""
    studies = [read_study(path) for path in paths]
    if len(studies) == 1:
        study = studies[0]
        figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained", sharey=True, width_ratios=[1.25, 1])
        draw_series(left, study, "cpu_seconds")
        draw_series(right, study, "right_hand_sides")
        limit_errors(left, study)
        make_room(left)
        draw_fastest(left, study)
        for axes in left, right:
            draw_floor(axes, study)
        left.set(xlabel="run time [s]", ylabel=ERROR, title=f"{title(study)}: error against run time")
        right.set(xlabel="evaluations of the equations of motion", title="error against evaluations")
    else:
        columns = 2
        figure, grid = plt.subplots(-(-len(studies) // columns), columns, figsize=(10, 3.5 * -(-len(studies) // columns)),
                                    layout="constrained", squeeze=False)
        for axes, study in zip(grid.flat, studies, strict=False):
            draw_series(axes, study, "cpu_seconds")
            limit_errors(axes, study)
            make_room(axes)
            draw_fastest(axes, study)
            draw_floor(axes, study)
            axes.set(title=title(study))
        for axes in grid[-1]:
            axes.set_xlabel("run time [s]")
        for axes in grid[:, 0]:
            axes.set_ylabel(ERROR)
        for axes in grid.flat[len(studies):]:
            axes.set_visible(False)
    figure.legend(handles=legend_entries(studies), loc="outside lower center", ncols=8, columnspacing=1.3, handletextpad=0.5)
    save(figure, picture)
