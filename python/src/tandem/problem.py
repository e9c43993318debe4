# SPDX-License-Identifier: MIT
"""A problem of the library: its handle, with the functions, options and events of a model."""

from __future__ import annotations

import contextlib
import ctypes
import signal
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .callbacks import Guard, address_of
from .errors import InvalidInput, error_of
from .library import library
from .model import TERMS, DrawnModel, Model, constant

INTEGERS = {"max_steps", "max_evaluations", "max_events", "iteration_limit", "constant_mass"}
TEXTS = {"stepper", "chart", "refresh", "basis", "projection", "singular", "velocity_metric"}
LISTS = {"rtol_q", "rtol_qd", "atol_q", "atol_qd", "fixed_q", "fixed_qd", "weight_q", "weight_qd", "coordinate_scale", "breakpoints",
         "nu_jumps", "mass_blocks"}
#: The keys of [initial] that say how a start is assembled, as options.
ASSEMBLY = {"fixed": "fixed_q", "fixed_velocities": "fixed_qd", "weights": "weight_q", "velocity_weights": "weight_qd",
            "velocity_metric": "velocity_metric", "largest_move": "largest_move_q", "largest_velocity_move": "largest_move_qd"}
#: Options of `solve_ivp` that users may look for.
OF_SCIPY = {"dense_output": "`solution.simulation.at(t)` tells the state within the last step, and t_eval at any times",
            "method": "name a stepper", "args": "let the functions of the model know them", "jac": "see `force_q` and its like",
            "vectorized": "functions are called for one time"}
SETTERS = {"t q": "set_position_function", "q": "set_position_function", "t q qd": "set_motion_function",
           "q qd": "set_motion_function"}


@dataclass
class Event:
    """An event of a run: a function of (t, q, qd), or an entry of "q", "qd" or "lambda", given by its number or name, passes through a
    value.

    `direction`: 1 for rising values, -1 for falling ones, 0 for both. `stops`: the run ends at the event, otherwise the event is
    recorded. A plain function with SciPy's attributes `terminal` and `direction` is accepted too."""

    function: Callable | None = None
    name: str = ""
    quantity: str = "q"
    index: int | str = 0
    value: float = 0.0
    direction: int = 0
    stops: bool = False

    @classmethod
    def of(cls, given: Any) -> Event:
        """An event as given: itself, a function, or a dictionary of its fields."""
        if isinstance(given, cls):
            return given
        if isinstance(given, Mapping):
            return cls(**given)
        if callable(given) or address_of(given) is not None:
            if getattr(given, "terminal", 0) not in (0, 1):
                raise ValueError(f"terminal = {given.terminal!r} of an event: a run stops at the first occurrence or at none, True or False")
            return cls(given, getattr(given, "__name__", "").replace("<lambda>", ""), direction=int(np.sign(getattr(given, "direction", 0))),
                       stops=bool(getattr(given, "terminal", False)))
        raise TypeError(f"an event is a function of (t, q, qd) or a tandem.Event, not {given!r}")


def as_state(name: str, values: Any, n: int) -> np.ndarray:
    """Coordinates or velocities for the library: a copy, from numbers of any kind and order."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} holds {array.dtype} numbers: it must hold real ones")
    if array.shape != (n,):
        raise ValueError(f"{name} has the shape {array.shape}: the model has {n} coordinates, so it must be ({n},)")
    return np.array(array, dtype=np.float64)


def pointer(array: np.ndarray | None) -> int | None:
    return None if array is None else array.ctypes.data


class Problem:
    """A model used by the library. Simultaneous use by two threads is an error."""

    def __init__(self, model: Model, options: Mapping[str, Any] | None = None, events: Sequence[Any] | Callable | None = None):
        if not isinstance(model, Model):
            raise TypeError(f"the model is {model!r}: give an instance of tandem.Model" + (
                f", {model.__name__}()" if isinstance(model, type) else ""))
        model.check_sizes()
        self.model = model
        self._library = library()
        self._lock = threading.RLock()
        is_drawn = isinstance(model, DrawnModel)
        handle = self._library.tandem_new_mechanism(None) if is_drawn else self._library.tandem_new(
            int(model.n), int(model.n_holonomic), int(model.n_nonholonomic), model.user_data)
        if not handle:
            raise MemoryError("there is no memory for a problem of tandem")
        self._handle = handle
        self._finalizer = weakref.finalize(self, self._library.tandem_free, handle)
        self._guard = Guard(0)
        if is_drawn:
            self._draw()
        self.n = self._guard.n = int(model.n)
        self.rows = int(model.n_holonomic + model.n_nonholonomic)
        # Report an invalid size now, not at the start.
        message = self.message
        if not message.startswith("ok"):
            raise InvalidInput(message, -2)
        if not is_drawn:
            self._give_model()
        for name, value in (options or {}).items():
            self.set_option(name, value)
        self.events: list[Event] = []
        if events is not None:
            for event in [events] if callable(events) or isinstance(events, (Event, Mapping)) else events:
                self._add_event(Event.of(event))

    # --- calls ---------------------------------------------------------------------------------------------------------

    @property
    def message(self) -> str:
        """The message of the last call."""
        return self._library.tandem_message(self._handle).decode(errors="replace")

    def call(self, name: str, *arguments: Any) -> None:
        """A function of the library: the exception of a callback comes first, then that of its status."""
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("another thread runs this simulation now: give each thread a simulation of its own")
        try:
            code = getattr(self._library, f"tandem_{name}")(self._handle, *arguments)
            if self._guard.raised:
                first = self._guard.raised[0]
                self._guard.raised.clear()
                raise first
            if code:
                raise error_of(code, self.message)
        finally:
            self._lock.release()

    def __reduce__(self):
        raise TypeError("a simulation cannot be copied: `save()` gives its state, which `restore()` of another one takes up")

    @contextlib.contextmanager
    def interruptible(self):
        """Ctrl-C ends a call in which functions of Python run, also where the signal comes just outside of them."""
        usual = (self._guard.has_python and threading.current_thread() is threading.main_thread()
                 and signal.getsignal(signal.SIGINT) is signal.default_int_handler)
        if not usual:
            yield
            return
        signals, codes = self._guard.signals, self._guard.codes
        signals.clear()

        def interrupt(number, frame):
            signals.append(number)
            # In the frame that the library calls, an exception would be lost: the next function raises it.
            if frame is None or frame.f_code not in codes:
                raise KeyboardInterrupt

        signal.signal(signal.SIGINT, interrupt)
        try:
            yield
            if signals:
                raise KeyboardInterrupt
        except Exception:
            if signals:
                raise KeyboardInterrupt from None
            raise
        finally:
            signals.clear()
            signal.signal(signal.SIGINT, signal.default_int_handler)

    # --- the model -----------------------------------------------------------------------------------------------------

    def _draw(self) -> None:
        """Build a mechanism of its keys, and learn its sizes and names."""
        model = self.model
        for key, value in model.keys:
            self.call("set_key", key.encode(), value.encode())
        self.call("define", int(model.planar), int(model.is_open), *model.times)
        sizes = [ctypes.c_int() for _ in range(3)]
        self.call("get_sizes", *map(ctypes.addressof, sizes))
        model.n, model.n_holonomic, model.n_nonholonomic = (size.value for size in sizes)
        text = ctypes.create_string_buffer(200)

        def names(what: str, count: int) -> list[str]:
            found = []
            for i in range(count):
                self.call("get_name", what.encode(), i, len(text), text)
                found.append(text.value.decode(errors="replace"))
            return found

        model.coordinates, model.units = names("coordinate", model.n), names("unit", model.n)
        model.constraints = names("row", model.n_holonomic + model.n_nonholonomic)

    def own_start(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """The start of a mechanism: its reference configuration, changed as its `initial` requests."""
        if not isinstance(self.model, DrawnModel):
            raise TypeError("a model of functions has no start of its own: give q and qd")
        initial = self.model.initial
        q, qd = np.empty(self.n), np.empty(self.n)
        self.call("get_drawing", pointer(q), pointer(qd))
        if "q" in initial:
            q = as_state("q of [initial]", initial["q"], self.n)
        if "qd" in initial:
            qd = as_state("qd of [initial]", initial["qd"], self.n)
        if initial.get("equilibrium"):
            q, qd = self.find_equilibrium(q, t), np.zeros(self.n)
        if initial.get("assemble"):
            for key, option in ASSEMBLY.items():
                if key in initial:
                    value = initial[key]
                    if key.startswith("fixed"):
                        value = [float(name in value) for name in self.model.coordinates]
                    self.set_option(option, value)
            q, qd = self.assemble(q, qd, t)
        if initial.get("steady"):
            q, qd = self.find_steady_motion(q, qd, initial["steady"], t)
        return q, qd

    def _give_model(self) -> None:
        model, guard = self.model, self._guard
        settings = {name: getattr(model, name) for name in ("coordinate_scale", "breakpoints", "nu_jumps", "mass_blocks")}
        is_constant = bool(model.constant_mass)
        for name, value in model.terms().items():
            words, shape_words = TERMS[name]
            shape = model.shape_of(shape_words)
            if 0 in shape:
                continue
            timeless, motion = not words.startswith("t"), len(words.split()) - words.startswith("t") == 2
            if not callable(value) and address_of(value) is None:
                value = constant(name, value, timeless, motion)
                is_constant = is_constant or name == "mass_matrix"
            entries = {"x": self.n, "y": self.rows, "qd": self.n}.get(words.split()[-1], self.n)
            address = guard.address(name, value, shape, motion, timeless, entries)
            self.call(SETTERS.get(words, "set_direction_function"), name.encode(), address)
        if model.evaluate is not None:
            provides = int(model.provides)
            address = guard.evaluate(model.evaluate, int(model.n_holonomic), int(model.n_nonholonomic), provides)
            self.call("set_evaluate", address, provides)
        if is_constant:
            self.set_option("constant_mass", 1)
        for name, value in settings.items():
            if value is not None:
                self.set_option(name, value)
        for row, name in enumerate(model.constraints or ()):
            self.call("set_row_name", row, str(name).encode())

    def set_option(self, name: str, value: Any) -> None:
        """An option by its name in doc/options.md; lists are arrays, and rtol and atol may be lists too."""
        if value is None:
            return
        if name in OF_SCIPY:
            raise TypeError(f"{name!r} is no option of tandem: {OF_SCIPY[name]}")
        if name in ("rtol_q", "rtol_qd", "atol_q", "atol_qd") and not np.ndim(value):
            value = np.full(self.n, float(value))
        if name in LISTS or (name in ("rtol", "atol") and np.ndim(value)):
            array = np.ascontiguousarray(np.asarray(value, dtype=np.float64).reshape(-1))
            for each in [name] if name in LISTS else [f"{name}_q", f"{name}_qd"]:
                self.call("set_vector", each.encode(), array.size, pointer(array))
        elif name in TEXTS or isinstance(value, str):
            self.call("set_text", name.encode(), str(value).encode())
        elif name in INTEGERS:
            if int(value) != value:
                raise TypeError(f"the option {name} is {value!r}: it must be a whole number")
            self.call("set_integer", name.encode(), int(value))
        else:
            self.call("set_real", name.encode(), float(value))

    def _add_event(self, event: Event) -> None:
        number = len(self.events)
        name = event.name or f"event {number + 1}"
        if name in (other.name for other in self.events):
            name = f"{name} {number + 1}"
        event = Event(**{**event.__dict__, "name": name})
        if event.function is not None:
            address = self._guard.address(f"event {name!r}", event.function, (), True, False)
            self.call("add_event_function", name.encode(), address, int(np.sign(event.direction)), int(event.stops))
        else:
            if isinstance(event.index, str):
                known = self.model.constraints if event.quantity == "lambda" else self.model.coordinate_names
                if event.index not in (known or ()):
                    raise KeyError(f"the event {name!r} watches {event.index!r}; there are {', '.join(known or ())}")
                event.index = list(known).index(event.index)
            self.call("add_event", name.encode(), event.quantity.encode(), event.index, float(event.value), int(np.sign(event.direction)),
                      int(event.stops))
        self.events.append(event)

    # --- what needs no run ---------------------------------------------------------------------------------------------

    def check(self, q: Any, qd: Any, t: float = 0.0) -> None:
        """Compare the functions of the model with differences of each other."""
        q, qd = as_state("q", q, self.n), as_state("qd", qd, self.n)
        with self.interruptible():
            self.call("check", float(t), pointer(q), pointer(qd))

    def assemble(self, q: Any, qd: Any, t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """The nearest state that satisfies the constraints."""
        q, qd = as_state("q", q, self.n), as_state("qd", qd, self.n)
        with self.interruptible():
            self.call("assemble", float(t), pointer(q), pointer(qd))
        return q, qd

    def find_equilibrium(self, q: Any, t: float = 0.0) -> np.ndarray:
        """The nearest equilibrium, stable or not."""
        q = as_state("q", q, self.n)
        with self.interruptible():
            self.call("find_equilibrium", float(t), pointer(q))
        return q

    def find_steady_motion(self, q: Any, qd: Any, motions: Sequence[str] = ("any",), t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """The nearest steady motion along the named symmetries; "NAME=RATE" fixes a rate (rad/s, m/s)."""
        q, qd = as_state("q", q, self.n), as_state("qd", qd, self.n)
        words = [motions] if isinstance(motions, str) else motions
        with self.interruptible():
            self.call("find_steady_motion", float(t), pointer(q), pointer(qd), " ".join(words).encode())
        return q, qd

    def linearise(self, q: Any, qd: Any, t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues of small motions about a state (k), complex, 1/s, by their real parts; and the matrix (k, k)."""
        q, qd = as_state("q", q, self.n), as_state("qd", qd, self.n)
        count, parts, matrix = ctypes.c_int(), np.empty((2, 2*self.n)), np.empty(4*self.n**2)
        with self.interruptible():
            self.call("linearise", float(t), pointer(q), pointer(qd), ctypes.addressof(count), pointer(parts[0]), pointer(parts[1]),
                      pointer(matrix))
        k = count.value
        return parts[0, :k] + 1j*parts[1, :k], matrix[:k*k].reshape(k, k).T.copy()

    def number(self, name: str, kind: type = ctypes.c_int, *arguments: Any):
        """A number returned by the last argument of a function of the library."""
        value = kind()
        self.call(name, *arguments, ctypes.byref(value))
        return value.value


def check(model: Model, q: Any, qd: Any, t: float = 0.0) -> None:
    """Compare every function of a model with differences of another one at ten random states near (t, q, qd).

    Raises `InvalidInput`, which names the function, the entry and both values, where one is wrong. A wrong sign in
    `constraint_acceleration` lets a run end well with a wrong motion: check each new model."""
    Problem(model).check(q, qd, t)


def assemble(model: Model, q: Any, qd: Any, t: float = 0.0, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """The state nearest to (q, qd) that satisfies the constraints at t. Options: `fixed_q`, `fixed_qd`, `weight_q`, `weight_qd`
    (lists), `largest_move_q`, `largest_move_qd`, `velocity_metric`; doc/linking.md says what they mean."""
    return Problem(model, options).assemble(q, qd, t)
