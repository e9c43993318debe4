# SPDX-License-Identifier: MIT
"""A whole run by one call, with the habits of SciPy's `solve_ivp`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from .errors import TandemError
from .model import Model
from .simulation import Occurrence, RunError, Simulation


@dataclass
class Solution:
    """Result of `solve`: rows of the motion, events, figures.

    `t` (nt), `q`, `qd`, `qdd` (nt, n); `status` and `message`; `events`, `stopped_by`; `statistics`, `warnings`; `error`, where it was
    asked for; `simulation`, the run, which can be taken further. `plot()` and `view()` draw the motion."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    names: list[str]
    units: list[str]
    status: str = "ok"
    message: str = ""
    events: list[Occurrence] = field(default_factory=list)
    stopped_by: str | None = None
    statistics: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    error: RunError | None = None
    simulation: Simulation | None = None
    #: Of a mechanism, its scene.
    scene: dict[str, Any] = field(default_factory=dict)
    #: A plot and an animation of the motion: `tandem.plot.overview` and `tandem.view`, bound by `tandem.show`.
    plot: ClassVar[Callable[..., Any]]
    view: ClassVar[Callable[..., Any]]

    @property
    def success(self) -> bool:
        return self.status == "ok"

    @property
    def time(self) -> np.ndarray:
        return self.t

    def __getitem__(self, name: str) -> np.ndarray:
        """The series of a coordinate by its name."""
        if name not in self.names:
            raise KeyError(f"there is no coordinate {name!r}; there are {', '.join(self.names)}")
        return self.q[:, self.names.index(name)]

    def __getstate__(self) -> dict[str, Any]:
        # Copies and other processes get the numbers: the run is the library's.
        return {**self.__dict__, "simulation": None}

    def to_xarray(self):
        """An xarray dataset of the motion, its dimensions time and coordinate."""
        from .xarrays import motion_dataset

        return motion_dataset(self.t, {"q": self.q, "qd": self.qd, "qdd": self.qdd}, self.names, self.units,
                              {"status": self.status, "message": self.message})

    def __repr__(self) -> str:
        until = f"t = {self.t[0]:g} to {self.t[-1]:g}" if self.t.size else "no rows"
        return f"<tandem.Solution: {self.status}, {until}, {self.t.size} rows of {len(self.names)} coordinates>"


def solve(model: Model, t_span: tuple[float, float], q: Any = None, qd: Any = None, *, stepper: str | None = None, rtol: Any = None,
          atol: Any = None, step: float | None = None, t_eval: Any = None, events: Sequence[Any] | Callable | None = None,
          error: bool = False, **options: Any) -> Solution:
    """Run a model from t_span[0] to t_span[1], from the coordinates q and the velocities qd; a mechanism, from its own start, where
    they are left out.

    stepper   rk4, dopri5, dop853, trapezoid, sdirk54, radau5, radau, auto (the default)
    rtol      tolerance of a step, for all or per coordinate (1e-6); or `step`, the size of fixed steps in s
    t_eval    times of the rows, by dense output; None: a row for the start and for each step
    events    functions of (t, q, qd), which may have the attributes `terminal` and `direction`; or `tandem.Event`s
    error     true to estimate the error at the end by a second run
    options   all others of doc/options.md, under their names

    Raises `InvalidInput` where something cannot be, `RunFailed` where the run could not go on (what was reached is its
    `solution`), and the exception of a function of the model as it is.
    """
    t0, t1 = (float(t) for t in t_span)
    if not (np.isfinite(t0) and np.isfinite(t1) and t1 >= t0):
        raise ValueError(f"t_span is ({t0}, {t1}): it must be finite and ascend")
    run = Simulation(model, q, qd, t0, events=events, stepper=stepper, rtol=rtol, atol=atol, step=step, **options)
    if error and t1 > t0:
        run.watch_error(t1)
    times = None
    if t_eval is not None:
        times = np.array(t_eval, dtype=np.float64)
        if times.ndim != 1:
            raise ValueError(f"t_eval has the shape {times.shape}: it must be a list of times")
        if times.size and (times.min() < t0 or times.max() > t1):
            raise ValueError(f"t_eval goes from {times.min()} to {times.max()}: it must lie within t_span = ({t0}, {t1})")
    start = run.state
    blocks = [(np.array([start.t]), start.q[None], start.qd[None], start.qdd[None])] if times is None else []
    try:
        blocks.extend(run.rows(t1, times))
    except TandemError as failure:
        failure.solution = gather(run, blocks, failure.status, str(failure))
        raise
    solution = gather(run, blocks, "ok", f"stopped by {run.stopped_by}" if run.stopped_by else "the end of t_span was reached")
    if error and run.stopped_by is None and t1 > t0:
        solution.error = run.estimate_error()
        solution.warnings = run.warnings
    return solution


def gather(run: Simulation, blocks: list, status: str, message: str) -> Solution:
    """The rows of a run as a solution."""
    n = run.problem.n
    empty = (np.empty(0), np.empty((0, n)), np.empty((0, n)), np.empty((0, n)))
    t, q, qd, qdd = (np.concatenate([block[i] for block in blocks] or [empty[i]]) for i in range(4))
    model = run.model
    return Solution(t, q, qd, qdd, model.coordinate_names, model.coordinate_units, status, message, run.events, run.stopped_by,
                    run.statistics, run.warnings, None, run, getattr(model, "scene", {}))
