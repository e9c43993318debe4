# SPDX-License-Identifier: MIT
"""Cost of a model in Python: numba beside C, NumPy beside SciPy's solve_ivp on the same right-hand side. Times are stated; only
ratios within one run are asserted."""

import sys
import time
import unittest
from pathlib import Path
from statistics import median

import numba
import numpy as np
import scipy.integrate
import tandem

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "package"))
from models import G, START, Pendulum, compiled_pendulum  # noqa: E402


@numba.cfunc(tandem.numba_signature("position"))
def phi(t, q, value, data):
    value[0] = q[0]*q[0] + q[1]*q[1] - 1
    return 0


@numba.cfunc(tandem.numba_signature("position"))
def jacobian(t, q, value, data):
    value[0], value[1] = 2*q[0], 2*q[1]
    return 0


@numba.cfunc(tandem.numba_signature("motion"))
def gamma(t, q, qd, value, data):
    value[0] = 2*(qd[0]*qd[0] + qd[1]*qd[1])
    return 0


@numba.cfunc(tandem.numba_signature("position"))
def mass(t, q, value, data):
    value[0] = value[3] = 1.0
    value[1] = value[2] = 0.0
    return 0


@numba.cfunc(tandem.numba_signature("motion"))
def force(t, q, qd, value, data):
    value[0], value[1] = 0.0, -9.81
    return 0


NUMBA = tandem.Model(n=2, n_holonomic=1, holonomic=phi, holonomic_jacobian=jacobian, constraint_acceleration=gamma, mass_matrix=mass,
                     applied_force=force, constant_mass=True)


def seconds(act, times=7):
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        act()
        taken.append(time.perf_counter() - start)
    return median(taken)


class Speed(unittest.TestCase):
    def test_numba_beside_c(self):
        model, alive = compiled_pendulum()

        def run(one):
            simulation = tandem.Simulation(one, *START, stepper="rk4", step=1e-4)
            simulation.integrate(5.0)
            return simulation.q

        self.assertLess(np.abs(run(model) - run(NUMBA)).max(), 1e-10)
        ratios = [seconds(lambda: run(NUMBA), 1)/seconds(lambda: run(model), 1) for _ in range(15)]
        print(f"numba takes {median(ratios):.2f} of C; {seconds(lambda: run(model), 3)/50000*1e6:.2f} us a step of rk4", file=sys.stderr)
        self.assertLess(median(ratios), 1.2)
        del alive

    def test_numpy_beside_solve_ivp(self):
        def rhs(t, y):
            """The same accelerations, eliminated by hand."""
            q, qd = y[:2], y[2:]
            lagrange = -(qd @ qd - G*q[1])/(q @ q)
            return np.array([qd[0], qd[1], lagrange*q[0], lagrange*q[1] - G])

        ours = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-9)
        theirs = scipy.integrate.solve_ivp(rhs, (0, 10), [*START[0], *START[1]], method="DOP853", rtol=1e-9, atol=1e-9)
        a = seconds(lambda: tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-9), 5)
        b = seconds(lambda: scipy.integrate.solve_ivp(rhs, (0, 10), [*START[0], *START[1]], method="DOP853", rtol=1e-9, atol=1e-9), 5)
        counts = ours.statistics
        calls = sum(counts[f"evaluations_{name}"] for name in ("phi", "jacobian", "gamma", "force"))
        exact = np.array([-0.27508746257611686, -0.96141920509912506])
        print(f"a NumPy model: {1e3*a:.0f} ms, {calls} calls, {1e6*a/calls:.1f} us a call with all of tandem; error {np.abs(ours.q[-1] - exact).max():.1e}; "
              f"solve_ivp: {1e3*b:.0f} ms, {theirs.nfev} calls, {1e6*b/theirs.nfev:.1f} us a call; error {np.abs(theirs.y[:2, -1] - exact).max():.1e}", file=sys.stderr)
        self.assertLess(np.abs(ours.q[-1] - exact).max(), np.abs(theirs.y[:2, -1] - exact).max())


if __name__ == "__main__":
    unittest.main()
