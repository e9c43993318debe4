# SPDX-License-Identifier: MIT
"""tandem linearise --near as users call it: the lowest modes of long chains, what the file holds, and what is refused."""

import json
import subprocess
import sys
import unittest

import h5py
import numpy as np
from test_output import TANDEM, Case

# Rods of 1 m that hang from each other.
CHAIN = """
[scene]
model = "mechanism"
planar = true
[parameters]
n = 5
[gravity]
vector = [0, -9.81]
[body.rod1]
mass = 1
inertia = "1/12"
position = [0, -0.5]
[joint.pin1]
type = "revolute"
bodies = ["ground", "rod1"]
at = [0, 0]
[repeat.link]
count = "n - 1"
first = 2
[repeat.link.body."rod{i}"]
mass = 1
inertia = "1/12"
position = [0, "0.5 - i"]
[repeat.link.joint."pin{i}"]
type = "revolute"
bodies = ["rod{i - 1}", "rod{i}"]
at = [0, "1 - i"]
[time]
end = 1
"""


# The same rods as they turn about the pivot, without gravity.
ROTOR = """
[scene]
model = "mechanism"
planar = true
[parameters]
n = 5
w = 1
[body.rod1]
mass = 1
inertia = "1/12"
position = [0.5, 0]
velocity = [0, "0.5*w"]
omega = "w"
[joint.pin1]
type = "revolute"
bodies = ["ground", "rod1"]
at = [0, 0]
[repeat.link]
count = "n - 1"
first = 2
[repeat.link.body."rod{i}"]
mass = 1
inertia = "1/12"
position = ["i - 0.5", 0]
velocity = [0, "w*(i - 0.5)"]
omega = "w"
[repeat.link.joint."pin{i}"]
type = "revolute"
bodies = ["rod{i - 1}", "rod{i}"]
at = ["i - 1", 0]
[time]
end = 1
"""


# Rods that hang from two supports, in the shape of a V at the start; n is even.
CATENARY = """
[scene]
model = "mechanism"
planar = true
[parameters]
n = 4
[gravity]
vector = [0, -9.81]
[body.rod1]
mass = 1
inertia = "1/12"
position = [0.3, -0.4]
angle = "-atan(4/3)"
[joint.pin1]
type = "revolute"
bodies = ["ground", "rod1"]
at = [0, 0]
[repeat.down]
count = "n/2 - 1"
first = 2
[repeat.down.body."rod{i}"]
mass = 1
inertia = "1/12"
position = ["0.6*(i - 0.5)", "-0.8*(i - 0.5)"]
angle = "-atan(4/3)"
[repeat.down.joint."pin{i}"]
type = "revolute"
bodies = ["rod{i - 1}", "rod{i}"]
at = ["0.6*(i - 1)", "-0.8*(i - 1)"]
[repeat.up]
count = "n/2"
first = "n/2 + 1"
[repeat.up.body."rod{i}"]
mass = 1
inertia = "1/12"
position = ["0.6*(i - 0.5)", "-0.8*(n - i + 0.5)"]
angle = "atan(4/3)"
[repeat.up.joint."pin{i}"]
type = "revolute"
bodies = ["rod{i - 1}", "rod{i}"]
at = ["0.6*(i - 1)", "-0.8*(n - i + 1)"]
[repeat.end]
count = 1
first = "n"
[repeat.end.joint."last{i}"]
type = "revolute"
bodies = ["rod{i}", "ground"]
at = ["0.6*i", 0]
[time]
end = 1
"""


def frequencies(n):
    """Of small angles a from the vertical: (n - max(i, j) + 1/2) a_j'' + (n - i + 1/3) a_i'' + g (n - i + 1/2) a_i = 0."""
    i = np.arange(1, n + 1)
    mass = n - np.maximum.outer(i, i) + 0.5
    mass[np.diag_indices(n)] = n - i + 1 / 3
    stiffness = 9.81 * (n - i + 0.5)
    return 1 / np.sqrt(np.linalg.eigvalsh(mass / np.sqrt(np.outer(stiffness, stiffness)))[::-1])


class Nearest(Case):
    def said(self, *words):
        return json.loads(self.tandem("linearise", *words, "--json").stdout)

    def peak(self, *words):
        """The largest memory of a process, kB. A small process starts it, since the memory of the one that does counts too."""
        small = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL); " \
            "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
        done = subprocess.run([sys.executable, "-I", "-S", "-c", small, TANDEM, *words], cwd=self.folder, capture_output=True,
                              text=True, check=True)
        return int(done.stdout)

    def test_the_lowest_modes_of_1000_bodies(self):
        """Against the closed form; factors and products grow with the number of bodies, and memory stays far from dense."""
        entries = {}
        for n in (250, 1000):
            said = self.said(self.scene(CHAIN), "--set", f"parameters.n={n}", "--near", "0")
            self.assertTrue(said["complete"])
            found = sorted(im for re, im in said["eigenvalues"] if im > 0)
            # Rounding of forces of n bodies over those of one, and of the reference's matrix.
            self.assertLess(np.max(np.abs(np.array(found[:10]) / frequencies(n)[:10] - 1)), 1e-10)
            self.assertLess(max(abs(re) for re, im in said["eigenvalues"]), 1e-10)
            entries[n] = said["factor_entries"]
            self.assertLess(said["products"], 200)
        self.assertLess(entries[1000], 4.2 * entries[250])
        # One full matrix of these 3000 coordinates has 72 MB, and the dense analysis has more than ten.
        self.assertLess(self.peak("linearise", self.scene(CHAIN), "--set", "parameters.n=1000", "--near", "0"), 400_000)

    def test_a_large_chain_in_the_wind(self):
        """The sparse form finds the equilibrium, and the modes are those of a stronger gravity."""
        scene = self.scene(CHAIN)
        wind = ["--set", "parameters.n=400", "--set", "gravity.vector=[3, -9.81]"]
        rest = json.loads(self.tandem("equilibrium", scene, *wind, "--json").stdout)
        angle = np.arctan2(3, 9.81)
        self.assertLess(np.max(np.abs(np.array(rest["q"][2::3]) - angle)), 1e-9)
        self.assertNotIn("stability", rest)
        # Full matrices of 900 coordinates would take more than a minute.
        some = json.loads(self.tandem("equilibrium", scene, "--set", "parameters.n=300", "--json").stdout)
        self.assertNotIn("stability", some)
        said = self.said(scene, *wind, "--equilibrium", "--near", "0", "--modes", "3")
        found = np.array(sorted(im for re, im in said["eigenvalues"] if im > 0)[:3])
        ratio = (9.81**2 + 9) ** 0.25 / 9.81**0.5
        self.assertLess(np.max(np.abs(found / frequencies(400)[:3] / ratio - 1)), 1e-9)

    def test_all_modes_of_a_hanging_chain(self):
        """By singular values of 240 coordinates, by sparse factors of 270, and with less memory than ten full matrices of these."""
        for n in (80, 90):
            words = [self.scene(CHAIN), "--set", f"parameters.n={n}"]
            found = np.array(sorted(im for re, im in self.said(*words)["eigenvalues"] if im > 0))
            self.assertEqual(len(found), n)
            # Rounding of forces of n bodies over those of one.
            self.assertLess(np.max(np.abs(found / frequencies(n) - 1)), 1e-11)
        n = 200
        self.assertLess(self.peak("linearise", self.scene(CHAIN), "--set", f"parameters.n={n}"), 110_000)

    def test_where_long_chains_hang(self):
        """From the horizontal to the straight chain below the pivot, in a number of steps that does not grow with the chain."""
        for n in (20, 80, 400):
            still = ["--set", f"parameters.n={n}", "--set", "parameters.w=0", "--set", "gravity.vector=[0, -9.81]"]
            rest = json.loads(self.tandem("equilibrium", self.scene(ROTOR), *still, "--json").stdout)
            q = np.array(rest["q"]).reshape(-1, 3)
            self.assertLess(np.max(np.abs(q[:, 0])), 1e-9 * n)
            self.assertLess(np.max(np.abs(q[:, 1] + np.arange(n) + 0.5)), 1e-9 * n)
            self.assertLess(np.max(np.abs(np.exp(1j * q[:, 2]) + 1j)), 1e-9)
            self.assertLess(rest["relaxations"], 80)

    def test_chains_between_two_supports(self):
        """The rods of a catenary: the tangents of their angles grow by the weight of a rod over the pull at the supports."""
        for n in (20, 120):
            rest = json.loads(self.tandem("equilibrium", self.scene(CATENARY), "--set", f"parameters.n={n}", "--json").stdout)
            angle = np.array(rest["q"])[2::3]
            growth = np.diff(np.tan(angle))
            self.assertGreater(np.min(growth), 0)
            self.assertLess(np.max(growth) / np.min(growth) - 1, 1e-8)
            self.assertGreater(np.min(np.cos(angle)), 0)
            self.assertAlmostEqual(np.sum(np.cos(angle)), 0.6 * n, delta=1e-9 * n)

    def test_a_rotor_of_1000_bodies(self):
        """Rods one behind the other that turn about a pivot, in coordinates that go along: of small angles a between them and the radius
        m_ij a_j'' + w^2 sum_j m_ij (a_i - a_j) = 0, where the masses are those of a chain; a rope's are w^2 (k (2 k - 1) - 1)."""
        n, w = 1000, 2.0
        said = self.said(self.scene(ROTOR), "--set", f"parameters.n={n}", "--set", f"parameters.w={w}", "--near", "0,3")
        self.assertEqual((said["kind"], list(said["steady"])), ("steady motion", ["world.rotation"]))
        # Rounding of squares of places of up to 1000 m.
        self.assertLess(abs(said["steady"]["world.rotation"] - w), 1e-12)
        i = np.arange(1, n + 1)
        mass = n - np.maximum.outer(i, i) + 0.5
        mass[np.diag_indices(n)] = n - i + 1 / 3
        stiffness = -mass.copy()
        stiffness[np.diag_indices(n)] = 0
        stiffness[np.diag_indices(n)] = -stiffness.sum(axis=1)
        root = np.linalg.cholesky(mass)
        half = np.linalg.solve(root, stiffness)
        wanted = w * np.sqrt(np.linalg.eigvalsh(np.linalg.solve(root, half.T))[1:])
        found = np.array([complex(*pair) for pair in said["eigenvalues"]])
        seen = [value for value in found if value.imag > 0.1]
        self.assertGreater(len(seen), 7)
        for value in seen:
            # Differences as gradients, and rounding of forces along the whole chain.
            self.assertLess(np.min(np.abs(value - 1j * wanted)), 1e-9 * abs(value))
        self.assertLess(abs(wanted[0] / w - 5**0.5), 1e-5)

    def test_the_file(self):
        said = self.said(self.scene(CHAIN), "--near", "0,3", "--modes", "2", "--output", "modes.h5")
        with h5py.File(self.folder / "modes.h5") as file:
            group = file["linearisation"]
            self.assertEqual(group["eigenvalues"][:].tolist(), said["eigenvalues"])
            self.assertEqual([name.decode() for name in group["bodies"][:]], [f"rod{i}" for i in range(1, 6)])
            shapes = group["shapes_re"][:] + 1j * group["shapes_im"][:]
            motions = (group["motions_re"][:] + 1j * group["motions_im"][:]).reshape(len(shapes), 5, 6)
            self.assertEqual((group.attrs["shift_re"], group.attrs["shift_im"]), (0, 3))
        # In the plane the motions of bodies are the coordinates.
        self.assertEqual(motions[:, :, [0, 1, 5]].tolist(), shapes.reshape(-1, 5, 3).tolist())
        self.assertEqual(np.max(np.abs(motions[:, :, 2:5])), 0)

    def test_bodies_of_all_modes(self):
        """The dense analysis writes motions of bodies as well: points of the bicycle's wheels that touch the ground."""
        self.tandem("linearise", "bicycle", "--output", "bicycle.h5")
        with h5py.File(self.folder / "bicycle.h5") as file:
            group = file["linearisation"]
            names = [name.decode() for name in group["bodies"][:]]
            motions = (group["motions_re"][:] + 1j * group["motions_im"][:]).reshape(-1, len(names), 6)
            coordinates = [name.decode() for name in group["coordinates"][:]]
            q = dict(zip(coordinates, group["q"][:], strict=True))
            causes = [cause.decode() for cause in group["cause"][:]]
        for mode, cause in enumerate(causes):
            if cause != "motion":
                continue
            for wheel in ("rear", "front"):
                move = motions[mode, names.index(wheel)]
                # The wheel's point lowest at rest does not rise, to first order.
                lowest = move[:3] + np.cross(move[3:], [0, 0, -q[f"{wheel}.z"]])
                self.assertLess(abs(lowest[2]), 1e-12)
        said = self.tandem("linearise", "bicycle", "--shapes").stdout
        self.assertIn("motions of bodies at", said)

    def test_what_is_refused(self):
        self.scene(CHAIN)
        for words, piece in (
            (["--near", "x"], "--near"),
            (["--near", "1,2,3"], "--near"),
            (["--near", "1,"], "--near"),
            (["--near", "1e999"], "--near"),
            (["--near", "0", "--modes", "51"], "from 1 to 50"),
            (["--near", "0", "--at", "1"], "--at"),
            (["--near", "0", "--period", "1"], "--period"),
        ):
            with self.subTest(words):
                self.assertIn(piece, self.tandem("linearise", "scene.toml", *words, code=2).stderr)
        self.assertIn("unbalanced", self.tandem("linearise", "scene.toml", "--near", "0", "--set", "gravity.vector=[1, -9]",
                                                    code=1).stderr)
        # A disk that goes round the bend is in no steady motion.
        self.assertIn("steady motion", self.tandem("linearise", "mechanism_disk", "--near", "0", code=1).stderr)
        # Full matrices of so many coordinates are not begun.
        self.assertIn("--near", self.tandem("linearise", "scene.toml", "--set", "parameters.n=400", code=1).stderr)


if __name__ == "__main__":
    unittest.main()
