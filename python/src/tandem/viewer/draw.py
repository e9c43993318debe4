# SPDX-License-Identifier: MIT
"""Creates the drawing of a result."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..plot.data import chosen, listed, scalars, series_named
from .drawing import Curve, Drawing
from .mechanisms import draw_mechanism
from ..motion import frame_times, interpolated, resampled
from .shipped import DRAW, draw_by_names

#: Approximate limit for the count of numbers in a page; the number of frames is reduced to meet it.
MOST_NUMBERS = 6_000_000


def draw(result, *, per_second: float = 60.0, names: list[str] | None = None, look: Callable | None = None) -> Drawing:
    """Create the drawing of a `tandem.Result`, with `per_second` frames per second, and with the series `names` as curves.
    `look(result, times, values)` returns the drawing of a user-defined model."""
    if result.time.size == 0:
        raise ValueError("there is no motion to show: the result has no rows")
    if not (np.isfinite(result.q).all() and np.isfinite(result.time).all()):
        raise ValueError("there is no motion to show: some rows are not finite")
    numbers = 7*max(1, len(result.names)//7 if result.model != "mechanism" else sum(name.endswith(".x") for name in result.names))
    times = frame_times(result.time[0], result.time[-1], per_second, most=max(600, MOST_NUMBERS//numbers))
    drawing = draw_model(result, times, resampled(result, times), look)
    drawing.about = about(result)
    drawing.curves = curves(result, times, names)
    return drawing


def draw_model(result, times: np.ndarray, values: dict[str, np.ndarray], look: Callable | None = None) -> Drawing:
    """Create the bodies and their parts at the given times from the coordinates."""
    if look is None:
        look = draw_mechanism if result.model == "mechanism" else DRAW.get(result.model, draw_by_names)
    drawing = look(result, times, values)
    if drawing is None:
        raise ValueError(f"the model {result.model or 'of this file'} cannot be shown: it has no coordinates named x and y, or NAME.x "
                         "and NAME.y; in Python, use tandem.view(result, look=...) with a user-defined drawing")
    return drawing


def about(result) -> str:
    solver = result.scene.get("solver", {})
    parts = [result.scene.get("scene", {}).get("description", ""), solver.get("stepper", ""),
             result.status if result.status not in ("complete", "ok", "") else ""]
    return ", ".join(part for part in parts if part)


def curves(result, times: np.ndarray, names: list[str] | None) -> list[Curve]:
    """Series that can be plotted beside the motion: those in `names`, otherwise sensors and the coordinates with the largest motion."""
    wanted = listed(names) or [*list(scalars(result))[:12], *vectors(result)[:12], *[name for name in chosen_coordinates(result)]]
    found = []
    for name in dict.fromkeys(wanted):
        values, unit = series_named(result, name)
        if np.isfinite(values).all():
            found.append(Curve(name, unit, at_frames(result, name, values, times)))
    return found


def vectors(result) -> list[str]:
    """Names of the components of sensors with vector values."""
    return [f"{name} {what} {axis}" for name, all_ in result.sensors.items() for what, one in all_.items() if one.values.ndim == 2
            for axis in one.names or "xyz"[:one.values.shape[1]]]


def chosen_coordinates(result) -> list[str]:
    bare = type(result)(result.time, result.names, result.units, result.q)
    return chosen(bare, 6)


def at_frames(result, name: str, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Interpolate a series to the frames; velocities and accelerations are used for coordinates."""
    if name in result.names and result.qd is not None:
        j = result.names.index(name)
        qdd = None if result.qdd is None else result.qdd[:, j:j + 1]
        return interpolated(result.time, result.q[:, j:j + 1], result.qd[:, j:j + 1], qdd, times)[:, 0]
    return np.interp(times, result.time, values)


