# SPDX-License-Identifier: MIT
"""tandem linearise and tandem equilibrium as users call them: what --json says, where scenes rest, and what is refused."""

import json
import re
import unittest

import h5py
import numpy as np
from test_output import ROOT, Case

SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))
# Constraints or a motor move them, so that they cannot rest.
DRIVEN = {"mechanism_chopper", "mechanism_motorcycle", "motorcycle", "motorcycle_chopper", "slider_crank"}
RESTLESS = {"parallelogram"}
UNSTABLE = {"a02_four_bars", "a03_andrews", "bicycle", "centric_slider_crank", "mechanism_disk", "rolling_disk", "spatial_slider_crank"}


CART = """
[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.cart]
mass = 2.0
inertia = 0.1
position = [0, 0]
[joint.rail]
type = "prismatic"
bodies = ["ground", "cart"]
at = [0, 0]
axis = [1, 0]
"""
# A cart on a spring, which a force pushes; a pendulum that hangs from a cart with imposed displacement.
PUSHED = CART + """
[force]
spring = { type = "spring", between = ["ground:[-1, 0]", "cart"], stiffness = 50, damping = 0.8 }
push = { type = "load", on = "cart", force = [3, 0], factor = 0 }
[sensor]
cart = { point = "cart" }
rail = { joint = "rail" }
[time]
end = 1
"""
# A torsion spring that is at rest more than half a turn away from the drawing.
WOUND = """
[scene]
model = "mechanism"
[body.wheel]
mass = 1
inertia = [0.1, 0.1, 0.2]
position = [0, 0, 0]
[joint.pin]
type = "revolute"
bodies = ["ground", "wheel"]
at = [0, 0, 0]
axis = [0, 0, 1]
[force.coil]
type = "torsion"
joint = "pin"
stiffness = 2
damping = 0.1
angle = 4.0
[time]
end = 1
[initial]
equilibrium = true
"""
# An arm that hangs from a shaft, which a motor turns about the vertical.
HOOP = """
[scene]
model = "mechanism"
[parameters]
w = 3.0
[gravity]
vector = [0, 0, -9.81]
[body.shaft]
mass = 1
inertia = [1, 1, 1]
position = [0, 0, 0]
omega = [0, 0, "w"]
[body.arm]
mass = 1
inertia = INERTIA
position = [0, 0, -1]
omega = [0, 0, "w"]
[joint.motor]
type = "revolute"
bodies = ["ground", "shaft"]
at = [0, 0, 0]
axis = [0, 0, 1]
motion = "w*t"
[joint.hinge]
type = "revolute"
bodies = ["shaft", "arm"]
at = [0, 0, 0]
axis = [0, 1, 0]
[time]
end = 1
"""
# A disk between a shaft, which a motor turns, and the ground.
ROTOR = """
[scene]
model = "mechanism"
[parameters]
w = 3.0
[body.shaft]
mass = 1
inertia = [1, 1, 1]
position = [0, 0, 0]
omega = [0, 0, "w"]
[body.disk]
mass = MASS
inertia = [0.1, 0.1, 0.15]
position = [0, 0, 0]
omega = [0, 0, "w"]
[joint.motor]
type = "revolute"
bodies = ["ground", "shaft"]
at = [0, 0, 0]
axis = [0, 0, 1]
motion = "w*t"
[joint.slide]
type = "primitive"
bodies = ["shaft", "disk"]
at = [0, 0, 0]
axis = [0, 0, 1]
hold = [0, 0, 1, 1, 1, 1]
[force.inner]
type = "bushing"
between = ["shaft", "disk"]
at = [0, 0, 0]
axis = [0, 0, 1]
stiffness = [800, 800, 0, 0, 0, 0]
damping = [INNER, INNER, 0, 0, 0, 0]
[force.outer]
type = "bushing"
between = ["ground", "disk"]
at = [0, 0, 0]
axis = [0, 0, 1]
stiffness = [200, 200, 0, 0, 0, 0]
damping = [OUTER, OUTER, 0, 0, 0, 0]
[time]
end = 1
"""
# Whose rod has no length yet.
COINCIDING = """
[scene]
model = "mechanism"
planar = true
[body.bob]
mass = 0.1
inertia = 0.2
position = [0, 1]
[body.rod]
mass = 1.1
inertia = 1
position = [0, 0]
points = { tip = [0, 1] }
[joint.pin]
type = "revolute"
bodies = ["ground", "rod"]
at = [0, 0]
[force.pad]
type = "bushing"
between = ["bob", "ground"]
at = [1, 0]
stiffness = [1, 2, -0.1]
damping = [0.5, 2, 0.1]
[constraint.link]
type = "distance"
between = ["bob", "rod.tip"]
length = 1
[time]
end = 1
"""
SLEEPING_TOP = """
[scene]
model = "mechanism"
[parameters]
w = 100
[gravity]
vector = [0, 0, -9.81]
[body.top]
mass = 1.0
inertia = [0.02, 0.02, 0.01]
position = [0, 0, 0.3]
omega = [0, 0, "w"]
[joint.tip]
type = "spherical"
bodies = ["ground", "top"]
at = [0, 0, 0]
[time]
end = 1
"""
ZIEGLER = """
[scene]
model = "mechanism"
planar = true
[parameters]
push = 1
[body]
first = { mass = 2, inertia = 0, position = [1, 0] }
second = { mass = 1, inertia = 0, position = [2, 0] }
[joint]
foot = { type = "revolute", bodies = ["ground", "first"], at = [0, 0] }
knee = { type = "revolute", bodies = ["first", "second"], at = [1, 0] }
[force]
at_foot = { type = "torsion", joint = "foot", stiffness = 1 }
at_knee = { type = "torsion", joint = "knee", stiffness = 1 }
follower = { type = "load", on = "second", force = ["-push", 0], in_body = true }
[time]
end = 1
"""
SWUNG = CART + """
motion = 0
[body.bob]
mass = 0.5
inertia = 0.02
position = [0, -0.8]
[joint.pin]
type = "revolute"
bodies = ["cart", "bob"]
at = [0, 0]
[sensor]
pin = { joint = "pin" }
bob = { point = "bob" }
[time]
end = 1
"""


class Linearisation(Case):
    def transfer(self, said, source, output, s):
        """From a motion with its rate and acceleration, or from a force, to an output: C (s - A)^-1 B + D at s."""
        a, b, c, d = (np.array(said[name]) for name in "abcd")
        row = said["outputs"].index(output)
        total = 0
        for order in range(3):
            name = source + order * "'"
            if name in said["inputs"]:
                column = said["inputs"].index(name)
                state = np.linalg.solve(s * np.eye(len(a)) - a, b[:, column])
                total += (c[row] @ state + d[row, column]) * s**order
        return total

    def test_a_force_as_input(self):
        said = self.said("linearise", self.scene(PUSHED), "--output", "cart.h5")
        self.assertEqual(said["inputs"], ["push"])
        for s in (0.3, 1 + 2j, 7j):
            way = 3 / (2 * s**2 + 0.8 * s + 50)
            for output, expected in (("rail/displacement", way), ("rail/speed", s * way), ("cart/position[1]", way),
                                     ("cart/acceleration[1]", s**2 * way), ("cart/position[2]", 0)):
                # Sensors by differences of fourth order with displacements of 1e-3.
                self.assertLess(abs(self.transfer(said, "push", output, s) - expected), 1e-11)
        with h5py.File(self.folder / "cart.h5") as file:
            group = file["linearisation"]
            for name in "abcd":
                self.assertEqual(group[name][:].tolist(), said[name])
            self.assertEqual(group["eigenvalues"][:].tolist(), said["eigenvalues"])
            self.assertEqual([name.decode() for name in group["outputs"][:]], said["outputs"])
            self.assertEqual(group.attrs["kind"], "equilibrium")
        self.refused("linearise", "scene.toml", "--output", "cart.h5", says="exists")

    def test_a_motion_as_input(self):
        """The pivot at u: J phi'' = -m l (g phi + u''), the bob's place u + l phi."""
        said = self.said("linearise", self.scene(SWUNG))
        self.assertEqual(said["inputs"], ["rail", "rail'", "rail''"])
        inertia = 0.02 + 0.5 * 0.8**2
        for s in (0.3, 1 + 2j, 7j):
            angle = -0.4 * s**2 / (inertia * s**2 + 0.4 * 9.81)
            for output, expected in (("pin/angle", angle), ("pin/rate", s * angle), ("bob/position[1]", 1 + 0.8 * angle),
                                     ("bob/velocity[1]", s + 0.8 * s * angle),
                                     ("bob/acceleration[1]", s**2 * (1 + 0.8 * angle))):
                self.assertLess(abs(self.transfer(said, "rail", output, s) - expected), 1e-10 * max(1, abs(expected)))

    def said(self, *words):
        return json.loads(self.tandem(*words, "--json").stdout)

    def test_the_benchmark(self):
        """The command of the documentation: all eigenvalues of the bicycle, sorted, in full precision."""
        said = self.said("linearise", "bicycle", "--set", "parameters.speed=2")
        values = [complex(*pair) for pair in said["eigenvalues"]]
        self.assertEqual(len(values), 10)
        self.assertEqual([value.real for value in values], sorted(value.real for value in values))
        for expected in (-8.673879848317, -3.071586456415, 2.682345175127 + 1.680662965907j, 2.682345175127 - 1.680662965907j):
            # Half a unit of the last digit, and what the matrix has of errors.
            self.assertLess(min(abs(value - expected) for value in values), 1e-12)
        self.assertEqual(sum(mode["cause"] != "motion" for mode in said["modes"]), 6)
        self.assertEqual(said["kind"], "steady motion")
        self.assertEqual(said["zeros"], {"count": 6, "jordan_blocks": [2, 2, 1, 1]})
        # The matrix is the one whose eigenvalues these are; zeros in its Jordan blocks come out as 1e-8 of numpy.
        found = np.sort_complex(np.linalg.eigvals(np.array(said["a"])))
        self.assertLess(np.max(np.abs(found - np.sort_complex(np.array(values)))), 1e-6)

    def test_at_a_time_of_a_run(self):
        """The pendulum at its lowest point moves: no equilibrium, and the same eigenvalues as at the start of a run from there."""
        said = self.said("linearise", "a01_pendulum", "--at", "0.5")
        self.assertAlmostEqual(said["time"], 0.5)
        self.assertEqual(said["kind"], "instant")

    def test_every_scene_is_linearised(self):
        for scene in SCENES:
            with self.subTest(scene):
                said = self.said("linearise", scene)
                self.assertEqual(len(said["eigenvalues"]), said["n_v"] + said["n_w"])

    def test_every_scene_rests_or_says_why_not(self):
        for scene in SCENES:
            with self.subTest(scene):
                if scene in DRIVEN:
                    refused = self.tandem("equilibrium", scene, code=1)
                    self.assertIn("no_equilibrium", refused.stderr)
                    self.assertIn("constraints impose a motion", refused.stderr)
                    continue
                if scene in RESTLESS:
                    self.assertIn("no_equilibrium", self.tandem("equilibrium", scene, code=1).stderr)
                    continue
                said = self.said("equilibrium", scene)
                self.assertEqual(said["stability"] == "unstable", scene in UNSTABLE)
                self.assertLess(said["residual"], 1e-9)

    def test_where_a_pendulum_hangs(self):
        said = self.said("equilibrium", "a01_pendulum")
        self.assertLess(max(abs(np.array(said["q"]) - [0, -1])), 1e-13)
        found = sorted(value[1] for value in said["eigenvalues"])
        self.assertLess(max(abs(np.array(found) - [-(9.81**0.5), 9.81**0.5])), 1e-13)

    def test_a_pendulum_upside_down(self):
        """Newton's iteration finds the unstable equilibrium that is near."""
        said = self.said("equilibrium", "a01_pendulum", "--set", "body.bob.position=[0.6, 0.8]")
        self.assertEqual(said["stability"], "unstable")
        self.assertLess(max(abs(np.array(said["q"]) - [0, 1])), 1e-13)

    def test_what_cannot_be_evaluated_ends_the_search(self):
        """A rod of length zero has no direction: forces and their derivatives are NaN. A search for equilibrium once did not end there."""
        (self.folder / "coinciding.toml").write_text(COINCIDING)
        refused = self.tandem("equilibrium", "coinciding.toml", code=2)
        self.assertIn("not_finite", refused.stderr)
        self.assertIn("a rod of length zero", refused.stderr)

    def test_a_run_from_an_equilibrium_stays_there(self):
        # The steepest direction has a rate of some 4 /s: rounding grows by e^4, that of stages beside the manifold on the sparse chart to a
        # tenth of the tolerance.
        for kind, allowed in (("dense", 1e-12), ("sparse", 5e-12)):
            with self.subTest(kind):
                self.tandem("run", "a04_bricard", "--set", "initial.equilibrium=true", "--set", "time.end=1", "--set",
                            f"solver.chart_kind={kind}", "--output", f"{kind}.h5", "--quiet")
                with h5py.File(self.folder / f"{kind}.h5") as file:
                    q = file["trajectory/q"][:]
                self.assertLess(np.max(np.abs(q - q[0])), allowed)

    def test_a_governor_turns_as_it_does(self):
        """Its steady motion at the speed of the start is kept by a run, to the tolerance of that."""
        settings = ["--set", 'initial.steady=["world.rotation_z"]']
        said = self.said("linearise", "a05_governor", *settings)
        self.assertEqual(said["kind"], "steady motion")
        self.assertAlmostEqual(said["steady"]["world.rotation_z"], 2 * np.pi, places=12)
        short = ["--set", "time.end=0.3", "--set", "solver.stepper=radau5", "--set", "solver.rtol=1e-8"]
        self.tandem("run", "a05_governor", *settings, *short, "--output", "steady.h5", "--quiet", "--no-error")
        with h5py.File(self.folder / "steady.h5") as file:
            s = file["sensors/s/displacement"][:]
        self.assertLess(np.max(np.abs(s - s[0])), 1e-9)

    def test_the_nearest_steady_motion(self):
        """After a push the bicycle continues at nearly its speed; the nearest steady motion is straight ahead at that speed. Steady
        turns of a rider who does not steer lie beside the speed of capsize alone, 1 m/s from there."""
        for push, far in ((30, 0.002), (120, 0.01)):
            self.tandem("run", "bicycle", "--set", f"parameters.push={push}", "--set", "time.end=1.5", "--set", "solver.stepper=dop853",
                        "--set", "solver.rtol=1e-9", "--output", f"push{push}.h5", "--quiet", "--no-error")
            with h5py.File(self.folder / f"push{push}.h5") as file:
                q, qd = (file[f"trajectory/{name}"][-1].tolist() for name in ("q", "qd"))
            said = self.said("linearise", "bicycle", "--set", "parameters.push=0", "--set", f"initial.q={q}", "--set", f"initial.qd={qd}",
                             "--set", 'initial.steady=["any"]')
            self.assertEqual(said["kind"], "steady motion")
            velocity, before = said["qd"][7:9], qd[7:9]
            # The swerving left by the push is not in it: a part of the velocity, measured as 1e-3 and 4e-3 m/s.
            self.assertLess(np.hypot(*np.subtract(velocity, before)), far)
            self.assertNotIn("world.rotation_z", said["steady"])

    def test_rates_that_are_held(self):
        said = self.said("linearise", "bicycle", "--steady", "any,rear.spin_y=18")
        # Rolling without slip: the speed is that of the wheel.
        self.assertAlmostEqual(said["steady"]["rear.spin_y"], 18, places=12)
        self.assertAlmostEqual(said["qd"][7], 18*0.3, places=11)
        said = self.said("linearise", "a05_governor", "--steady", "world.rotation_z=7")
        self.assertAlmostEqual(said["steady"]["world.rotation_z"], 7, places=12)
        self.assertEqual(said["kind"], "steady motion")
        # A turn at a speed at which the bicycle does not turn by itself.
        refused = self.tandem("linearise", "bicycle", "--steady", "any,world.rotation_z=0.1,rear.spin_y=16.7", code=1)
        self.assertIn("no steady motion", refused.stderr)
        for names, piece in (("any,rear.spin_y=fast", "not a finite number"), ("any,rear.spin=3", "only the rate of a single motion"),
                             ("any,rear.spinn_y=3", "is not one of"),
                             ("world.turn_z", 'did you mean "world.rotation_z"?'), ("any,rear.spin_y=1e999", "not a finite number")):
            self.assertIn(piece, self.tandem("linearise", "bicycle", "--steady", names, code=2).stderr)

    def test_a_steady_turn_is_kept_for_100_s(self):
        """The bicycle in a turn whose rate is held, the others free: what a run from it does."""
        turn = 0.03
        settings = ["--set", "parameters.push=0", "--set", f'initial.steady=["any", "world.rotation_z={turn}"]']
        self.assertAlmostEqual(self.said("linearise", "bicycle", *settings)["steady"]["world.rotation_z"], turn, places=12)
        self.tandem("run", "bicycle", *settings, "--set", "time.end=100", "--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-11",
                    "--set", "output.interval=1", "--output", "turn.h5", "--quiet", "--no-error",
                    # 15 s of a debug build, and much more of one on a machine that does other things.
                    timeout=600)
        with h5py.File(self.folder / "turn.h5") as file:
            t, q, qd, steer = (file[name][:] for name in ("trajectory/time", "trajectory/q", "trajectory/qd", "sensors/steer/angle"))
        place, velocity = q[:, 7] + 1j * q[:, 8], qd[:, 7] + 1j * qd[:, 8]
        circle = place[0] + velocity[0] * (np.exp(1j * turn * t) - 1) / (1j * turn)
        # Local errors add up to some 1e-9. Over 600 m a part of it in the rates is 1e-6 m.
        self.assertLess(np.max(np.abs(steer - steer[0])), 1e-8)
        self.assertLess(np.max(np.abs(np.abs(velocity) - abs(velocity[0]))), 1e-7)
        self.assertLess(np.max(np.abs(place - circle)), 1e-4)

    def test_critical_speeds(self):
        """Weave and capsize of the bicycle against its 2 x 2 form: capsize where K is singular, weave by the criterion of Routh."""
        g, m, c1, k0, k2 = 9.81, *(np.array(entries).reshape(2, 2) for entries in (
            [80.81722, 2.31941332208709, 2.31941332208709, 0.29784188199686],
            [0, 33.86641391492494, -0.85035641456978, 1.68540397397560],
            [-80.95, -2.59951685249872, -2.59951685249872, -0.80329488458618],
            [0, 76.59734589573222, 0, 2.65431523794604]))

        def routh(v):
            c, k = v * c1, g * k0 + v**2 * k2
            parts = [[(m[i, j], c[i, j], k[i, j]) for j in (0, 1)] for i in (0, 1)]
            a = np.polymul(parts[0][0], parts[1][1]) - np.polymul(parts[0][1], parts[1][0])
            return a[1] * a[2] * a[3] - a[0] * a[3] ** 2 - a[1] ** 2 * a[4]

        low, high = 4.0, 5.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if (routh(middle) > 0) == (routh(low) > 0) else (low, middle)
        capsize = np.sqrt(g * (k0[0, 1] ** 2 - k0[0, 0] * k0[1, 1]) / (k0[0, 0] * k2[1, 1] - k2[0, 1] * k0[0, 1]))
        said = self.said("study", "modes", "bicycle", "--over", "parameters.speed=3:8:6", "--output", "loci.csv")
        weave, fall = said["critical"]
        self.assertEqual([weave["crossing"], weave["grows_beyond"]], ["hopf", False])
        self.assertEqual([fall["crossing"], fall["grows_beyond"]], ["zero", True])
        # The form has 15 digits; the places move by 1e-13 or so with its last ones.
        self.assertLess(abs(weave["value"] - low), 1e-11)
        self.assertLess(abs(fall["value"] - capsize), 1e-11)
        lines = (self.folder / "loci.csv").read_text().splitlines()
        self.assertEqual(lines[0], "value,re,im,cause")
        self.assertEqual(len(lines), 1 + 6 * 10)
        # The same where a sample is so near that the eigenvalue counts among the zeros.
        for over in ("parameters.speed=0:10:101", f"parameters.speed=6:{float(capsize + (capsize - 6))!r}:3"):
            fall = self.said("study", "modes", "bicycle", "--over", over)["critical"][-1]
            self.assertLess(abs(fall["value"] - capsize), 1e-10)
        # Real ones that meet and part as a pair cross nothing.
        rows = self.said("study", "modes", "bicycle", "--over", "parameters.speed=1:2:2")
        self.assertEqual([len(rows["rows"]), rows["critical"]], [2, []])

    def test_critical_speeds_of_a_driven_hoop(self):
        """Arms on a driven shaft in space: each leaves the vertical at w^2 (m l^2 + I1 - I3) = m g l, within what is stated."""
        for inertia, over in (((0.1, 0.1, 0.1), "1:8:15"), ((0.1, 0.3, 0.35), "2:6:2"), ((0.02, 0.04, 0.05), "3:3.5:40")):
            with self.subTest(over):
                (self.folder / "hoop.toml").write_text(HOOP.replace("INERTIA", str(list(inertia))))
                found, = self.said("study", "modes", "hoop.toml", "--over", "parameters.w=" + over)["critical"]
                exact = np.sqrt(9.81/(1 + inertia[0] - inertia[2]))
                self.assertEqual([found["crossing"], found["grows_beyond"]], ["zero", True])
                self.assertLess(abs(found["value"] - exact), min(1e-9, found["uncertainty"]))

    def test_the_critical_speed_of_a_rotor_with_inner_damping(self):
        """Inner damping drives whirl from w = sqrt(k/m) (1 + c_outer/c_inner) on, whatever the samples are."""
        for mass, inner, outer in ((2, 3, 1), (0.5, 0.3, 0.7), (7, 25, 2)):
            text = ROTOR.replace("MASS", str(mass)).replace("INNER", str(inner)).replace("OUTER", str(outer))
            (self.folder / "rotor.toml").write_text(text)
            exact = np.sqrt(1000/mass)*(1 + outer/inner)
            for low, high, n in ((0.3, 1.1, 2), (0.4, 1.9, 3), (0.85, 1.5, 2), (0.6, 2.0, 6)):
                with self.subTest((mass, low)):
                    over = f"parameters.w={float(low*exact)}:{float(high*exact)}:{n}"
                    found, = self.said("study", "modes", "rotor.toml", "--over", over)["critical"]
                    self.assertEqual([found["crossing"], found["grows_beyond"]], ["hopf", True])
                    self.assertLess(abs(found["value"] - exact), min(1e-9*exact, found["uncertainty"]))

    def test_a_start_at_rest_beyond_half_a_turn(self):
        """Turns are counted from the reference configuration to the equilibrium, and the run stays there."""
        (self.folder / "wound.toml").write_text(WOUND)
        self.tandem("run", "wound.toml", "--quiet", "--no-error")
        with h5py.File(self.folder / "wound.h5") as file:
            self.assertLess(np.ptp(file["trajectory/q"][:], axis=0).max(), 1e-12)
            self.assertAlmostEqual(2*np.arctan2(file["trajectory/q"][-1, 6], file["trajectory/q"][-1, 3]) % (2*np.pi), 4.0, delta=1e-9)

    def test_critical_values_of_what_loses_no_energy(self):
        """Two eigenvalues that meet at zero, or two pairs that meet on the imaginary axis, against closed forms."""
        disk = ("mechanism_disk", "--set", 'body.disk.velocity=[0,"w",0]', "--set", 'body.disk.omega=["-w",0,0]', "--set", "parameters.w=1")
        for over in "1:3:11", "1.5:2:2", "1:3:41", "1.7888:1.7889:3":
            with self.subTest(over):
                found, = self.said("study", "modes", *disk, "--over", "parameters.w=" + over)["critical"]
                self.assertEqual([found["crossing"], found["grows_beyond"]], ["zero", False])
                exact = np.sqrt(10*9.6*2.5001/(5*(5 + 10)))
                self.assertLess(abs(found["value"] - exact), 1e-10)
                self.assertLess(abs(found["value"] - exact), found["uncertainty"])
        top = self.folder / "top.toml"
        top.write_text(SLEEPING_TOP)
        inertia, height = 0.02, 0.3
        for over in "50:300:30", "113:115:2", "100:120:3":
            with self.subTest(over):
                found, = self.said("study", "modes", str(top), "--over", "parameters.w=" + over)["critical"]
                self.assertEqual([found["crossing"], found["grows_beyond"]], ["krein", False])
                exact = 2*np.sqrt((inertia + height**2)*9.81*height)/0.01
                self.assertLess(abs(found["value"] - exact), 1e-9)
                self.assertLess(abs(found["value"] - exact), found["uncertainty"])
                # Nutation and precession are one there, half of C omega/A'.
                self.assertLess(abs(found["eigenvalue"][1] - 0.01*exact/(2*(inertia + height**2))), 1e-5)
        # Ziegler's column (1952): two rods, masses 2 and 1, springs of 1, a force that follows the last rod.
        column = self.folder / "column.toml"
        column.write_text(ZIEGLER)
        found, = self.said("study", "modes", str(column), "--over", "parameters.push=0.5:3:26")["critical"]
        self.assertEqual([found["crossing"], found["grows_beyond"]], ["krein", True])
        self.assertLess(abs(found["value"] - (3.5 - np.sqrt(2))), 1e-9)

    def test_a_study_of_modes_that_cannot_be(self):
        for over in ("parameters.speed", "parameters.speed=1:2", "parameters.speed=2:1:3", "parameters.speed=1:2:1",
                     "parameters.speed=1:2:x", "=1:2:3"):
            with self.subTest(over):
                self.assertIn("--over KEY=a:b:n", self.tandem("study", "modes", "bicycle", "--over", over, code=2).stderr)
        self.assertIn("body.fram", self.tandem("study", "modes", "bicycle", "--over", "body.fram.mass=1:2:3", code=2).stderr)
        # Parameters may have any name, and have no effect if unused.
        self.assertIn("do not change", self.tandem("study", "modes", "bicycle", "--over", "parameters.spee=1:2:3").stderr)
        self.assertIn("cannot write", self.tandem("study", "modes", "bicycle", "--over", "parameters.speed=1:2:2", "--output",
                                                  "no/such/file.csv", code=1).stderr)

    def test_the_page(self):
        """Every command of doc/linearisation.md runs as it is written, and says what the page shows."""
        page = (ROOT / "doc" / "linearisation.md").read_text()
        blocks = re.findall(r"^```(\w*)\n(.*?)^```$", page, re.M | re.S)
        for kind, text in blocks:
            if kind == "toml" and text.startswith("# chain.toml"):
                self.scene(text, "chain.toml")
        shown = 0
        for (kind, text), (_, answer) in zip(blocks, [*blocks[1:], ("", "")], strict=True):
            for line in text.splitlines() if kind == "sh" else []:
                done = self.tandem(*line.split()[1:])
                # Numbers that begin a line, or follow "critical at"; the last digits are rounding.
                for row in re.findall(r"^(?:critical at )?-?\d[^#\n]*", answer, re.M):
                    numbers = [abs(float(number)) for number in re.findall(r"\d+\.\d{9,}(?:E[+-]\d+)?", row)]
                    said = [abs(float(number)) for number in re.findall(r"\d+\.\d{9,}(?:E[+-]\d+)?", done.stdout)]
                    for number in numbers:
                        shown += 1
                        self.assertLess(min(abs(number - other) for other in said), 1e-10, f"{line}: {number}")
        self.assertGreater(shown, 8)

    def test_what_is_refused(self):
        for words, piece in (
            (["linearise", "bicycle", "--steady", "frame.z"], "not one of any, world.x"),
            (["linearise", "bicycle", "--steady", "any", "--equilibrium"], "cannot be combined"),
            (["linearise", "bicycle", "--at", "-1"], "--at"),
            (["linearise", "bicycle", "--at", "1e300"], "from 0.000000 to 2147483647 after --at"),
            (["linearise", "bicycle", "--period", "0"], "positive"),
            (["linearise", "nothing"], "nothing"),
            (["equilibrium"], "needs a SCENE"),
        ):
            with self.subTest(words):
                self.assertIn(piece, self.tandem(*words, code=2).stderr)
        # A time that takes too many steps ends, and the advice is what can be done.
        self.assertIn("shorter period", self.tandem("linearise", self.scene(PUSHED), "--period", "1e9", code=1).stderr)


if __name__ == "__main__":
    unittest.main()
