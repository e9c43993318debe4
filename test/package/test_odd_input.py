# SPDX-License-Identifier: MIT
"""Unusual names, files, numbers and uses: they are shown unchanged, or refused with a message."""

import copy
import ctypes
import os
import pickle
import re
import subprocess
import sys
import tempfile
import threading
import unittest
import warnings
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import tandem
from models import ROOT, START, Pendulum
from tandem.errors import STATUSES
from tandem.plot.data import motion_of
from tandem.viewer.draw import draw
from tandem.viewer.html import page

NASTY = r"""
[scene]
name = "nasty.1"
description = "</script><img src=x onerror=alert(2)> $\\frac$ ü @ABOUT@"
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body."<b>$r_{$</b>"]
mass = 1.0
inertia = 0.083
position = [0.5, 0]
[body."_rod"]
mass = 1.0
inertia = 0.083
position = [1.5, 0]
[joint."__proto__"]
type = "revolute"
bodies = ["ground", "_rod"]
at = [0, 0]
[force.coil]
type = "spring"
between = ["_rod", "<b>$r_{$</b>"]
stiffness = 10.0
length = 1.0
[sensor."$\\q$<i>"]
joint = "__proto__"
[results]
joints = "all"
forces = "all"
balance = true
[time]
end = 0.1
[solver]
stepper = "rk4"
step = 1e-3
"""


class Names(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.place = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.place.cleanup)
        cls.file = Path(cls.place.name) / "na sty ü.h5"
        cls.result = tandem.Mechanism.from_toml(NASTY).run(output=cls.file, error=False)

    def test_pictures_take_no_name_for_a_formula(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for kind in ("overview", "tracks", "coordinates", "sensors", "phase", "reactions"):
                with self.subTest(kind):
                    tandem.plot.save(getattr(tandem.plot, kind)(self.file), Path(self.place.name) / "a b ü.svg")
        labels = [text.get_text() for text in tandem.plot.tracks(self.file).axes[0].get_legend().get_texts()]
        # Both are in the legend, also the one that begins as matplotlib's private labels do; an escaped dollar begins no formula.
        self.assertEqual(labels[:2], [r"<b>\$r_{\$</b>", "\u200b_rod"])

    def test_pages_hold_no_markup_of_names(self):
        text = page(draw(self.result))
        self.assertNotIn("<img", text)
        self.assertNotIn("<b>", text)
        self.assertEqual(text.count("</script>"), page(draw(tandem.run_scene("slider_crank", {"time.end": 0.1}, error=False))).count("</script>"))

    def test_one_name_is_no_list_of_letters(self):
        self.assertEqual([curve.name for curve in draw(self.result, names="_rod.x").curves], ["_rod.x"])
        tandem.plot.coordinates(self.result, "_rod.x")
        tandem.plot.overview(self.result, "_rod.x")

    def test_a_scene_names_no_file_elsewhere(self):
        elsewhere = Path(self.place.name) / "elsewhere"
        with self.assertRaisesRegex(tandem.ProgramError, "name must be"):
            tandem.Mechanism({"scene.name": f"../../../../../..{elsewhere}"}).check()
        self.assertFalse(elsewhere.with_suffix(".toml").exists())

    def test_all_groups_are_read(self):
        with h5py.File(self.file) as file:
            kinds = [kind for kind in ("bodies", "joints", "wheels", "constraints", "forces") if kind in file]
            self.assertEqual(set(self.result.groups), {*kinds, "balance"})
            # Each group of the file has the times; they are not one of its series.
            self.assertIn("time", file["forces/coil"])
            all_ = [whats for group in (*self.result.groups.values(), self.result.sensors) for whats in group.values()]
            self.assertFalse([whats for whats in all_ if "time" in whats])
            np.testing.assert_array_equal(self.result.groups["forces"]["coil"]["tension"].values, file["forces/coil/tension"][:])
            np.testing.assert_array_equal(self.result.to_xarray("forces")["coil_tension"], file["forces/coil/tension"][:])
            with self.assertRaisesRegex(KeyError, "there is no group 'force'; there are trajectory, diagnostics, sensors"):
                self.result.to_xarray("force")
            np.testing.assert_array_equal(self.result.groups["balance"]["balance"]["residual"].values, file["balance/residual"][:])


class Arrows(unittest.TestCase):
    def test_forces_are_where_they_act(self):
        """The joint's at the joint, the spring's at its second point; each is the file's, and NaN spoils no page."""
        result = tandem.Mechanism.from_toml(NASTY).run(error=False)
        drawing = draw(result)
        found = {arrow.name: arrow for arrow in drawing.arrows}
        self.assertEqual(set(found), {"__proto__ force", "coil force"})
        np.testing.assert_allclose(found["__proto__ force"].positions, 0, atol=1e-9)
        np.testing.assert_allclose(found["coil force"].positions, drawing.body("<b>$r_{$</b>").position, atol=1e-9)
        np.testing.assert_allclose(found["coil force"].vectors[[0, -1]], result.groups["forces"]["coil"]["force"].values[[0, -1]])
        self.assertEqual((found["coil force"].on, found["coil force"].unit), ("<b>$r_{$</b>", "N"))
        self.assertNotEqual(found["coil force"].colour, found["__proto__ force"].colour)
        found["coil force"].vectors[3] = np.nan
        self.assertNotIn("NaN", re.search(r'id="drawing">(.*?)</script>', page(drawing), re.S)[1])

    def check(self, drawing, wanted, frame=0):
        """{name: (the body that it acts on, where, vector)} are all arrows, at a frame."""
        self.assertEqual({arrow.name for arrow in drawing.arrows}, set(wanted))
        for arrow in drawing.arrows:
            on, place, vector = wanted[arrow.name]
            self.assertEqual((arrow.on, arrow.unit), (on, "N m" if arrow.name.endswith("torque") else "N"))
            np.testing.assert_allclose(arrow.positions[frame], place, atol=1e-9)
            np.testing.assert_allclose(arrow.vectors[frame], vector, atol=1e-9)

    def test_a_cantilever(self):
        """Reactions of a beam clamped in a wall, from statics: weight at its middle, a force and a torque at its tip."""
        beam = {"scene.model": "mechanism", "gravity.vector": [0, 0, -10], "body.beam.mass": 2.0, "body.beam.inertia": [0.1, 0.2, 0.2],
                "body.beam.position": [0.5, 0, 0], "body.beam.points": {"tip": [0.5, 0, 0]}, "joint.wall.type": "fixed",
                "joint.wall.bodies": ["ground", "beam"], "joint.wall.at": [0, 0, 0], "force.hand.type": "load", "force.hand.on": "beam.tip",
                "force.hand.force": [0, 3, 0], "force.hand.torque": [5, 0, 0], "results.joints": "all", "results.forces": "all", "time.end": 0.1}
        self.check(draw(tandem.Mechanism(beam).run(error=False)), {
            "wall force": ("beam", [0, 0, 0], [0, -3, 20]), "wall torque": ("beam", [0, 0, 0], [-5, -10, -3]),
            "hand force": ("beam", [1, 0, 0], [0, 3, 0]), "hand torque": ("beam", [1, 0, 0], [5, 0, 0])})

    def test_torsions(self):
        """A spring with a motor that turn a wheel about its middle, and a spring that pulls a slider back: J alpha and m a."""
        parts = {"scene.model": "mechanism", "scene.planar": True, "body.wheel.mass": 1.0, "body.wheel.inertia": 0.3,
                 "body.wheel.position": [1, 0], "joint.axle.type": "revolute", "joint.axle.bodies": ["ground", "wheel"], "joint.axle.at": [1, 0],
                 "force.coil.type": "torsion", "force.coil.joint": "axle", "force.coil.stiffness": 2.0, "force.coil.angle": -0.4,
                 "force.coil.torque": 1.5,
                 "body.slider.mass": 3.0, "body.slider.inertia": 0.1, "body.slider.position": [0, 2], "joint.rail.type": "prismatic",
                 "joint.rail.bodies": ["ground", "slider"], "joint.rail.at": [0, 2], "joint.rail.axis": [0.6, 0.8],
                 "force.band.type": "torsion", "force.band.joint": "rail", "force.band.stiffness": 5.0, "force.band.angle": 0.3,
                 "results.forces": "all", "output.interval": 1/60, "time.end": 1.0}
        result = tandem.Mechanism(parts).run(error=False)
        drawing = draw(result)
        for frame in (0, 17, 60):
            alpha, ax, ay = (result.qdd[frame, result.names.index(name)] for name in ("wheel.angle", "slider.x", "slider.y"))
            self.assertGreater(abs(alpha), 0.1)
            x, y = (result[f"slider.{name}"][frame] for name in "xy")
            self.check(drawing, {"coil torque": ("wheel", [1, 0, 0], [0, 0, 0.3*alpha]), "band force": ("slider", [x, y, 0], [3*ax, 3*ay, 0])}, frame)


class Files(unittest.TestCase):
    def setUp(self):
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.place = Path(place.name)

    def write(self, name="odd.h5", rows=3, times=None, value=0.0, with_names=True, diagnostics=None):
        path = self.place / name
        with h5py.File(path, "w") as file:
            file["trajectory/q"] = np.full((rows, 2), value) + np.arange(rows)[:, None]
            file["trajectory/time"] = np.arange(float(rows if times is None else times))
            if with_names:
                file["trajectory/q"].attrs["names"], file["trajectory/q"].attrs["units"] = ["x", "y"], ["m", "m"]
            if diagnostics is not None:
                file["diagnostics/step"] = np.ones(diagnostics)
        return path

    def ends(self, path, message, kinds=("plot", "view")):
        for kind in kinds:
            done = subprocess.run([sys.executable, "-m", "tandem", kind, str(path)], capture_output=True, text=True, cwd=self.place)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertRegex(done.stderr, message)
            self.assertNotIn("Traceback", done.stderr)

    def test_no_files_of_results(self):
        (self.place / "text.h5").write_text("hello")
        (self.place / "empty.h5").write_bytes(b"")
        (self.place / "cut.h5").write_bytes(self.write().read_bytes()[:600])
        with h5py.File(self.place / "series.h5", "w") as file:
            file["trajectory"] = np.zeros(3)
        for name, message in (("text.h5", "text.h5 cannot be read"), ("empty.h5", "empty.h5 cannot be read"), ("cut.h5", "cut.h5 cannot be read"),
                              ("none.h5", "there is no file .*none.h5"), ("series.h5", "is no result of tandem run")):
            with self.subTest(name):
                self.ends(self.place / name, message, ("plot",))
        self.ends(self.place, "cannot be read.*folder", ("plot",))
        self.ends(self.write(with_names=False), "odd.h5 is no whole result", ("view",))

    def test_no_rows(self):
        path = self.write(rows=0)
        self.ends(path, "no rows")
        for kind in ("overview", "tracks", "coordinates", "errors", "phase"):
            with self.assertRaisesRegex(ValueError, "no rows"):
                getattr(tandem.plot, kind)(path)
        self.assertIn("none", tandem.read(path)._repr_html_())

    def test_rows_that_are_no_numbers(self):
        path = self.write(value=np.nan)
        self.ends(path, "some rows are not finite", ("view",))
        tandem.plot.overview(path).savefig(self.place / "nan.png")
        self.assertIn("odd", tandem.read(path)._repr_html_())

    def test_rows_of_a_run_that_was_killed(self):
        """All series are cut where the shortest ends, the times and what stands beside the coordinates among them."""
        for path, rows in ((self.write("a.h5", rows=5, times=4), 4), (self.write("b.h5", rows=5, diagnostics=3), 3)):
            result = tandem.read(path)
            self.assertEqual((len(result.time), len(result.q)), (rows, rows))
            tandem.plot.overview(result).savefig(self.place / "cut.png")
            draw(result)

    def test_files_that_memory_might_not_hold(self):
        """Pictures read every so many rows, as few as are needed; other readers say how many they want."""
        path = self.write(rows=1000, diagnostics=1000)
        self.assertEqual(len(motion_of(path).time), 1000)
        with mock.patch("tandem.result.MOST_BYTES", 8000):
            result = motion_of(path)
        # Two columns of q, times and steps are 32000 bytes.
        self.assertEqual(len(result.time), 250)
        np.testing.assert_array_equal(result.q[:, 0], np.arange(0, 1000, 4))
        self.assertEqual(len(result.diagnostics["step"].values), 250)
        self.assertEqual(len(tandem.read(path, every=300).q), 4)
        with self.assertRaisesRegex(ValueError, "every is 0"):
            tandem.read(path, every=0)

    def test_a_file_of_an_earlier_version(self):
        """A mechanism without /drawing has no shapes: the message states the remedy."""
        result = tandem.Mechanism.from_toml(NASTY).run(error=False)
        result.drawing.clear()
        with self.assertRaisesRegex(ValueError, "no /drawing.*run its scene again"):
            draw(result)

    def test_elements_of_a_later_version(self):
        """Elements of unknown tables are not drawn."""
        result = tandem.Mechanism.from_toml(NASTY).run(error=False)
        pieces = [len(body.pieces) for body in draw(result).bodies]
        result.drawing["kind"].append("field magnet")
        result.drawing["name"].append("north")
        result.drawing["elements"] = np.concatenate([result.drawing["elements"], np.zeros((1, 10))])
        self.assertEqual([len(body.pieces) for body in draw(result).bodies], pieces)


class Uses(unittest.TestCase):
    def test_a_whole_number_is_no_address(self):
        """It used to be called, which ended the interpreter."""
        code = ("import tandem\n"
                "s = tandem.solve(tandem.Model(n=1, mass_matrix=2, applied_force=4), (0, 1), [0], [0])\n"
                "print(abs(s.q[-1, 0] - 1) < 1e-9)")
        self.assertEqual(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip(), "True")

    def test_an_address(self):
        kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)]*3, ctypes.c_void_p)

        @kind
        def force(t, q, qd, value, data):
            value[0] = 4.0
            return 0

        model = tandem.Model(n=1, mass_matrix=[[2.0]], applied_force=ctypes.cast(force, ctypes.c_void_p))
        self.assertAlmostEqual(tandem.solve(model, (0, 1), [0], [0]).q[-1, 0], 1.0, places=9)

    def test_complex_constants(self):
        with self.assertRaisesRegex(TypeError, "mass_matrix holds complex128"):
            tandem.solve(tandem.Model(n=1, mass_matrix=[[1 + 1j]]), (0, 1), [0], [0])

    def test_copies_of_a_solution(self):
        """Other processes get the numbers; the run itself is not transferred."""
        solution = tandem.solve(Pendulum(), (0, 1), *START)
        for other in (pickle.loads(pickle.dumps(solution)), copy.deepcopy(solution)):
            np.testing.assert_array_equal(other.q, solution.q)
            self.assertIsNone(other.simulation)
        self.assertIsNotNone(solution.simulation)
        with self.assertRaisesRegex(TypeError, "cannot be copied"):
            pickle.dumps(solution.simulation)

    def test_an_unknown_coordinate(self):
        with self.assertRaisesRegex(KeyError, "there is no coordinate 'z'; there are x, y"):
            tandem.solve(Pendulum(), (0, 0.1), *START)["z"]

    def test_two_threads_in_one_simulation(self):
        within, go_on = threading.Event(), threading.Event()

        class Slow(Pendulum):
            def applied_force(self, t, q, qd):
                if threading.current_thread() is not threading.main_thread():
                    within.set()
                    go_on.wait(20)
                return [0, -9.81]

        run = tandem.Simulation(Slow(), *START)
        thread = threading.Thread(target=run.integrate, args=(0.05,))
        thread.start()
        self.assertTrue(within.wait(20))
        try:
            with self.assertRaisesRegex(RuntimeError, "another thread"):
                run.step()
        finally:
            go_on.set()
            thread.join()
        self.assertEqual(run.t, 0.05)

    def test_every_status_has_its_name(self):
        declared = re.findall(r"TANDEM_(\w+) = (-\d+)", (ROOT / "include" / "tandem.h").read_text())
        self.assertEqual({int(code): name.lower() for name, code in declared} | {0: "ok"}, STATUSES)

    def test_what_the_program_says_in_other_alphabets(self):
        """Its words are UTF-8, whatever the locale is."""
        code = ("import tandem\ntry: tandem.Mechanism({'scene.description': '\\u00fc', 'body.r\\u00fc.maas': 1}).check()\n"
                "except tandem.ProgramError as error: print('r\\u00fc' in str(error))")
        done = subprocess.run([sys.executable, "-X", "utf8=0", "-c", code], capture_output=True, text=True,
                              env={**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"})
        self.assertEqual(done.stdout.strip(), "True", done.stderr)


if __name__ == "__main__":
    unittest.main()
