# SPDX-License-Identifier: MIT
"""Friction on the reactions of joints: stick and slip against closed forms and converged references of other formulations."""

import json
import unittest

import h5py
import numpy as np
from test_mechanisms import Mechanism
from test_results import PLANE, SPACE, TIGHT, energies

G = 9.81
RUB = '[force.rub]\ntype = "friction"\njoint = "line"\n'
SHOWN = '\n[results]\njoints = "all"\nforces = "all"\nbalance = true\n\n[time]\nend = 1\n\n' + TIGHT


def brown_mcphee(v, dynamic, static, speed):
    u = v/speed
    return dynamic*np.tanh(4*u) + (static - dynamic)*u/(u*u/4 + 0.75)**2


def incline(angle, more, velocity=0.0):
    """A block of 2 kg on a line that rises by an angle."""
    along = [float(np.cos(angle)), float(np.sin(angle))]
    return PLANE + f'[body.block]\nmass = 2\nposition = [0, 0]\nvelocity = {[velocity*x for x in along]}\n\n[joint.line]\n' \
        f'type = "point_on_line"\nbodies = ["ground", "block"]\nat = [0, 0]\naxis = {along}\n\n' + RUB + more + SHOWN


def tilting(more, velocity=3.0):
    """A block on a horizontal rail, its centre of mass beside and above the joint, so that the rail holds a torque."""
    return PLANE + f'[body.block]\nmass = 2\ninertia = 0.3\nposition = [0.1, 0.2]\nvelocity = [{velocity}, 0]\n\n[joint.line]\n' \
        'type = "prismatic"\nbodies = ["ground", "block"]\nat = [0, 0]\naxis = [1, 0]\n\n' + RUB + more + SHOWN


def pendulum(head, more, axis=""):
    """A rod of 1 m and 2 kg on a hinge, from the horizontal at rest."""
    planar = head == PLANE
    pad = "" if planar else ", 0"
    inertia = '"1/6"' if planar else '[0.01, "1/6", "1/6"]'
    return head.replace("[0, 0, -9.81]", "[0, -9.81, 0]") + f'[body.rod]\nmass = 2\ninertia = {inertia}\nposition = [0.5, 0{pad}]\n\n' \
        f'[joint.line]\ntype = "revolute"\nbodies = ["ground", "rod"]\nat = [0, 0{pad}]\n{axis}\n' + RUB + more + SHOWN


def pendulum_rate(y, radius, law):
    """With the reaction F = m (a_G - g) of the hinge, J w' = -m g l cos(angle) - radius mu(w) |F|."""
    angle, w = y
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    mu, alpha = brown_mcphee(w, *law), 0.0
    for _ in range(100):
        force = 2*(0.5*alpha*across - 0.5*w*w*along + np.array([0, G]))
        new = (-2*G*0.5*np.cos(angle) - radius*mu*np.linalg.norm(force))/(2/3)
        if abs(new - alpha) <= 1e-14*(1 + abs(new)):
            break
        alpha = new
    return np.array([w, new])


def rk4(rate, y, h, n, every):
    found = [np.array(y)]
    for step in range(1, n + 1):
        a = rate(y)
        b = rate(y + h/2*a)
        c = rate(y + h/2*b)
        y = y + h/6*(a + 2*b + 2*c + rate(y + h*c))
        if step % every == 0:
            found.append(y)
    return np.array(found)


class Closed(Mechanism):
    """Tolerances: a hundred times that of a step where nothing is said."""

    def test_slips_down(self):
        """Far above the transition speed v' = g (sin - mu cos), but for tanh, which is 1 to rounding."""
        with self.went(self.scene(incline(-0.6, "dynamic = 0.3\nspeed = 0.01\n", velocity=1.0))) as file:
            t, v = file["trajectory/time"][:], file["joints/line/speed"][:]
            self.near(v, 1 + G*(np.sin(0.6) - 0.3*np.cos(0.6))*t, 1e-9)
            self.near(file["forces/rub/force"][:], -0.3*2*G*np.cos(0.6), 1e-9)
            self.near(file["forces/rub/power"][:], file["forces/rub/force"][:]*v, 1e-11)
            residual, scale = energies(file)
            self.assertLess(residual, 1e-9*scale)

    def test_slips_up_and_sticks(self):
        """It comes to rest on the incline, but for the creep where mu tanh(4 v/v_t) cos = sin."""
        creep = 0.01/4*np.arctanh(np.tan(0.2)/0.3)
        for stepper in ("dop853", "radau5", "sdirk54"):
            scene = self.scene(incline(0.2, "dynamic = 0.3\nspeed = 0.01\n", velocity=2.0))
            with self.subTest(stepper), self.went(scene, f'solver.stepper="{stepper}"', "solver.rtol=1e-8") as file:
                t, v = file["trajectory/time"][:], file["joints/line/speed"][:]
                stops = 2/(G*(np.sin(0.2) + 0.3*np.cos(0.2)))
                before = t < stops - 0.02
                self.near(v[before], 2 - G*(np.sin(0.2) + 0.3*np.cos(0.2))*t[before], 1e-6)
                self.near(v[-1], -creep, 1e-7)
                self.near(file["forces/rub/force"][-1], 2*G*np.sin(0.2), 1e-4)

    def test_pressed_by_its_own_friction(self):
        """The rail holds M = m g b + h mu N, which presses too: N^2 = (m g)^2 + (M/arm)^2."""
        m, b, h, mu, arm = 2, 0.1, 0.2, 0.4, 0.25
        first, second = m*G*b/arm, h*mu/arm
        normal = (first*second + np.sqrt((first*second)**2 + (1 - second**2)*((m*G)**2 + first**2)))/(1 - second**2)
        for stepper in ("dop853", "radau5"):
            with self.subTest(stepper), self.went(self.scene(tilting(f"dynamic = {mu}\nspeed = 0.01\narm = {arm}\n", 9.0)),
                                                  f'solver.stepper="{stepper}"') as file:
                self.near(file["forces/rub/force"][:], -mu*normal, 1e-9*normal)
                self.near(file["joints/line/torque"][:, 2], m*G*b + h*mu*normal, 1e-9*normal)
                self.near(file["joints/line/speed"][:], 9 - mu*normal/m*file["trajectory/time"][:], 1e-8)

    def test_torques_do_not_press_without_an_arm(self):
        with self.went(self.scene(tilting("dynamic = 0.4\nspeed = 0.01\n", 9.0))) as file:
            self.near(file["forces/rub/force"][:], -0.4*2*G, 1e-9)

    def test_jams(self):
        """For mu h/arm > 1, friction causes more normal force than it needs: no motion, or several."""
        scene = self.scene(tilting("dynamic = 0.6\nspeed = 0.01\narm = 0.1\n"))
        self.refused("run", scene, "--output", "jam.h5", says=["friction (jammed)"])

    def test_a_viscous_part(self):
        with self.went(self.scene(incline(0, "dynamic = 0\nspeed = 0.01\nviscous = 3\n", velocity=1.0))) as file:
            self.near(file["joints/line/speed"][:], np.exp(-1.5*file["trajectory/time"][:]), 1e-9)


def hanging(angle, more):
    """The same rod, let go at an angle from where it hangs."""
    across, down = 0.5*np.sin(angle), -0.5*np.cos(angle)
    return pendulum(PLANE, more).replace("position = [0.5, 0]", f"position = [{across}, {down}]\nangle = {angle - np.pi/2}")


class Sticks(Mechanism):
    """A hinge that holds: m g l sin(angle) from where the rod hangs is below radius mu m g, that is sin(angle) < 0.12."""

    SPEED = 0.01
    MORE = f"dynamic = 0.3\nspeed = {SPEED}\nradius = 0.2\n"

    def creep(self, angle):
        """Creep under friction that carries the weight: radius mu tanh(4 w/v) = l sin(angle). The neglected inertia is J w' in m g l,
        below 2e-4 of the torque here."""
        return -self.SPEED/4*np.arctanh(0.5*np.sin(angle)/(0.2*0.3))

    def test_it_stays(self):
        """Released within the limit, it only creeps as the law predicts, and the joint reports the torque that holds it."""
        for stepper, rtol in (("dop853", 1e-9), ("radau5", 1e-8), ("sdirk54", 1e-7)):
            with self.subTest(stepper), self.went(self.scene(hanging(0.1, self.MORE)), f'solver.stepper="{stepper}"',
                                                  f"solver.rtol={rtol}", "time.end=2", "output.interval=0.1") as file:
                angle, w = 0.1 + file["joints/line/angle"][1:], file["joints/line/rate"][1:]
                # The start is at rest; 0.1 s are seventy times of what it takes to come to the creep.
                self.assertLess(np.max(np.abs(w/self.creep(angle) - 1)), 1e-3)
                self.near(file["forces/rub/torque"][1:], 2*G*0.5*np.sin(angle), 1e-3)
                self.assertGreater(np.min(angle), 0.09)

    def test_it_comes_to_rest(self):
        """Let go beyond the limit, it swings, and sticks off the vertical. Reference: the equation of the angle by RK4, with an
        error of about 2e-9 as twice the step shows; afterwards the creep."""
        expected = rk4(lambda y: pendulum_rate(y, 0.2, (0.3, 0.3, self.SPEED)), np.array([0.6 - np.pi/2, 0]), 1.25e-4, 24000, 2000)
        for stepper, rtol, bound in (("dop853", 1e-9, 1e-7), ("radau5", 1e-8, 1e-6)):
            with self.subTest(stepper), self.went(self.scene(hanging(0.6, self.MORE)), f'solver.stepper="{stepper}"',
                                                  f"solver.rtol={rtol}", "time.end=3", "output.interval=0.25") as file:
                angle, w = 0.6 + file["joints/line/angle"][:], file["joints/line/rate"][:]
                self.near(angle - np.pi/2, expected[:, 0], bound)
                self.near(w, expected[:, 1], 10*bound)
                self.assertGreater(np.max(np.abs(w[:6])), 0.5)
                # It rests where no pendulum without friction would.
                self.assertGreater(abs(angle[-1]), 1e-3)
                self.assertLess(abs(w[-1]/self.creep(angle[-1]) - 1), 1e-3)
                residual, scale = energies(file)
                self.assertLess(residual, 10*bound*scale)

    def test_it_lets_go(self):
        """Beyond the limit nothing holds it: it turns at once as m g l sin - radius mu N says."""
        with self.went(self.scene(hanging(0.2, self.MORE)), "time.end=0.1", "output.interval=0.02") as file:
            expected = rk4(lambda y: pendulum_rate(y, 0.2, (0.3, 0.3, self.SPEED)), np.array([0.2 - np.pi/2, 0]), 1e-4, 1000, 200)
            self.near(file["joints/line/rate"][:], expected[:, 1], 1e-7)
            self.assertGreater(abs(file["joints/line/rate"][-1]), 10*self.SPEED)


class Converged(Mechanism):
    LAW = (0.2, 0.4, 0.05)
    MORE = "dynamic = 0.2\nstatic = 0.4\nspeed = 0.05\nradius = 0.3\n"

    def test_a_pendulum(self):
        """Slips, turns back, sticks. Reference: the equation of the angle by RK4 with 2e-4 s."""
        expected = rk4(lambda y: pendulum_rate(y, 0.3, self.LAW), np.zeros(2), 2e-4, 10000, 1250)
        for head, axis, stepper, rtol, bound in ((PLANE, "", "dop853", 1e-9, 1e-7), (SPACE, "axis = [0, 0, 1]\n", "dop853", 3e-9, 1e-6),
                                                 (PLANE, "", "radau5", 1e-7, 1e-5), (SPACE, "axis = [0, 0, 1]\n", "radau5", 1e-6, 1e-4)):
            settings = [f'solver.stepper="{stepper}"', f"solver.rtol={rtol}", "output.interval=0.25", "time.end=2"]
            with self.subTest(head=head, stepper=stepper), self.went(self.scene(pendulum(head, self.MORE, axis)), *settings) as file:
                self.near(file["joints/line/angle"][:], expected[:, 0], bound)
                self.near(file["joints/line/rate"][:], expected[:, 1], 10*bound)
                residual, scale = energies(file)
                self.assertLess(residual, 10*bound*scale)
        checked = json.loads(self.tandem("check", "scene.toml", "--json").stdout)
        # Random states are far above the transition speed, where little is left of the derivative.
        self.assertLessEqual(max(procedure["error"] for procedure in checked["procedures"]), 1e-8)

    def test_two_pendulums(self):
        """Each joint's friction presses the other one. Reference: all equations with the multipliers solved by the contraction, in the
        two angles, by RK4."""
        law, radius = (0.3, 0.3, 0.5), 0.2
        text = PLANE + "".join(
            f'[body.{name}]\nmass = 2\ninertia = "1/6"\nposition = [{x}, 0]\n\n[joint.hinge_{name}]\ntype = "revolute"\n'
            f'bodies = ["{other}", "{name}"]\nat = [{x - 0.5}, 0]\n\n[force.rub_{name}]\ntype = "friction"\njoint = "hinge_{name}"\n'
            f'dynamic = {law[0]}\nspeed = {law[2]}\nradius = {radius}\n\n'
            for name, other, x in (("one", "ground", 0.5), ("two", "one", 1.5))) + \
            '[results]\njoints = "all"\nforces = "all"\nbalance = true\n\n[time]\nend = 1\n\n' + TIGHT
        mass = np.diag([2, 2, 1/6, 2, 2, 1/6])

        def rate(y):
            one, two, w1, w2 = y
            s1, c1, s2, c2 = np.sin(one), np.cos(one), np.sin(two), np.cos(two)
            c = np.array([[1, 0, 0.5*s1, 0, 0, 0], [0, 1, -0.5*c1, 0, 0, 0],
                          [-1, 0, 0.5*s1, 1, 0, 0.5*s2], [0, -1, -0.5*c1, 0, 1, -0.5*c2]])
            gamma = 0.5*np.array([c1*w1**2, s1*w1**2, c1*w1**2 + c2*w2**2, s1*w1**2 + s2*w2**2])
            along = np.array([[0, 0, 1, 0, 0, 0], [0, 0, -1, 0, 0, 1]]).T
            mu = radius*brown_mcphee(np.array([w1, w2 - w1]), *law)
            inverse = np.linalg.inv(np.block([[mass, c.T], [c, np.zeros((4, 4))]]))
            force, normal = np.array([0, -2*G, 0, 0, -2*G, 0]), np.zeros(2)
            for _ in range(200):
                x = inverse @ np.concatenate([force - along @ (mu*normal), -gamma])
                new = np.array([np.linalg.norm(x[6:8]), np.linalg.norm(x[8:10])])
                if np.max(np.abs(new - normal)) <= 1e-13*np.max(new):
                    break
                normal = new
            return np.array([w1, w2, x[2], x[5]])

        # An error of about 1e-10 with this step, as half of it shows.
        expected = rk4(rate, np.zeros(4), 2e-3, 500, 125)
        for stepper in ("dop853", "radau5"):
            with self.subTest(stepper), self.went(self.scene(text), f'solver.stepper="{stepper}"', "solver.rtol=1e-10",
                                                  "output.interval=0.25") as file:
                self.near(file["joints/hinge_one/angle"][:], expected[:, 0], 1e-7)
                self.near(file["joints/hinge_two/angle"][:], expected[:, 1] - expected[:, 0], 1e-7)
                residual, scale = energies(file)
                self.assertLess(residual, 1e-8*scale)


class Linearised(Mechanism):
    def test_a_damper_at_rest(self):
        """Hanging at rest the hinge carries the weight: J s^2 + radius m g mu'(0) s + m g l = 0. Sliding is refused."""
        text = pendulum(PLANE, "dynamic = 0.01\nstatic = 0.02\nspeed = 0.5\nradius = 0.3\n").replace("[0.5, 0]", "[0, -0.5]")
        said = json.loads(self.tandem("linearise", self.scene(text), "--json").stdout)
        slope = (4*0.01 + 0.01/0.75**2)/0.5
        expected = np.roots([2/3, 0.3*2*G*slope, 2*G*0.5])
        found = [complex(*pair) for pair in said["eigenvalues"]]
        self.near(sorted(found, key=lambda value: value.imag), sorted(expected, key=lambda value: value.imag), 1e-9)
        moving = text.replace("[joint.line]", "omega = 1\nvelocity = [0.5, 0]\n\n[joint.line]")
        self.assertIn("friction", self.tandem("linearise", self.scene(moving), "--json", code=1).stderr)


class Resumed(Mechanism):
    def test_bitwise(self):
        """A resumed run equals an uninterrupted one, with Newton matrices that contain the derivatives of normal forces."""
        scene = self.scene(tilting("dynamic = 0.4\nstatic = 0.5\nspeed = 0.5\narm = 0.25\n"))
        settings = ["--set", 'solver.stepper="radau5"', "--set", "solver.rtol=1e-6", "--quiet", "--no-error"]
        self.tandem("run", scene, *settings, "--output", "whole.h5")
        self.tandem("run", scene, *settings, "--set", "solver.max_steps=7", "--output", "part.h5", code=1)
        self.tandem("resume", "part.h5", "--set", "solver.max_steps=100000", "--quiet")
        with h5py.File(self.folder / "whole.h5") as whole, h5py.File(self.folder / "part.h5") as part:
            self.assertGreater(len(whole["trajectory/time"]), 10)
            for path in ("trajectory/q", "forces/rub/force", "balance/residual"):
                np.testing.assert_array_equal(whole[path][:], part[path][:])


class Sparse(Mechanism):
    def test_as_dense(self):
        """Both charts find the same motion and the same reactions."""
        text = tilting("dynamic = 0.4\nstatic = 0.5\nspeed = 0.5\narm = 0.25\n")
        for stepper in ("dop853", "radau5"):
            settings = [f'solver.stepper="{stepper}"', "solver.rtol=1e-11", "output.interval=0.25"]
            with self.subTest(stepper), self.went(self.scene(text), *settings, 'solver.chart_kind="dense"') as file:
                q, force = file["trajectory/q"][:], file["forces/rub/force"][:]
            with self.went(self.scene(text), *settings, 'solver.chart_kind="sparse"') as file:
                self.near(file["trajectory/q"][:], q, 1e-8)
                self.near(file["forces/rub/force"][:], force, 1e-7)


class Refused(Mechanism):
    def test_wrong_words(self):
        for text, says in ((incline(0, "dynamic = 0.3\nspeed = 1\nradius = 2\n"), ["rub", "radius"]),
                           (pendulum(PLANE, "dynamic = 0.3\nspeed = 1\n"), ["rub", "radius"]),
                           (pendulum(PLANE, "dynamic = 0.3\nspeed = 1\nradius = 0\n"), ["radius"]),
                           (incline(0, "dynamic = 0.3\nspeed = 1\nnormal = 2\narm = 1\n"), ["rub", "arm"]),
                           (incline(0, "dynamic = 0.3\nspeed = 1\narm = -1\n"), ["arm"])):
            with self.subTest(text):
                self.refused("check", self.scene(text), says=says)

    def test_where_reactions_are_undetermined(self):
        """A plane beside the hinge leaves the force along the axis undetermined."""
        text = pendulum(SPACE, "dynamic = 0.3\nspeed = 1\nradius = 0.1\n", "axis = [0, 0, 1]\n") + \
            '\n[joint.other]\ntype = "point_on_plane"\nbodies = ["ground", "rod"]\nat = [0, 0, 0]\naxis = [0, 0, 1]\n'
        self.refused("run", self.scene(text), "--output", "two.h5", says=["friction", "redundant"])


if __name__ == "__main__":
    unittest.main()
