# SPDX-License-Identifier: MIT
"""tandem linearise and tandem equilibrium as users call them: what --json says, where scenes rest, and what is refused."""

import json
import unittest

import h5py
import numpy as np
from test_output import ROOT, Case

SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))
# Their constraints move them, so that they cannot rest.
DRIVEN = {"mechanism_chopper", "mechanism_motorcycle", "motorcycle", "motorcycle_chopper", "slider_crank"}
UNSTABLE = {"a02_four_bars", "a03_andrews", "bicycle", "mechanism_disk", "rolling_disk", "spatial_slider_crank"}


class Linearisation(Case):
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
                    self.assertIn("constraints move it", refused.stderr)
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

    def test_a_run_from_an_equilibrium_stays_there(self):
        self.tandem("run", "a04_bricard", "--set", "initial.equilibrium=true", "--set", "time.end=1", "--output", "rest.h5", "--quiet")
        with h5py.File(self.folder / "rest.h5") as file:
            q = file["trajectory/q"][:]
        # The steepest direction has a rate of some 4 /s: rounding grows by e^4.
        self.assertLess(np.max(np.abs(q - q[0])), 1e-12)

    def test_a_governor_turns_as_it_does(self):
        """Its steady motion at the speed of the start is kept by a run, to the tolerance of that."""
        settings = ["--set", 'initial.steady=["world.turn_z"]']
        said = self.said("linearise", "a05_governor", *settings)
        self.assertEqual(said["kind"], "steady motion")
        self.assertAlmostEqual(said["steady"]["world.turn_z"], 2 * np.pi, places=12)
        short = ["--set", "time.end=0.3", "--set", "solver.stepper=radau5", "--set", "solver.rtol=1e-8"]
        self.tandem("run", "a05_governor", *settings, *short, "--output", "steady.h5", "--quiet", "--no-error")
        with h5py.File(self.folder / "steady.h5") as file:
            s = file["sensors/s/way"][:]
        self.assertLess(np.max(np.abs(s - s[0])), 1e-9)

    def test_what_is_refused(self):
        for words, piece in (
            (["linearise", "bicycle", "--steady", "frame.z"], "none of any, world.x"),
            (["linearise", "bicycle", "--steady", "any", "--equilibrium"], "cannot be combined"),
            (["linearise", "bicycle", "--at", "-1"], "--at"),
            (["linearise", "nothing"], "nothing"),
            (["equilibrium"], "needs a SCENE"),
        ):
            with self.subTest(words):
                self.assertIn(piece, self.tandem(*words, code=2).stderr)


if __name__ == "__main__":
    unittest.main()
