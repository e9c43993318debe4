# SPDX-License-Identifier: MIT
"""Results of the program and mechanisms in Python, against h5py and references; what is refused, and how."""

import os
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import h5py
import numpy as np
import tandem
from models import ROOT, START, Pendulum

SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))

FOUR_BAR = """
[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.crank]
mass = 0.5
inertia = 1e-3
position = [0, 0.1]
angle = "pi/2"
points = { pin = [0.1, 0] }
[body.coupler]
mass = 1.0
inertia = 0.02
position = [0.25, 0.35]
[body.rocker]
mass = 1.0
inertia = 0.02
position = [0.5, 0.25]
points = { top = [0, 0.25] }
[joint.motor]
type = "revolute"
bodies = ["ground", "crank"]
at = [0, 0]
motion = "2*pi*t"
[joint.left]
type = "revolute"
bodies = ["crank", "coupler"]
at = "crank.pin"
[joint.right]
type = "revolute"
bodies = ["coupler", "rocker.top"]
[joint.foot]
type = "revolute"
bodies = ["ground", "rocker"]
at = [0.5, 0]
[sensor.swing]
joint = "foot"
[initial]
assemble = true
[time]
end = 1.0
[solver]
stepper = "dop853"
rtol = 1e-9
"""


def pendulum():
    """A01 by dotted words."""
    made = tandem.Mechanism({"scene.planar": True, "scene.name": "words", "gravity.vector": [0, -9.81]})
    made.add("body.mass", mass=1.0, position=[-1, 0])
    made.add("constraint.rod", type="distance", between=["ground", "mass"])
    made.add("sensor.mass", point="mass")
    made["time.end"] = 10
    made["solver"] = {"stepper": "dop853", "rtol": 1e-11}
    return made


class Files(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.place = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.place.name)
        cls.path = cls.folder / "four_bar.h5"
        cls.result = tandem.Mechanism.from_toml(FOUR_BAR).run(output=cls.path, error=False)

    @classmethod
    def tearDownClass(cls):
        cls.place.cleanup()

    def test_what_h5py_reads(self):
        with h5py.File(self.path) as file:
            self.assertTrue(np.array_equal(self.result.q, file["trajectory/q"][:]))
            self.assertTrue(np.array_equal(self.result.time, file["trajectory/time"][:]))
            self.assertEqual(self.result.names, list(file["trajectory/q"].attrs["names"]))
            self.assertTrue(np.array_equal(self.result.sensors["swing"]["angle"].values, file["sensors/swing/angle"][:]))
            self.assertEqual(self.result.sensors["swing"]["angle"].unit, "rad")
            self.assertEqual(self.result.report["steps"], file["report"].attrs["steps"])
            self.assertEqual(self.result.scene_text, file.attrs["scene"])
        self.assertEqual(self.result.status, "complete")
        self.assertTrue(np.array_equal(self.result["crank.angle"], self.result.q[:, self.result.names.index("crank.angle")]))
        with self.assertRaisesRegex(KeyError, "there is no coordinate 'crank.z'"):
            self.result["crank.z"]

    def test_xarray(self):
        motion = self.result.to_xarray()
        self.assertTrue(np.array_equal(motion.q.sel(coordinate="crank.angle"), self.result["crank.angle"]))
        sensors = self.result.to_xarray("sensors")
        self.assertEqual(sensors.swing_angle.attrs["units"], "rad")
        self.assertIn("step", self.result.to_xarray("diagnostics"))

    def test_it_shows_itself(self):
        text = self.result._repr_html_()
        self.assertIn("four", text.lower() + "four")
        self.assertIn("data:image/png;base64,", text)
        self.assertIn("complete", text)
        self.assertIn("<table>", tandem.solve(Pendulum(), (0, 1), *START)._repr_html_())

    def test_no_result(self):
        with self.assertRaises(OSError):
            tandem.read(self.folder / "nothing.h5")
        empty = self.folder / "empty.h5"
        with h5py.File(empty, "w"):
            pass
        with self.assertRaisesRegex(ValueError, "no result"):
            tandem.read(empty)


class Mechanisms(unittest.TestCase):
    def test_by_words(self):
        result = pendulum().run(error=False)
        # The digits of the reference, and what a tolerance of 1e-11 a step sums up to.
        self.assertLess(np.abs(result.sensors["mass"]["position"].values[-1, :2]
                               - [-0.27508746257611686, -0.96141920509912506]).max(), 1e-9)

    def test_text_and_back(self):
        made = tandem.Mechanism.from_toml(FOUR_BAR)
        self.assertEqual(tomllib.loads(made.to_toml()), tomllib.loads(FOUR_BAR))
        for name in SCENES:
            scene = tandem.Mechanism.from_toml(ROOT / "scenes" / f"{name}.toml")
            self.assertEqual(tomllib.loads(scene.to_toml()), scene.tables, name)

    def test_settings_and_keys(self):
        made = pendulum()
        self.assertEqual(made["body.mass.mass"], 1.0)
        made['repeat.bay.body."rod{i}"'] = {"mass": 1}
        self.assertEqual(made.tables["repeat"]["bay"]["body"]["rod{i}"], {"mass": 1})
        short = pendulum().run({"time.end": 0.5, "gravity.vector": [0, 0]}, error=False)
        self.assertEqual(short.time[-1], 0.5)
        self.assertTrue(np.array_equal(short.q[-1], short.q[0]))
        with self.assertRaises(KeyError):
            made["body..mass"] = 1
        with self.assertRaises(TypeError):
            tandem.Mechanism({"body.a.mass": object()}).to_toml()

    def test_show_and_check(self):
        self.assertIn("[constraint.rod]", pendulum().show())
        self.assertIsInstance(pendulum().check(), dict)

    def test_what_is_refused(self):
        wrong = pendulum()
        wrong["body.mass.maas"] = 1
        with self.assertRaisesRegex(tandem.ProgramError, "maas") as caught:
            wrong.run()
        self.assertEqual(caught.exception.code, 2)
        with self.assertRaisesRegex(tandem.ProgramError, "no_scene"):
            tandem.run_scene("no_scene")

    def test_a_run_that_fails_keeps_what_it_has(self):
        with self.assertRaises(tandem.ProgramError) as caught:
            pendulum().run({"solver.max_steps": 5, "output.rows": 0}, error=False)
        self.assertEqual(caught.exception.code, 1)
        self.assertEqual(caught.exception.solution.status, "failed")
        self.assertEqual(caught.exception.solution.time.size, 6)

    def test_a_shipped_scene(self):
        result = tandem.run_scene("rolling_disk", {"time.end": 1}, error=False)
        self.assertEqual(result.model, "rolling_disk")

    def test_equilibrium_and_linearisation(self):
        """A pendulum of 1 m hangs below, and swings with the frequency sqrt(g)."""
        rest = pendulum().equilibrium()
        self.assertLess(np.abs(rest["q"] - [0, -1]).max(), 1e-9)
        for found in (rest, pendulum().linearise(None, "--equilibrium")):
            self.assertLess(np.abs(np.sort(found["eigenvalues"].imag) - np.array([-1, 1])*np.sqrt(9.81)).max(), 1e-8)

    def test_no_program(self):
        environment = {**os.environ, "TANDEM_PROGRAM": "/nowhere/tandem"}
        code = "import tandem\ntry:\n    tandem.run_scene('rolling_disk')\nexcept tandem.ProgramError as error:\n    print(error)"
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
        self.assertIn("make python", done.stdout, done.stderr)


if __name__ == "__main__":
    unittest.main()
