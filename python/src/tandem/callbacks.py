# SPDX-License-Identifier: MIT
"""A function of Python as one that the library can call.

No exception can pass through the library: it is kept, the call ends, and whoever called the library raises it again. Arrays that
a function is given are copies, so that it may keep them; what it returns is checked and copied into the library's memory. Functions
that are compiled, by numba or in C, are called directly.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from .errors import NotEvaluable
from .library import EVALUATE, MOTION, POSITION

#: More addresses than the library uses for one argument; a cache that grows beyond is emptied.
MOST_VIEWS = 512


class Views:
    """Array views of the library's memory, by their addresses. The library calls with few addresses again and again."""

    def __init__(self, *shape: int):
        self.shape = shape
        self.size = int(np.prod(shape))
        self.kind = ctypes.c_double * self.size
        self.known: dict[int, np.ndarray] = {}

    def __call__(self, address: int) -> np.ndarray:
        try:
            return self.known[address]
        except KeyError:
            if len(self.known) >= MOST_VIEWS:
                self.known.clear()
            view = np.frombuffer(self.kind.from_address(address)).reshape(self.shape) if self.size else np.zeros(self.shape)
            return self.known.setdefault(address, view)


def put(name: str, view: np.ndarray, result: Any) -> None:
    """Copy the result of a function after a check of its shape and kind."""
    if result.__class__ is np.ndarray and result.shape == view.shape and result.dtype.kind in "fiu":
        view[...] = result
        return
    if result is None:
        raise TypeError(f"{name} returned None: it must return an array of the shape {view.shape}")
    array = np.asarray(result)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} returned {array.dtype} numbers: it must return real ones")
    if array.shape != view.shape:
        # An array of one entry may be given as a number, and one of one row as a vector.
        if array.size != view.size or max(array.ndim, view.ndim) > 1 and max(1, *array.shape, *view.shape) != view.size:
            raise ValueError(f"{name} returned an array of the shape {array.shape}: it must have the shape {view.shape}")
        array = array.reshape(view.shape)
    view[...] = array


def address_of(function: Any) -> int | None:
    """Address of a compiled function: of numba's `cfunc`, of ctypes, or a `ctypes.c_void_p`; None for one of Python. A
    plain number is none: it is a term that never changes."""
    if isinstance(function, ctypes._CFuncPtr):
        return ctypes.cast(function, ctypes.c_void_p).value
    if isinstance(function, ctypes.c_void_p):
        return function.value
    address = getattr(function, "address", None)
    return address if isinstance(address, int) and hasattr(function, "ctypes") else None


class Guard:
    """Creates functions for one problem, and stores the exceptions that they raise."""

    def __init__(self, n: int):
        self.n = n
        self.raised: list[BaseException] = []
        #: Objects to which the library holds pointers; they must live as long as the problem.
        self.alive: list[Any] = []
        #: Signals that have arrived in a frame of these codes, where no exception could pass: the next function raises it.
        self.signals: list[int] = []
        self.codes: set[Any] = set()
        #: True if a function of Python may be called: only such functions can be interrupted by a signal.
        self.has_python = False

    def address(self, name: str, function: Callable, shape: tuple[int, ...], motion: bool, timeless: bool, x: int = 0) -> int:
        """The address of a function of (t, q), or of (t, q, v) where `motion`, without t where `timeless`; x: entries of v."""
        compiled = address_of(function)
        if compiled is not None:
            self.alive.append(function)
            return compiled
        self.has_python = True
        made = self._of_motion(name, function, shape, timeless, x or self.n) if motion else self._of_position(
            name, function, shape, timeless)
        self.alive.append(made)
        return ctypes.cast(made, ctypes.c_void_p).value

    def _of_position(self, name, function, shape, timeless):
        at_q, at_value, keep, signals = Views(self.n), Views(*shape), self.raised.append, self.signals

        def call(t, q, value, _):
            try:
                if signals:
                    raise KeyboardInterrupt
                state = at_q(q).copy()
                put(name, at_value(value), function(state) if timeless else function(t, state))
            except NotEvaluable:
                return 1
            except BaseException as exception:
                keep(exception)
                return -1
            return 0

        self.codes.add(call.__code__)
        return POSITION(call)

    def _of_motion(self, name, function, shape, timeless, entries):
        at_q, at_v, at_value, keep, signals = Views(self.n), Views(entries), Views(*shape), self.raised.append, self.signals

        def call(t, q, v, value, _):
            try:
                if signals:
                    raise KeyboardInterrupt
                state, second = at_q(q).copy(), at_v(v).copy()
                put(name, at_value(value), function(state, second) if timeless else function(t, state, second))
            except NotEvaluable:
                return 1
            except BaseException as exception:
                keep(exception)
                return -1
            return 0

        self.codes.add(call.__code__)
        return MOTION(call)

    def evaluate(self, function: Callable, n_holonomic: int, n_nonholonomic: int, provides: int) -> int:
        """The address of a function of all terms at once, which returns a dictionary of them."""
        compiled = address_of(function)
        if compiled is not None:
            self.alive.append(function)
            return compiled
        self.has_python = True
        n, m = self.n, n_holonomic + n_nonholonomic
        at_q, at_qd, keep, signals = Views(n), Views(n), self.raised.append, self.signals
        shapes = {"phi": (n_holonomic,), "jacobian": (m, n), "nu": (m,), "gamma": (m,), "mass": (n, n), "force": (n,)}
        views = [(name, 1 << i, Views(*shape)) for i, (name, shape) in enumerate(shapes.items())]

        def call(need, t, q, qd, *places):
            try:
                if signals:
                    raise KeyboardInterrupt
                known = function(need, t, at_q(q).copy(), at_qd(qd).copy())
                for (name, bit, at), place in zip(views, places, strict=False):
                    if need & bit and provides & bit:
                        put(name, at(place), known[name])
            except NotEvaluable:
                return 1
            except BaseException as exception:
                keep(exception)
                return -1
            return 0

        self.codes.add(call.__code__)
        made = EVALUATE(call)
        self.alive.append(made)
        return ctypes.cast(made, ctypes.c_void_p).value
