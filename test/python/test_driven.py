# SPDX-License-Identifier: MIT
"""Mechanisms that functions of time drive, under every stepper, against the geometry of their positions."""

import re
import unittest

import numpy as np
from test_mechanisms import Mechanism
from test_results import PLANE, SPACE

IMPLICIT = ("radau5", "radau", "sdirk54")
STEPPERS = (*IMPLICIT, "auto", "dop853", "dopri5")
KINDS = ("dense", "sparse")
CRANK, COUPLER, ROCKER = 0.3, 0.9, 0.7


def closed(theta):
    """Angles of the coupler and the rocker of a four-bar linkage between (0, 0) and (1, 0), for the angle of its crank."""
    pin = CRANK*np.array([np.cos(theta), np.sin(theta)])
    way = np.array([1.0, 0.0]) - pin
    length = np.hypot(*way)
    inner = np.arccos((COUPLER**2 + length**2 - ROCKER**2)/(2*COUPLER*length))
    coupler = np.arctan2(way[1], way[0]) + inner
    top = pin + COUPLER*np.array([np.cos(coupler), np.sin(coupler)]) - [1.0, 0.0]
    return coupler, np.arctan2(top[1], top[0])


def linkage(motion, free=""):
    """The linkage with its crank at 1 rad, and further moving parts."""
    coupler, rocker = closed(1.0)
    pin, top = [CRANK*np.cos(1.0), CRANK*np.sin(1.0)], [1 + ROCKER*np.cos(rocker), ROCKER*np.sin(rocker)]
    text = PLANE
    for name, angle, (x, y), length in (("crank", 1.0, (pin[0]/2, pin[1]/2), CRANK),
                                        ("coupler", coupler, ((pin[0] + top[0])/2, (pin[1] + top[1])/2), COUPLER),
                                        ("rocker", rocker, ((1 + top[0])/2, top[1]/2), ROCKER)):
        text += f"[body.{name}]\nmass = 1\ninertia = 0.05\nposition = [{float(x)!r}, {float(y)!r}]\nangle = {float(angle)!r}\n" \
            f"points = {{ from = [{-length/2}, 0], to = [{length/2}, 0] }}\n\n"
    for name, first, second in (("motor", "ground", "crank.from"), ("left", "crank.to", "coupler.from"),
                                ("right", "coupler.to", "rocker.to"), ("foot", "ground:[1, 0]", "rocker.from")):
        text += f'[joint.{name}]\ntype = "revolute"\nbodies = ["{first}", "{second}"]\n'
        text += f'motion = "{motion}"\n\n' if name == "motor" else "\n"
    return text + free + "[initial]\nassemble = true\n\n[time]\nend = 3\n"


def turn(axis, angle):
    """A rotation about x or z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if axis == "x" else [[c, -s, 0], [s, c, 0], [0, 0, 1]])


def bricard(theta, motion):
    """Six links of length 1/2, twisted by 60 degrees to either side in turn; angles of the joints alternate."""
    def chain(other):
        """Positions and axes of the joints, and the pose of the end."""
        place, way = np.zeros(3), np.eye(3)
        joints = [(place, way[:, 2])]
        for k in range(6):
            way = way @ turn("z", other if k % 2 else theta)
            place = place + way @ [0.5, 0, 0]
            way = way @ turn("x", -np.pi/3 if k % 2 else np.pi/3)
            joints.append((place, way[:, 2]))
        return joints

    def gap(other):
        place, axis = chain(other)[-1]
        return np.concatenate([place, axis - [0, 0, 1]])

    # Newton's iteration for the other angle, which closes the loop.
    other = 2.0
    for _ in range(20):
        slope = (gap(other + 1e-6) - gap(other - 1e-6))/2e-6
        other -= slope @ gap(other)/(slope @ slope)
    assert np.max(np.abs(gap(other))) < 1e-12
    joints, text = chain(other), SPACE.replace("-9.81", "0")
    for k in range(5):
        middle = [float(x) for x in (joints[k][0] + joints[k + 1][0])/2]
        text += f"[body.l{k + 1}]\nmass = 1\ninertia = [0.05, 0.06, 0.07]\nposition = {middle}\n\n"
    for k in range(6):
        sides = ["ground" if k == 0 else f"l{k}", f"l{k + 1}" if k < 5 else "ground"]
        at, axis = ([float(x) for x in part] for part in joints[k])
        text += f"[joint.j{k + 1}]\ntype = \"revolute\"\nbodies = {sides}\nat = {at}\naxis = {axis}\n".replace("'", '"')
        text += f'motion = "{motion}"\n\n' if k == 0 else "\n"
    return text + "[initial]\nassemble = true\n\n[time]\nend = 5\n"


class Driven(Mechanism):
    def without_a_warning(self, scene, *settings):
        """A run with the estimate of its error, which warns of nothing."""
        words = [word for setting in settings for word in ("--set", setting)]
        done = self.tandem("run", scene, *words, "--output", "out.h5", "--force", "--quiet")
        self.assertNotIn("WARNING", done.stdout + done.stderr)

    def test_a_linkage_without_a_freedom(self):
        """Positions follow from the time alone. The iteration for them must end on the branch of the start, whatever the tolerance:
        steps are bounded by the motion that the constraints impose."""
        coupler, rocker = closed(16.0)
        scene = self.scene(linkage("5*t"))
        for kind in KINDS:
            for stepper in STEPPERS:
                for rtol in (1e-3, 1e-6, 1e-9):
                    settings = [f"solver.stepper={stepper}", f"solver.rtol={rtol}", f"solver.chart_kind={kind}"]
                    with self.subTest(settings), self.went(scene, *settings) as file:
                        self.near(file["trajectory/q"][-1, [2, 5, 8]], [16.0, coupler, rocker], 1e-10)
                        # An estimate of a motion of fifteen radians takes steps.
                        self.assertGreater(file["report"].attrs["steps"], 10)

    def test_a_motion_that_rests_between(self):
        """Steps that have grown at rest meet a turn of two radians in a tenth of a second."""
        scene = self.scene(linkage("1 + tanh(40*(t - 2))"))
        coupler, rocker = closed(3.0)
        for kind in KINDS:
            for stepper in IMPLICIT:
                settings = [f"solver.stepper={stepper}", "solver.rtol=1e-6", f"solver.chart_kind={kind}"]
                with self.subTest(settings), self.went(scene, *settings) as file:
                    self.near(file["trajectory/q"][-1, [2, 5, 8]], [3.0, coupler, rocker], 1e-9)

    def test_driven_runs_that_are_right_do_not_warn(self):
        """In the plane and in space, fixed to a motor or beside a pendulum of its own."""
        crank = '[body.crank]\nmass = 1\ninertia = {}\nposition = {}\n\n[joint.motor]\ntype = "revolute"\nbodies = ["ground", "crank"]\n' \
            'at = {}\n{}motion = "8*t"\n\n[initial]\nassemble = true\n\n[time]\nend = 3\n'
        pendulum = '[body.bob]\nmass = 1\ninertia = 0.1\nposition = [3, 0]\n\n[joint.pivot]\ntype = "revolute"\n' \
            'bodies = ["ground", "bob"]\nat = [2, 0]\n\n'
        scenes = [PLANE + crank.format("0.1", "[0.1, 0]", "[0, 0]", ""),
                  SPACE + crank.format("[0.1, 0.1, 0.1]", "[0.1, 0, 0]", "[0, 0, 0]", "axis = [0, 1, 1]\n"),
                  linkage("5*t"), linkage("sin(4*t)", pendulum)]
        for number, text in enumerate(scenes):
            for kind in KINDS:
                for stepper in (*IMPLICIT, "trapezoid"):
                    # Errors of the pendulum add up.
                    rtol = {"sdirk54": 1e-8, "trapezoid": 1e-5}.get(stepper, 1e-7)
                    if number == 3 and stepper in ("sdirk54", "trapezoid"):
                        continue
                    with self.subTest([number, kind, stepper]):
                        self.without_a_warning(self.scene(text), f"solver.stepper={stepper}", f"solver.rtol={rtol}",
                                               f"solver.chart_kind={kind}")

    def test_driven_runs_of_loose_tolerances_do_not_warn(self):
        """The geometry makes them exact, whatever steps miss of the velocities."""
        for motion, angle in (("2*t", 7.0), ("2*sin(2*t)", 1 + 2*np.sin(6.0))):
            scene = self.scene(linkage(motion))
            for kind in KINDS:
                for stepper in (*IMPLICIT, "trapezoid"):
                    settings = [f"solver.stepper={stepper}", "solver.rtol=1e-3", f"solver.chart_kind={kind}"]
                    with self.subTest([motion, *settings]):
                        self.without_a_warning(scene, *settings)
                        with self.went(scene, *settings) as file:
                            self.near(file["trajectory/q"][-1, [2, 5, 8]], [angle, *closed(angle)], 1e-10)

    def test_a_crossing_of_branches(self):
        """A Bricard linkage of threefold symmetry, whose one redundant row is left out, is driven to half a turn, where its branches
        meet. With singular = "stop" runs end there, and their status says why."""
        scene = self.scene(bricard(0.4, "0.9*t"))
        for kind in KINDS:
            for stepper in STEPPERS:
                for rtol in (1e-6, 1e-9):
                    settings = ["--set", f"solver.stepper={stepper}", "--set", f"solver.rtol={rtol}", "--set", f"solver.chart_kind={kind}",
                                "--set", "solver.singular=stop"]
                    with self.subTest(settings):
                        done = self.tandem("run", scene, *settings, "--quiet", "--no-error", "--force", code=1)
                        self.assertIn("rank_deficient", done.stderr)
                        self.near(float(re.search(r" t = ([0-9.]+)", done.stderr)[1]), (np.pi - 0.4)/0.9, 1e-3)

    def test_a_crossing_of_branches_is_passed(self):
        """The same runs continue on the smooth branch: the motor determines the position at the end, which all of them find."""
        scene, ends = self.scene(bricard(0.4, "0.9*t")), []
        for kind in KINDS:
            for stepper in STEPPERS:
                with self.subTest((kind, stepper)), self.went(scene, f"solver.stepper={stepper}", "solver.rtol=1e-9",
                                                              f"solver.chart_kind={kind}") as file:
                    ends.append(file["trajectory/q"][-1])
                    self.assertEqual(file["report"].attrs["crossings"], 1)
                    self.near(ends[-1], ends[0], 1e-8)


class Names(Mechanism):
    """Freedoms given by names, and matrices by rows."""

    def test_a_motion_in_space_by_name(self):
        """A primitive that holds all, one freedom of it driven: the second body follows along the axis, or turns about it."""
        axes = np.eye(3)
        for k, name in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            joint = '[body.arm]\nmass = 1\ninertia = [0.1, 0.2, 0.3]\nposition = [0.3, 0.4, 0.5]\n\n[joint.base]\n' \
                'type = "primitive"\nbodies = ["ground", "arm"]\nat = [0, 0, 0]\naxis = [0, 0, 1]\nacross = [1, 0, 0]\n' \
                f'hold = [1, 1, 1, 1, 1, 1]\nmotion = "0.3*t^2"\ndrive = "{name}"\n\n[results]\nbodies = "all"\n\n[time]\nend = 1\n'
            with self.subTest(name), self.went(self.scene(SPACE + joint)) as file:
                t, start, axis = file["trajectory/time"][:], np.array([0.3, 0.4, 0.5]), axes[k % 3]
                way = (0.3*t**2)[:, None]
                expected = start + way*axis
                if k >= 3:
                    along = axis*(axis @ start)
                    expected = along + np.cos(way)*(start - along) + np.sin(way)*np.cross(axis, start)
                self.near(file["bodies/arm/position"][:], expected, 1e-11)

    def test_a_motion_in_the_plane_by_name(self):
        for name, move in (("x", lambda s: (0.3 + s, 0.4 + 0*s)), ("y", lambda s: (0.3 + 0*s, 0.4 + s)),
                           ("angle", lambda s: (0.3*np.cos(s) - 0.4*np.sin(s), 0.3*np.sin(s) + 0.4*np.cos(s)))):
            joint = '[body.arm]\nmass = 1\ninertia = 0.1\nposition = [0.3, 0.4]\n\n[joint.base]\ntype = "primitive"\n' \
                'bodies = ["ground", "arm"]\nat = [0, 0]\naxis = [1, 0]\nhold = [1, 1, 1]\nmotion = "0.3*t^2"\n' \
                f'drive = "{name}"\n\n[results]\nbodies = "all"\n\n[time]\nend = 1\n'
            with self.subTest(name), self.went(self.scene(PLANE + joint)) as file:
                expected = np.array(move(0.3*file["trajectory/time"][:]**2)).T
                self.near(file["bodies/arm/position"][:, :2], expected, 1e-11)
        self.refused("check", self.scene(PLANE + joint.replace('"angle"', '"rz"')), says=["joint.base.drive", "x, y, angle"])

    def test_a_bushing_by_rows(self):
        """Stiffness between x and y: along (1, 1) it is k + c, along (1, -1) k - c, and damping goes along with both."""
        k, c, d = 40.0, 15.0, 0.8
        bushing = '[gravity]\nvector = [0, 0, 0]\n\n[body.mass]\nmass = 2\ninertia = [1, 1, 1]\nposition = [0, 0, 0]\n' \
            'velocity = [0.3, VY, 0]\n\n[force.mount]\ntype = "bushing"\nbetween = ["ground", "mass"]\nat = [0, 0, 0]\n' \
            'axis = [0, 0, 1]\nacross = [1, 0, 0]\nstiffness = STIFFNESS\ndamping = DAMPING\n\n[results]\nbodies = "all"\n\n' \
            '[time]\nend = 2\n\n[solver]\nstepper = "dop853"\nrtol = 1e-11\n'
        stiffness, damping = np.diag([k, k, k, 5.0, 5.0, 5.0]), d*np.eye(6)
        stiffness[0, 1] = stiffness[1, 0] = c
        for sign, stiff in ((1, k + c), (-1, k - c)):
            for shape in (np.ndarray.tolist, lambda matrix: matrix.ravel().tolist()):
                text = '[scene]\nmodel = "mechanism"\n\n' + bushing.replace("VY", str(0.3*sign))
                text = text.replace("STIFFNESS", str(shape(stiffness))).replace("DAMPING", str(shape(damping)))
                with self.subTest(sign=sign, shape=shape), self.went(self.scene(text)) as file:
                    t = file["trajectory/time"][:]
                    decay = d/(2*2)
                    rate = np.sqrt(stiff/2 - decay**2)
                    x = 0.3/rate*np.exp(-decay*t)*np.sin(rate*t)
                    self.near(file["bodies/mass/position"][:], np.array([x, sign*x, 0*x]).T, 1e-10)
        rows = [row[:5] for row in stiffness.tolist()]
        text = text.replace(str(shape(stiffness)), str(rows))
        self.refused("check", self.scene(text), says=["force.mount.stiffness", "has rows of 5", "give 6 rows of 6"])


if __name__ == "__main__":
    unittest.main()
