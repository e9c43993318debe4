# SPDX-License-Identifier: MIT
"""Plots of the tables of sweeps (`tandem sweep`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..table import Column, Table, read_table
from .data import listed
from .style import BLUE, COLOURS, GREY, RED, in_style, label, legend, new_figure, shown


def chosen(table: Table, columns: dict[str, Column], names: Sequence[str] | None, most: int) -> list[str]:
    """The named columns among `columns`; without names, the first columns with single numbers."""
    if names:
        names = listed(names)
        for name in names:
            table.column(name)
        return [name for name in names if name in columns]
    return [name for name, column in columns.items() if column.values.ndim == 1][:most]


def missing(axes, what: str) -> None:
    axes.text(0.5, 0.5, what, transform=axes.transAxes, ha="center", va="center", color=GREY)
    axes.set_axis_off()


@in_style
def histogram(given, names: Sequence[str] | None = None, *, title: str | None = None):
    """Histograms of kept values."""
    table = read_table(given)
    wanted = chosen(table, table.outputs, names, 4)
    figure, axes = new_figure(1, max(1, len(wanted)))
    for one, name in zip(axes[0], wanted, strict=False):
        column = table.outputs[name]
        values = column.values[np.isfinite(column.values)]
        one.hist(values, bins="auto" if len(values) < 100000 else 100, color=BLUE)
        one.set_xlabel(label(name, column.unit))
        one.set_ylabel("cases")
    if not wanted:
        missing(axes[0, 0], "no single numbers in the table")
    figure.suptitle(shown(title) if title else f"{shown(table.name)}: {np.count_nonzero(table.status == 0)} of {len(table.status)} cases")
    return figure


@in_style
def scatter(given, names: Sequence[str] | None = None, *, title: str | None = None):
    """Kept values against varied inputs; red marks at the lower edge show the inputs of failed cases."""
    table = read_table(given)
    rows, columns = chosen(table, table.outputs, names, 4), chosen(table, table.inputs, names, 4)
    rows, columns = rows or chosen(table, table.outputs, None, 4), columns or chosen(table, table.inputs, None, 4)
    figure, axes = new_figure(max(1, len(rows)), max(1, len(columns)), size=(2.8 * len(columns) + 1, 2.4 * max(1, len(rows)) + 0.3),
                              sharex="col", sharey="row")
    failed = table.status != 0
    size = 6 if len(failed) < 2000 else 1
    for i, output in enumerate(rows):
        for j, name in enumerate(columns):
            one, x = axes[i, j], table.inputs[name]
            one.scatter(x.values, table.outputs[output].values, s=size, color=BLUE, linewidths=0, rasterized=len(failed) > 5000)
            if failed.any():
                one.plot(x.values[failed], np.zeros(failed.sum()), "|", color=RED, transform=one.get_xaxis_transform(), clip_on=False)
            if x.labels:
                one.set_xticks(range(1, len(x.labels) + 1), [shown(text) for text in x.labels])
            if i == len(rows) - 1:
                one.set_xlabel(label(name, x.unit))
            if j == 0:
                one.set_ylabel(label(output, table.outputs[output].unit))
    if not rows:
        missing(axes[0, 0], "no single numbers in the table")
    figure.suptitle(shown(title) if title else f"{shown(table.name)}: {len(failed)} cases, {failed.sum()} failed")
    return figure


@in_style
def surface(given, names: Sequence[str] | None = None, *, title: str | None = None):
    """A kept value as a function of two inputs, shown as colour: `names` are the two inputs and the output."""
    table = read_table(given)
    inputs, outputs = chosen(table, table.inputs, names, 2), chosen(table, table.outputs, names, 1)
    if len(inputs) != 2 or len(outputs) != 1:
        raise ValueError("a surface is over two inputs, of one output: --names \"INPUT,INPUT,OUTPUT\"")
    x, y, z = table.inputs[inputs[0]], table.inputs[inputs[1]], table.outputs[outputs[0]]
    here = np.isfinite(z.values)
    figure, axes = new_figure(size=(6, 4.6))
    one = axes[0, 0]
    if len(set(x.values[here])) < 2 or len(set(y.values[here])) < 2:
        raise ValueError("a surface needs cases that differ in both inputs")
    drawn = one.tricontourf(x.values[here], y.values[here], z.values[here], levels=16, cmap="viridis")
    if here.sum() <= 2000:
        one.plot(x.values[here], y.values[here], ".", color="white", markersize=1.5)
    one.plot(x.values[~here], y.values[~here], "x", color=RED, markersize=4)
    figure.colorbar(drawn, label=label(outputs[0], z.unit))
    one.set_xlabel(label(inputs[0], x.unit))
    one.set_ylabel(label(inputs[1], y.unit))
    one.set_title(shown(title or table.name))
    return figure


@in_style
def bands(given, names: Sequence[str] | None = None, *, title: str | None = None):
    """Values kept at several times: the median against time, and bands that contain 50 % and 90 % of the cases."""
    table = read_table(given)
    wanted = [name for name in listed(names) or table.outputs if table.column(name).times is not None][:4]
    figure, axes = new_figure(1, max(1, len(wanted)))
    for i, (one, name) in enumerate(zip(axes[0], wanted, strict=False)):
        column, colour = table.outputs[name], COLOURS[i % len(COLOURS)]
        # There are no bands at times that no case has reached.
        reached = np.isfinite(column.values).any(axis=0)
        values = column.values[:, reached]
        here = np.isfinite(values).all(axis=1)
        if not here.any():
            missing(one, "no case reaches these times")
            continue
        times, levels = column.times[reached], np.quantile(values[here], [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
        outer = one.fill_between(times, levels[0], levels[4], color=colour, alpha=0.2, linewidth=0)
        inner = one.fill_between(times, levels[1], levels[3], color=colour, alpha=0.35, linewidth=0)
        median, = one.plot(times, levels[2], color=colour)
        one.set_xlabel("t [s]")
        one.set_ylabel(label(name, column.unit))
        legend(one, [(outer, "90 %"), (inner, "50 %"), (median, "median")])
    if not wanted:
        missing(axes[0, 0], "nothing was kept at several times")
    figure.suptitle(shown(title or table.name))
    return figure


def overview(given, names: Sequence[str] | None = None, *, title: str | None = None):
    """Bands if values were kept at several times, otherwise a scatter plot."""
    table = read_table(given)
    draw = bands if any(column.times is not None for column in table.outputs.values()) else scatter
    return draw(table, names, title=title)


#: Plots of tables by name.
TABLE_KINDS = {"overview": overview, "scatter": scatter, "histogram": histogram, "surface": surface, "bands": bands}
