# SPDX-License-Identifier: MIT
"""A motion between the rows of a result: at equal times for frames, and near enough to each other for lines.

Between two rows coordinates follow the polynomial that has their values, velocities and, where the file has them, accelerations at
both: of degree 5, otherwise 3. If an event has changed the motion, the polynomial ends at the state before it, which the file holds.
For rows as far apart as the steps of an accurate run, the error of the polynomial is far below a pixel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .result import Result, Series

#: More frames than these are spread over the run instead of 60 a second.
MOST_FRAMES = 36000
#: Lines have at least so many points.
LEAST_POINTS = 1000
#: The rate of a series of a sensor or an element, by their names.
RATES = {"position": "velocity", "velocity": "acceleration", "angle": "rate", "displacement": "speed", "distance": "rate", "length": "rate"}


def frame_times(first: float, last: float, per_second: float = 60.0, most: int = MOST_FRAMES) -> np.ndarray:
    """Equidistant times from the first to the last one, with about the given number per second; at least 2."""
    count = min(most, max(1, round((last - first) * per_second))) if last > first else 1
    return np.linspace(first, last, count + 1)


def interpolated(time, q, qd, qdd, wanted):
    """The coordinates (len(wanted), n) at times within those of the rows. Rows at the same time, an event's, are a jump."""
    if len(time) < 2:
        return np.repeat(q[:1], len(wanted), axis=0)
    k = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    h = time[k + 1] - time[k]
    return between(time, q, qd, qdd, k, ((wanted - time[k])/np.where(h > 0, h, 1.0)).clip(0, 1))


def between(time, q, qd, qdd, k, s):
    """The coordinates (len(k), n) at the fraction s of the interval from row k to the next. Velocities and accelerations may be absent,
    everywhere or as NaN in some rows: the degree is lower there."""
    h, s = (time[k + 1] - time[k])[:, None], s[:, None]
    a, b = q[k], q[k + 1]
    straight = a + s*(b - a)
    if qd is None:
        return straight
    va, vb = h*qd[k], h*qd[k + 1]
    third = (2*s**3 - 3*s**2 + 1)*a + (s**3 - 2*s**2 + s)*va + (3*s**2 - 2*s**3)*b + (s**3 - s**2)*vb
    third = np.where(np.isfinite(third), third, straight)
    if qdd is None:
        return third
    wa, wb = h*h*qdd[k], h*h*qdd[k + 1]
    d = b - a - va - wa/2
    e = vb - va - wa
    f = wb - wa
    fifth = a + s*(va + s*(wa/2 + s*((10*d - 4*e + f/2) + s*((-15*d + 7*e - f) + s*(6*d - 3*e + f/2)))))
    return np.where(np.isfinite(fifth), fifth, third)


def knots(result: Result):
    """The rows with the states before the actions of events: times, coordinates, velocities, accelerations, and the number of the row
    of each. Such a state stands before the row at its time, and has the number of the row before that; its acceleration is not known."""
    number = np.arange(len(result.time))
    states = result.time, result.q, result.qd, result.qdd
    events = result.events
    if result.qd is None or not len(events.get("time", ())) or len(result.time) < 2:
        return *states, number
    # An action makes its time that of a row, but for rounding.
    j = np.clip(np.searchsorted(result.time, events["time"]), 1, len(result.time) - 1)
    j -= np.abs(result.time[j - 1] - events["time"]) < np.abs(result.time[j] - events["time"])
    rounding = 1e-9*(result.time[-1] - result.time[0])/len(result.time)
    acts = (j > 0) & (np.abs(result.time[j] - events["time"]) <= rounding) & (result.qd[j] != events["qd"]).any(axis=1)
    # Of several events at once the first has seen the state before all of them.
    j, first = np.unique(j[acts], return_index=True)
    q, qd = events["q"][acts][first], events["qd"][acts][first]
    qdd = None if result.qdd is None else np.insert(result.qdd, j, np.nan, axis=0)
    return (np.insert(result.time, j, result.time[j]), np.insert(result.q, j, q, axis=0), np.insert(result.qd, j, qd, axis=0), qdd,
            np.insert(number, j, j - 1))


def resampled(result: Result, times: np.ndarray) -> dict[str, np.ndarray]:
    """Dictionary of the coordinates of a result at the times."""
    values = interpolated(*knots(result)[:4], times)
    return {name: values[:, j] for j, name in enumerate(result.names)}


def with_rows_between(result: Result, least: int = LEAST_POINTS) -> Result:
    """A result to draw lines of: its rows, and more between them where they are further apart than the run is long by `least`. Series
    without a rate, diagnostics among them, are straight between rows; `events` and `report` stay."""
    if len(result.time) < 2 or not result.time[-1] > result.time[0]:
        return result
    time, q, qd, qdd, number = knots(result)
    h = np.diff(time)
    parts = np.maximum(1, np.ceil(h*least/(time[-1] - time[0])*(1 - 1e-9))).astype(int)
    if (parts == 1).all() and len(time) == len(result.time):
        return result
    k = np.repeat(np.arange(len(parts)), parts)
    s = np.concatenate([np.arange(n)/n for n in parts])
    k, s = np.append(k, len(parts) - 1), np.append(s, 1.0)
    wanted = time[k] + s*h[k]
    # Other series have no values before an action in the file: they are interpolated linearly up to it.
    row = np.minimum(number[k], len(result.time) - 2)
    length = np.diff(result.time)[row]
    part = np.where(length > 0, (wanted - result.time[row])/np.where(length > 0, length, 1.0), 0.0)
    straight = np.zeros(len(result.time) - 1, bool)
    straight[number[1:][np.diff(number) == 0]] = True

    def of_series(one: Series, rate: Series | None) -> Series:
        values = one.values.reshape(len(one.values), -1).astype(float)
        drawn = between(result.time, values, None, None, row, part)
        if rate is not None and rate.values.shape == one.values.shape:
            curved = between(result.time, values, rate.values.reshape(values.shape), None, row, part)
            drawn = np.where(straight[row][:, None], drawn, curved)
        return replace(one, values=drawn.reshape(len(wanted), *one.values.shape[1:]))

    def of_group(whats: dict[str, Series]) -> dict[str, Series]:
        return {name: of_series(one, whats.get(RATES.get(name, ""))) for name, one in whats.items()}

    return replace(result, time=wanted, q=between(time, q, qd, qdd, k, s), qd=None if qd is None else between(time, qd, qdd, None, k, s),
                   qdd=None if result.qdd is None else between(result.time, result.qdd, None, None, row, part), multipliers=None,
                   diagnostics=of_group(result.diagnostics), sensors={name: of_group(whats) for name, whats in result.sensors.items()},
                   groups={kind: {name: of_group(whats) for name, whats in all_.items()} for kind, all_ in result.groups.items()})
