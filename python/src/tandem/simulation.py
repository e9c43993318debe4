# SPDX-License-Identifier: MIT
"""A run, step by step."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .errors import TandemError
from .model import Model
from .problem import Problem, as_state, pointer

#: Steps in one call of the library: between calls, Ctrl-C is noticed also where no function of Python runs.
CHUNK = 1000

FIGURES = (
    "steps rejected failed smallest_step largest_step stiff stiff_from stiff_steps implicit_part switches implicit_steps "
    "charts right_hand_sides evaluations_phi evaluations_jacobian evaluations_nu evaluations_gamma evaluations_mass "
    "evaluations_force fused_calls newton_matrices newton_factorizations newton_corrections implicit_stages "
    "difference_evaluations gamma_evaluations position_corrections largest_position_error largest_velocity_error "
    "largest_acceleration_error local_error local_error_sum dense_error dense_error_q dense_error_qd start_moved_q "
    "start_moved_qd event_evaluations n_redundant wall_seconds cpu_seconds").split()
ERRORS = "global_error_q global_error_qd global_error global_error_largest global_error_time global_error_is_bound".split()
# Real figures; all others are counters.
REALS = {name for name in FIGURES if name.startswith(
    ("smallest", "largest", "local", "dense", "start_moved", "wall", "cpu", "stiff_from", "implicit_part"))}


@dataclass(frozen=True)
class State:
    """The state at a time."""

    t: float
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


@dataclass(frozen=True)
class Occurrence:
    """An event that has happened: its name and number, its direction (0 where the function only touched zero), time and state."""

    name: str
    number: int
    direction: int
    t: float
    q: np.ndarray
    qd: np.ndarray


@dataclass(frozen=True)
class RunError:
    """The estimated error of a run at its end: coordinates, velocities, all of it relative to s + |y|, the largest of the run and
    when; `is_bound` where they are bounds and no estimates."""

    q: float
    qd: float
    relative: float
    largest: float
    time: float
    is_bound: bool


class Simulation:
    """A run of a model from (t, q, qd).

        run = tandem.Simulation(model, q, qd, stepper="dop853", rtol=1e-9)
        run.integrate(10.0)
        run.t, run.q, run.qd

    Steps follow an error estimate with the tolerance `rtol` (1e-6), or have the fixed size `step`; the default stepper is auto. Other
    options have the names given in doc/options.md. `events`: functions of (t, q, qd) or `tandem.Event`s. A run that fails raises; its
    state is then that of the last accepted step, and the run can be asked and taken further.
    """

    def __init__(self, model: Model, q: Any, qd: Any, t: float = 0.0, *, events: Sequence[Any] | Callable | None = None,
                 watch_error: float | None = None, stepper: str | None = None, rtol: Any = None, step: float | None = None,
                 **options: Any):
        options = {"stepper": stepper, "rtol": rtol, "step": step, **options}
        if (q is None) != (qd is None):
            raise ValueError(f"{'q' if qd is None else 'qd'} is given without {'qd' if qd is None else 'q'}: give both")
        self.problem = Problem(model, options, events)
        self.model = model
        if q is None:
            q, qd = self.problem.own_start(float(t))
        self.start(q, qd, t)
        if watch_error is not None:
            self.watch_error(watch_error)

    def start(self, q: Any, qd: Any, t: float = 0.0) -> None:
        """Start, or start anew, with the same model and options."""
        n = self.problem.n
        self._has_warned = False
        q, qd = as_state("q", q, n), as_state("qd", qd, n)
        with self.problem.interruptible():
            self.problem.call("start", float(t), pointer(q), pointer(qd))

    # --- on the way ----------------------------------------------------------------------------------------------------

    def integrate(self, t_end: float) -> State:
        """Run to t_end, or to an event that stops the run (`stopped_by`)."""
        for _ in self.rows(t_end, capacity=0):
            pass
        return self.state

    def step(self, t_limit: float = 1e300) -> State:
        """One accepted step that does not pass t_limit."""
        with self.problem.interruptible():
            self.problem.call("step", float(t_limit))
        return self.state

    def rows(self, t_end: float, times: Any = None, capacity: int = CHUNK):
        """Run to t_end and yield the motion, as arrays (t, q, qd, qdd) of some rows at a time: at `times`, which ascend, or at the
        end of each step. Rows before a failure are yielded before it is raised."""
        problem, n = self.problem, self.problem.n
        at_steps = times is None
        wanted = None if at_steps else np.array(times, dtype=np.float64).reshape(-1)
        if not at_steps and not (np.all(np.diff(wanted) >= 0) and np.all(np.isfinite(wanted))):
            raise ValueError("the times of rows must ascend")
        if wanted is not None and wanted.size and wanted[0] < self.t:
            raise ValueError(f"the first time {wanted[0]} of rows is before the current time {self.t}")
        done = 0
        while True:
            room = (capacity if at_steps else min(CHUNK, wanted.size - done))
            t = np.empty(room) if at_steps else wanted[done:done + room].copy()
            q, qd, qdd = (np.empty((room, n)) for _ in range(3))
            filled = ctypes.c_int()
            failure = None
            try:
                with problem.interruptible():
                    problem.call("advance", float(t_end), CHUNK, room, int(at_steps and room > 0), pointer(t), pointer(q), pointer(qd),
                                 pointer(qdd), ctypes.addressof(filled))
            except BaseException as error:
                failure = error
            done += filled.value
            self.warn_of_contradictions()
            if filled.value:
                yield t[:filled.value], q[:filled.value], qd[:filled.value], qdd[:filled.value]
            if failure is not None:
                raise failure
            left = not at_steps and done < wanted.size and wanted[done] <= self.t
            if not left and (self.t >= t_end or self.stopped_by is not None):
                return

    def warn_of_contradictions(self) -> None:
        """Say at once, by Python's warnings, that functions of the model contradict each other: such a run may take for ever."""
        if not self._has_warned and self.problem.number("count_warnings"):
            for text in self.warnings:
                if "contradicts itself" in text:
                    self._has_warned = True
                    warnings.warn(text, RuntimeWarning, stacklevel=3)

    # --- what is known of it ---------------------------------------------------------------------------------------------

    @property
    def t(self) -> float:
        """The current time."""
        value = ctypes.c_double()
        self.problem.call("get_state", ctypes.addressof(value), None, None, None)
        return value.value

    @property
    def state(self) -> State:
        """The current state."""
        t = ctypes.c_double()
        q, qd, qdd = (np.empty(self.problem.n) for _ in range(3))
        self.problem.call("get_state", ctypes.addressof(t), pointer(q), pointer(qd), pointer(qdd))
        return State(t.value, q, qd, qdd)

    @property
    def q(self) -> np.ndarray:
        return self.state.q

    @property
    def qd(self) -> np.ndarray:
        return self.state.qd

    @property
    def qdd(self) -> np.ndarray:
        return self.state.qdd

    def at(self, t: float) -> State:
        """The state at a time within the last step, by dense output, on the constraints. The run does not notice."""
        q, qd, qdd = (np.empty(self.problem.n) for _ in range(3))
        self.problem.call("get_state_at", float(t), pointer(q), pointer(qd), pointer(qdd))
        return State(float(t), q, qd, qdd)

    def multipliers(self, t: float | None = None) -> np.ndarray:
        """lambda, now or at a time within the last step; one for each constraint row, holonomic rows first."""
        values = np.empty(self.problem.rows)
        self.problem.call("get_multipliers", self.t if t is None else float(t), pointer(values))
        return values

    def energies(self) -> tuple[float, float]:
        """Kinetic and potential energy of the current state; the latter is 0 where the model has none."""
        kinetic, potential = ctypes.c_double(), ctypes.c_double()
        self.problem.call("get_energies", ctypes.addressof(kinetic), ctypes.addressof(potential))
        return kinetic.value, potential.value

    @property
    def events(self) -> list[Occurrence]:
        """The events that have happened, in the order of time."""
        found = []
        for i in range(self.problem.number("count_events")):
            number, direction, t = ctypes.c_int(), ctypes.c_int(), ctypes.c_double()
            q, qd = np.empty(self.problem.n), np.empty(self.problem.n)
            self.problem.call("get_event", i, ctypes.addressof(number), ctypes.addressof(direction), ctypes.addressof(t), pointer(q),
                              pointer(qd))
            found.append(Occurrence(self.problem.events[number.value].name, number.value, direction.value, t.value, q, qd))
        return found

    @property
    def stopped_by(self) -> str | None:
        """The name of the event that has stopped the run where it stands now."""
        if not self.problem.events:
            return None
        number = self.problem.number("get_stop")
        return None if number < 0 else self.problem.events[number].name

    def statistic(self, name: str) -> float:
        """One figure of the run by its name in doc/options.md."""
        return self.problem.number("get_statistic", ctypes.c_double, name.encode())

    @property
    def statistics(self) -> dict[str, float]:
        """The figures of the run."""
        return {name: self.statistic(name) if name in REALS else int(self.statistic(name)) for name in FIGURES}

    @property
    def warnings(self) -> list[str]:
        """Warnings of the run: large errors, redundant rows, ..."""
        texts, room = [], 1000
        for i in range(self.problem.number("count_warnings")):
            text = ctypes.create_string_buffer(room)
            self.problem.call("get_warning", i, room, text)
            texts.append(text.value.decode(errors="replace"))
        return texts

    @property
    def segment(self) -> int:
        """Which smooth piece of the model's functions of time is current: 1 before the first breakpoint."""
        return self.problem._library.tandem_get_segment(self.problem._handle)

    # --- its error, and its checkpoints ------------------------------------------------------------------------------------

    def watch_error(self, t_end: float) -> None:
        """Watch the run, right after its start, up to t_end, so that its error can be estimated there."""
        self.problem.call("watch_error", float(t_end))

    def estimate_error(self) -> RunError:
        """Make a second, more accurate run, and tell the error of the first. The run must have been watched from its start on."""
        with self.problem.interruptible():
            self.problem.call("estimate_error")
        values = [self.statistic(name) for name in ERRORS]
        return RunError(*values[:5], bool(values[5]))

    def save(self) -> np.ndarray:
        """All that the run remembers, as whole numbers; keep them where you like. Your own data of the model are not among them."""
        count = self.problem.number("save_state", ctypes.c_int, 0, None)
        words = np.empty(count, dtype=np.int64)
        self.problem.number("save_state", ctypes.c_int, count, pointer(words))
        return words

    def restore(self, words: Any) -> None:
        """Continue from the words returned by `save`, bitwise as without interruption, in a run of the same model with the same
        options. If they are refused, the run stays unchanged."""
        words = np.ascontiguousarray(words, dtype=np.int64)
        before, state = self.save(), self.state
        try:
            self.problem.call("restore_state", words.size, pointer(words))
        except TandemError:
            self.start(state.q, state.qd, state.t)
            self.problem.call("restore_state", before.size, pointer(before))
            raise

    def linearise(self) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues of small motions about the current state (k), complex, 1/s, by their real parts; and the matrix (k, k)."""
        state = self.state
        return self.problem.linearise(state.q, state.qd, state.t)

    def find_equilibrium(self, q: Any = None) -> np.ndarray:
        """The place of rest that is nearest to q, or to where the run is now; stable or not. The run does not move."""
        return self.problem.find_equilibrium(self.state.q if q is None else q, self.t)

    def find_steady_motion(self, motions: Sequence[str] = ("any",), q: Any = None, qd: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """q and qd of the steady motion that is nearest to them, or to the state of the run: along the symmetries that are named, all of
        them with "any"; "world.rotation_z=0.03" holds a rate. The run does not move."""
        state = self.state
        return self.problem.find_steady_motion(state.q if q is None else q, state.qd if qd is None else qd, motions, self.t)

    def check(self) -> None:
        """Compare the model's functions with differences of each other near the current state."""
        state = self.state
        self.problem.check(state.q, state.qd, state.t)

    def __repr__(self) -> str:
        return f"<tandem.Simulation of {type(self.model).__name__} at t = {self.t:g}, {int(self.statistic('steps'))} steps>"
