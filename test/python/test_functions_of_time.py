# SPDX-License-Identifier: MIT
"""Fast switching in scene files, also across an interruption, and a run whose steps collapse."""

import unittest

import h5py
from test_output import Case

SWITCHED = """[scene]
model = "mechanism"
planar = true
[body.m]
mass = 1.0
position = [0, 0]
[force.f]
type = "load"
on = "m"
force = [1, 0]
factor = "step(sin(2*pi*1000*t))"
[time]
end = 1.0
[solver]
stepper = "dop853"
rtol = 1e-9
"""

COIN = """[scene]
model = "mechanism"
[gravity]
vector = [0, 0, -9.81]
[parameters]
a = 1.2
r = 0.5
m = 0.01
[body.coin]
mass = "m"
inertia = ["m*r^2/2", "m*r^2/4", "m*r^2/4"]
position = [0, 0, "r*sin(a)"]
rotation = [0, "a - pi/2", 0]
[wheel.contact]
type = "disk"
at = "coin"
radius = "r"
axis = ["sin(a)", 0, "cos(a)"]
[time]
end = 1.0
[solver]
stepper = "dop853"
rtol = 1e-9
"""

LATE = """
[scene]
model = "mechanism"
planar = true
[body.rod]
mass = 1.0
inertia = 0.1
position = [0.5, 0]
[joint.pivot]
type = "revolute"
bodies = ["ground", "rod"]
at = [0, 0]
motion = "max(0, t - 0.75)"
[results]
joints = "all"
[time]
end = 1.0
[solver]
stepper = "dop853"
rtol = 1e-9
"""


class FunctionsOfTime(Case):
    def test_a_run_is_prolonged_beyond_known_kinks(self):
        """After whole periods the velocity is t/2 and the place t^2/4 + t/8000."""
        (self.folder / "pwm.toml").write_text(SWITCHED)
        self.tandem("run", "pwm.toml", "--output", "out.h5", "--quiet", "--no-error", "--set", "time.end=0.5")
        self.tandem("resume", "out.h5", "--quiet", "--set", "time.end=1.0")
        with h5py.File(self.folder / "out.h5") as file:
            self.assertLess(abs(file["trajectory/qd"][-1, 0] - 0.5), 1e-12)
            self.assertLess(abs(file["trajectory/q"][-1, 0] - 0.250125), 1e-12)

    def test_a_run_is_prolonged_beyond_jumps_of_the_velocity(self):
        """A hinge that begins to turn at 1 rad/s at 0.75 s, behind the end of the first run."""
        (self.folder / "late.toml").write_text(LATE)
        self.tandem("run", "late.toml", "--output", "out.h5", "--quiet", "--no-error", "--set", "time.end=0.5")
        self.tandem("resume", "out.h5", "--quiet", "--no-error", "--set", "time.end=1.0")
        with h5py.File(self.folder / "out.h5") as file:
            self.assertLess(abs(file["joints/pivot/angle"][-1] - 0.25), 1e-12)
            self.assertLess(abs(file["joints/pivot/rate"][-1] - 1.0), 1e-12)

    def test_a_coin_falls_flat(self):
        """From rest at the inclination a, gravity alone turns it about the point of contact: it lies flat after the time that energy
        gives, 0.5537 s; steps collapse just before."""
        (self.folder / "coin.toml").write_text(COIN)
        result = self.tandem("run", "coin.toml", "--output", "coin.h5", "--quiet", "--no-error", code=1)
        self.assertRegex(result.stderr, "step_underflow|rank_deficient")
        with h5py.File(self.folder / "coin.h5") as file:
            time = file["trajectory/time"][:]
        self.assertLess(abs(time[-1] - 0.553700572656770906), 1e-4)
        self.assertLess(len(time), 30000)


if __name__ == "__main__":
    unittest.main()
