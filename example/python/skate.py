#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""A skate on an inclined plane from Python: the shared library by ctypes, nothing else.

Usage: skate.py [LIBRARY]        by default libtandem.so.1, where the dynamic linker looks for libraries
"""

import ctypes
import functools
import math
import sys

N = 3  # x downhill, y, heading
SLOPE, SPIN, INERTIA = 9.81 * math.sin(0.3), 1.5, 0.2

Doubles = ctypes.POINTER(ctypes.c_double)
Position = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, Doubles, Doubles, ctypes.c_void_p)
Motion = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, Doubles, Doubles, Doubles, ctypes.c_void_p)

tandem = ctypes.CDLL(sys.argv[1] if len(sys.argv) > 1 else "libtandem.so.1")
if tandem.tandem_interface_version() // 1000 != 1:
    sys.exit("another interface than the one that this program was written for")
# Without these, ctypes takes pointers and numbers for int.
problem_type, text = ctypes.c_void_p, ctypes.c_char_p
tandem.tandem_new.restype = problem_type
tandem.tandem_new.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_void_p]
tandem.tandem_free.argtypes = [problem_type]
tandem.tandem_message.restype = text
tandem.tandem_message.argtypes = [problem_type]
tandem.tandem_set_position_function.argtypes = [problem_type, text, Position]
tandem.tandem_set_motion_function.argtypes = [problem_type, text, Motion]
tandem.tandem_set_integer.argtypes = [problem_type, text, ctypes.c_int]
tandem.tandem_set_real.argtypes = [problem_type, text, ctypes.c_double]
tandem.tandem_set_text.argtypes = [problem_type, text, text]
tandem.tandem_start.argtypes = [problem_type, ctypes.c_double, Doubles, Doubles]
tandem.tandem_step.argtypes = [problem_type, ctypes.c_double]
tandem.tandem_get_state.argtypes = [problem_type, Doubles, Doubles, Doubles, Doubles]
tandem.tandem_get_state_at.argtypes = [problem_type, ctypes.c_double, Doubles, Doubles, Doubles]


def fill(value, numbers):
    """A pointer takes numbers one by one."""
    for i, number in enumerate(numbers):
        value[i] = number


raised = []


def guarded(function):
    """An exception cannot pass through the library: it is kept, the run ends, and `check` raises it again."""

    @functools.wraps(function)
    def call(*arguments):
        try:
            function(*arguments)
            return 0
        except BaseException as exception:
            raised.append(exception)
            return -1

    return call


@guarded
def no_slip(t, q, value, _):
    """E: sin(heading) xd - cos(heading) yd = 0."""
    fill(value, [math.sin(q[2]), -math.cos(q[2]), 0.0])


@guarded
def acceleration(t, q, qd, value, _):
    """gamma of E qdd = -gamma."""
    value[0] = qd[2] * (math.cos(q[2]) * qd[0] + math.sin(q[2]) * qd[1])


@guarded
def mass(t, q, value, _):
    """M by rows."""
    fill(value, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, INERTIA])


@guarded
def force(t, q, qd, value, _):
    """Q_A."""
    fill(value, [SLOPE, 0.0, 0.0])


def check(status):
    if raised:
        raise raised.pop(0)
    if status:
        sys.exit(tandem.tandem_message(problem).decode())


# The library keeps the addresses of these, so they must live as long as the problem.
functions = [Position(no_slip), Position(mass), Motion(acceleration), Motion(force)]

problem = tandem.tandem_new(N, 0, 1, None)
check(tandem.tandem_set_position_function(problem, b"nonholonomic_jacobian", functions[0]))
check(tandem.tandem_set_position_function(problem, b"mass_matrix", functions[1]))
check(tandem.tandem_set_motion_function(problem, b"constraint_acceleration", functions[2]))
check(tandem.tandem_set_motion_function(problem, b"applied_force", functions[3]))
check(tandem.tandem_set_integer(problem, b"constant_mass", 1))
check(tandem.tandem_set_text(problem, b"stepper", b"dop853"))
check(tandem.tandem_set_real(problem, b"rtol", 1e-10))

t, q, qd = ctypes.c_double(0), (ctypes.c_double * N)(), (ctypes.c_double * N)(0, 0, SPIN)
check(tandem.tandem_start(problem, t, q, qd))
error, t_out, t_end = 0.0, 1.0, 10.0
while t.value < t_end:
    check(tandem.tandem_step(problem, t_end))
    check(tandem.tandem_get_state(problem, ctypes.byref(t), None, None, None))
    while t_out <= t.value:
        check(tandem.tandem_get_state_at(problem, t_out, q, qd, None))
        a, b = SLOPE / (4 * SPIN**2), 2 * SPIN * t_out
        exact = [a * (1 - math.cos(b)), a * (b - math.sin(b)), SPIN * t_out]
        error = max(error, *(abs(q[i] - exact[i]) for i in range(N)))
        print(f"{t_out:6.1f} {q[0]:13.9f} {q[1]:13.9f} {q[2]:13.9f}")
        t_out += 1.0
tandem.tandem_free(problem)
print(f"error: {error:.1e}")
