# SPDX-License-Identifier: MIT
"""tandem linearise --near as users call it: the lowest modes of long chains, what the file holds, and what is refused."""

import json
import resource
import unittest

import h5py
import numpy as np
from test_output import Case

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
        self.assertLess(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, 400_000)

    def test_a_large_chain_in_the_wind(self):
        """Where it rests is found by the sparse form, and the modes are those of a stronger gravity."""
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
            (["--near", "0", "--steady", "any"], "steady"),
        ):
            with self.subTest(words):
                self.assertIn(piece, self.tandem("linearise", "scene.toml", *words, code=2).stderr)
        self.assertIn("out of balance", self.tandem("linearise", "scene.toml", "--near", "0", "--set", "gravity.vector=[1, -9]",
                                                    code=1).stderr)
        # Those at rest at the same place are no answer for a bicycle that rolls.
        said = self.tandem("linearise", "bicycle", "--near", "0", code=2).stderr
        self.assertIn('"bicycle" moves: the velocity of ', said)
        self.assertIn("without --near has those of steady motions", said)
        # Full matrices of so many coordinates are not begun.
        self.assertIn("--near", self.tandem("linearise", "scene.toml", "--set", "parameters.n=400", code=1).stderr)


if __name__ == "__main__":
    unittest.main()
