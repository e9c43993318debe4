# SPDX-License-Identifier: MIT
"""Shared parts of the package's tests: a pendulum whose motion is known, a skate on an incline, the compiled library."""

import ctypes
import math
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import tandem

ROOT = Path(__file__).resolve().parents[2]
G = 9.81
#: A pendulum of 1 m and 1 kg from the horizontal at rest at x = -1, after 10 s: theta = 2 asin(k cd(sqrt(g) t | k^2)), k = sin(pi/4).
AT_10 = np.array([-0.27508746257611686, -0.96141920509912506])


class Pendulum(tandem.Model):
    n, n_holonomic = 2, 1
    coordinates, units, constraints = ["x", "y"], ["m", "m"], ["rod"]
    mass_matrix = np.eye(2)

    def holonomic(self, t, q):
        return q @ q - 1

    def holonomic_jacobian(self, t, q):
        return 2*q

    def constraint_acceleration(self, t, q, qd):
        return 2*qd @ qd

    def applied_force(self, t, q, qd):
        return np.array([0, -G])

    def potential_energy(self, t, q):
        return G*q[1]


class Skate(tandem.Model):
    """On an incline, x downhill: it moves along a cycloid."""

    n, n_nonholonomic = 3, 1
    slope, spin = G*math.sin(0.3), 1.5
    mass_matrix = np.diag([1.0, 1.0, 0.2])

    def nonholonomic_jacobian(self, t, q):
        return [[math.sin(q[2]), -math.cos(q[2]), 0.0]]

    def constraint_acceleration(self, t, q, qd):
        return [qd[2]*(math.cos(q[2])*qd[0] + math.sin(q[2])*qd[1])]

    def applied_force(self, t, q, qd):
        return [self.slope, 0.0, 0.0]

    def exact(self, t):
        a, b = self.slope/(4*self.spin**2), 2*self.spin*np.asarray(t)
        return np.stack([a*(1 - np.cos(b)), a*(b - np.sin(b)), self.spin*np.asarray(t)], axis=-1)


START = ([-1.0, 0.0], [0.0, 0.0])

C_PENDULUM = """
int phi(double t, const double *q, double *v, void *u) { v[0] = q[0]*q[0] + q[1]*q[1] - 1; return 0; }
int jacobian(double t, const double *q, double *v, void *u) { v[0] = 2*q[0]; v[1] = 2*q[1]; return 0; }
int gamma_(double t, const double *q, const double *qd, double *v, void *u) { v[0] = 2*(qd[0]*qd[0] + qd[1]*qd[1]); return 0; }
int mass(double t, const double *q, double *v, void *u) { v[0] = v[3] = 1; v[1] = v[2] = 0; return 0; }
int force(double t, const double *q, const double *qd, double *v, void *u) { v[0] = 0; v[1] = -*(double *)u; return 0; }
"""


def compiled_pendulum():
    """The pendulum by functions of C, with the objects that must outlive it; None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None, None
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "pendulum.c", Path(folder) / "pendulum.so"
        source.write_text(C_PENDULUM)
        subprocess.run([compiler, "-O2", "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
        functions = ctypes.CDLL(str(library))
    gravity = ctypes.c_double(G)
    model = tandem.Model(n=2, n_holonomic=1, holonomic=functions.phi, holonomic_jacobian=functions.jacobian,
                         constraint_acceleration=functions.gamma_, mass_matrix=functions.mass, applied_force=functions.force,
                         constant_mass=True, user_data=ctypes.addressof(gravity))
    return model, (functions, gravity)
