# SPDX-License-Identifier: MIT
"""A motion at equal times, for frames.

Between the rows of a file the coordinates are interpolated by the polynomial that has their values, velocities and, where the file
has them, accelerations at both rows: of degree 5, else 3. Where rows are as far apart as the steps of an accurate run, the error of
that is far below a pixel; `[output] interval` in the scene gives rows by dense output.
"""

from __future__ import annotations

import numpy as np

#: More frames than these are spread over the run instead of 60 a second.
MOST_FRAMES = 36000


def frame_times(first: float, last: float, per_second: float = 60.0, most: int = MOST_FRAMES) -> np.ndarray:
    """Equal times from the first to the last one, about so many a second; at least 2."""
    count = min(most, max(1, round((last - first) * per_second))) if last > first else 1
    return np.linspace(first, last, count + 1)


def interpolated(time, q, qd, qdd, wanted):
    """The coordinates (len(wanted), n) at times within those of the rows. Rows at the same time, an event's, are a jump."""
    if len(time) < 2:
        return np.repeat(q[:1], len(wanted), axis=0)
    k = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    h = (time[k + 1] - time[k])[:, None]
    h = np.where(h > 0, h, 1.0)
    s = ((wanted - time[k])[:, None]/h).clip(0, 1)
    a, b = q[k], q[k + 1]
    if qd is None:
        return a + s*(b - a)
    va, vb = h*qd[k], h*qd[k + 1]
    if qdd is None:
        return (2*s**3 - 3*s**2 + 1)*a + (s**3 - 2*s**2 + s)*va + (3*s**2 - 2*s**3)*b + (s**3 - s**2)*vb
    wa, wb = h*h*qdd[k], h*h*qdd[k + 1]
    d = b - a - va - wa/2
    e = vb - va - wa
    f = wb - wa
    return a + s*(va + s*(wa/2 + s*((10*d - 4*e + f/2) + s*((-15*d + 7*e - f) + s*(6*d - 3*e + f/2)))))


def resampled(result, times: np.ndarray) -> dict[str, np.ndarray]:
    """The coordinates of a result by name at the times."""
    values = interpolated(result.time, result.q, result.qd, result.qdd, times)
    return {name: values[:, j] for j, name in enumerate(result.names)}
