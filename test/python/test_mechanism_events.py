# SPDX-License-Identifier: MIT
"""Events of mechanisms: on sensors and reactions, and what they lock, free and change, against closed forms.

A bound of 1e-9 is a hundred times the tolerance of a step."""

import itertools
import unittest

import h5py
import numpy as np
from test_mechanisms import Mechanism
from test_output import ROOT
from test_results import PLANE, SPACE, TIGHT, energies

G = 9.81
STRING = PLANE + f'[body.bob]\nmass = 1\nposition = [0, -1]\nvelocity = [{float(np.sqrt(3.5*G))!r}, 0]\n\n' \
    '[constraint.string]\ntype = "distance"\nbetween = ["ground", "bob"]\n\n[sensor.pull]\nreaction = "string"\n\n' \
    '[sensor.bob]\npoint = "bob"\n\n[time]\nend = 5\n\n' + TIGHT
DISCS = SPACE + "".join(
    f'[body.{name}]\nmass = 1\ninertia = [1, 1, {spin}]\nposition = [0, 0, {z}]\nomega = [0, 0, {omega}]\n\n'
    f'[joint.{name}_axle]\ntype = "revolute"\nbodies = ["ground", "{name}"]\nat = [0, 0, {z}]\naxis = [0, 0, 1]\n\n'
    for name, spin, z, omega in (("one", 1, 0, 3), ("two", 0.5, 1, 0))) + \
    '[constraint.clutch]\ntype = "coupling"\njoints = ["one_axle", "two_axle"]\nfactors = [1, -1]\nlocked = false\n\n' \
    '[results]\njoints = "all"\nconstraints = "all"\nbodies = "all"\nbalance = true\n\n[time]\nend = 2\n\n' + TIGHT
SPRING = PLANE.replace("-9.81", "0") + '[body.mass]\nmass = 1\nposition = [3, 0]\n\n[joint.line]\ntype = "point_on_line"\n' \
    'bodies = ["ground", "mass"]\nat = [3, 0]\naxis = [1, 0]\n\n[force.coil]\ntype = "spring"\nbetween = ["ground", "mass"]\n' \
    'stiffness = 1\nlength = 2\n\n[sensor.way]\njoint = "line"\n\n[time]\nend = 3\n\n' + TIGHT

# Upright cranks of length 1 and a coupler of length 2, J = 2/3 + 1 about the pivots, on a spring: a harmonic motion of 2 rad/s.
CRANKS = PLANE.replace("-9.81", "0") + "".join(
    f'[body.{name}]\nmass = 1\ninertia = "1/12"\nposition = [{x}, 0.5]\nvelocity = [-2.5, 0]\nomega = 5\npoints = {{ pin = [0, 0.5] }}\n\n'
    f'[joint.{name}_pivot]\ntype = "revolute"\nbodies = ["ground", "{name}"]\nat = [{x}, 0]\n\n'
    f'[joint.{name}_pin]\ntype = "revolute"\nbodies = ["{name}", "coupler"]\nat = "{name}.pin"\n\n' for name, x in (("left", 0), ("right", 2))) + \
    '[body.coupler]\nmass = 1\ninertia = 1\nposition = [1, 1]\nvelocity = [-5, 0]\n\n[sensor.crank]\njoint = "left_pivot"\n\n' \
    '[force.coil]\ntype = "torsion"\njoint = "left_pivot"\nstiffness = "20/3"\n\n[time]\nend = 1.2\n\n' + TIGHT


def event(name, watch, value, direction="both", **keys):
    lines = {"name": name, "watch": watch, "direction": direction} | keys
    return f'\n[[event]]\nvalue = {value!r}\n' + "".join(f'{key} = "{text}"\n' for key, text in lines.items())


class Watching(Mechanism):
    def test_a_reaction_that_vanishes(self):
        """With v^2 = 3.5 g l at the bottom the string is slack at 120 degrees."""
        text = STRING + event("slack", "/sensors/pull/tension", 0.0, "falling", action="stop")
        with self.went(self.scene(text)) as file:
            self.assertIn('stopped by "slack"', file.attrs["status_message"])
            self.near(file["sensors/bob/position"][-1], [np.sqrt(0.75), 0.5, 0], 1e-9)
            self.near(file["sensors/pull/tension"][-1], 0, 1e-8)

    def test_a_height(self):
        text = STRING + event("level", "/sensors/bob/position.y", -0.5, "rising")
        with self.went(self.scene(text), "time.end=0.5") as file:
            self.assertEqual([name.decode() for name in file["events/name"][:]], ["level"])
            self.near(file["events/q"][0][1], -0.5, 1e-12)

    def test_a_change_in_a_singular_position(self):
        """At, before and behind the flat position of a parallelogram a spring becomes stiffer."""
        for beside in (0.0, 1e-6, -1e-6, 1e-3, -1e-3, 0.05, -0.05):
            at = np.pi/2 + beside
            t = np.arcsin(at/2.5)/2
            rest = 4*(1.2 - t)
            angle = at*np.cos(rest) + 5*np.cos(2*t)/4*np.sin(rest)
            for kind in ("dense", "sparse"):
                with self.subTest(beside=beside, kind=kind):
                    text = CRANKS + event("stiffer", "/sensors/crank/angle", float(at), "rising", change="force.coil.stiffness = 80/3")
                    with self.went(self.scene(text), f"solver.chart_kind={kind}") as file:
                        self.near(file["events/time"][0], t, 1e-8)
                        self.near(file["sensors/crank/angle"][-1], angle, 1e-7)
                        if beside >= 0:
                            self.near(file["events/singular/time"][0], np.arcsin(np.pi/5)/2, 1e-6)

    def test_no_step_passes_a_singular_position_unseen(self):
        """A parallelogram that a motor turns: every flat position is listed, also where steps are as long as the way between two."""
        for stepper, kind, rate in itertools.product(("dop853", "dopri5", "radau5"), ("dense", "sparse"), (8, 12, 20)):
            with self.subTest(stepper=stepper, kind=kind, rate=rate):
                with self.went("parallelogram", f"solver.stepper={stepper}", f"solver.chart_kind={kind}", "solver.rtol=1e-3",
                               f'force.drive.law="20*(1 - rate/{rate})"') as file:
                    angle = np.pi/2 + file["sensors/crank/angle"][-1]
                    self.assertEqual(len(file["events/singular/time"]), abs(np.floor(angle/np.pi)))

    def test_a_near_miss_is_not_a_singular_position(self):
        """The rod of a slider-crank is longer by 1e-8 than the crank: the slider turns back where it would pass through the pivot. At
        these tolerances the difference is far below the errors of the steps."""
        scene = (ROOT / "scenes" / "centric_slider_crank.toml").read_text()
        longer = scene.replace('tip = ["r/2*cos(a)", "-r/2*sin(a)"]', 'tip = ["(1+2e-8)*r/2*cos(a)", "-(1+2e-8)*r/2*sin(a)"]')
        self.assertNotEqual(longer, scene)
        for stepper, kind, rtol in itertools.product(("dop853", "radau5"), ("dense", "sparse"), (1e-4, 1e-5)):
            with self.subTest(stepper=stepper, kind=kind, rtol=rtol):
                with self.went(self.scene(longer), f"solver.stepper={stepper}", f"solver.chart_kind={kind}", f"solver.rtol={rtol}",
                               "time.end=0.5") as file:
                    self.assertNotIn("singular", file.get("events", ()))

    def test_a_run_stops_at_the_first_flat_position(self):
        """Steps at loose tolerances turn these cranks by more than a radian, from one flat position nearly to the next."""
        scene = (ROOT / "scenes" / "parallelogram.toml").read_text()
        heavy = {"r = 0.3 ": "r = 1.92 ", "d = 0.5 ": "d = 4.1 ", '[0, "r/2"]': '["r/2*cos(a)", "r/2*sin(a)"]',
                 '["d", "r/2"]': '["d + r/2*cos(a)", "r/2*sin(a)"]', '["d/2", "r"]': '["r*cos(a) + d/2", "r*sin(a)"]',
                 "[parameters]\n": "[parameters]\na = -0.388\n", 'inertia = "2*d^2/12"': "inertia = 7.2", "mass = 2.0": "mass = 7.8",
                 "stiffness = 50, damping = 2": "stiffness = 20, damping = 4.3",
                 "assemble = true": 'assemble = true\nfixed_velocities = ["left.angle"]',
                 "[body.left]\nmass = 1.0": "[body.left]\nomega = -11.3\nmass = 0.33",
                 '[body.right]\nmass = 1.0\ninertia = "r^2/12"': "[body.right]\nmass = 0.14\ninertia = 0.06"}
        for old, to in heavy.items():
            self.assertIn(old, scene)
            scene = scene.replace(old, to)
        scene = "\n".join(line for line in scene.split("\n") if not line.startswith("drive ="))
        for stepper, rtol in (("dopri5", 1e-3), ("dopri5", 1e-4), ("dop853", 1e-3)):
            with self.subTest(stepper=stepper, rtol=rtol):
                done = self.tandem("run", self.scene(scene), "--set", f"solver.stepper={stepper}", "--set", f"solver.rtol={rtol}",
                                   "--set", "solver.chart_kind=sparse", "--set", "solver.singular=stop", "--quiet", "--no-error",
                                   "--force", code=1)
                self.assertIn("rank_deficient", done.stderr)
                self.assertIn("t = 0.25", done.stderr)

    def test_a_run_may_stop_where_two_loops_are_flat(self):
        """Two ranks are lost at once, which the orientation of C does not show."""
        for kind in ("dense", "sparse"):
            with self.subTest(kind):
                done = self.tandem("run", "a02_four_bars", "--set", "solver.singular=stop", "--set", f"solver.chart_kind={kind}", "--set",
                                   "solver.stepper=dop853", "--set", "solver.rtol=1e-6", "--quiet", "--no-error", "--force", code=1)
                self.assertIn("rank_deficient", done.stderr)
                self.assertIn("t = 0.7143", done.stderr)

    def test_a_limit_of_a_joint(self):
        """A joint's angle after more than a turn."""
        text = DISCS + event("limit", "/joints/one_axle/angle", 5.0, "rising", action="stop")
        with self.went(self.scene(text)) as file:
            self.near(file["trajectory/time"][-1], 5/3, 1e-9)
            self.near(file["joints/one_axle/angle"][-1], 5, 1e-9)

    def test_wrong_events(self):
        cases = {
            event("e", "/sensors/bob/place", 0.0): ["is not an output of the model", "/sensors/bob/position"],
            event("e", "/sensors/pull/traction", 0.0): ['did you mean "/sensors/pull/tension"?'],
            event("e", "/sensors/bob/position", 0.0): [".x, .y or .z"],
            event("e", "/sensors/bob/acceleration.x", 0.0): ["cannot be watched"],
            event("e", "/sensors/pull/tension.x", 0.0): ["is a scalar"],
            event("e", "bob.x", 0.0, change="lock string"): ["string", "locked"],
            event("e", "bob.x", 0.0, change="open the door"): ["not a valid change", "lock NAME"],
            event("e", "bob.x", 0.0, change="force.coil.stiffness = 3"): ["coil", "neither a spring"],
            event("e", "bob.x", 0.0, change="force.coil.stiffness = x"): ["does not set a number"],
        }
        for text, says in cases.items():
            with self.subTest(text):
                self.refused("check", self.scene(STRING + text), says=says)
        text = SPRING + event("e", "mass.x", 0.0, change="force.coil.colour = 3")
        self.refused("check", self.scene(text), says=["colour", "stiffness, damping or length"])
        # A list-directed read takes each of these for a number, or for none without an error.
        for number in ("2*", ",", "/", "1,2", "1e3 xyz", "", "1 2", "1-5x", "1/0", "k"):
            with self.subTest(number):
                text = SPRING + event("e", "mass.x", 0.0, change=f"force.coil.stiffness = {number}")
                self.refused("check", self.scene(text), says=["does not set a number", "force.NAME.KEY = NUMBER"])
        self.refused("check", "rolling_disk", "--set", 'event=[{name="e", watch="phi", change="lock it"}]', says=["event"])


class Changing(Mechanism):
    def test_a_clutch(self):
        """A disc that turns and one at rest go on together with J1 w/(J1 + J2), and the energy that this costs is gone for good;
        freed again, both keep what they have."""
        text = DISCS + event("engage", "/joints/one_axle/angle", 1.5, "rising", change="lock clutch") + \
            event("release", "/joints/two_axle/angle", 1.0, "rising", change="free clutch")
        with self.went(self.scene(text)) as file:
            t, one, two = (file[name][:] for name in ("trajectory/time", "joints/one_axle/rate", "joints/two_axle/rate"))
            self.near(file["events/time"][:], [0.5, 1.0], 1e-10)
            # The row at the event itself may be from before or after it.
            before, after = t < 0.5 - 1e-9, t > 0.5 + 1e-9
            self.near(one[before], 3, 1e-9)
            self.near(one[after], 2, 1e-9)
            self.near(two[before], 0, 1e-12)
            self.near(two[after], 2, 1e-9)
            self.near(file["balance/kinetic"][-1], 3, 1e-9)
            self.near(file["balance/residual"][-1], -1.5, 1e-9)
            self.near(file["joints/two_axle/angle"][-1], 3, 1e-9)
            self.near(file["constraints/clutch/torque"][:], 0, 1e-10)
            # J2 w = 1 comes to the second disc; freeing takes no impulse.
            impulse = file["constraints/clutch/impulse"]
            # M (jump of the first one's rate) = impulse.
            self.near(impulse[:][after], -1, 1e-9)
            self.near(impulse[:][before], 0, 1e-300)
            self.assertEqual(impulse.attrs["unit"], "N m s")

    def test_a_latch(self):
        """A pendulum that is caught at 45 degrees rests there, and the latch carries its weight."""
        text = PLANE + '[body.rod]\nmass = 2\ninertia = "1/6"\nposition = [0.5, 0]\n\n[joint.pivot]\ntype = "revolute"\n' \
            'bodies = ["ground", "rod"]\nat = [0, 0]\n\n[constraint.latch]\ntype = "coupling"\njoints = ["pivot"]\nfactors = [1]\n' \
            'locked = false\n\n[results]\njoints = "all"\nconstraints = "all"\n\n[time]\nend = 2\n\n' + TIGHT + \
            event("catch", "/joints/pivot/angle", -float(np.pi)/4, "falling", change="lock latch")
        with self.went(self.scene(text)) as file:
            after = file["trajectory/time"][:] > file["events/time"][0]
            self.assertGreater(np.count_nonzero(after), 2)
            self.near(file["joints/pivot/angle"][:][after], -np.pi/4, 1e-11)
            self.near(file["joints/pivot/rate"][:][after], 0, 1e-12)
            # It holds the moment of the weight, m g cos(45 degrees)/2.
            self.near(file["constraints/latch/torque"][:][after], 2*G*np.cos(np.pi/4)/2, 1e-10)

    def test_a_latch_in_space_catches_once(self):
        """A coordinate latched at the value of its event stays there up to rounding, which causes no further event."""
        text = SPACE + '[body.rod]\nmass = 2\ninertia = [0.1, 0.4, 0.3]\nposition = [0.5, 0, 0]\n\n' \
            '[body.bob]\nmass = 1\ninertia = [0.1, 0.2, 0.1]\nposition = [1, 0, -0.5]\n\n' \
            '[joint.pivot]\ntype = "revolute"\nbodies = ["ground", "rod"]\nat = [0, 0, 0]\naxis = [0, 1, 0]\n\n' \
            '[joint.hand]\ntype = "revolute"\nbodies = ["rod", "bob"]\nat = [1, 0, 0]\naxis = [0, 1, 0]\n\n' \
            '[constraint.latch]\ntype = "coupling"\njoints = ["hand"]\nfactors = [1]\nlocked = false\n\n' \
            '[results]\njoints = "all"\n\n[time]\nend = 1\n\n[solver]\nstepper = "dop853"\nrtol = 1e-8\n'
        for value in np.linspace(-0.5, 0.0, 17)[1:-1]:
            scene = self.scene(text + event("catch", "/joints/hand/angle", float(value), change="lock latch"))
            with self.subTest(value), self.went(scene) as file:
                self.assertEqual(len(file["events/time"]), 1)
                after = file["trajectory/time"][:] > file["events/time"][0]
                self.near(file["joints/hand/angle"][:][after], value, 1e-11)

    def test_a_latch_catches_once_whatever_else_happens(self):
        """The elbow of a double pendulum is locked at the angle that is watched. Events of its shoulder end steps all along."""
        text = PLANE.replace("[0,", "[1,") + '[initial]\nassemble = true\n\n[time]\nend = 4\n\n[results]\njoints = "all"\n\n' \
            '[body.upper]\nmass = 1\ninertia = 0.1\nposition = [0.1, -0.5]\nomega = 1\n\n[joint.shoulder]\ntype = "revolute"\n' \
            'bodies = ["ground", "upper"]\nat = [0, 0]\n\n[body.lower]\nmass = 0.7\ninertia = 0.05\nposition = [0.3, -1.4]\n' \
            'omega = 3\n\n[joint.elbow]\ntype = "revolute"\nbodies = ["upper", "lower"]\nat = [0.2, -1]\n\n' \
            '[constraint.latch]\ntype = "coupling"\njoints = ["elbow"]\nfactors = [1]\nlocked = false\n\n' \
            '[force.twist]\ntype = "torsion"\njoint = "shoulder"\nstiffness = 2\n' \
            + event("caught", "/joints/elbow/angle", 0.1, change="lock latch")
        for k, angle in enumerate((-0.02, -0.05, -0.1, -0.12, -0.15, -0.2)):
            text += event(f"at{k}", "/joints/shoulder/angle", angle, change="force.twist.stiffness = 2")
        scene = self.scene(text + event("still", "/joints/elbow/rate", 0.0, change="force.twist.stiffness = 2"))
        for stepper in ("sdirk54", "radau5", "dop853", "dopri5", "auto"):
            for rtol in (1e-5, 1e-6, 1e-8):
                settings = [f"solver.stepper={stepper}", f"solver.rtol={rtol}"]
                with self.subTest(settings), self.went(scene, *settings) as file:
                    names = file["events/name"][:].tolist()
                    self.assertEqual(names.count(b"caught"), 1)
                    # The rate of the locked elbow is zero except for rounding, which causes no event.
                    self.assertNotIn(b"still", names[names.index(b"caught"):])
                    self.assertGreater(len(names), 20)
                    self.near(file["joints/elbow/angle"][-1], 0.1, 1e-11)

    def test_a_stop_lets_go(self):
        """An elbow is locked at an angle and freed where the torque of the lock vanishes, be it soon after: there the angle leaves
        the one that is watched with the third power of the time, at first within rounding, and towards either side."""
        text = PLANE.replace("[0,", "[1,") + '[initial]\nassemble = true\n\n[time]\nend = 4\n\n' \
            '[results]\njoints = "all"\nconstraints = "all"\n\n[body.upper]\nmass = 1\ninertia = 0.1\n' \
            'position = [0.1, -0.5]\nomega = {}\n\n[joint.shoulder]\ntype = "revolute"\n' \
            'bodies = ["ground", "upper"]\nat = [0, 0]\n\n[body.lower]\nmass = 0.7\ninertia = 0.05\nposition = [0.3, -1.4]\n' \
            'omega = {}\n\n[joint.elbow]\ntype = "revolute"\nbodies = ["upper", "lower"]\nat = [0.2, -1]\n\n' \
            '[constraint.stop]\ntype = "coupling"\njoints = ["elbow"]\nfactors = [1]\nlocked = false\n' \
            + event("hit", "/joints/elbow/angle", -0.1, change="lock stop") \
            + event("leave", "/constraints/stop/torque", 0.0, change="free stop")
        n_left = 0
        for upper, lower in ((-6, -3), (-3, -3), (4, 3), (-6, 3)):
            scene = self.scene(text.replace("{}", str(upper), 1).replace("{}", str(lower), 1))
            for kind, stepper, rtol in (("dense", "dop853", 1e-10), ("dense", "dopri5", 1e-6), ("dense", "auto", 1e-7),
                                        ("dense", "radau5", 1e-7), ("sparse", "dop853", 1e-10), ("sparse", "radau5", 1e-7)):
                settings = [f"solver.stepper={stepper}", f"solver.rtol={rtol}", f"solver.chart_kind={kind}"]
                with self.subTest((upper, lower), settings=settings), self.went(scene, *settings) as file:
                    # The torque of a lock that is free is zero from the start on, which is one event.
                    t, names = file["events/time"][1:], file["events/name"][1:].tolist()
                    n_left += names.count(b"leave")
                    self.assertEqual(names, [(b"hit", b"leave")[k % 2] for k in range(len(names))])
                    self.assertGreater(np.diff(t).min(initial=1), 1e-3)
        self.assertGreater(n_left, 20)

    def test_a_spring_that_changes(self):
        """k = 1 until the mass passes the middle, k = 4 from there."""
        text = SPRING + event("middle", "/sensors/way/displacement", -1.0, change="force.coil.stiffness = 4", direction="falling")
        with self.went(self.scene(text)) as file:
            t, x = file["trajectory/time"][:], file["sensors/way/displacement"][:] + 1
            self.near(file["events/time"][:], [np.pi/2], 1e-10)
            self.near(x, np.where(t < np.pi/2, np.cos(t), -0.5*np.sin(2*(t - np.pi/2))), 1e-9)

    def test_a_clutch_under_every_stepper(self):
        """A disc with 10 rad/s takes along one of 3/2 of its inertia after 0.5 s, with 4 rad/s. Both keep that
        rate where the clutch is freed and locked again."""
        text = PLANE + "".join(
            f'[body.{name}]\nmass = 1\ninertia = {spin}\nposition = [{x}, 0]\nomega = {rate}\n\n[joint.j{name}]\n'
            f'type = "revolute"\nbodies = ["ground", "{name}"]\nat = [{x}, 0]\n\n'
            for name, spin, x, rate in (("a", 2, 0, 10), ("b", 3, 1, 0))) + \
            '[constraint.clutch]\ntype = "coupling"\njoints = ["ja", "jb"]\nfactors = [1, -1]\nlocked = false\n\n' \
            '[results]\njoints = "all"\n\n[time]\nend = 2\n' + \
            event("engage", "/joints/ja/angle", 5.0, "rising", change="lock clutch") + \
            event("release", "/joints/jb/angle", 3.0, "rising", change="free clutch") + \
            event("again", "/joints/jb/angle", 4.0, "rising", change="lock clutch")
        controlled = ("dopri5", "dop853", "sdirk54", "radau5", "radau", "auto")
        cases = [[f"solver.stepper={name}", "solver.rtol=1e-8"] for name in controlled]
        cases += [[f"solver.stepper={name}", "solver.step=0.01"] for name in ("rk4", "trapezoid", "sdirk54", "radau5")]
        for settings in cases:
            with self.subTest(settings), self.went(self.scene(text), *settings) as file:
                self.near(file["events/time"][:], [0.5, 1.25, 1.5], 1e-10)
                self.near([file["joints/ja/angle"][-1], file["joints/jb/angle"][-1]], [11, 6], 1e-9)
                self.near([file["joints/ja/rate"][-1], file["joints/jb/rate"][-1]], [4, 4], 1e-9)

    def test_resumed(self):
        """A run resumed after a lock is bitwise equal to an uninterrupted one."""
        text = DISCS + event("engage", "/joints/one_axle/angle", 1.5, "rising", change="lock clutch")
        settings = ["--set", "solver.rtol=0", "--set", "solver.step=0.01", "--quiet", "--no-error"]
        scene = self.scene(text)
        self.tandem("run", scene, *settings, "--output", "whole.h5")
        self.tandem("run", scene, *settings, "--set", "solver.max_steps=120", "--output", "part.h5", code=1)
        self.tandem("resume", "part.h5", "--set", "solver.max_steps=100000", "--quiet")
        with h5py.File(self.folder / "whole.h5") as whole, h5py.File(self.folder / "part.h5") as part:
            for path in ("trajectory/q", "joints/two_axle/angle", "balance/residual", "events/time", "constraints/clutch/impulse"):
                np.testing.assert_array_equal(whole[path][:], part[path][:])
            self.near(whole["joints/two_axle/rate"][-1], 2, 1e-10)

    def test_energy_without_a_change(self):
        """A clutch that is never locked has no effect."""
        with self.went(self.scene(DISCS), "output.rows=0") as file:
            residual, scale = energies(file)
            self.assertLess(residual, 1e-10*scale)
            self.near(file["joints/one_axle/rate"][:], 3, 1e-9)
        self.tandem("check", self.scene(DISCS))


if __name__ == "__main__":
    unittest.main()
