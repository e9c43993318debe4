# SPDX-License-Identifier: MIT
"""Data for plots: results of the program, result files, and solutions of `tandem.solve`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ..result import Result, Series, read, rows_for_pictures

EULER = re.compile(r"(^|\.)e[0-3]$")


def motion_of(given: Any) -> Result:
    """Convert a result, a result file or a solution to a result."""
    if isinstance(given, Result):
        return given
    if isinstance(given, (str, Path)):
        return read(given, rows_for_pictures(given))
    if hasattr(given, "t") and hasattr(given, "names"):
        scene = given.scene or {"scene": {"name": type(given.simulation.model).__name__ if given.simulation else ""}}
        events = {name: np.array([getattr(one, name[:1] if name == "time" else name) for one in given.events])
                  for name in ("time", "q", "qd") if given.events}
        return Result(given.t, given.names, given.units, given.q, given.qd, given.qdd, events=events, report=given.statistics,
                      status=given.status, message=given.message, scene=scene)
    raise TypeError(f"a plot needs a result, its file, or a solution, not {type(given).__name__}")


def motions_of(given: Any) -> list[Result]:
    """Convert to a list of results, all of which have rows."""
    results = [motion_of(one) for one in (given if isinstance(given, (list, tuple)) else [given])]
    for result in results:
        if result.time.size == 0:
            raise ValueError(f"{result.path or result.name}: there is nothing to draw, since the result has no rows"
                             f"{f' ({result.message or result.status})' if result.status not in ('complete', 'ok', '') else ''}")
    return results


def listed(names: Any) -> list[str]:
    """Convert a name or several names to a list."""
    return [names] if isinstance(names, str) else list(names or [])


def positions(result: Result) -> dict[str, tuple[np.ndarray, str]]:
    """Tracks of points, {name: (positions (nt, 2 or 3), unit)}: points of sensors, otherwise bodies, otherwise the first two coordinates."""
    found = {name: (group["position"].values, group["position"].unit) for name, group in result.sensors.items() if "position" in group}
    if found:
        return found
    for pattern, order in ((r"^(?P<body>.+)\.(?P<axis>[xyz])$", "xyz"), (r"^(?P<body>r)(?P<axis>[xyz])$", "xyz"),
                           (r"^(?P<axis>[xyz])(?P<body>\d*)$", "xyz")):
        bodies: dict[str, dict[str, str]] = {}
        for name in result.names:
            if match := re.match(pattern, name):
                bodies.setdefault(match["body"], {})[match["axis"]] = name
        for body, axes in bodies.items():
            if "x" in axes and "y" in axes:
                names = [axes[axis] for axis in order if axis in axes]
                found[body if body and body != "r" else "track"] = result.columns(*names), result.unit(names[0])
        if found:
            return found
    if len(result.names) >= 2:
        first, second = result.names[:2]
        return {f"{second} over {first}": (result.columns(first, second), result.unit(first))}
    return {}


def scalars(result: Result) -> dict[str, Series]:
    """Series of sensors with a single number: {"name what": series}."""
    return {f"{name} {what}": one for name, group in result.sensors.items() for what, one in group.items() if one.values.ndim == 1}


def series_named(result: Result, name: str) -> tuple[np.ndarray, str]:
    """A series by its name: a coordinate, `d(coordinate)` its rate, a diagnostic, `sensor what` or `sensor what axis`, of /joints and
    /bodies too."""
    if name in result.names:
        return result[name], result.unit(name)
    if match := re.fullmatch(r"d\((.+)\)", name):
        if match[1] in result.names and result.qd is not None:
            return result.qd[:, result.names.index(match[1])], rate_unit(result.unit(match[1]))
    if name in result.diagnostics:
        return result.diagnostics[name].values, result.diagnostics[name].unit
    words = name.split()
    for group in (result.sensors, *result.groups.values()):
        if len(words) in (2, 3) and words[0] in group and words[1] in group[words[0]]:
            one = group[words[0]][words[1]]
            if one.values.ndim == 1:
                return one.values, one.unit
            columns = list(one.names or "xyz"[:one.values.shape[1]])
            if len(words) == 2:
                return np.linalg.norm(one.values, axis=1), one.unit
            if words[2] in columns:
                return one.values[:, columns.index(words[2])], one.unit
    raise KeyError(f"there is no series {name!r}; there are {', '.join(names_of(result))}")


def names_of(result: Result) -> list[str]:
    """All names accepted by `series_named`, with the components of vectors."""
    names = [*result.names, *(f"d({name})" for name in result.names if result.qd is not None), *result.diagnostics]
    for group in (result.sensors, *result.groups.values()):
        for name, quantities in group.items():
            for what, one in quantities.items():
                names.append(f"{name} {what}")
                if one.values.ndim > 1:
                    names += [f"{name} {what} {axis}" for axis in one.names or "xyz"[:one.values.shape[1]]]
    return names


def rate_unit(unit: str) -> str:
    return "1/s" if unit in ("", "1") else f"{unit}/s"


def chosen(result: Result, most: int = 4) -> list[str]:
    """Default series: sensors with a single number, otherwise the coordinates with the largest motion, except Euler parameters."""
    if sensors := list(scalars(result)):
        return sensors[:most]
    names = [name for name in result.names if not EULER.search(name)] or result.names
    moved = [(-np.ptp(result[name]), i, name) for i, name in enumerate(names)]
    best = sorted(moved)[:most]
    return [name for _, _, name in sorted(best, key=lambda row: row[1])]
