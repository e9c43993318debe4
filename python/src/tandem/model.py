# SPDX-License-Identifier: MIT
"""Models: the functions of the equations of motion, as methods of a class or as functions of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

#: The functions of a model: their arguments, and the shapes of their values in n coordinates, nh and nd constraints, m = nh + nd.
#: Those that must not depend on time have no t.
TERMS: dict[str, tuple[str, str]] = {
    "holonomic": ("t q", "nh"),
    "holonomic_jacobian": ("t q", "nh n"),
    "holonomic_rate": ("t q", "nh"),
    "nonholonomic_jacobian": ("t q", "nd n"),
    "nonholonomic_rhs": ("t q", "nd"),
    "mass_matrix": ("q", "n n"),
    "potential_energy": ("t q", ""),
    "nu_derivative": ("t q", "m n"),
    "constraint_acceleration": ("t q qd", "m"),
    "inertia_force": ("q qd", "n"),
    "applied_force": ("t q qd", "n"),
    "kinetic_energy": ("q qd", ""),
    "gamma_q": ("t q qd", "m n"),
    "gamma_qd": ("t q qd", "m n"),
    "force_q": ("t q qd", "n n"),
    "force_qd": ("t q qd", "n n"),
    "jacobian_derivative": ("t q x", "m n"),
    "reaction_derivative": ("t q y", "n n"),
    "mass_derivative": ("q x", "n n"),
}

#: Terms that `evaluate` may return, for `provides` and `need`.
PHI, JACOBIAN, NU, GAMMA, MASS, FORCE = 1, 2, 4, 8, 16, 32

NUMBERS = ("n", "n_holonomic", "n_nonholonomic")
SETTINGS = ("provides", "constant_mass", "coordinates", "units", "constraints", "coordinate_scale", "breakpoints", "nu_jumps",
            "mass_blocks", "user_data")


class Model:
    """The equations

        Phi(t, q) = 0,  E(t, q) qd = e(t, q),  M(q) qdd + C' lambda = S(q, qd) + Q_A(t, q, qd),  C = [Phi_q; E],

    and their differentiated constraints C qdd = -gamma(t, q, qd), holonomic rows first.

    A subclass sets `n`, `n_holonomic`, `n_nonholonomic`, and has some of the functions of `TERMS` as methods:

        class Pendulum(tandem.Model):
            n, n_holonomic = 2, 1
            def holonomic(self, t, q): return q @ q - 1
            def holonomic_jacobian(self, t, q): return 2*q
            def constraint_acceleration(self, t, q, qd): return 2*qd @ qd
            mass_matrix = np.eye(2)
            def applied_force(self, t, q, qd): return [0, -9.81]

    Alternatively, functions are given as keywords: `Model(n=2, n_holonomic=1, holonomic=..., ...)`. A function returns a number,
    a sequence or an array of the right shape and of any kind of real numbers; an array instead of a function is a constant term.
    A function may also be compiled: the result of numba's `cfunc` with `numba_signature`, or an address as a `ctypes.c_void_p`, is
    called directly, and has the argument list of include/tandem.h.

    Others that may be set: `evaluate(need, t, q, qd)`, which returns several terms at once in a dictionary (phi, jacobian, nu,
    gamma, mass, force), with `provides`, the sum of `PHI`, `JACOBIAN`, ... that it gives; `coordinates` and `units` (n texts),
    `constraints` (names of the rows); `constant_mass`; `coordinate_scale`; `breakpoints`, `nu_jumps`, `mass_blocks`: doc/linking.md
    explains these. `user_data` is the address that compiled functions get.
    """

    n: int = 0
    n_holonomic: int = 0
    n_nonholonomic: int = 0
    provides: int = 0
    evaluate: Callable | None = None
    constant_mass: bool = False
    coordinates: Sequence[str] | None = None
    units: Sequence[str] | None = None
    constraints: Sequence[str] | None = None
    coordinate_scale: Sequence[float] | None = None
    breakpoints: Sequence[float] | None = None
    nu_jumps: Sequence[float] | None = None
    mass_blocks: Sequence[int] | None = None
    user_data: int | None = None

    def __init__(self, **given: Any):
        known = {*TERMS, *NUMBERS, *SETTINGS, "evaluate"}
        for name, value in given.items():
            if name not in known:
                raise TypeError(f"a model has no {name!r}; it may have {', '.join(sorted(known))}")
            setattr(self, name, value)

    def check_sizes(self) -> None:
        """Refuse numbers that are not integers, and lists of names of a wrong length."""
        for name in NUMBERS:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
                raise TypeError(f"{name} of a model is {value!r}: it must be a whole number")
        for name, length in (("coordinates", self.n), ("units", self.n), ("constraints", self.n_holonomic + self.n_nonholonomic)):
            value = getattr(self, name)
            if value is not None and len(value) != length:
                raise ValueError(f"{name} of the model has {len(value)} entries: it must have {length}")

    def shape_of(self, words: str) -> tuple[int, ...]:
        """The shape that a row of `TERMS` names."""
        sizes = {"n": self.n, "nh": self.n_holonomic, "nd": self.n_nonholonomic, "m": self.n_holonomic + self.n_nonholonomic}
        return tuple(int(sizes[word]) for word in words.split())

    def terms(self) -> dict[str, Any]:
        """Dictionary of the functions and constant arrays of the model."""
        found = {name: getattr(self, name, None) for name in TERMS}
        return {name: value for name, value in found.items() if value is not None}

    @property
    def coordinate_names(self) -> list[str]:
        return list(self.coordinates) if self.coordinates is not None else [f"q{i}" for i in range(self.n)]

    @property
    def coordinate_units(self) -> list[str]:
        return list(self.units) if self.units is not None else [""] * self.n


class DrawnModel(Model):
    """A mechanism for the library, which builds it of its keys; `tandem.Mechanism.model` makes one. Sizes and names of coordinates,
    units and constraints are known as soon as a simulation has it."""

    def __init__(self, keys: list[tuple[str, str]], *, planar: bool, is_open: bool, times: tuple[float, float], initial: dict[str, Any],
                 scene: dict[str, Any]):
        super().__init__()
        #: Dotted keys with their values as texts.
        self.keys = keys
        self.planar, self.is_open, self.times = planar, is_open, times
        #: Settings of the start, and the whole scene, for pictures.
        self.initial, self.scene = initial, scene


def constant(name: str, value: Any, timeless: bool, motion: bool) -> Callable:
    """A term that never changes as a function."""
    array = np.array(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} holds {array.dtype} numbers: it must hold real ones")
    array = array.astype(float)
    array.flags.writeable = False
    if motion:
        return (lambda q, v: array) if timeless else (lambda t, q, v: array)
    return (lambda q: array) if timeless else (lambda t, q: array)


def numba_signature(kind: str = "motion"):
    """The signature for numba's `cfunc`: of a function of "position" (t, q, value, user_data), of "motion" (t, q, qd, value,
    user_data; also those with a vector x in the place of qd), or "evaluate". Such a function sets `value` and returns 0."""
    from numba import types

    doubles = types.CPointer(types.double)
    if kind == "position":
        return types.intc(types.double, doubles, doubles, types.voidptr)
    if kind == "motion":
        return types.intc(types.double, doubles, doubles, doubles, types.voidptr)
    if kind == "evaluate":
        return types.intc(types.intc, types.double, *[doubles] * 8, types.voidptr)
    raise ValueError(f"there is no kind {kind!r} of functions: position, motion, evaluate")
