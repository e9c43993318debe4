#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Steps on a pendulum whose spring is far stiffer than its motion: SciPy's Radau in polar coordinates, which know of no constraint,
compared with radau5 and sdirk54 of tandem in Cartesian coordinates with the stretch of the spring.

Usage: bench/stiff_pendulum.py    with an environment that has SciPy and the package of python/ (doc/python.md)
"""

import numpy as np
import tandem
from scipy.integrate import solve_ivp

G, START, END = 9.81, 1.0, 2.0
RATIOS, TOLERANCES = (1e2, 1e4, 1e6), (1e-4, 1e-6, 1e-8, 1e-10)


class Pendulum(tandem.Model):
    """x, y and the stretch s of a spring of 1 m at rest: (x^2 + y^2 - (1 + s)^2)/2 = 0."""

    n, n_holonomic = 3, 1
    mass_matrix = np.diag([1.0, 1.0, 0.0])

    def __init__(self, ratio):
        super().__init__()
        self.k = ratio**2*G
        self.c = np.sqrt(self.k)

    def holonomic(self, t, q):
        return (q[0]**2 + q[1]**2 - (1 + q[2])**2)/2

    def holonomic_jacobian(self, t, q):
        return np.array([q[0], q[1], -1 - q[2]])

    def constraint_acceleration(self, t, q, qd):
        return qd[0]**2 + qd[1]**2 - qd[2]**2

    def applied_force(self, t, q, qd):
        return np.array([0, -G, -self.k*q[2] - self.c*qd[2]])


def by_tandem(ratio, tolerance, stepper):
    """Number of steps, and position of the mass at the end."""
    stretch = G*np.cos(START)/(ratio**2*G)
    start = [(1 + stretch)*np.sin(START), -(1 + stretch)*np.cos(START), stretch]
    solution = tandem.solve(Pendulum(ratio), (0, END), start, [0, 0, 0], stepper=stepper, rtol=tolerance)
    return int(solution.statistics["steps"]), solution.q[-1, :2]


def by_scipy(ratio, tolerance):
    """The same in (s, angle)."""
    k = ratio**2*G
    c = np.sqrt(k)

    def rates(t, y):
        s, angle, sd, w = y
        return [sd, w, (1 + s)*w**2 + G*np.cos(angle) - k*s - c*sd, -(2*sd*w + G*np.sin(angle))/(1 + s)]

    def jacobian(t, y):
        s, angle, sd, w = y
        return np.array([[0, 0, 1, 0], [0, 0, 0, 1], [w**2 - k, -G*np.sin(angle), -c, 2*(1 + s)*w],
                         [(2*sd*w + G*np.sin(angle))/(1 + s)**2, -G*np.cos(angle)/(1 + s), -2*w/(1 + s), -2*sd/(1 + s)]])

    done = solve_ivp(rates, (0, END), [G*np.cos(START)/k, START, 0, 0], method="Radau", rtol=tolerance, atol=tolerance, jac=jacobian)
    s, angle = done.y[:2, -1]
    return done.t.size - 1, np.array([(1 + s)*np.sin(angle), -(1 + s)*np.cos(angle)])


if __name__ == "__main__":
    print("| ratio | rtol | SciPy: steps | error | `radau5`: steps | error | over SciPy's | `sdirk54`: steps | error |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for ratio in RATIOS:
        exact = by_scipy(ratio, 1e-13)[1]
        for tolerance in TOLERANCES:
            (n, x), (m, y), (k, z) = by_scipy(ratio, tolerance), *(by_tandem(ratio, tolerance, name) for name in ("radau5", "sdirk54"))
            errors = [f"{np.abs(place - exact).max():.0e}".replace("e-0", "e-").replace("e+0", "e") for place in (x, y, z)]
            print(f"| {ratio:.0e} | {tolerance:.0e} | {n} | {errors[0]} | {m} | {errors[1]} | {m/n:.2f} | {k} | {errors[2]} |"
                  .replace("e-0", "e-").replace("e+0", "e"))
