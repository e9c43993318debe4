# SPDX-License-Identifier: MIT
"""Bodies that look as files of triangles say."""

import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import tandem
from tandem.viewer.draw import draw
from tandem.viewer.gltf import glb
from tandem.viewer.html import page
from tandem.viewer.meshes import put_meshes, read_mesh

#: A corner of a cube, and the same as files.
CORNERS = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 0, 2], [1, 0, 0]], [[0, 0, 0], [0, 1, 0], [0, 0, 2]]], dtype=float)
BINARY = bytes(80) + struct.pack("<I", 3) + b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.reshape(-1), 0) for triangle in CORNERS)
TEXT = "solid corner\n" + "".join(
    "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle) + "endloop\nendfacet\n"
    for triangle in CORNERS) + "endsolid corner\n"
OBJ = "# a comment\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nf 1/1/1 2//2 3\nf 1 -1 2\nf 1 3 4\n"


class Meshes(unittest.TestCase):
    def setUp(self):
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.folder = Path(place.name)
        for name, content in (("a.stl", BINARY), ("b.stl", TEXT.encode()), ("c.obj", OBJ.encode()), ("flat.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 1\n"),
                              ("cut.stl", BINARY[:-7]), ("none.stl", b""), ("odd.obj", b"v 0 0\nv 1 1\nf 1 2 9\n"),
                              ("nan.stl", TEXT.replace("vertex 1.0", "vertex nan", 1).encode())):
            (self.folder / name).write_bytes(content)

    def test_the_same_triangles(self):
        for name in ("a.stl", "b.stl", "c.obj"):
            np.testing.assert_array_equal(read_mesh(self.folder / name), CORNERS, name)

    def test_what_is_refused(self):
        for name in ("flat.obj", "cut.stl", "none.stl", "odd.obj", "nan.stl"):
            with self.subTest(name), self.assertRaisesRegex(ValueError, f"{name} cannot be read as a mesh"):
                read_mesh(self.folder / name)
        with self.assertRaises(FileNotFoundError):
            read_mesh(self.folder / "nowhere.stl")
        solution = tandem.Mechanism.from_toml(Path(__file__).resolve().parents[2] / "scenes" / "slider_crank.toml").solve((0, 0.1))
        with self.assertRaisesRegex(KeyError, "there is no body 'wheel'; there are crank, rod, slider"):
            solution.view(meshes={"wheel": self.folder / "a.stl"})

    def test_large_files(self):
        """Files that memory might not hold are refused by their size, and those of many triangles before all are read."""
        for name in ("a.stl", "c.obj"):
            with open(self.folder / name, "ab") as file:
                file.truncate(6*10**9)
            with self.subTest(name), self.assertRaisesRegex(ValueError, "has 6000 MB: make it simpler"):
                read_mesh(self.folder / name)
        (self.folder / "many.stl").write_text("solid many\n" + "vertex 0 0 0 "*650_000)
        (self.folder / "many.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "f 1 2 3\n"*210_000)
        (self.folder / "fan.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + " 1 2 3"*100_000)
        for name in ("many.stl", "many.obj", "fan.obj"):
            with self.subTest(name), self.assertRaisesRegex(ValueError, "200000 triangles"):
                read_mesh(self.folder / name)

    def test_in_pages_and_gltf(self):
        scene = tandem.Mechanism.from_toml(Path(__file__).resolve().parents[2] / "scenes" / "slider_crank.toml")
        drawing = draw(scene.run({"time.end": 0.1}, error=False))
        put_meshes(drawing, {"slider": (self.folder / "a.stl", 0.1)})
        self.assertEqual([piece.shape for piece in drawing.body("slider").pieces], ["mesh slider"])
        np.testing.assert_allclose(drawing.meshes["mesh slider"], 0.1*CORNERS)
        self.assertIn("mesh slider", page(drawing))
        # A pose of the mesh in the file: nine corners, the largest 0.2 along z.
        content = glb(drawing)
        self.assertIn(b'"max":[0.1', content)
        self.assertIn(np.float32(0.2).tobytes(), content)

    def test_command(self):
        scene = tandem.Mechanism.from_toml(Path(__file__).resolve().parents[2] / "scenes" / "slider_crank.toml")
        scene.run({"time.end": 0.1}, self.folder / "run.h5", error=False)
        for word, code in (("slider=a.stl:0.1", 0), ("slider=c.obj", 0), ("slider", 2), ("slider=none.stl", 2)):
            done = subprocess.run([sys.executable, "-m", "tandem", "view", "run.h5", "--mesh", word], cwd=self.folder, capture_output=True, text=True)
            self.assertEqual(done.returncode, code, done.stderr)


if __name__ == "__main__":
    unittest.main()
