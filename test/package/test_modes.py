# SPDX-License-Identifier: MIT
"""Mode shapes in pages and glTF files: they are those of the file, and the motion of a mode is the closed form."""

import json
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np
import tandem
from tandem import viewer
from tandem.viewer import rotations
from tandem.viewer.gltf import glb
from tandem.viewer.html import page

#: Two equal masses between three equal springs: the modes are known.
CHAIN = """
[scene]
model = "mechanism"
planar = true
[body.a]
mass = 1.0
inertia = 0.01
position = [1, 0]
[body.b]
mass = 1.0
inertia = 0.01
position = [2, 0]
[joint.guide_a]
type = "prismatic"
bodies = ["ground", "a"]
at = [1, 0]
axis = [1, 0]
[joint.guide_b]
type = "prismatic"
bodies = ["ground", "b"]
at = [2, 0]
axis = [1, 0]
[force.first]
type = "spring"
between = ["ground:[0, 0]", "a"]
stiffness = 100.0
length = 1.0
[force.middle]
type = "spring"
between = ["a", "b"]
stiffness = 100.0
length = 1.0
[force.last]
type = "spring"
between = ["b", "ground:[3, 0]"]
stiffness = 100.0
length = 1.0
[time]
end = 1.0
"""


def vector_of(p):
    """The rotation vector of a quaternion, of less than half a turn."""
    return 2*np.arctan2(np.linalg.norm(p[1:]), p[0])*p[1:]/(np.linalg.norm(p[1:]) or 1.0)


class Modes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        place = tempfile.TemporaryDirectory()
        cls.addClassCleanup(place.cleanup)
        cls.folder = Path(place.name)
        tandem.Mechanism.from_toml(CHAIN).linearise(None, "--equilibrium", "--output", cls.folder / "chain.h5")
        tandem.run_program("linearise", "bicycle", "--output", cls.folder / "bicycle.h5")

    def test_closed_form(self):
        """Two equal masses between three equal springs: together at sqrt(k/m), against each other at sqrt(3 k/m)."""
        drawing = viewer.drawing_of(self.folder / "chain.h5")
        found = {round(float(name.split(" Hz")[0]), 3): {body.name: body.position[:, 0] for body in bodies} for name, bodies in drawing.takes}
        self.assertEqual(set(found), {round(10/(2*np.pi), 3), round(10*np.sqrt(3)/(2*np.pi), 3)})
        for frequency, sign in ((10/(2*np.pi), 1), (10*np.sqrt(3)/(2*np.pi), -1)):
            places = found[round(frequency, 3)]
            swing = np.cos(2*np.pi*drawing.times/2.0)
            far = np.abs(places["a"] - 1).max()
            # Shapes are right to rounding; the frames are those of a cosine.
            np.testing.assert_allclose(np.abs(places["a"] - 1), np.abs(far*swing), atol=1e-9*far)
            np.testing.assert_allclose(places["b"] - 2, sign*(places["a"] - 1), atol=1e-9*far)
            self.assertGreater(far, 0.05)
            self.assertLess(far, 1.0)

    def test_shapes_are_those_of_the_file(self):
        """In space, with a phase: the displacements of bodies are the file's complex shapes, turned in time and by one factor."""
        modes = viewer.read_modes(self.folder / "bicycle.h5")
        with h5py.File(self.folder / "bicycle.h5") as file:
            group = file["linearisation"]
            frequency, names = group["frequency"][:], [name.decode() if isinstance(name, bytes) else name for name in group["coordinates"][:]]
            shapes = group["shapes_re"][:] + 1j*group["shapes_im"][:]
            q = group["q"][:]
            values = group["eigenvalues"][:]
        self.assertEqual(set(np.abs(np.sort(modes.eigenvalues.imag))), set(np.abs(np.sort(values[1] if len(values) == 2 else values[:, 1]))))
        drawing = viewer.drawing_of(modes)
        self.assertEqual(len(drawing.takes), 3)
        name, bodies = next((name, bodies) for name, bodies in drawing.takes if "Hz" in name)
        # Of the pair, the one that turns as exp(i omega t) with a positive omega.
        i = int(np.flatnonzero(modes.eigenvalues.imag > 0)[0])
        self.assertAlmostEqual(float(name.split(" Hz")[0]), frequency[i], places=3)
        here = [names.index(f"{body.name}.y") for body in bodies]
        moved = np.stack([body.position[:, 1] - q[j] for body, j in zip(bodies, here, strict=True)])
        quarter = (len(drawing.times) - 1)//4
        # Real part at the first frame, minus i times the part a quarter period later.
        seen = moved[:, 0] - 1j*moved[:, quarter]
        wanted = shapes[i, here]
        self.assertAlmostEqual(abs(np.vdot(seen, wanted))/(np.linalg.norm(seen)*np.linalg.norm(wanted)), 1.0, places=9)

    def test_bodies_move_as_the_file_says(self):
        """Places and turns of all bodies are `motions` by one factor; and these are what the Euler parameters of the shapes mean."""
        modes = viewer.read_modes(self.folder / "bicycle.h5")
        drawing = viewer.drawing_of(modes)
        quarter = (len(drawing.times) - 1)//4
        for (_, bodies), i in zip(drawing.takes, modes.shown(), strict=True):
            factors = []
            for body in bodies:
                j = modes.bodies.index(body.name)
                e, de = (np.array([row[modes.names.index(f"{body.name}.e{k}")] for k in range(4)]) for row in (modes.q, modes.shapes[i]))
                turn = 2*(rotations.product(de.real, rotations.conjugate(e)) + 1j*rotations.product(de.imag, rotations.conjugate(e)))
                np.testing.assert_allclose(turn[1:], modes.motions[i, j, 3:], atol=1e-12)
                rest = np.array([modes.q[modes.names.index(f"{body.name}.{axis}")] for axis in "xyz"])
                moved = [np.concatenate([body.position[f] - rest, vector_of(rotations.product(body.rotation[f], rotations.conjugate(e)))])
                         for f in (0, quarter)]
                seen, wanted = moved[0] - 1j*moved[1], modes.motions[i, j]
                factor = np.vdot(wanted, seen)/np.vdot(wanted, wanted)
                np.testing.assert_allclose(seen, factor*wanted, atol=1e-12)
                factors.append(factor)
            np.testing.assert_allclose(factors, factors[0], rtol=1e-9)

    def test_motions_are_what_is_drawn(self):
        """A file in which another body moves shows that; one without motions of bodies shows its coordinates."""
        path = self.folder / "altered.h5"
        shutil.copyfile(self.folder / "chain.h5", path)
        first = viewer.drawing_of(path).takes[0][1]
        with h5py.File(path, "r+") as file:
            for part in ("motions_re", "motions_im"):
                file[f"linearisation/{part}"][:] = 0
            file["linearisation/motions_re"][:, 7] = 1
        b = viewer.drawing_of(path).takes[0][1]
        self.assertEqual((np.abs(b[0].position[0] - [1, 0, 0]).max(), b[1].position[0, 0]), (0.0, 2.0))
        self.assertGreater(b[1].position[0, 1], 0.1)
        with h5py.File(path, "r+") as file:
            del file["linearisation/motions_re"], file["linearisation/motions_im"], file["linearisation/bodies"]
        for body, other in zip(viewer.drawing_of(path).takes[0][1], first, strict=True):
            np.testing.assert_allclose(body.position, other.position, atol=1e-12)

    def test_modes_near_a_number(self):
        """A file of `--near`, which has no causes and only some modes."""
        tandem.Mechanism.from_toml(CHAIN).linearise(None, "--near", "0,10", "--modes", "2", "--output", self.folder / "near.h5")
        labels = [name for name, _ in viewer.drawing_of(self.folder / "near.h5").takes]
        self.assertTrue(any(label.startswith(f"{10/(2*np.pi):.4g} Hz") for label in labels), labels)

    def test_labels(self):
        """Rounding does not count as growth: a rolling disk tumbles, and oscillates with real parts of 1e-15."""
        tandem.run_program("linearise", "rolling_disk", "--output", self.folder / "disk.h5")
        modes = viewer.read_modes(self.folder / "disk.h5")
        labels = [modes.label(i) for i in modes.shown()]
        self.assertEqual([label for label in labels if "unstable" in label], [f"does not swing, {modes.eigenvalues.real.max():.4g} 1/s, unstable"])
        self.assertTrue(all(label.endswith("damping 0 %") for label in labels if "Hz" in label), labels)

    def test_page_and_animations(self):
        drawing = viewer.drawing_of(self.folder / "bicycle.h5")
        text = page(drawing)
        for name, _ in drawing.takes:
            self.assertIn(json.dumps(name), text)
        data = glb(drawing)
        length = struct.unpack("<I", data[12:16])[0]
        content = json.loads(data[20:20 + length])
        self.assertEqual([one["name"] for one in content["animations"]], [name for name, _ in drawing.takes])

    def test_command(self):
        done = subprocess.run([sys.executable, "-m", "tandem", "view", "bicycle.h5"], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout.split()), (0, ["bicycle.html", "bicycle.glb"]), done.stderr)

    def test_no_whole_file(self):
        with h5py.File(self.folder / "odd.h5", "w") as file:
            file["linearisation/q"] = np.zeros(2)
        with self.assertRaisesRegex(ValueError, "odd.h5 is not a complete linearised system"):
            viewer.drawing_of(self.folder / "odd.h5")


if __name__ == "__main__":
    unittest.main()
