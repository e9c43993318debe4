# SPDX-License-Identifier: MIT
"""Files for ParaView, as VTK's own reader reads them."""

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np
import tandem
from tandem import viewer
from tandem.viewer.vtkhdf import write_vtkhdf
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "package"))
from models import ROOT  # noqa: E402
from test_modes import CHAIN  # noqa: E402


def steps_of(path):
    """Of each step its time, places (np, 3), lines (nl, 2), triangles (nt, 3), the body and the colour of each cell."""
    reader = vtkHDFReader()
    if not reader.CanReadFile(str(path)):
        raise ValueError(f"VTK cannot read {path}")
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    for k in range(reader.GetNumberOfSteps()):
        reader.SetStep(k)
        reader.Update()
        found = reader.GetOutput()
        lines, polygons = (vtk_to_numpy(cells.GetConnectivityArray()) for cells in (found.GetLines(), found.GetPolys()))
        yield (reader.GetTimeValue(), vtk_to_numpy(found.GetPoints().GetData()).astype(float), lines.reshape(-1, 2), polygons.reshape(-1, 3),
               *(vtk_to_numpy(found.GetCellData().GetArray(name)) for name in ("body", "colour")))


class Vtkhdf(unittest.TestCase):
    def setUp(self):
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.folder = Path(place.name)

    def test_bodies_move_as_the_rows_say(self):
        """At rows of the file: each body is the one of the first row, moved and turned as its coordinates say."""
        run = self.folder / "run.h5"
        tandem.run_scene("slider_crank", {"time.end": 1, "output.interval": 1/60}, run, error=False)
        write_vtkhdf(viewer.drawing_of(run), self.folder / "run.vtkhdf")
        with h5py.File(run) as file:
            q, time, names = file["trajectory/q"][:], file["trajectory/time"][:], list(file["trajectory/q"].attrs["names"])
        with h5py.File(self.folder / "run.vtkhdf") as file:
            bodies = [name.decode() for name in file["bodies"][:]]
        self.assertEqual(bodies, ["crank", "rod", "slider"])
        steps = list(steps_of(self.folder / "run.vtkhdf"))
        np.testing.assert_allclose([step[0] for step in steps], time, atol=1e-12)
        _, first, lines, triangles, owner, colours = steps[0]
        self.assertEqual((len(lines), len(owner)), (0, len(triangles)))
        self.assertGreater(len({tuple(colour) for colour in colours}), 3)
        for i, body in enumerate(bodies):
            x, y, angle = (q[:, names.index(f"{body}.{what}")] for what in ("x", "y", "angle"))
            corners = np.unique(triangles[owner == i])
            self.assertGreater(len(corners), 7)
            for k in (1, 17, 60):
                c, s = np.cos(angle[k] - angle[0]), np.sin(angle[k] - angle[0])
                wanted = (first[corners] - [x[0], y[0], 0]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [x[k], y[k], 0]
                # 24 bits of numbers of about 1.
                np.testing.assert_allclose(steps[k][1][corners], wanted, atol=1e-6)

    def test_arrows(self):
        """A line from where each force acts, as long as it is on one scale; about each torque an arc as a right hand turns, and its axis."""
        scene = tandem.Mechanism.from_toml(ROOT / "scenes" / "slider_crank.toml")
        scene["results.joints"] = "all"
        drawing = viewer.drawing_of(scene.run({"time.end": 0.5}, error=False))
        write_vtkhdf(drawing, self.folder / "arrows.vtkhdf")
        self.assertEqual({arrow.unit for arrow in drawing.arrows}, {"N", "N m"})
        largest = {unit: max(np.linalg.norm(arrow.vectors, axis=1).max() for arrow in drawing.arrows if arrow.unit == unit)
                   for unit in ("N", "N m")}
        size = np.subtract(*drawing.bounds()[::-1]).max()
        for f, (_, places, lines, _, owner, _) in enumerate(steps_of(self.folder / "arrows.vtkhdf")):
            for k, arrow in enumerate(drawing.arrows):
                wanted = {"N": 0.5, "N m": 0.12}[arrow.unit]*size/largest[arrow.unit]*arrow.vectors[f]
                *arc, (start, end) = places[lines[owner[:len(lines)] == -2 - k]]
                np.testing.assert_allclose(start, arrow.positions[f], atol=1e-6)
                np.testing.assert_allclose(end - start, wanted, atol=1e-6)
                self.assertEqual(len(arc), 24*(arrow.unit == "N m"))
                if len(arc) and np.linalg.norm(wanted) > 1e-3*size:
                    begins, ends = np.moveaxis(np.array(arc) - start, 1, 0)
                    np.testing.assert_allclose(np.linalg.norm(begins, axis=1), np.linalg.norm(wanted), rtol=1e-3)
                    # Each piece turns by 270 degrees over 24 about the torque.
                    sine = np.cross(begins, ends) @ wanted/np.linalg.norm(wanted)**3
                    np.testing.assert_allclose(sine, np.sin(1.5*np.pi/24), rtol=1e-2)
        with h5py.File(self.folder / "arrows.vtkhdf") as file:
            self.assertEqual([name.decode() for name in file["arrows"]], [f"{arrow.name} on {arrow.on} [{arrow.unit}]" for arrow in drawing.arrows])

    def test_tracks(self):
        """They grow: up to the frame they are places of the file's rows in their order, and end where the body is now."""
        run = self.folder / "run.h5"
        tandem.run_scene("trailers", {"time.end": 5, "output.interval": 1/60}, run, error=False)
        drawing = viewer.drawing_of(run)
        write_vtkhdf(drawing, self.folder / "run.vtkhdf")
        with h5py.File(run) as file, h5py.File(self.folder / "run.vtkhdf") as made:
            whole = file["sensors/tractor/position"][:]
            number = -2 - [name.decode() for name in made["tracks"]].index("tractor")
        self.assertFalse(drawing.arrows)
        for f, (_, places, lines, _, owner, _) in enumerate(steps_of(self.folder / "run.vtkhdf")):
            pieces = places[lines[owner[:len(lines)] == number]]
            self.assertEqual(len(pieces), 199)
            np.testing.assert_array_equal(pieces[1:, 0], pieces[:-1, 1])
            line = np.concatenate([pieces[:1, 0], pieces[:, 1]])
            # Of 301 rows every third is left out or so; 24 bits of places of up to 10 m.
            rows = [np.abs(whole[:f + 1] - place).max(axis=1).argmin() for place in line]
            np.testing.assert_allclose(line, whole[rows], atol=2e-6)
            self.assertEqual(rows, sorted(rows))
            self.assertEqual((rows[0], rows[-1]), (0, f))

    def test_springs_and_modes(self):
        """One mode after the other; lines of springs end at what they join."""
        tandem.Mechanism.from_toml(CHAIN).linearise(None, "--equilibrium", "--output", self.folder / "modes.h5")
        done = subprocess.run([sys.executable, "-m", "tandem", "view", "modes.h5", "--output", "modes.vtkhdf"], cwd=self.folder,
                              capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout.split()), (0, ["modes.vtkhdf"]), done.stderr)
        drawing = viewer.drawing_of(self.folder / "modes.h5")
        steps = list(steps_of(self.folder / "modes.vtkhdf"))
        nf = len(drawing.times)
        self.assertEqual(len(steps), 2*nf)
        for k, (_, bodies) in enumerate(drawing.takes):
            a, b = bodies
            for f in (0, 31):
                _, places, lines, _, owner, _ = steps[k*nf + f]
                self.assertEqual(owner[:3].tolist(), [-1]*3)
                wanted = [[[0, 0, 0], a.position[f]], [a.position[f], b.position[f]], [b.position[f], [3, 0, 0]]]
                np.testing.assert_allclose(places[lines], wanted, atol=1e-6)


if __name__ == "__main__":
    unittest.main()
