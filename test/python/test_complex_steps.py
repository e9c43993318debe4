# SPDX-License-Identifier: MIT
"""The matrix of small motions against complex steps of equations that are written here a second time, without a line of tandem's: index 1,
[M C'; C 0] in complex numbers. No difference is taken of the state, so that nothing is lost to a step's length."""

import unittest

import h5py
import numpy as np
from test_output import Case

GRAVITY = 9.81
TINY = 1e-30
#: Rates of rows along the motion, by differences of eighth order: 1/128 leaves some 1e-14.
WEIGHTS, STEP = (4/5, -1/5, 4/105, -1/280), 1/128

PLANAR = """
[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.upper]
mass = 2.0
inertia = 0.3
position = [0.4, -0.3]
omega = 1.5
velocity = [0.45, 0.6]
[body.lower]
mass = 1.2
inertia = 0.1
position = [1.1, -0.2]
omega = -0.7
velocity = [0.97, 0.99]
[joint.pivot]
type = "revolute"
bodies = ["ground", "upper"]
at = [0, 0]
[joint.knee]
type = "revolute"
bodies = ["upper", "lower"]
at = [0.8, -0.6]
[force.coil]
type = "spring"
between = ["ground:[1.5, 0.5]", "lower:[0.2, 0.1]"]
stiffness = 40
damping = 3
length = 0.6
[initial]
assemble = true
[time]
end = 1
"""
CARS = """
[scene]
model = "mechanism"
planar = true
[body.car]
mass = 3.0
inertia = 0.5
position = [0, 0]
velocity = [1, 0.1]
omega = 0.2
[body.trailer]
mass = 1.5
inertia = 0.2
position = [-1.6, 0]
velocity = [1, 0]
omega = -0.3
[wheel.axle]
type = "knife_edge"
at = "car:[-0.5, 0]"
across = [0, 1]
[joint.hitch]
type = "revolute"
bodies = ["car", "trailer"]
at = [-0.8, 0]
[wheel.behind]
type = "knife_edge"
at = "trailer:[-0.4, 0]"
across = [0, 1]
[force.rope]
type = "spring"
between = ["ground:[3, 1]", "car:[0.5, 0.1]"]
stiffness = 8
damping = 0.5
length = 1
[initial]
assemble = true
[time]
end = 1
"""


class Equations:
    """Rows and forces of a mechanism at complex coordinates: bodies in the plane (x, y, angle), or in space (x, y, z, e0 to e3)."""

    def __init__(self, size):
        #: Of each body its first coordinate, mass and inertia (a number, a matrix).
        self.size, self.bodies, self.rows, self.forces = size, [], [], []

    def add(self, mass, inertia, gravity=GRAVITY):
        k = self.size*len(self.bodies)
        self.bodies.append((k, mass, inertia))
        # Down is -y in the plane, -z in space.
        self.forces.append(lambda q, qd, force: force.__setitem__(k + (1 if self.size == 3 else 2), -mass*gravity))
        return k

    @property
    def n(self):
        return self.size*len(self.bodies)

    def jacobian(self, q):
        return np.concatenate([np.atleast_2d(row(q)) for row in self.rows])

    def gamma(self, q, qd):
        """The rate of the rows along the motion, times the velocities."""
        return sum(w/STEP*(self.jacobian(q + k*STEP*qd) - self.jacobian(q - k*STEP*qd)) for k, w in enumerate(WEIGHTS, 1)) @ qd

    def acceleration(self, q, qd):
        mass, force = np.zeros((self.n, self.n), complex), np.zeros(self.n, complex)
        for add in self.forces:
            add(q, qd, force)
        for k, m, inertia in self.bodies:
            if self.size == 3:
                mass[range(k, k + 3), range(k, k + 3)] = m, m, inertia
                continue
            mass[range(k, k + 3), range(k, k + 3)] = m
            g, gd = body_rates(q[k + 3:k + 7]), body_rates(qd[k + 3:k + 7])
            mass[k + 3:k + 7, k + 3:k + 7] = 4*g.T @ inertia @ g
            # Of T = 2 ed' G' J G ed by Lagrange's equations, with G(ed) e = -G(e) ed.
            force[k + 3:k + 7] += -8*gd.T @ inertia @ g @ qd[k + 3:k + 7]
        c = self.jacobian(q)
        m = len(c)
        whole = np.block([[mass, c.T], [c, np.zeros((m, m))]])
        return np.linalg.solve(whole, np.concatenate([force, -self.gamma(q, qd)]))[:self.n]


def body_rates(e):
    """G: the velocity of turning in the body's axes is 2 G ed."""
    return np.array([[-e[1], e[0], e[3], -e[2]], [-e[2], -e[3], e[0], e[1]], [-e[3], e[2], -e[1], e[0]]])


def world_rates(e):
    return np.array([[-e[1], e[0], -e[3], e[2]], [-e[2], e[3], e[0], -e[1]], [-e[3], -e[2], e[1], e[0]]])


def cross(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def in_world(e, a):
    """A vector of the body, and its derivatives with respect to e (3, 4)."""
    e0, v, a = e[0], e[1:], np.asarray(a, dtype=float)
    derivative = np.column_stack([2*(e0*a + cross(v) @ a),
                                  -2*np.outer(a, v) + 2*(v @ a)*np.eye(3) + 2*np.outer(v, a) - 2*e0*cross(a)])
    return (e0**2 - v @ v)*a + 2*v*(v @ a) + 2*e0*cross(v) @ a, derivative


# --- in the plane ---


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


QUARTER = np.array([[0.0, -1], [1, 0]])


def point_rows(q, n, k, place):
    """How a point of a body moves with the coordinates; of the ground not at all."""
    rows = np.zeros((2, n), complex)
    if k is not None:
        rows[:, k:k + 2] = np.eye(2)
        rows[:, k + 2] = QUARTER @ turn(q[k + 2]) @ place
    return rows


def add_hinge(it, one, place_one, two, place_two):
    it.rows.append(lambda q: point_rows(q, it.n, one, place_one) - point_rows(q, it.n, two, place_two))


def add_edge(it, k, place, across):
    it.rows.append(lambda q: (turn(q[k + 2]) @ across) @ point_rows(q, it.n, k, place))


def add_spring(it, fixed, k, place, stiffness, damping, length):
    def add(q, qd, force):
        rows = point_rows(q, it.n, k, place)
        way = q[k:k + 2] + turn(q[k + 2]) @ place - fixed
        size = np.sqrt(way @ way)
        pull = stiffness*(size - length) + damping*(way @ (rows @ qd))/size
        force -= pull/size*(way @ rows)

    it.forces.append(add)


# --- in space ---


def add_unit(it, k):
    def row(q):
        made = np.zeros(it.n, complex)
        made[k + 3:k + 7] = 2*q[k + 3:k + 7]
        return made

    it.rows.append(row)


def add_revolute(it, one, place_one, two, place_two, axis):
    """The points meet; two directions across the axis of the first body stay across that of the second."""
    axis = np.asarray(axis)/np.linalg.norm(axis)
    across = np.linalg.svd(axis[None])[2][1:]

    def rows(q):
        made = np.zeros((5, it.n), complex)
        for k, place, sign in ((one, place_one, 1), (two, place_two, -1)):
            made[:3, k:k + 3] = sign*np.eye(3)
            made[:3, k + 3:k + 7] = sign*in_world(q[k + 3:k + 7], place)[1]
        for i, direction in enumerate(across):
            a, of_a = in_world(q[one + 3:one + 7], direction)
            b, of_b = in_world(q[two + 3:two + 7], axis)
            made[3 + i, one + 3:one + 7], made[3 + i, two + 3:two + 7] = b @ of_a, a @ of_b
        return made

    it.rows.append(rows)


def add_wheel(it, k, radius, axis):
    """A disk on the plane z = 0: its lowest point stays on it (one row of Phi), and does not slip along x and y."""
    def rows(q):
        e = q[k + 3:k + 7]
        a, of_a = in_world(e, axis)
        size = np.sqrt(1 - a[2]**2)
        arm = -radius*(np.array([0, 0, 1]) - a[2]*a)/size
        made = np.zeros((3, it.n), complex)
        made[0, k + 2], made[0, k + 3:k + 7] = 1, radius*a[2]/size*of_a[2]
        made[1:, k:k + 2] = np.eye(2)
        made[1:, k + 3:k + 7] = (-cross(arm) @ (2*world_rates(e)))[:2]
        return made

    it.rows.append(rows)


def bicycle():
    it = Equations(7)
    rear, frame, fork, front = (it.add(mass, np.array(inertia)) for mass, inertia in (
        (2.0, np.diag([0.0603, 0.12, 0.0603])), (85.0, [[9.2, 0, -2.4], [0, 11, 0], [-2.4, 0, 2.8]]),
        (4.0, [[0.05892, 0, 0.00756], [0, 0.06, 0], [0.00756, 0, 0.00708]]), (3.0, np.diag([0.1405, 0.28, 0.1405]))))
    places = {rear: (0, 0, 0.3), frame: (0.3, 0, 0.9), fork: (0.9, 0, 0.7), front: (1.02, 0, 0.35)}
    for k in (rear, frame, fork, front):
        add_unit(it, k)
    tilt = np.pi/10
    for one, two, at, axis in ((frame, rear, (0, 0, 0.3), (0, 1, 0)), (frame, fork, (1.1, 0, 0), (np.sin(tilt), 0, -np.cos(tilt))),
                               (fork, front, (1.02, 0, 0.35), (0, 1, 0))):
        add_revolute(it, one, np.subtract(at, places[one]), two, np.subtract(at, places[two]), axis)
    add_wheel(it, rear, 0.3, (0, 1, 0))
    add_wheel(it, front, 0.35, (0, 1, 0))
    return it


def disk():
    it = Equations(7)
    it.add(10.0, np.diag([5.0, 2.5001, 2.5001]), 9.6)
    add_unit(it, 0)
    add_wheel(it, 0, 1.0, (1, 0, 0))
    return it


def double_pendulum():
    it = Equations(3)
    upper, lower = it.add(2.0, 0.3), it.add(1.2, 0.1)
    add_hinge(it, None, (0, 0), upper, (-0.4, 0.3))
    add_hinge(it, upper, (0.4, -0.3), lower, (-0.3, -0.4))
    add_spring(it, (1.5, 0.5), lower, (0.2, 0.1), 40, 3, 0.6)
    return it


def cars():
    it = Equations(3)
    car, trailer = it.add(3.0, 0.5, 0.0), it.add(1.5, 0.2, 0.0)
    add_edge(it, car, (-0.5, 0), (0, 1))
    add_hinge(it, car, (-0.8, 0), trailer, (0.8, 0))
    add_edge(it, trailer, (-0.4, 0), (0, 1))
    add_spring(it, (3, 1), car, (0.5, 0.1), 8, 0.5, 1)
    return it


class ComplexSteps(Case):
    def compare(self, it, scene, *settings):
        self.tandem("linearise", scene, *(word for setting in settings for word in ("--set", setting)), "--output", "it.h5")
        with h5py.File(self.folder / "it.h5") as file:
            group = file["linearisation"]
            a, v, g, w, q, qd, scale = (group[name][:] for name in ("a", "v", "g", "w", "q", "qd", "scale"))
            # The part that moves with a steady motion is not subtracted here.
            self.assertEqual(group.attrs["kind"], "instant")
        self.assertEqual(len(q), it.n)
        nv, nw = v.shape[1], w.shape[1]
        c = it.jacobian(q).real
        # The same tangent spaces, both of the velocities and of the file's bases, which are orthonormal in scaled coordinates.
        self.assertLess(max(np.abs(c @ w).max(), np.abs(c @ qd).max()), 1e-11)
        self.assertEqual((len(c), np.linalg.matrix_rank(c)), (it.n - nw,)*2)
        v_dual, w_dual = ((basis/scale[:, None]**2).T for basis in (v, w))
        for basis, dual in ((v, v_dual), (w, w_dual)):
            self.assertLess(np.abs(dual @ basis - np.eye(basis.shape[1])).max(), 1e-12)
        found = np.zeros_like(a)
        for j in range(nv + nw):
            move, rate = (v[:, j], np.zeros(it.n)) if j < nv else (np.zeros(it.n), w[:, j - nv])
            moved = q + 1j*TINY*move
            # C qd = 0 beside the point too, the least change that does it: it has no part along W.
            rate = rate + scale*np.linalg.lstsq(c*scale, -(it.jacobian(moved) @ qd).imag/TINY - c @ rate, rcond=None)[0]
            if j < nv:
                self.assertLess(np.abs(rate - g[:, j]).max(), 1e-10*max(1, np.abs(g).max()))
            found[:, j] = np.concatenate([v_dual @ rate, w_dual @ it.acceleration(moved, qd + 1j*TINY*rate).imag/TINY])
        error = np.abs(found - a).max()/np.linalg.norm(a)
        self.assertLess(error, 1e-10)
        return error

    def test_a_double_pendulum_with_a_damped_spring(self):
        self.compare(double_pendulum(), self.scene(PLANAR))

    def test_a_car_and_a_trailer_on_knife_edges(self):
        self.compare(cars(), self.scene(CARS))

    def test_a_disk_that_rolls(self):
        self.compare(disk(), "mechanism_disk")

    def test_a_bicycle_that_falls(self):
        self.compare(bicycle(), "bicycle", "parameters.lean=0.3")


if __name__ == "__main__":
    unittest.main()
