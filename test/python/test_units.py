# SPDX-License-Identifier: MIT
"""Mechanisms of any size, written in any units of length, mass and time: the same steps, statuses and results."""

import json
import math
import random
import unittest

from test_output import Case

# Factors of length, mass and time: metres, kilograms and seconds come first.
UNITS = [(1, 1, 1), (1e3, 1, 1), (1e-3, 1e3, 60), (1e6, 1e-6, 1e-3)]
STEPPERS = ["dop853", "radau5", "sdirk54", "auto"]


def numbers(values):
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def chain(seed, length, mass, time):
    """A random chain of bars on springs, in the plane or in space, some of millimetres and some of hundreds of metres."""
    chosen = random.Random(seed)
    planar = seed % 2 == 0
    size = 10**chosen.uniform(-3, 2.5)
    gravity = 9.81 if chosen.random() < 0.7 else 0.0
    down = [0, -gravity] if planar else [0, 0, -gravity]
    lines = ["[scene]", 'model = "mechanism"', "planar = true" if planar else "", "[gravity]",
             f"vector = {numbers(x*length/time**2 for x in down)}"]
    place, before = [0.0]*len(down), "ground"
    # Time of a swing, so that runs of all sizes last as long.
    swing = math.sqrt(size/9.81)
    for i in range(chosen.randint(1, 3)):
        bar, angle, m = size*chosen.uniform(0.5, 1.5), chosen.uniform(-1.5, 1.5), chosen.uniform(0.5, 3)
        along = [math.cos(angle), math.sin(angle)] if planar else [math.cos(angle), 0, math.sin(angle)]
        inertia = m*bar**2/12*mass*length**2
        lines += [f"[body.b{i}]", f"mass = {m*mass}",
                  f"inertia = {inertia}" if planar else f"inertia = {numbers([inertia, 1.1*inertia, 0.9*inertia])}",
                  f"position = {numbers((x + bar/2*d)*length for x, d in zip(place, along))}",
                  f"[joint.j{i}]", 'type = "revolute"', f'bodies = ["{before}", "b{i}"]',
                  f"at = {numbers(x*length for x in place)}", "" if planar else "axis = [0, 1, 0]"]
        place, before = [x + bar*d for x, d in zip(place, along)], f"b{i}"
    anchor = [size*chosen.uniform(-2, 2), *([] if planar else [0.3*size]), size*chosen.uniform(0.5, 2)]
    stiffness = 10**chosen.uniform(0, 2)/swing**2
    lines += ["[force.s]", 'type = "spring"', f'between = ["ground:{numbers(x*length for x in anchor)}", "{before}"]',
              f"stiffness = {stiffness*mass/time**2}", f"length = {size*chosen.uniform(0.2, 1)*length}", f"damping = {0.2/swing*mass/time}",
              "[time]", f"end = {3*swing*time}"]
    scales = [size*length]*len(down) + [1]*(1 if planar else 4)
    return "\n".join(lines) + "\n", scales


def clutch(length, mass, time):
    """A wheel on a spring and a rack, which a clutch couples for a while; a clock of constant speed works the clutch."""
    inertia = mass*length**2
    return "\n".join([
        "[scene]", 'model = "mechanism"', "planar = true",
        "[body.clock]", f"mass = {mass}", f"inertia = {inertia}", f"position = {numbers([-3*length, 0])}", f"omega = {2/time}",
        "[joint.axle]", 'type = "revolute"', 'bodies = ["ground", "clock"]', f"at = {numbers([-3*length, 0])}",
        "[body.wheel]", f"mass = {5*mass}", f"inertia = {0.9*inertia}", f"position = {numbers([0.4*length, 0.3*length])}",
        f"omega = {2.5/time}", "[joint.pin]", 'type = "revolute"', 'bodies = ["ground", "wheel"]', "at = [0, 0]",
        "[body.rack]", f"mass = {2*mass}", f"inertia = {inertia}", f"position = {numbers([0, 2*length])}",
        "[joint.guide]", 'type = "prismatic"', 'bodies = ["ground", "rack"]', f"at = {numbers([0, 2*length])}", "axis = [1, 0]",
        "[constraint.clutch]", 'type = "coupling"', 'joints = ["pin", "guide"]', f"factors = {numbers([length, 1])}", "locked = false",
        "[force.spring]", 'type = "spring"', f'between = ["ground:{numbers([1.2*length, -2.4*length])}", "wheel"]',
        f"stiffness = {27*mass/time**2}", f"damping = {3*mass/time}", f"length = {2.9*length}",
        "[initial]", "assemble = true", "[time]", f"end = {time}", "[results]", 'joints = ["axle"]',
        *[line for name, angle, change in (("one", 0.4, "lock"), ("two", 0.9, "free"), ("three", 1.4, "lock")) for line in
          ("[[event]]", f'name = "{name}"', 'watch = "/joints/axle/angle"', f"value = {angle}", f'change = "{change} clutch"')]]) + "\n"


class Units(Case):
    def one(self, *arguments):
        done = self.tandem(*arguments, "--json")
        return json.loads(done.stdout)

    def ran(self, text, stepper, rtol):
        path = self.scene(text)
        return self.one("run", path, "--set", f"solver.stepper={stepper}", "--set", f"solver.rtol={rtol}", "--no-error",
                        "--set", "output.rows=0", "--quiet", "--force", "--output", "out.h5")

    def test_runs(self):
        """Rounding differs from unit to unit, which may cost a step or two; errors of the motion amplify it."""
        for seed in range(8):
            stepper = STEPPERS[seed//2 % len(STEPPERS)]
            reports = []
            for unit in UNITS:
                text, scales = chain(seed, *unit)
                report = self.ran(text, stepper, 1e-7)
                scaled = [q/scales[i % len(scales)] for i, q in enumerate(report["q"])]
                reports.append((report["status"], len(report["warnings"]), report["figures"]["steps"], scaled))
            for status, warnings, steps, q in reports[1:]:
                with self.subTest(seed=seed, stepper=stepper):
                    self.assertEqual((status, warnings), reports[0][:2])
                    self.assertLessEqual(abs(steps - reports[0][2]), 2 + reports[0][2]//50)
                    self.assertLess(max(abs(a - b) for a, b in zip(q, reports[0][3])), 1e-5)

    def test_latches(self):
        """A coupling that events lock and free has a coordinate without effect, whose mass must not be one kilogram."""
        lengths = [(1, 1, 1), (1e-3, 1e-3, 1/3600), (1e3, 1e-3, 1e3), (1e-6, 1e-15, 1e-3)]
        for stepper in ("sdirk54", "radau5", "dop853"):
            found = []
            for length, mass, time in lengths:
                report = self.ran(clutch(length, mass, time), stepper, 1e-6)
                found.append((report["status"], report["figures"]["steps"], [event["t"]/time for event in report["events"]],
                              report["q"][5], report["q"][8]/length))
            self.assertEqual(len(found[0][2]), 3)
            for other in found[1:]:
                with self.subTest(stepper=stepper):
                    self.assertEqual(other[0], "ok")
                    self.assertLessEqual(abs(other[1] - found[0][1]), 2)
                    for a, b in zip([*other[2], *other[3:]], [*found[0][2], *found[0][3:]], strict=True):
                        self.assertAlmostEqual(a, b, delta=1e-8)

    def test_equilibria(self):
        for seed in range(8):
            found = []
            for unit in UNITS:
                text, scales = chain(seed, *unit)
                report = self.one("equilibrium", self.scene(text))
                found.append([q/scales[i % len(scales)] for i, q in enumerate(report["q"])])
            for q in found[1:]:
                with self.subTest(seed=seed):
                    self.assertLess(max(abs(a - b) for a, b in zip(q, found[0])), 1e-7)

    def test_eigenvalues(self):
        for seed in range(0, 8, 2):
            found = []
            for unit in UNITS:
                text, _ = chain(seed, *unit)
                report = self.one("linearise", self.scene(text))
                found.append(sorted((re*unit[2], im*unit[2]) for re, im in report["eigenvalues"]))
            for values in found[1:]:
                with self.subTest(seed=seed):
                    self.assertEqual(len(values), len(found[0]))
                    largest = max(abs(x) for pair in found[0] for x in pair)
                    for a, b in zip(values, found[0]):
                        self.assertLess(math.dist(a, b), 1e-7*largest)

    def test_a_pendulum_of_a_nanometre(self):
        """Half of a full swing from the horizontal takes 2 K(1/2) sqrt(l/g): there it is on the other side, at rest."""
        period = 2*1.8540746773013719
        for length in (1.0, 1e-6, 1e-9):
            text = f"""
[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.bob]
mass = 1e-12
position = [{-length}, 0]
[constraint.rod]
type = "distance"
between = ["ground", "bob"]
[time]
end = {period*math.sqrt(length/9.81)!r}
"""
            report = self.ran(text, "dop853", 1e-8)
            with self.subTest(length=length):
                self.assertEqual(report["warnings"], [])
                self.assertLess(abs(report["q"][0]/length - 1), 1e-7)
                self.assertLess(abs(report["q"][1]/length), 1e-6)

    def test_a_boom_of_any_length_hangs(self):
        for length in (1e-6, 1, 600, 1e5):
            report = self.one("equilibrium", self.scene(f"""
[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.a]
mass = 1
inertia = {length**2/12}
position = [{length/2}, 0]
[joint.p]
type = "revolute"
bodies = ["ground", "a"]
at = [0, 0]
[time]
end = 1
"""))
            with self.subTest(length=length):
                self.assertLess(abs(report["q"][1]/length + 0.5), 1e-9)
                self.assertLess(abs(report["q"][2] + math.pi/2), 1e-9)


if __name__ == "__main__":
    unittest.main()
