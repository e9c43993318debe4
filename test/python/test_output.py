# SPDX-License-Identifier: MIT
"""The program `tandem` as its users meet it: result files read with h5py, and every error of the input.

Runs build/tandem, or what the environment variable TANDEM names.
"""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
DEFAULT = ["q", "qd", "qdd", "position_error", "velocity_error", "acceleration_error", "step", "chart"]
SHORT = ["--set", "time.end=0.1"]
# glibc overwrites what is given back, so that whoever still reads it, HDF5 too, fails here and not only under valgrind.
STRICT = {"OPENBLAS_NUM_THREADS": "1", "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0:glibc.malloc.perturb=165"}


def run(*arguments, cwd, **kwargs):
    environment = {key: value for key, value in os.environ.items() if key != "TANDEM_SCENES"}
    environment |= STRICT | kwargs.pop("env", {})
    return subprocess.run([TANDEM, *arguments], cwd=cwd, env=environment, capture_output=True, text=True,
                          errors="replace", **{"timeout": 60, **kwargs})


class Case(unittest.TestCase):
    """A test in an empty folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def tandem(self, *arguments, code=0, **kwargs):
        done = run(*arguments, cwd=self.folder, **kwargs)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertNotIn("Backtrace", done.stderr)
        return done

    def refused(self, *arguments, says, left=(), **kwargs):
        """The input is wrong: exit code 2, a message that holds `says`, nothing on stdout and no file left behind."""
        before = {path: path.read_bytes() for path in self.folder.iterdir() if path.is_file()}
        done = self.tandem(*arguments, code=2, **kwargs)
        for words in [says] if isinstance(says, str) else says:
            self.assertIn(words, done.stderr)
        self.assertEqual(done.stdout, "")
        self.assertTrue(done.stderr.startswith("tandem: "), done.stderr)
        self.assertEqual(before, {path: path.read_bytes() for path in self.folder.iterdir() if path.is_file()})
        return done

    def scene(self, text, name="scene.toml"):
        path = self.folder / name
        path.write_text(text)
        return name

    def disk(self, **tables):
        """A scene file of the disk with more lines in its tables."""
        tables = {"scene": 'model = "rolling_disk"', "time": "end = 0.1"} | tables
        return self.scene("".join(f"[{table}]\n{lines}\n" for table, lines in tables.items()))



class Doubts(Case):
    """Warnings of the report on the terminal are in the file too."""

    def test_no_row_is_missing(self):
        """Steps in which a disk turns by more than a right angle: fixed ones, and those of a loose tolerance."""
        spin = ["--set", "model.mass=1.561", "--set", "model.radius=0.1119", "--set", "model.gravity=0.0", "--set",
                "initial.tilt=-0.9642", "--set", "initial.omega=[16.387,-0.563,0.892]", "--set", "time.end=2", "--set",
                "solver.stepper=dop853", "--quiet", "--no-error"]
        coin = ["--set", "model.mass=0.5", "--set", "model.radius=0.05", "--set", "model.inertia=[6.25e-4,3.125e-4,3.125e-4]",
                "--set", "model.gravity=9.81", "--set", "initial.omega=[-30,1,0]", "--set", "initial.tilt=0.3", "--set",
                "time.end=5", "--set", "solver.stepper=dop853", "--quiet", "--no-error"]
        for settings, interval, rows in ((spin + ["--set", "solver.step=0.1"], "0.04", 51),
                                         (spin + ["--set", "solver.rtol=0.00163"], "0.04", 51),
                                         *((coin + ["--set", f"solver.rtol={rtol}"], "0.01", 501)
                                           for rtol in ("1e-3", "1e-4", "1e-5"))):
            with self.subTest(settings=settings):
                self.tandem("run", "rolling_disk", *settings, "--set", f"output.interval={interval}", "--force", "--output",
                            "rows.h5")
                self.tandem("run", "rolling_disk", *settings, "--set", "output.every=1", "--force", "--output", "steps.h5")
                with h5py.File(self.folder / "rows.h5") as looked, h5py.File(self.folder / "steps.h5") as steps:
                    self.assertEqual(len(looked["trajectory/time"]), rows)
                    self.assertLess(np.max(looked["diagnostics/position_error"]), 1e-12)
                    # Rounding, where a step ends with a search for pivots.
                    np.testing.assert_allclose(looked["trajectory/q"][-1], steps["trajectory/q"][-1], rtol=0, atol=1e-11)

    def test_rounding_keeps_no_row_out(self):
        """The iteration stands still at 1.6e-14, above its own tolerance, but well within that of the constraints."""
        self.tandem("run", "rolling_disk", "--set", "solver.stepper=trapezoid", "--set", "solver.rtol=0.00511", "--set",
                    "solver.chart=adaptive", "--set", "model.mass=0.03736", "--set", "model.radius=9.604", "--set",
                    "model.gravity=1.0", "--set", "initial.tilt=-1.3467", "--set", "initial.omega=[-12.791,-1.725,-1.869]",
                    "--set", "time.end=2", "--set", "output.interval=0.054054", "--quiet", "--no-error", "--output", "rows.h5")
        with h5py.File(self.folder / "rows.h5") as file:
            self.assertEqual(len(file["trajectory/time"]), 39)
            self.assertLess(np.max(file["diagnostics/position_error"]), 1e-12)

    def test_errors_between_steps_and_at_the_end(self):
        done = self.tandem("run", "motorcycle", "--output", "doubts.h5", "--set", "solver.stepper=dop853", "--set",
                           "solver.rtol=1e-8", "--set", 'solver.projection="stages"', "--set", "output.interval=0.1")
        told = re.sub(r"\s+", " ", done.stdout)
        with h5py.File(self.folder / "doubts.h5") as file:
            report = file["report"].attrs
            warnings = [text if isinstance(text, str) else text.decode() for text in report.get("warnings", [])]
            self.assertFalse(any("between steps" in text for text in warnings), warnings)
            for text in warnings:
                self.assertIn(text, told)
            for name in ("dense_error_q", "dense_error_qd"):
                self.assertGreater(report[name], 0)
                self.assertLess(report[name], 1.5e-7)
            self.assertGreaterEqual(report["velocity_gap"], 0)


class Check(Case):
    def test_every_shipped_scene_is_right(self):
        for path in sorted((ROOT / "scenes").glob("*.toml")):
            with self.subTest(path.stem):
                done = self.tandem("check", str(path))
                # Bricard's mechanism has a row too many.
                self.assertIn("C has rank 34 of 35" if path.stem == "a04_bricard" else "C has full rank", done.stdout)
                self.assertNotIn("WRONG", done.stdout)
                self.assertGreaterEqual(done.stdout.count("right, within"), 9)
                self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_start_that_is_off(self):
        done = self.tandem("check", "articulated_vehicle", "--set", "initial.q=[6.0, 0.1, 0, 0, 0, 0]", "--set",
                           "initial.qd=[15.0, 0, 0, 15.0, 0, 0]", code=2)
        self.assertIn('inconsistent_start', done.stderr)
        self.assertIn('"joint y"', done.stderr)

    def test_usage(self):
        self.assertIn("needs a SCENE", self.tandem("check", code=2).stderr)


    def test_procedures_that_give_no_numbers(self):
        """The steering turns so fast that its square overflows."""
        for frequency in "1e200", "1e300":
            done = self.tandem("check", "motorcycle", "--set", f"model.frequency={frequency}", code=2)
            self.assertIn("not_finite", done.stderr)
            self.assertRegex(done.stdout, r"constraint_acceleration +FAILED: no number: row 1 is NaN")
            self.assertNotIn("by NaN", done.stdout)


class Rows(Case):
    """Default rows of runs with error control: at all steps, and between them."""

    FALL = """
[scene]
model = "mechanism"
[gravity]
vector = [0, 0, -10]
[body.stone]
mass = 2.0
inertia = [1, 1, 1]
position = [0, 0, 0]
velocity = [3, 0, 4]
[time]
end = 2.0
[solver]
rtol = 1e-6
"""

    def series(self, *arguments, scene, settings=(), code=0):
        self.tandem("run", scene, "--output", "rows.h5", "--force", "--no-error", *arguments,
                    *(word for setting in settings for word in ("--set", setting)), code=code)
        with h5py.File(self.folder / "rows.h5") as file:
            found = {name: data[:] for group in ("trajectory", "diagnostics") for name, data in file[group].items() if name != "coordinate"}
            return found, dict(file["report"].attrs), list(file["trajectory/q"].attrs["names"])

    def test_few_steps(self):
        """300 rows of the lane change that dop853 makes in 30 steps; the steps, and the rows at their ends, are the same."""
        settings = ["solver.stepper=dop853", "solver.rtol=1e-6"]
        rows, report, _ = self.series(scene="motorcycle", settings=settings)
        self.assertLess(report["steps"], 60)
        self.assertGreater(len(rows["time"]), 300)
        self.assertLess(len(rows["time"]), 302 + report["steps"])
        self.assertTrue((np.diff(rows["time"]) > 0).all())
        self.assertLess(np.diff(rows["time"]).max(), 10/300*(1 + 1e-6))
        ends = np.flatnonzero(rows["step"])
        self.assertEqual(len(ends), report["steps"])
        np.testing.assert_allclose(np.diff(rows["time"][[0, *ends]]), rows["step"][ends], rtol=1e-12, atol=1e-14)
        for level in ("position", "velocity", "acceleration"):
            self.assertLess(rows[f"{level}_error"].max(), 1e-12)
            self.assertEqual(rows[f"{level}_error"][[0, *ends]].max(), report[f"largest_{level}_error"])
        # More rows within the same steps.
        finer, other, _ = self.series(scene="motorcycle", settings=[*settings, "output.rows=5000"])
        self.assertGreater(len(finer["time"]), 5000)
        self.assertEqual(report["steps"], other["steps"])
        for name, values in finer.items():
            np.testing.assert_array_equal(rows[name][[0, *ends]], values[[0, *np.flatnonzero(finer["step"])]], name)
        steps, other, _ = self.series(scene="motorcycle", settings=[*settings, "output.rows=0"])
        self.assertEqual(len(steps["time"]), other["steps"] + 1)
        self.assertTrue((steps["step"][1:] > 0).all())
        # Many steps are rows enough.
        settings = ["solver.stepper=dopri5", "solver.rtol=1e-6", "solver.max_step=2e-3", "time.end=1"]
        rows, report, _ = self.series(scene="rolling_disk", settings=settings)
        self.assertGreater(report["steps"], 499)
        self.assertEqual(len(rows["time"]), report["steps"] + 1)

    def test_rows_between_steps_are_on_the_motion(self):
        rows, report, names = self.series(scene=self.scene(self.FALL))
        self.assertLess(report["steps"], 30)
        self.assertGreater(len(rows["time"]), 300)
        time = rows["time"]
        for name, place, velocity, acceleration in (("stone.x", 3*time, 3 + 0*time, 0*time),
                                                    ("stone.z", 4*time - 5*time**2, 4 - 10*time, -10 + 0*time)):
            column = names.index(name)
            for field, expected in (("q", place), ("qd", velocity), ("qdd", acceleration)):
                np.testing.assert_allclose(rows[field][:, column], expected, rtol=0, atol=1e-11, err_msg=f"{field} {name}")

    def test_what_scenes_say(self):
        """every and interval place the rows, wherever they are given; the complete scene is the same run."""
        name = self.scene(self.FALL)
        shown = tomllib.loads(self.tandem("show", name).stdout)["output"]
        self.assertEqual((shown["every"], shown["interval"], shown["rows"]), (1, 0.0, 300))
        (self.folder / "whole.toml").write_text(self.tandem("show", name).stdout)
        count = len(self.series(scene=name)[0]["time"])
        for words, rows in (((), count), (("output.every=1",), 0), (("output.every=1000000",), 2), (("output.interval=0.5",), 5),
                            (("output.interval=0",), 0), (("output.rows=0",), 0)):
            for scene in name, "whole.toml":
                with self.subTest(words, scene=scene):
                    found, report, _ = self.series(scene=scene, settings=words)
                    if scene == "whole.toml" and words == ("output.interval=0",):
                        # Zero takes nothing from a scene.
                        self.assertEqual(len(found["time"]), count)
                    else:
                        self.assertEqual(len(found["time"]), rows or report["steps"] + 1)
        every = self.scene(self.FALL + "[output]\nevery = 2\n", "every.toml")
        self.assertEqual(tomllib.loads(self.tandem("show", every).stdout)["output"]["rows"], 0)
        self.assertGreater(len(self.series(scene=every, settings=["output.rows=400"])[0]["time"]), 400)
        for given in "every = 2", "interval = 0.1":
            both = self.scene(self.FALL + f"[output]\nrows = 500\n{given}\n", "both.toml")
            self.refused("run", both, says=["rows has no effect together with every or interval", "--unset output.rows"])
        self.refused("run", name, "--set", "output.rows=-1", says="rows must not be negative")
        # Fixed steps are rows; further rows are added on request.
        fixed = self.scene(self.FALL.replace("rtol = 1e-6", "step = 0.1"), "fixed.toml")
        self.assertEqual(len(self.series(scene=fixed)[0]["time"]), 21)
        self.assertEqual(len(self.series(scene=fixed, settings=["output.rows=100"])[0]["time"]), 101)
        for path in sorted((ROOT / "scenes").glob("*.toml")):
            shown = tomllib.loads(self.tandem("show", str(path)).stdout)
            self.assertEqual((shown["output"]["every"], shown["output"]["interval"]), (1, 0.0), path.stem)
            self.assertEqual(shown["output"]["rows"], 0 if shown["solver"]["step"] > 0 else 300, path.stem)

    def test_an_event_between_rows(self):
        """Rows up to an event that stops a run, and on both sides of a clutch that is locked: 3 rad/s and 0 become 2 and 2."""
        stop = '\n[[event]]\nname = "top"\nwatch = "qd:stone.z"\ndirection = "falling"\naction = "stop"\n'
        rows, report, names = self.series(scene=self.scene(self.FALL + stop))
        time, z = rows["time"], rows["q"][:, names.index("stone.z")]
        self.assertAlmostEqual(time[-1], 0.4, delta=1e-9)
        self.assertLess(np.diff(time).max(), 2/300*(1 + 1e-6))
        np.testing.assert_allclose(z, 4*time - 5*time**2, rtol=0, atol=1e-11)
        self.assertEqual(np.count_nonzero(rows["step"]), report["steps"])
        self.assertAlmostEqual(rows["step"].sum(), 0.4, delta=1e-9)
        discs = "".join(f'[body.{name}]\nmass = 1\ninertia = {spin}\nposition = [{x}, 0]\nomega = {omega}\n[joint.{name}_axle]\n'
                        f'type = "revolute"\nbodies = ["ground", "{name}"]\nat = [{x}, 0]\n'
                        for name, spin, x, omega in (("one", 1, 0, 3), ("two", 0.5, 1, 0)))
        clutch = '[scene]\nmodel = "mechanism"\nplanar = true\n' + discs + \
            '[constraint.clutch]\ntype = "coupling"\njoints = ["one_axle", "two_axle"]\nfactors = [1, -1]\nlocked = false\n' \
            '[time]\nend = 2\n[solver]\nstepper = "STEPPER"\nrtol = 1e-9\n[[event]]\nname = "engage"\nwatch = "one.angle"\n' \
            'value = 1.5\ndirection = "rising"\nchange = "lock clutch"\n'
        for stepper in "dop853", "radau5":
            with self.subTest(stepper):
                rows, report, names = self.series(scene=self.scene(clutch.replace("STEPPER", stepper)))
                time, one, two = rows["time"], names.index("one.angle"), names.index("two.angle")
                self.assertLess(np.diff(time).max(), 2/300*(1 + 1e-6))
                self.assertEqual(np.count_nonzero(rows["step"]), report["steps"])
                before, after = time < 0.5 - 1e-7, time > 0.5 + 1e-7
                np.testing.assert_allclose(rows["qd"][before][:, [one, two]], [[3, 0]]*before.sum(), atol=1e-8)
                np.testing.assert_allclose(rows["qd"][after][:, [one, two]], [[2, 2]]*after.sum(), atol=1e-8)
                np.testing.assert_allclose(rows["q"][:, one], np.where(time < 0.5, 3*time, 0.5 + 2*time), atol=1e-8)
                np.testing.assert_allclose(rows["q"][:, two], np.where(time < 0.5, 0, 2*time - 1), atol=1e-8)

    def test_rows_that_cannot_be(self):
        """A force that is undefined in a short interval between steps: rows there are left out, and the run continues."""
        hole = self.FALL + """
[force.push]
type = "load"
on = "stone"
force = ["0*sqrt((t - 1.2345)^2 - 1e-6)", 0, 0]
"""
        rows, report, names = self.series(scene=self.scene(hole), settings=["solver.stepper=dop853", "output.rows=20000"])
        time = rows["time"]
        self.assertFalse((abs(time - 1.2345) < 1e-3).any())
        # 1e-4 s apart, they are missing for 2e-3 s.
        self.assertAlmostEqual(len(time), 20000 - 20, delta=5)
        self.assertAlmostEqual(time[-1], 2, delta=1e-12)


class ResultFile(Case):
    def test_headers_lie_in_one_page(self):
        """The system may kill a program between two pages of a write; /report is written at the end alone."""
        scene = ["--set", 'event=[{name="low", watch="rz", value=0.9}]', "--output", "pages.h5"]
        self.tandem("run", "rolling_disk", *SHORT, *scene)
        with h5py.File(self.folder / "pages.h5") as file:
            names = []
            file.visit(names.append)
            self.assertGreater(len(names), 20)
            for name in names:
                about = h5py.h5o.get_info(file[name].id)
                if name != "report":
                    self.assertEqual(about.hdr.nchunks, 1, name)
                    self.assertEqual(about.addr//4096, (about.addr + about.hdr.space.total - 1)//4096, name)

    def result(self, *arguments, scene="rolling_disk"):
        self.tandem("run", scene, "--output", "result.h5", "--force", *arguments)
        return h5py.File(self.folder / "result.h5")

    def test_interval_by_dense_output(self):
        adaptive = ["--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-9", "--set", "time.end=2"]
        with self.result(*adaptive, "--set", "output.interval=0.01") as file:
            time = file["trajectory/time"][:]
            np.testing.assert_allclose(time, np.linspace(0, 2, 201), rtol=0, atol=1e-12)
            self.assertLess(file["report"].attrs["steps"], 60)
            for level in ("position", "velocity", "acceleration"):
                self.assertLess(file[f"diagnostics/{level}_error"][:].max(), 1e-12)
            q = file["trajectory/q"][:]
        # Error control shortens steps for the rows; fixed steps are unchanged.
        with self.result(*adaptive) as file:
            np.testing.assert_allclose(file["trajectory/q"][-1], q[-1], rtol=0, atol=1e-7)
        ends = []
        for rows in ("output.interval=0.01", "output.every=1"):
            with self.result("--set", "solver.stepper=dop853", "--set", "solver.step=0.05", "--set", "time.end=2", "--set", rows) as file:
                ends.append(file["trajectory/q"][-1])
        np.testing.assert_array_equal(*ends)
        # The height has a smooth second difference only if rows between steps are right.
        self.assertLess(np.abs(np.diff(q[:, 2], 4)).max(), 1e-6)

    def test_default_fields_and_shapes(self):
        with self.result(*SHORT, "--set", "output.every=10") as file:
            time = file["trajectory/time"]
            np.testing.assert_allclose(time, 0.01 * np.arange(11), rtol=0, atol=1e-15)
            names = [*file["trajectory"], *file["diagnostics"]]
            self.assertEqual(sorted(names), sorted(["time", "coordinate", "time", *DEFAULT]))
            for name in "q", "qd", "qdd":
                self.assertEqual(file["trajectory"][name].shape, (11, 9))
                self.assertEqual(file["trajectory"][name].dtype, np.float64)
            for name in DEFAULT[3:]:
                self.assertEqual(file["diagnostics"][name].shape, (11,))
            self.assertEqual(file["diagnostics/chart"].dtype, np.int64)
            self.assertEqual(file["diagnostics/chart"][:3].tolist(), [1, 10, 20])
            np.testing.assert_allclose(file["diagnostics/step"], [0] + 10 * [1e-3], rtol=1e-12)
            for level in "position", "velocity", "acceleration":
                self.assertLessEqual(file[f"diagnostics/{level}_error"][:].max(), 1e-12)
                self.assertLessEqual(file[f"diagnostics/{level}_error"][:].max(),
                                     file["report"].attrs[f"largest_{level}_error"])

    def test_the_columns_are_the_coordinates(self):
        with self.result(*SHORT) as file:
            q, qd = file["trajectory/q"], file["trajectory/qd"]
            np.testing.assert_array_equal(q[0], [0, 0, 1, 1, 0, 0, 0, 0, -1])
            self.assertAlmostEqual(qd[0, 1], 1.0, 12)
            np.testing.assert_allclose(np.linalg.norm(q[:, 3:7], axis=1), 1, atol=1e-12)

    def test_names_and_units_are_texts(self):
        with self.result(*SHORT, "--set", 'output.fields=["q", "qd", "qdd", "lambda"]') as file:
            names = ["rx", "ry", "rz", "e0", "e1", "e2", "e3", "a1", "a2"]
            for name, per in ("q", ""), ("qd", "/s"), ("qdd", "/s^2"):
                attributes = file["trajectory"][name].attrs
                self.assertEqual(list(attributes["names"]), names)
                self.assertEqual(list(attributes["units"]), [unit + per for unit in "mmm1111mm"])
                self.assertIsInstance(attributes["names"][0], str)
                self.assertIsInstance(attributes["meaning"], str)
            rows = list(file["trajectory/lambda"].attrs["names"])
            self.assertEqual(len(rows), 6)
            self.assertEqual(len(set(rows)), 6)
            self.assertEqual(file["trajectory/time"].attrs["unit"], "s")

    def test_multipliers_have_units(self):
        """Work over the unit of the row: rows of a length N, of a square of a length N/m, the norm of Euler parameters J."""
        for scene, units in {"rolling_disk": "N N J N/m N N", "articulated_vehicle": "N N N N N",
                             "motorcycle": "N N N N J N/m N N/m"}.items():
            self.tandem("run", scene, "--set", "time.end=0.01", "--set", 'output.fields=["lambda"]', "--output", "result.h5", "--force")
            with h5py.File(self.folder / "result.h5") as file:
                self.assertEqual(list(file["trajectory/lambda"].attrs["units"]), units.split())

    def test_time_is_the_dimension_scale_of_the_others(self):
        with self.result(*SHORT, "--set", 'output.fields=["q", "lambda", "kinetic_energy", "chart"]') as file:
            time = file["trajectory/time"]
            self.assertTrue(time.is_scale)
            for path in "trajectory/q", "trajectory/lambda", "diagnostics/kinetic_energy", "diagnostics/chart":
                scale = file[path].dims[0]
                self.assertEqual(scale.keys(), ["time"])
                np.testing.assert_array_equal(scale[0], time)
                self.assertEqual(len(time), len(file[path]))

    def test_every_dimension_has_a_scale_in_its_group(self):
        """So that readers of netCDF take the file: xarray refuses data of which some dimensions have scales and others none, and
        looks for a scale in the group of the data alone."""
        event = 'event=[{name="a", watch="ry", value=0.05}]'
        fields = 'output.fields=["q", "qd", "qdd", "lambda", "kinetic_energy", "chart"]'
        with self.result(*SHORT, "--set", fields, "--set", event) as file:
            seen = set()
            for group in "trajectory", "diagnostics", "events":
                for name, data in file[group].items():
                    if data.is_scale:
                        continue
                    for axis, dimension in enumerate(data.dims):
                        self.assertEqual(len(dimension), 1, f"{group}/{name}, dimension {axis}")
                        scale = dimension[0]
                        label = scale.name.rsplit("/", 1)[1]
                        self.assertEqual(file[group][label], scale, f"{group}/{name}, dimension {axis}")
                        self.assertEqual(scale.shape, (data.shape[axis],))
                        seen.add(label)
            self.assertEqual(seen, {"time", "coordinate", "constraint"})
            for path, scale in {"q": "coordinate", "qdd": "coordinate", "lambda": "constraint"}.items():
                names = file["trajectory"][scale].asstr()[:]
                self.assertEqual(list(names), list(file["trajectory"][path].attrs["names"]))

    def test_attributes_of_the_root(self):
        with self.result(*SHORT) as file:
            attributes = file.attrs
            self.assertEqual(attributes["status"], "complete")
            self.assertEqual(attributes["status_message"], "")
            self.assertEqual(attributes["format_version"], 1)
            version = re.search(r'^version = "(.*)"', (ROOT / "fpm.toml").read_text(), re.M)[1]
            self.assertEqual(attributes["tandem_version"], version)
            self.assertRegex(attributes["created"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d$")
            self.assertIn("run rolling_disk --output result.h5", attributes["command"])
            self.assertIn("(nt, n) in C", attributes["layout"])
            self.assertIn("[model]\nmass = 10.0", attributes["scene"])
            for value in attributes.values():
                self.assertIsInstance(value, (str, np.int64))

    def test_the_report_counts_the_whole_run(self):
        with self.result(*SHORT, "--set", "output.every=50") as file:
            report = dict(file["report"].attrs)
            self.assertEqual(len(file["trajectory/time"]), 3)
            self.assertEqual((report["steps"], report["rejected"], report["status_code"]), (100, 0, 0))
            self.assertEqual(report["charts"], 100)
            self.assertEqual(report["charts"], sum(value for key, value in report.items() if key.startswith("charts_by_")))
            for name in "right_hand_sides", "evaluations_phi", "evaluations_force", "basis_factorizations", "wall_seconds":
                self.assertGreater(report[name], 0, name)
            for name in "evaluations_nu", "multipliers", "kinetic_energies", "potential_energies", "velocity_jump":
                self.assertEqual(report[name], 0, name)

    def test_only_what_is_asked_for(self):
        with self.result(*SHORT, "--set", 'output.fields=["potential_energy"]', "--set", "output.every=10") as file:
            self.assertEqual(list(file["trajectory"]), ["time"])
            self.assertEqual(list(file["diagnostics"]), ["potential_energy", "time"])
            report = file["report"].attrs
            self.assertEqual((report["potential_energies"], report["kinetic_energies"], report["multipliers"]), (11, 0, 0))
        with self.result(*SHORT, "--set", "output.fields=[]") as file:
            self.assertEqual((list(file["trajectory"]), list(file["diagnostics"])), (["time"], []))

    def test_energies_and_multipliers(self):
        fields = 'output.fields=["q", "qdd", "lambda", "kinetic_energy", "potential_energy"]'
        with self.result("--set", "time.end=1", "--set", fields) as file:
            energy = file["diagnostics/kinetic_energy"][:] + file["diagnostics/potential_energy"][:]
            self.assertAlmostEqual(energy[0], 103.500625005, 9)
            self.assertLess(np.ptp(energy), 1e-6 * energy[0])
            np.testing.assert_allclose(file["diagnostics/potential_energy"], 96.0 * file["trajectory/q"][:, 2], rtol=1e-13)
            # Upright and straight, the contact carries the weight: m rz'' + lambda = -m g in the row of the height.
            lambda_, qdd = file["trajectory/lambda"], file["trajectory/qdd"]
            self.assertAlmostEqual(lambda_[0, 0] + 10 * qdd[0, 2], -96.0, 3)

    def test_the_last_state_is_there_off_the_grid_too(self):
        with self.result("--set", "time.end=0.0257", "--set", "output.every=10") as file:
            np.testing.assert_allclose(file["trajectory/time"], [0, 0.01, 0.02, 0.0257], atol=1e-15)
            self.assertAlmostEqual(file["diagnostics/step"][-1], 0.0007, 12)

    def test_more_rows_than_the_buffer_holds(self):
        with self.result("--set", "time.end=2", "--set", "output.every=1") as fine:
            time, q = fine["trajectory/time"][:], fine["trajectory/q"][:]
        np.testing.assert_allclose(time, 1e-3 * np.arange(2001), atol=1e-12)
        with self.result("--set", "time.end=2", "--set", "output.every=7") as coarse:
            np.testing.assert_array_equal(coarse["trajectory/q"][:-1], q[::7])
            np.testing.assert_array_equal(coarse["trajectory/q"][-1], q[-1])

    def test_the_vehicle(self):
        fields = 'output.fields=["q", "lambda", "kinetic_energy"]'
        with self.result("--set", fields, scene="articulated_vehicle") as file:
            q = file["trajectory/q"]
            self.assertEqual(list(q.attrs["names"]), ["x1", "y1", "phi1", "x2", "y2", "phi2"])
            self.assertEqual(list(q.attrs["units"]), ["m", "m", "rad", "m", "m", "rad"])
            np.testing.assert_allclose(q[-1, :2], [155.873568637815, 4.00289058254929], atol=1e-9)
            np.testing.assert_allclose(file["diagnostics/kinetic_energy"], 337500, rtol=1e-8)
            # Once for the chart, and once for the energies.
            self.assertEqual(file["report"].attrs["evaluations_mass"], 2)
            self.assertEqual(file["report"].attrs["evaluations_force"], 0)

    def test_the_motorcycle(self):
        settings = ["--set", "solver.stepper=sdirk54", "--set", "solver.step=0.02", "--set", "time.end=7", "--set",
                    'output.fields=["q", "qd", "chart"]', "--set", "output.every=1"]
        for scene, fork in ("motorcycle", 0.6207), ("motorcycle_chopper", 0.9103):
            with self.result(*settings, scene=scene) as file:
                q, report = file["trajectory/q"], file["report"].attrs
                self.assertEqual(q.shape[1], 10)
                self.assertAlmostEqual(q[0, list(q.attrs["names"]).index("s")], fork, 4)
                self.assertEqual(report["charts_by_breakpoint"], 1)
                self.assertGreater(report["velocity_jump"], 0)
                self.assertEqual(report["evaluations_dynamics_q"], report["newton_matrices"])
                self.assertGreater(report["newton_corrections"], report["implicit_stages"] / 2)

    def test_the_scene_in_the_file_runs_again_to_the_same_numbers(self):
        with self.result(*SHORT, "--set", "initial.omega=[-1, 0.1, 0.3]", "--set", "initial.tilt=0.1") as file:
            q, scene = file["trajectory/q"][:], file.attrs["scene"]
        with self.result(scene=self.scene(scene)) as again:
            np.testing.assert_array_equal(again["trajectory/q"], q)

    def test_the_example_of_the_documentation(self):
        self.tandem("run", "rolling_disk", *SHORT)
        example = re.search(r"```python\n(.*?)```", (ROOT / "doc" / "output.md").read_text(), re.S)[1]
        done = subprocess.run([sys.executable, "-c", example], cwd=self.folder, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("complete", done.stdout)
        self.assertRegex(done.stdout, r"lowest point 1\.0000 m at t = 0\.\d\d s")


class Events(Case):
    """Events of a scene: the disk rolls along x with a speed that is nearly constant, and nods about its axis."""

    EVENTS = """
[[event]]
name = "half way"
watch = "rx"
value = 0.5
direction = "rising"

[[event]]
name = "nod"
watch = "qd:rz"
"""
    STOP = """
[[event]]
name = "load"
watch = "lambda:%s"
value = %s
action = "stop"
"""

    def disk_with(self, events, end=2.0, **tables):
        tables = {"time": f"end = {end}", "initial": "omega = [-1.0, 0.01, 0.0]\ntilt = 0.1"} | tables
        path = self.folder / self.disk(**tables)
        path.write_text(path.read_text() + events)
        return path.name

    def test_events_agree_with_the_rows(self):
        name = self.disk_with(self.EVENTS, output='interval = 0.001\nfields = ["q", "qd"]',
                              solver='stepper = "dop853"\nrtol = 1e-10')
        done = self.tandem("run", name, "--output", "result.h5")
        with h5py.File(self.folder / "result.h5") as file:
            self.assertEqual(sorted(file["events"]), ["coordinate", "direction", "name", "number", "q", "qd", "time"])
            time, q, qd = (file["trajectory/" + field][:] for field in ("time", "q", "qd"))
            events = file["events"]
            names = [name.decode() for name in events["name"][:]]
            self.assertEqual(events["q"].shape, (len(names), 9))
            self.assertEqual(list(events["q"].attrs["names"]), list(file["trajectory/q"].attrs["names"]))
            self.assertEqual(events["qd"].attrs["units"][0], "m/s")
            self.assertEqual(file["report"].attrs["events"], len(names))
            self.assertEqual(file["report"].attrs["charts_by_event"], 0)
            self.assertEqual(list(np.diff(events["time"][:]) >= 0), [True] * (len(names) - 1))
            np.testing.assert_array_equal(events["number"][:], [1 + (name == "nod") for name in names])
            # The same crossings in the rows, whose spacing they must be within.
            found = np.flatnonzero(np.diff(np.sign(qd[:, 2])) != 0)
            nods = events["time"][:][[name == "nod" for name in names]]
            nods = nods[nods > 0]
            self.assertGreater(len(nods), 0)
            self.assertEqual(len(found[time[found] > 1e-9]), len(nods))
            for place, t in zip(found[time[found] > 1e-9], nods):
                self.assertTrue(time[place] <= t <= time[place + 1])
            at = names.index("half way") if "half way" in names else None
            if np.any(q[:, 0] > 0.5):
                self.assertAlmostEqual(events["q"][at, 0], 0.5, delta=1e-12)
                self.assertEqual(events["direction"][at], 1)
        self.assertRegex(done.stdout, r"(?m)^  event +half way \d time")
        self.assertRegex(done.stdout, r"(?m)^ +nod \d+ times? at t = [\d.]+")

    def test_a_stop_ends_the_file(self):
        name = self.disk_with(self.EVENTS + '[[event]]\nname = "far"\nwatch = "ry"\nvalue = 0.3\naction = "stop"\n', end=50.0,
                              output="interval = 0.01")
        text = self.tandem("run", name, "--output", "result.h5").stdout
        with h5py.File(self.folder / "result.h5") as file:
            self.assertEqual(file.attrs["status"], "complete")
            self.assertRegex(file.attrs["status_message"], '^stopped by "far" at t = ')
            last = file["trajectory/q"][-1]
            self.assertAlmostEqual(last[1], 0.3, delta=1e-12)
            self.assertEqual(file["trajectory/time"][-1], file["events/time"][-1])
            np.testing.assert_array_equal(file["events/q"][-1], last)
        self.assertIn('stopped by "far" at t = ', text)

    def test_a_stop_leaves_the_error_unknown(self):
        name = self.disk_with(self.EVENTS, end=1.0)
        self.assertRegex(self.tandem("run", name, "--error").stdout, r"  error at end +q \S+ ")
        name = self.disk_with('[[event]]\nname = "far"\nwatch = "ry"\nvalue = 0.3\naction = "stop"\n', end=50.0)
        done = self.tandem("run", name, "--error", "--output", "result.h5")
        self.assertRegex(" ".join(done.stdout.split()), "error at end not known: [^:]*: an event has stopped the run, and the second")
        with h5py.File(self.folder / "result.h5") as file:
            self.assertNotIn("global_error", file["report"].attrs)

    def test_a_scene_without_events_has_none(self):
        self.tandem("run", "rolling_disk", *SHORT, "--output", "result.h5")
        with h5py.File(self.folder / "result.h5") as file:
            self.assertNotIn("events", file)
            self.assertNotIn("events", file["report"].attrs)
            self.assertNotIn("warnings", file["report"].attrs)

    def test_the_complete_scene_keeps_its_events(self):
        name = self.disk_with(self.EVENTS + self.STOP % ("contact height", "1.5"))
        shown = self.tandem("show", name)
        if shown.returncode == 0:
            self.assertEqual(shown.stdout.count("[[event]]"), 3)
            self.scene(shown.stdout, "again.toml")
            again = self.tandem("show", "again.toml").stdout
            self.assertEqual(again.replace('"again', '"scene'), shown.stdout)

    def test_errors_name_the_line(self):
        good = 'name = "a"\nwatch = "rx"\n'
        for lines, says in [
                (good.replace("rx", "rxx"), ["is not a coordinate", 'did you mean "rx"?', "scene.toml:", "in [[event]]"]),
                (good.replace("rx", "lambda:contct"), ["is not a constraint", "scene.toml:"]),
                (good + 'direction = "up"\n', ["direction must be one of", "scene.toml:"]),
                (good + 'action = "explode"\n', ["action must be one of record, stop", "scene.toml:"]),
                (good + 'limit = 3\n', ['unknown key "limit" in [[event]]', "scene.toml:"]),
                (good + 'value = "big"\n', ["value must be a number", "scene.toml:"]),
                ('watch = "rx"\n', ["the key name is missing in [[event]]"]),
                ('name = "a"\n', ["the key watch is missing in [[event]]"]),
                (good + "[[event]]\n" + good, ["name is the name of another event"])]:
            with self.subTest(lines):
                self.refused("run", self.disk_with("[[event]]\n" + lines), says=says)
        self.refused("run", self.disk_with("[event]\n" + good), says="write [[event]] on a line of its own")

    def test_settings_give_events(self):
        name = self.disk_with('[[event]]\nname = "a"\nwatch = "rx"\nvalue = 3.0\n')

        def told(*settings):
            words = [word for setting in settings for word in ("--set", setting)]
            shown = tomllib.loads(self.tandem("show", name, *words).stdout).get("event", [])
            return [(event["name"], event["watch"], event["value"]) for event in shown]

        self.assertEqual(told(), [("a", "rx", 3.0)])
        self.assertEqual(told("event.1.value=4", "event.1.watch=ry"), [("a", "ry", 4.0)])
        self.assertEqual(told("event.2.name=b", "event.2.watch=rz"), [("a", "rx", 3.0), ("b", "rz", 0.0)])
        self.assertEqual(told('event=[{name="c", watch="rz", value=0.5}, {name="d", watch="qd:rz"}]', "event.2.value=1"),
                         [("c", "rz", 0.5), ("d", "qd:rz", 1.0)])
        self.assertEqual(told("event.1.value=4", "event=[]"), [])
        self.assertEqual(told("event=[]", 'event.1={name="e", watch="rx"}'), [("e", "rx", 0.0)])
        for setting, says in {
            "event.value=3": ["there are 1", "event.NUMBER.key=value, with a number from 1 to 2"],
            "event.3.name=b": "a number from 1 to 2", "event.0.name=b": "a number from 1 to 2", "event.01.name=b": "1 to 2",
            "event.1=3": "event.NUMBER.key=value", "event=[1]": "write event=[{KEY = VALUE, ...}, ...]", "event={name=1}": "must be table.key=value",
            'event=[{watch="rz"}]': "the key name is missing in [[event]] of --set",
            "event.2.name=b": "the key watch is missing in [[event]] of --set", "event.1.wath=rz": ['unknown key "wath"', "--set"],
            'event=[{name="a", watch="rq"}]': ["is not a coordinate", "--set:1:25"],
        }.items():
            with self.subTest(setting):
                self.refused("run", name, "--set", setting, says=says)
        self.tandem("run", "rolling_disk", *SHORT, "--set", 'event=[{name="a", watch="ry", value=0.05}]', "--output", "result.h5")
        with h5py.File(self.folder / "result.h5") as file:
            self.assertEqual(list(file["events/name"][:]), [b"a"])


    def test_the_mark_is_under_the_value(self):
        for setting, places in {"model.mass=-1": "12-13", "initial.omega=[1,2]": "15-19", "initial.omega= [1, 2]": "16-21",
                                'solver.rtol=[1,"a"]': "13-19", "time.end={a=1}": "10-14", 'output.fields=["x"]': "15-19",
                                "scene.model=[1]": "13-15", "model.mas=3": "7-9"}.items():
            with self.subTest(setting):
                self.refused("show", "rolling_disk", "--set", setting, says=f"--set:1:{places}")
        # Of a list on several lines the bracket alone.
        done = self.refused("show", self.disk(solver="rtol = [1,\n  2]\n"), says="rtol has 2 elements")
        self.assertRegex(done.stderr, r"(?m)scene\.toml:6:8$")


class Outcome(Case):
    def test_a_failed_run_keeps_its_rows(self):
        done = self.tandem("run", "rolling_disk", "--set", "solver.step=0.5", "--set", "output.every=1", code=1)
        self.assertRegex(done.stderr, r"(?m)^tandem: \w+: .*0\.5")
        self.assertIn("FAILED", done.stdout)
        with h5py.File(self.folder / "rolling_disk.h5") as file:
            self.assertEqual(file.attrs["status"], "failed")
            self.assertIn(file.attrs["status_message"], done.stderr)
            self.assertLess(file["report"].attrs["status_code"], 0)
            steps = file["report"].attrs["steps"]
            self.assertGreaterEqual(steps, 1)
            np.testing.assert_allclose(file["trajectory/time"], 0.5 * np.arange(steps + 1))

    def test_too_many_steps(self):
        done = self.tandem("run", "rolling_disk", "--set", "solver.max_steps=10", "--output", "a.h5", code=1)
        self.assertIn("tandem: step_limit: ", done.stderr)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file["trajectory/time"][-1], 0.01)

    def test_the_report_names_what_was_computed_and_what_not(self):
        report = self.tandem("run", "articulated_vehicle", *SHORT).stdout
        for words in "in 100 steps", "100: start 1, every step 99", "tolerance 1e-12", "articulated_vehicle.h5", "mass 1,":
            self.assertIn(words, report)
        left_out = report[report.index("left out"):]
        for words in "nu", "force", "multipliers", "energies", "derivatives":
            self.assertIn(words, left_out)
        fields = 'output.fields=["lambda", "kinetic_energy"]'
        report = self.tandem("run", "articulated_vehicle", *SHORT, "--set", fields, "--force").stdout
        self.assertIn("kinetic 337500.0 J at the start", report)
        self.assertNotIn("multipliers", report[report.index("left out"):])
        self.assertNotIn("projection of stages", report)
        ends = 'solver.projection="step_ends"'
        report = self.tandem("run", "articulated_vehicle", *SHORT, "--set", ends, "--force").stdout
        self.assertIn("projection of stages (steps meet the constraints at their ends)", report)
        self.refused("run", "articulated_vehicle", "--set", ends, "--set", "solver.stepper=sdirk54", says="remove it, or use an explicit stepper")

    def test_progress_is_a_line_per_ten_percent(self):
        done = self.tandem("run", "rolling_disk", "--set", "time.end=2")
        lines = done.stderr.splitlines()
        self.assertEqual(len(lines), 10, done.stderr)
        self.assertEqual([int(line.split()[0]) // 10 for line in lines], list(range(1, 11)))

    def test_quiet(self):
        done = self.tandem("run", "rolling_disk", *SHORT, "--quiet")
        self.assertEqual((done.stdout, done.stderr), ("", ""))

    def test_a_quiet_run_warns_all_the_same(self):
        done = self.tandem("run", "motorcycle", "--quiet", "--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-2", "--error",
                           "--output", "loose.h5")
        self.assertEqual(done.stdout, "")
        self.assertIn("WARNING: ", done.stderr)

    def test_reports_as_json(self):
        report = json.loads(self.tandem("run", "rolling_disk", *SHORT, "--json", "--output", "json.h5").stdout)
        with h5py.File(self.folder / "json.h5") as file:
            for name, value in file["report"].attrs.items():
                if name in report["figures"]:
                    self.assertEqual(report["figures"][name], value, name)
            self.assertEqual(report["q"], list(file["trajectory/q"][-1]))
        self.assertEqual(report["status"], "ok")
        self.assertEqual(report["error_at_end"]["is_known"], True)
        scenes = json.loads(self.tandem("list", "--json").stdout)["scenes"]
        self.assertEqual([scene["name"] for scene in scenes], sorted(path.stem for path in (ROOT / "scenes").glob("*.toml")))
        check = json.loads(self.tandem("check", "rolling_disk", "--json").stdout)
        self.assertTrue(check["start"]["passed"] and all(row["passed"] for row in check["procedures"]))
        self.assertEqual(json.loads(self.tandem("verify", "json.h5", "--json").stdout)["rows"], report["rows"])
        statuses = json.loads(self.tandem("statuses", "--json").stdout)["statuses"]
        self.assertEqual((statuses[0]["name"], statuses[0]["code"]), ("ok", 0))

    def test_progress_overwrites_itself_on_a_terminal(self):
        try:
            ours, theirs = pty.openpty()
        except OSError as problem:
            self.skipTest(f"this machine has no terminals to give: {problem}")
        try:
            done = subprocess.run([TANDEM, "run", "rolling_disk", *SHORT], cwd=self.folder, timeout=60,
                                  stdout=subprocess.PIPE, stderr=theirs)
            os.close(theirs)
            seen = os.read(ours, 100000).decode()
        finally:
            os.close(ours)
        self.assertEqual(done.returncode, 0)
        self.assertIn("\r", seen)
        self.assertNotIn("\n", seen)
        self.assertTrue(seen.endswith("\r"))


class Assembly(Case):
    """Starts that are off, from the paper's printed motorcycle, which leaves the pitch out (section 9)."""

    PRINTED = """[scene]
model = "motorcycle"
[initial]
q = [0, 0, 0.304, 1, 0, 0, 0, -0.062, -0.294, 0.621]
qd = [0, 15, 0, 0, 0, 0, 0, 0, 0, 0]
[time]
end = 0.1
"""

    def test_the_printed_start_runs_only_assembled(self):
        self.refused("run", self.scene(self.PRINTED), says=["inconsistent_start", "assemble the start", "keys q and qd of [initial], and assemble = true"])
        done = self.tandem("run", "scene.toml", "--set", "initial.assemble=true")
        self.assertRegex(done.stdout, r'assembled +position moved e1 by 3\.0e-3, s by -7\.8e-4, a1 by 6\.5e-4,')
        for row in "front contact height", "no slip front":
            self.assertIn(f'most of it for "{row}"', done.stdout)
        with h5py.File(self.folder / "scene.h5") as file:
            # The equilibrium, to half a unit of the printed digits.
            expected = [0, 0, 0.30378, 1, 0.00315, 0, 0, -0.06145, -0.29364, 0.62070]
            np.testing.assert_allclose(file["trajectory/q"][0], expected, rtol=0, atol=5e-4)
            self.assertLess(file["diagnostics/position_error"][0], 1e-14)
            self.assertLess(file["diagnostics/velocity_error"][0], 1e-14)
            self.assertAlmostEqual(file["report"].attrs["start_moved_q"], 2.97e-3, 5)
        done = self.tandem("run", "scene.toml", "--set", "initial.assemble=true", *SHORT, "--error", "--force")
        self.assertRegex(done.stdout, r"  error at end +q \S+ ")

    def test_check_says_what_would_move(self):
        done = self.tandem("check", self.scene(self.PRINTED), "--set", "initial.assemble=true")
        self.assertIn("start assembled: position moved e1 by", done.stdout)
        self.assertIn("C has full rank 8", done.stdout)
        self.assertIn("keys q and qd of [initial], and assemble = true", self.tandem("check", "scene.toml", code=2).stderr)

    def test_a_consistent_start_does_not_move(self):
        with_it = self.tandem("run", "motorcycle", *SHORT, "--set", "initial.assemble=true", "--output", "a.h5")
        self.assertIn("position unmoved, velocity unmoved, 0 iterations", with_it.stdout)
        self.tandem("run", "motorcycle", *SHORT, "--output", "b.h5")
        with h5py.File(self.folder / "a.h5") as a, h5py.File(self.folder / "b.h5") as b:
            np.testing.assert_array_equal(a["trajectory/q"], b["trajectory/q"])

    def test_keys(self):
        self.scene(self.PRINTED)
        details = ["--set", 'initial.fixed=["rx", "a2"]', "--set", 'initial.fixed_velocities=["ry"]',
                   "--set", "initial.weights=[1, 1, 2, 1, 1, 1, 1, 1, 1, 9]", "--set", "initial.velocity_metric=weights",
                   "--set", "initial.velocity_weights=[1, 1, 2, 1, 1, 1, 1, 1, 1, 9]",
                   "--set", "initial.largest_move=0.25", "--set", "initial.largest_velocity_move=2"]
        shown = self.tandem("show", "scene.toml", "--set", "initial.assemble=true", *details).stdout
        for line in 'fixed = ["rx", "a2"]', 'velocity_metric = "weights"', "largest_move = 0.25", "largest_velocity_move = 2.0":
            self.assertIn(line, shown)
        again = self.scene(shown, "again.toml")
        self.assertEqual(self.tandem("show", again).stdout, shown)
        self.tandem("run", again, "--output", "result.h5")
        with h5py.File(self.folder / "result.h5") as file:
            self.assertEqual(file["trajectory/q"][0, [0, 8]].tolist(), [0, -0.294])
            self.assertEqual(file["trajectory/qd"][0, 1], 15)
        for key in "fixed", "fixed_velocities":
            self.refused("run", "scene.toml", "--set", "initial.assemble=true", "--set", f'initial.{key}=["sx"]',
                         says=f'{key} "sx" is not one of rx, ry, rz')
        for key in "weights", "velocity_weights":
            self.refused("run", "scene.toml", "--set", "initial.assemble=true", "--set",
                         f"initial.{key}=[1, 1, 2, 0, 1, 1, 1, 1, 1, 9]", says=f"{key} element 4 must be positive")
        self.refused("run", "scene.toml", "--set", "initial.assemble=yes", says="assemble must be true or false, not a string")
        self.refused("run", "scene.toml", "--set", "initial.largest_move=1", says="largest_move needs assemble = true")
        self.refused("run", "scene.toml", "--set", "initial.assemble=true", "--set", "initial.largest_moves=1",
                     says=['did you mean "largest_move"?', "fixed_velocities"])

    def test_too_far_and_impossible(self):
        self.scene(self.PRINTED)
        assemble = ["run", "scene.toml", "--set", "initial.assemble=true", "--set"]
        self.refused(*assemble, "initial.largest_move=1e-3",
                     says=['coordinate "e1" would move by 0.29', 'most of it for "front contact height"'])
        self.refused(*assemble, 'initial.fixed=["rz", "e0"]', says=["no consistent position near", "with fixed rz, e0", "free some of them"])


class Target(Case):
    def test_the_default_name_is_the_scenes(self):
        self.tandem("run", self.disk(), "--set", "scene.name=wheel")
        self.assertTrue((self.folder / "wheel.h5").exists())
        self.tandem("run", "scene.toml")
        self.assertTrue((self.folder / "scene.h5").exists())

    def test_a_file_that_exists_is_kept(self):
        self.tandem("run", "rolling_disk", *SHORT)
        (self.folder / "text.h5").write_text("not HDF5\n")
        with h5py.File(self.folder / "other.h5", "w") as file:
            file["x"] = 1
        for name in "rolling_disk.h5", "text.h5", "other.h5":
            self.refused("run", "rolling_disk", *SHORT, "--output", name, says=[name + " exists", "--force"])
            self.tandem("run", "rolling_disk", "--set", "time.end=0.05", "--output", name, "--force")
            with h5py.File(self.folder / name) as file:
                self.assertEqual(file.attrs["status"], "complete")
                self.assertEqual(file["trajectory/time"][-1], 0.05)

    def test_the_scene_itself_is_not(self):
        scene = self.disk()
        (self.folder / "sub").mkdir()
        (self.folder / "symbolic.h5").symlink_to("scene.toml")
        (self.folder / "hard.h5").hardlink_to(self.folder / scene)
        for name in (scene, "./scene.toml", "sub/../scene.toml", str(self.folder / scene), "symbolic.h5", "hard.h5"):
            with self.subTest(name):
                self.refused("run", scene, "--output", name, "--force", says=f"{name} is the scene itself")
        self.refused("run", "./symbolic.h5", "--output", scene, "--force", says=f"{scene} is the scene itself")

    def test_no_regular_file(self):
        os.mkfifo(self.folder / "pipe")
        for name in ("pipe", "/dev/null", "/dev/stdin"):
            self.refused("run", "rolling_disk", *SHORT, "--output", name, "--force", input="", says=[f"cannot write {name}", "a pipe or a device"])

    def test_standard_output(self):
        for words in ["--output", "-"], ["--set", "output.file=-"]:
            self.refused("run", "rolling_disk", *SHORT, *words, "--force", says=["cannot write to standard output", "./-"])
        self.refused("study", "precision", "rolling_disk", "--output", "-", says=["standard output", "./-"])
        self.tandem("run", "rolling_disk", *SHORT, "--output", "./-")

    def test_no_such_folder(self):
        self.refused("run", "rolling_disk", "--output", "no/such/a.h5", says="there is no folder no/such/")

    def test_a_folder(self):
        (self.folder / "sub").mkdir()
        self.refused("run", "rolling_disk", "--output", "sub", says="it is a folder")
        self.refused("run", "rolling_disk", "--output", "sub/", says="it is a folder")

    def test_a_link_to_nothing(self):
        (self.folder / "a.h5").symlink_to("no/such.h5")
        for more in [], ["--force"]:
            self.refused("run", "rolling_disk", *SHORT, "--output", "a.h5", *more, says="cannot write a.h5: it is a symbolic link to nothing; remove")
        self.assertTrue((self.folder / "a.h5").is_symlink())

    def test_nobody_may_write_there(self):
        self.refused("run", "rolling_disk", "--output", "/proc/a.h5", says=["/proc/a.h5", "write permission"])

    @unittest.skipIf(os.geteuid() == 0, "root may write everywhere")
    def test_read_only(self):
        self.tandem("run", "rolling_disk", *SHORT, "--output", "a.h5")
        (self.folder / "a.h5").chmod(0o444)
        self.refused("run", "rolling_disk", *SHORT, "--output", "a.h5", says="ermission denied")
        (self.folder / "sub").mkdir(mode=0o555)
        self.refused("run", "rolling_disk", *SHORT, "--output", "sub/a.h5", says="ermission denied")


class SceneErrors(Case):
    """Errors of a scene file: file, line, the line itself with a marker, and the allowed values."""

    def refused_file(self, says, line, **tables):
        done = self.refused("run", self.disk(**tables), says=says)
        self.assertIn(f"--> scene.toml:{line}:", done.stderr)
        self.assertIn("^", done.stderr)
        return done

    def test_unknown_key(self):
        done = self.refused_file(['unknown key "masss" in [model]', "masss = 3", 'did you mean "mass"?'], 6, model="masss = 3")
        self.assertIn("the keys of [model]: mass, inertia, radius, gravity", done.stderr)
        done = self.refused_file(['unknown key "btol"', 'did you mean "Btol"?'], 6, solver="btol = 1e-9")
        self.assertIn("stepper, step, rtol, atol, rtol_qd, atol_qd, first_step, max_step, chart_kind, chart, refresh, basis, projection, singular, constraint_tolerance, utol, Btol, Htol, intol, v_limit", done.stderr)
        self.refused_file("the keys of [initial]: omega, tilt, q, qd", 6, initial="x = 1")
        self.refused_file("the keys of [output]: file, every, interval, rows, flush, fields", 6, output="x = 1")
        self.refused_file("the keys of [time]: start, end", 5, time="end = 1\nx = 1")
        self.refused_file("the keys of [scene]: name, description, model", 3, scene='model = "rolling_disk"\nx = 1')

    def test_unknown_table(self):
        done = self.refused_file(['unknown table or key "solvr"', 'did you mean "solver"?'], 5, solvr="step = 1e-3")
        self.assertIn("tables of a scene: scene, model, initial, time, solver, output", done.stderr)
        self.scene('end = 1\n[scene]\nmodel = "rolling_disk"\n')
        self.refused("run", "scene.toml", says=['unknown table or key "end"', "scene.toml:1:"])
        self.scene("scene = 1\n")
        self.refused("run", "scene.toml", says=['"scene" is a table', "scene.toml:1:"])
        self.scene('[[scene]]\nmodel = "rolling_disk"\n')
        self.refused("run", "scene.toml", says='"scene" is a table')

    def test_wrong_type(self):
        for key, says in {
            'mass = "heavy"': "mass must be a number, not a string",
            "mass = true": "mass must be a number, not true or false",
            "mass = [1.0]": "mass must be a number, not an array",
            "mass = 2026-01-01": "mass must be a number, not a date",
            "mass = {kg = 1}": "mass must be a number, not a table",
            "inertia = 5.0": "inertia must be an array of numbers",
            "inertia = [1, 2]": "inertia has 2 elements; it must have 3",
            'inertia = [1, 2, "3"]': "inertia element 3 must be a number",
        }.items():
            with self.subTest(key):
                self.refused_file([says, key], 6, model=key)
        self.refused_file("every must be an integer, not a number with a fraction", 6, output="every = 1.5")
        self.refused_file("file must be a string in quotes", 6, output="file = 3")
        self.refused_file("fields must be an array of strings", 6, output='fields = "q"')
        self.refused_file("fields element 2 must be a string in quotes", 6, output='fields = ["q", 1]')
        self.refused_file("model must be a string in quotes", 2, scene="model = 3")

    def test_impossible_value(self):
        for table, key, says in [
            ("model", "mass = -1", "mass must be positive"), ("model", "mass = 0", "mass must be positive"),
            ("model", "mass = nan", "must be a finite number"), ("model", "mass = 1e999", "must be a finite number"),
            ("model", "gravity = -inf", "must be a finite number"), ("model", "inertia = [1, -2, 3]", "element 2 must be"),
            ("model", "mass = 123456789012345678901", "too many digits"), ("initial", "tilt = 2.0", "between -pi/2 and pi/2"),
            ("solver", "step = -1.0", "step must be positive"), ("solver", 'stepper = "rk5"', 'did you mean "rk4"?'),
            ("solver", 'chart = "papre"', 'did you mean "paper"?'), ("solver", 'refresh = "never"', "factor, refine"),
            ("solver", "rtol = 1", "rtol must lie between"), ("solver", "rtol = [1e-6, 1e-7]", "must have 9"),
            ("solver", "rtol = " + str(8 * [1e-6] + [1]), "rtol must lie between 1e-15 and 1e-2"),
            ("solver", "atol = " + str(8 * [1e-6] + [-1]), "atol must be positive"), ("solver", "rtol_qd = 0", "rtol_qd must"),
            ("solver", "atol_qd = -1", "atol_qd must"), ("solver", 'rtol = "small"', "rtol must be a number, not a string"),
            ("solver", "constraint_tolerance = 1", "between 1e-15 and 1e-2"), ("solver", "utol = -1", "utol must"),
            ("solver", "Btol = 1", "Btol must"), ("solver", "Htol = 1", "Htol must"), ("solver", "v_limit = -1", "v_limit must"),
            ("solver", "w_limit = -1", "w_limit must"), ("solver", "secant_limit = 0.5", "must be above 1"),
            ("solver", "start_tolerance = 0", "start_tolerance must"), ("solver", 'basis = "lu"', "qr, svd"),
            ("solver", 'projection = "ends"', "stages, step_ends"),
            ("solver", "intol = 1", "intol must"), ("solver", "condition_limit = -1", "condition_limit must"),
            ("solver", "iteration_limit = -1", "iteration_limit must"), ("solver", "max_steps = 0", "must be at least 1"),
            ("solver", "max_evaluations = -1", "max_evaluations must"), ("solver", "max_seconds = -1", "max_seconds must"),
            ("solver", "max_steps = 3000000000", "must lie between"), ("output", "every = 0", "every must be positive"),
            ("output", 'file = ""', "must not be empty"), ("output", 'file = "a\\nb"', "control characters"),
            ("output", 'fields = ["q", "qqd"]', 'did you mean "qd"?'), ("output", 'fields = ["q", "q"]', "more than once"),
        ]:
            with self.subTest(key):
                self.refused_file([says, key], 6, **{table: key})
        self.refused_file("end must be after the start", 4, time="end = -1")
        self.refused_file("end must be after the start, 2.0", 4, time="end = 1\nstart = 2")
        self.refused_file("name must be letters", 3, scene='model = "rolling_disk"\nname = "../x"')
        self.refused_file('did you mean "rolling_disk"?', 2, scene='model = "rolling_disc"')

    def test_a_frequency_whose_period_is_infinite(self):
        for model in "motorcycle", "articulated_vehicle":
            for value in "1e-320", "-1e-301":
                self.refused("show", model, "--set", f"model.frequency={value}", says="frequency must be 0, or at least 1e-300 in size")
            for value in "0", "1e-300", "-1e-300":
                self.tandem("run", model, *SHORT, "--set", f"model.frequency={value}", "--output", "a.h5", "--force", "--no-error")

    def test_parameters_without_an_equilibrium(self):
        self.scene('[scene]\nmodel = "motorcycle"\n[model]\ngravity = 9.6e4\n[time]\nend = 1\n')
        self.refused("run", "scene.toml", says=["requires an equilibrium", "scene.toml"])

    def test_a_field_that_the_model_does_not_have(self):
        self.scene('[scene]\nmodel = "articulated_vehicle"\n[time]\nend = 1\n[output]\nfields = ["potential_energy"]\n')
        self.refused("run", "scene.toml", says=["potential_energy", "scene.toml:6:"])

    def test_missing_keys(self):
        self.scene("")
        self.refused("run", "scene.toml", says="the key model is missing in [scene] of scene.toml")
        self.scene('[scene]\nmodel = "rolling_disk"\n')
        self.refused("run", "scene.toml", says="the key end is missing in [time] of scene.toml")
        self.refused("run", self.disk(initial="q = [0, 0, 1, 1, 0, 0, 0, 0, -1]"), says="the key qd is missing in [initial]")

    def test_a_start_that_cannot_be(self):
        both = "q = [0, 0, 1, 1, 0, 0, 0, 0, -1]\nqd = [0, 0, 0, 0, 0, 0, 0, 0, 0]\n"
        self.refused_file("omega cannot be combined with q and qd", 8, initial=both + "omega = [1, 0, 0]")
        self.refused_file("q has 3 elements; it must have 9", 6, initial="q = [1, 2, 3]\nqd = [1, 2, 3]")
        done = self.refused("run", self.disk(initial=both.replace("0, 0, 1,", "0, 0, 2,")), says="inconsistent_start")
        self.assertIn("contact height", done.stderr)
        self.refused("run", self.disk(initial=both.replace("qd = [0,", "qd = [1,")), says=["inconsistent_start", "velocity"])
        self.tandem("run", self.disk(initial=both))

    def test_toml_that_is_none(self):
        for text, says in {
            "[scene]\nmodel = \n": "scene.toml:2:", "[scene\n": "scene.toml:1:", "x": "scene.toml:1:",
            '[scene]\nmodel = "rolling_disk"\nmodel = "rolling_disk"\n': "first defined here",
            "[scene]\n[model]\n[scene]\n": "already exists", "[model]\nmass = 1.\n": "scene.toml:2:",
            "a = " + 3000 * "[": "unclosed", 6000 * "[": "scene.toml:1:3", 100_000 * "\n": "not a valid scene", 2000 * "a." + "a = 1": "not a valid scene",
        }.items():
            with self.subTest(text[:40]):
                self.scene(text)
                self.refused("run", "scene.toml", says=says)

    def test_files_that_are_no_scenes(self):
        (self.folder / "junk.toml").write_bytes(bytes(range(256)) * 10)
        self.refused("show", "junk.toml", says="is it a binary file?")
        (self.folder / "latin.toml").write_bytes(b'[scene]\nname = "\xff\xfe"\n')
        self.refused("show", "latin.toml", says="line 2 contains bytes that are not UTF-8")
        (self.folder / "large.toml").write_bytes(b"#" * 4_200_000)
        self.refused("show", "large.toml", says="more than 4194304 bytes")
        self.refused("show", "missing.toml", says=["missing.toml", "No such file"])
        self.refused("show", str(self.folder), says="Is a directory")

    def test_texts_that_the_parser_must_not_meet(self):
        # Faults found by test/fuzz: hangs, numbers that wrapped around, reads beyond the text, text that readers of results refuse.
        head = b'[scene]\nmodel = "rolling_disk"\n'
        for more, says in {
            b"description = '\xc3('": "line 3 contains bytes that are not UTF-8", b"#\xed\xa0\x80": "not UTF-8", b"#\xf4\x90\x80\x80": "not UTF-8",
            b"#\xe2\x82": "not UTF-8", b"#\xc0\xaf": "not UTF-8", b"#\x0c": "line 3 contains the control character 12",
            b"[time]\rend = 1": "line 3 contains the control character 13", b'name = "\\x41"': "not part of TOML 1.0",
            b'name = """a\\\n"""': "line 3 ends a string with a backslash", b"#" + b" " * 40000: "line 3 has more than 32768 bytes",
            b"x = " + b"[" * 201 + b"]" * 201: "there may be 200 brackets within each other",
            b"".join(b"a%d = 1\n" % i for i in range(10_001)): "there may be 10000 values below one heading",
            b"x = [" + b"1, 1,\n" * 6000 + b"]": "there may be 10000 values below one heading",
            b"".join(b"[a%d]\n" % i for i in range(10_001)): "there may be 5000 headings",
            b"x = '''" + b"xxxxxxx\n" * 4097 + b"'''": "there may be 32768 characters in a text",
            b'"\\u001b[2J" = 1': 'unknown key "?[2J"', b"[model]\nmass = 0xFFFFFFFFFFFFFFFF": "too many digits",
            b'description = """' + (b"x" * 99 + b"\\\n") * 100 + b'x"""': "must not be longer than 4096 bytes",
        }.items():
            with self.subTest(more[:40]):
                (self.folder / "scene.toml").write_bytes(head + more + b"\n")
                self.refused("show", "scene.toml", says=["scene.toml", says])

    def test_tables_within_tables(self):
        """Scenes have none, and the parser would follow such a heading into a value that is not a table."""
        for text, place in {
            "a = [1]\n[a.b]\n": "2:3", "a = [1]\n[[a.b]]\n": "2:4", "a=[{}]\n[a.b]\n": "2:3", "a=[{}]\n[[a.b]]": "2:4",
            "solver=[1]\n[[solver.step]]\n": "2:9", "a=1\n[a.b.c]\n": "2:3", "a={b=[1]}\n[a.b.c]": "2:3",
            "[[a]]\n[[a.b]]\n[[a.b.c]]": "2:4", '["a"\t.\t"b"]': "1:6", "[solver]\nx = [\n[1],\n{y=[[2]]}]\n [ model . mass ] # why": "5:10",
        }.items():
            with self.subTest(text):
                self.scene(text)
                self.refused("show", "scene.toml", says=["a scene has no nested tables", f"scene.toml:{place}\n"])
        # Dots elsewhere do not make headings.
        head = 'model.mass = 7.0\nmodel.inertia = [\n1.0,\n# [a.b]\n2.0, 3.0]\n'
        text = head + '["scene"]\nmodel = "rolling_disk"\ndescription = \'\'\'\n[a.b]\'\'\'\n[time]\nend = 1.0 # [a.b]\n'
        self.assertIn("mass = 7.0", self.tandem("show", self.scene(text)).stdout)

    def test_characters_of_any_script(self):
        text = "é \u07ff \u0800 \ud7ff \uffff \U00010000 \U0010ffff"
        shown = self.tandem("show", self.disk(scene=f'model = "rolling_disk"\ndescription = "{text}"')).stdout
        self.assertIn(f'description = "{text}"', shown)

    def test_ends_of_lines_as_in_windows(self):
        (self.folder / "scene.toml").write_bytes(b'[scene]\r\nmodel = "rolling_disk"\r\n[time]\r\nend = -1\r\n')
        self.assertNotIn("\r", self.refused("show", "scene.toml", says="--> scene.toml:4:").stderr)

    def test_a_byte_order_mark_is_skipped(self):
        text = self.tandem("show", "rolling_disk").stdout
        (self.folder / "scene.toml").write_bytes(b"\xef\xbb\xbf" + text.encode())
        self.assertEqual(self.tandem("show", "scene.toml").stdout, text)
        # Only at the start, and lines are shown without it.
        (self.folder / "scene.toml").write_bytes(b"\xef\xbb\xbfx = 1\n")
        self.assertIn("x = 1", self.refused("show", "scene.toml", says="scene.toml:1:").stderr)
        (self.folder / "scene.toml").write_bytes(b"\n\xef\xbb\xbf" + text.encode())
        self.refused("show", "scene.toml", says="scene.toml:2:")

    def test_more_steps_or_rows_than_can_be(self):
        for tables, line in [
            ({"solver": "step = 1e-300"}, 6), ({"output": "interval = 1e-12"}, 6), ({"time": "end = 1e300", "solver": 'stepper = "rk4"'}, 4),
        ]:
            with self.subTest(tables):
                self.refused_file("at most 2147483647", line, **tables)
        self.refused("show", "rolling_disk", "--set", "solver.step=1e-12", says=["at most 2147483647", "solver.step=1e-12"])

    def test_a_start_that_overflows(self):
        self.refused("show", "articulated_vehicle", "--set", "model.half_length=1e308", says="qd are not finite for these values of")

    def test_many_events_are_read_at_once(self):
        text = self.tandem("show", "rolling_disk").stdout
        events = [f'[[event]]\nname = "e{i}"\nwatch = "rz"\n' for i in range(4998)]
        shown = self.tandem("show", self.scene(text + "".join(events[:400]))).stdout
        self.assertEqual(shown.count("[[event]]"), 400)
        # With every default the scene has headings that this one leaves out.
        short = '[scene]\nmodel = "rolling_disk"\n[time]\nend = 1.0\n'
        self.refused("show", self.scene(short + "".join(events)), says="scene.toml with every default is not a valid scene: there may be 5000 headings")

    def test_a_scene_may_come_through_a_pipe(self):
        text = self.tandem("show", "rolling_disk").stdout
        for path in ("/dev/stdin", "/dev/fd/0", "/proc/self/fd/0"):
            self.assertEqual(self.tandem("show", path, input=text).stdout, text)

    def test_a_pipe_with_a_name_is_not_waited_for(self):
        os.mkfifo(self.folder / "scene.toml")
        for command in ("show", "check", "run"):
            self.refused(command, "scene.toml", says=["cannot read the scene scene.toml: it is a pipe", "/dev/stdin"])

    def test_a_signal_ends_a_program_that_waits_for_its_scene(self):
        with subprocess.Popen([TANDEM, "run", "/dev/stdin"], cwd=self.folder, stdin=subprocess.PIPE) as process:
            try:
                with self.assertRaises(subprocess.TimeoutExpired):
                    process.wait(0.5)
                process.terminate()
                self.assertEqual(process.wait(10), -signal.SIGTERM)
            finally:
                process.kill()


class SceneReference(Case):
    """doc/scene_reference.md has every key, with what the program says of it."""

    PAGE = ROOT / "doc" / "scene_reference.md"

    def rows(self, heading):
        """The keys that the tables below a heading list."""
        text = self.PAGE.read_text()
        section = re.search(rf"^(#+) [^\n]*`{re.escape(heading)}`[^\n]*\n(.*?)(?=^\1 |^## |\Z)", text, re.M | re.S)
        self.assertIsNotNone(section, heading)
        return set(re.findall(r"^\| `(\w+)` \|", section[2], re.M))

    def keys(self, *arguments):
        """(heading, key) of what `tandem show` prints, the model's own tables under the name of the model."""
        scene = tomllib.loads(self.tandem("show", *arguments).stdout)
        model = scene["scene"]["model"]
        for table, content in scene.items():
            for entries in content if isinstance(content, list) else [content]:
                for key in entries:
                    yield (model if table == "model" else f"[[{table}]]" if table == "event" else f"[{table}]"), key

    def test_every_key_of_every_scene_is_on_the_page(self):
        event = ["--set", 'event=[{name="limit", watch="qd:%s"}]']
        more = ["--set", "initial.assemble=true", "--set", "solver.rtol_qd=1e-8", "--set", "solver.atol_qd=1e-8"]
        seen = set()
        for path in sorted((ROOT / "scenes").glob("*.toml")):
            model = tomllib.loads(path.read_text())["scene"]["model"]
            if model == "mechanism":
                # Their tables within tables are in doc/mechanism.md.
                continue
            watched = "x1" if model == "articulated_vehicle" else "rx"
            for heading, key in self.keys(path.stem, event[0], event[1] % watched, *more):
                known = self.rows(heading)
                if heading == "[initial]":
                    known = known | self.rows(model)
                self.assertIn(key, known, heading)
                seen.add((heading, key))
        self.assertLessEqual({("[[event]]", "action"), ("[solver]", "atol_qd"), ("[initial]", "largest_move"),
                              ("motorcycle", "fork_angle"), ("[time]", "end")}, seen)

    def test_its_tables_are_what_the_program_says(self):
        done = subprocess.run([sys.executable, ROOT / "tools" / "scene_reference.py", "--check"], capture_output=True, text=True,
                              env=os.environ | STRICT | {"TANDEM": TANDEM}, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_its_example_is_a_scene(self):
        self.scene(re.search(r"```toml\n(.*?)```", self.PAGE.read_text(), re.S)[1])
        self.tandem("show", "scene.toml")

    def test_fields_that_it_names_exist(self):
        text = re.search(r"`fields` may also name (.*?);", self.PAGE.read_text())[1]
        fields = re.findall(r"`(\w+)`", text)
        self.tandem("run", "rolling_disk", *SHORT, "--set", "output.fields=" + json.dumps(fields))


class CommandLine(Case):
    def test_help(self):
        overview = self.tandem("help").stdout
        self.assertIn("tandem run SCENE", overview)
        for words in [], ["--help"], ["-h"], ["study", "--help"]:
            self.assertEqual(self.tandem(*words).stdout, overview)
        for command in "run", "show", "list", "study precision":
            own = self.tandem("help", *command.split())
            self.assertEqual(own.stdout, self.tandem(*command.split(), "--help").stdout)
            self.assertTrue(own.stdout.startswith(f"Usage: tandem {command}"))
            self.assertEqual(own.stderr, "")
        self.refused("help", "rnu", says='Did you mean "run"?')

    def commands(self):
        """Commands listed in the overview."""
        return re.findall(r"^  tandem ((?:study )?[a-z]+)", self.tandem("help").stdout.split("Examples")[0], re.M)

    def test_help_lists_the_options_that_each_command_has(self):
        listed = {}
        for command in self.commands():
            for match in re.finditer(r"^  (--[a-z-]+)( [A-Z])?", self.tandem("help", *command.split()).stdout, re.M):
                listed.setdefault(command, {})[match[1]] = match[2] is not None
        options = {name: value for own in listed.values() for name, value in own.items()}
        self.assertGreater(len(options), 13)
        for command in listed:
            for option, value in options.items():
                words = [*command.split(), option, *(["1"] if value else []), "--help"]
                if option in listed[command]:
                    self.tandem(*words)
                else:
                    self.refused(*words, says=f"has no option {option}")

    def test_shells_complete_what_the_help_lists(self):
        script = self.folder / "completion.bash"
        script.write_text(self.tandem("completion", "bash").stdout)
        environment = {**os.environ, "PATH": f"{Path(TANDEM).parent}:{os.environ['PATH']}", "TANDEM_SCENES": str(ROOT / "scenes")}

        def completed(*words):
            line = f"source {script}; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _tandem; echo ${{COMPREPLY[@]}}"
            return subprocess.run(["bash", "-c", line], env=environment, cwd=self.folder, capture_output=True, text=True,
                                  check=True).stdout.split()

        self.assertEqual(completed("tandem", "ru"), ["run"])
        self.assertEqual(completed("tandem", "study", "pre"), ["precision"])
        self.assertEqual(completed("tandem", "run", "--qui"), ["--quiet"])
        self.assertEqual(completed("tandem", "study", "precision", "--ref"), ["--reference"])
        self.assertEqual(completed("tandem", "run", "rolling"), ["rolling_disk"])
        self.assertEqual({word for word in completed("tandem", "''")} | {"study"},
                         {command.split()[0] for command in self.commands()})
        self.assertTrue(self.tandem("completion", "zsh").stdout.startswith("#compdef tandem"))
        self.refused("completion", "fish", says="bash and zsh")

    def test_version(self):
        self.assertRegex(self.tandem("--version").stdout, r"^tandem \d+\.\d+\.\d+\n(fast|optimised|debug) build,.*, GCC version \d+.*\n$")

    def test_list(self):
        lines = self.tandem("list").stdout.splitlines()
        for scene in (ROOT / "scenes").glob("*.toml"):
            line = next(line for line in lines if line.split()[:1] == [scene.stem])
            self.assertNotIn("error", line)
        self.assertTrue(any(re.match(r"rk4 +4, 4 +explicit", line) for line in lines))

    def test_statuses_are_those_of_the_documents(self):
        shown = self.tandem("statuses").stdout
        self.assertTrue((ROOT / "doc" / "statuses.md").read_text().endswith("\n\n" + shown))
        rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in shown.splitlines()[2:]]
        self.assertEqual([int(code) for _, code, _, _ in rows], list(range(0, -len(rows), -1)))
        self.assertEqual(len({name for name, _, _, _ in rows}), len(rows))
        header = (ROOT / "include" / "tandem.h").read_text()
        for name, code, meaning, advice in rows:
            self.assertIn(f"TANDEM_{name.upper()} = {code}", header)
            self.assertTrue(meaning and advice)

    @unittest.skipUnless(os.path.exists("/dev/full"), "wants a device that is always full")
    def test_a_stdout_that_is_full(self):
        # The last one says more than any buffer holds.
        many = "".join(f'[[event]]\nname = "e{i}"\nwatch = "rz"\n' for i in range(300))
        for words in (["help"], ["--version"], ["list"], ["statuses"], ["show", "rolling_disk"], ["check", "rolling_disk"],
                      ["run", "rolling_disk", *SHORT, "--profile", "--output", "a.h5"], ["show", self.disk(output="every = 1\n" + many)]):
            with self.subTest(words), open("/dev/full", "w", encoding="utf-8") as full:
                done = subprocess.run([TANDEM, *words], cwd=self.folder, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
                self.assertEqual(done.returncode, 1, done.stderr)
                self.assertIn("stdout could not be written completely: No space left on device; ", done.stderr)
                # Faulty input takes precedence.
                self.assertEqual(subprocess.run([TANDEM, "show", "nothing"], stdout=full, stderr=subprocess.PIPE).returncode, 2)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file.attrs["status"], "complete")
            self.assertIn("profile", file["report"])
            self.assertIn("global_error_q", file["report"].attrs)

    def test_words_that_do_not_exist(self):
        self.refused("runn", "rolling_disk", says=['no subcommand "runn"', 'Did you mean "run"?'])
        self.refused("--verison", says=['no subcommand "--verison"', 'Did you mean "--version"?'])
        self.refused("--hlep", says='Did you mean "--help"?')
        self.refused("run", "rolling_disk", "--quite", says=["no option --quite", "did you mean --quiet?"])
        self.refused("show", "rolling_disk", "--quiet", says="no option --quiet")
        self.refused("list", "rolling_disk", says="has an unexpected argument")
        self.refused("run", "rolling_disk", "articulated_vehicle", says="has an unexpected argument")
        self.refused("run", says="needs a SCENE")
        self.refused("run", "rolling_disk", "--set", says="needs a value after --set")
        self.refused("run", "rolling_disk", "--output", says="needs a value after --output")
        self.refused("run", "rolling_disk", "--force=yes", says="takes no value")
        self.refused("run", "", says="no scene")

    def test_unknown_scene(self):
        self.refused("run", "rolling_disc", says=['no scene "rolling_disc"', 'did you mean "rolling_disk"?', "articulated_vehicle"])

    def test_scenes_of_ones_own(self):
        text = self.tandem("show", "rolling_disk", "--set", "scene.description=mine").stdout
        for place, environment in ("scenes", {}), ("mine", {"TANDEM_SCENES": str(self.folder / "mine")}):
            (self.folder / place).mkdir()
            (self.folder / place / f"{place}_disk.toml").write_text(text)
            self.assertRegex(self.tandem("list", env=environment).stdout, rf"(?m)^{place}_disk +rolling_disk +mine$")
            self.assertIn("mine", self.tandem("show", f"{place}_disk", env=environment).stdout)

    def test_bad_settings(self):
        for setting, says in {
            "solver.stp=1e-3": ['unknown key "stp"', "solver.stp=1e-3", 'did you mean "step"?'],
            "sover.step=1": ['unknown table or key "sover"', 'did you mean "solver"?'],
            "solver.step=fast": ["step must be a number", "--set"], "solver.step=-1": ["step must be positive", "solver.step=-1"],
            "solver.step": "must be table.key=value", "step=1": "must be table.key=value", "=": "must be table.key=value",
            "solver.step=": "has no value", "solver={step=1}": "must be table.key=value", "a.b.c=1": "must be table.key=value",
            "model.inertia=[1, 2": "model.inertia=[1, 2", 'output.file="x': 'output.file="x', "time.end=1\ntime.start=0": "one line",
        }.items():
            with self.subTest(setting):
                self.refused("run", "rolling_disk", "--set", setting, says=says)

    def test_settings_override_the_file_and_the_last_one_wins(self):
        text = self.tandem("show", "rolling_disk", "--set", "solver.step=1", "--set", "solver.step=2e-3", "--set=model.mass=7",
                           "--set", "output.file=some/where.h5", "--set", "solver.chart=paper").stdout
        for line in "step = 0.002 ", "mass = 7.0 ", 'file = "some/where.h5"', 'chart = "paper"':
            self.assertIn("\n" + line, text)
        start = ["--set", "initial.q=[0, 0, 1, 1, 0, 0, 0, 0, -1]", "--set", "initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]"]
        text = self.tandem("show", "rolling_disk", *start).stdout
        self.assertIn("\nq = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0]", text)
        self.assertNotIn("\nomega", text)

    def test_what_show_prints_is_the_same_scene(self):
        for scene in sorted((ROOT / "scenes").glob("*.toml")):
            text = self.tandem("show", scene.stem).stdout
            self.scene(text, "again.toml")
            self.assertEqual(self.tandem("show", "again.toml").stdout, text)
            self.assertEqual(self.tandem("show", str(scene)).stdout, text)

    def test_tolerances_for_all_or_one_a_coordinate(self):
        text = self.tandem("show", "rolling_disk", "--set", "solver.rtol=1e-6").stdout
        self.assertIn("\nrtol = 1e-6 ", text)
        self.assertNotIn("\nrtol_qd", text)
        rtol = [1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7, 1e-7, 1e-8, 1e-8]
        settings = ["--set", "solver.stepper=dopri5", "--set", f"solver.rtol={rtol}", "--set", "solver.atol_qd=1e-5"]
        text = self.tandem("show", "rolling_disk", *settings).stdout
        self.assertIn("\nrtol = [1e-6, 1e-6, 1e-6, 1e-7, ", text)
        self.assertIn("\natol_qd = 1e-5 ", text)
        self.assertNotIn("\nrtol_qd", text)
        self.assertEqual(self.tandem("show", self.scene(text)).stdout, text)
        report = self.tandem("run", "scene.toml", *SHORT, "--output", "a.h5").stdout
        self.assertIn("dopri5, rtol 1e-8 to 1e-6, atol 1e-8 to 1e-5", report)
        text = self.tandem("show", "scene.toml", "--set", "solver.rtol=1e-4").stdout
        self.assertIn("\nrtol = 0.0001 ", text)

    def test_the_error_of_a_run(self):
        settings = ["--set", "solver.stepper=dopri5", "--set", "solver.rtol=1e-3", "--set", "time.end=10"]
        report = self.tandem("run", "rolling_disk", *settings, "--error", "--output", "a.h5").stdout
        self.assertRegex(report, r"  error at end +q [^\n]*,\n? *estimated by a second run with a tenth of the tolerance")
        self.assertRegex(report, r"  WARNING +the error reaches \S+ times the tolerance")
        self.assertRegex(report, r"  local error +\S+ per step at most, \S+ summed over the run")
        with h5py.File(self.folder / "a.h5") as file:
            attributes = file["report"].attrs
            self.assertGreater(attributes["global_error"], 0.3)
            self.assertGreaterEqual(attributes["global_error_largest"], attributes["global_error"])
            self.assertIn(attributes["global_error_warning"], re.sub(r"\s+", " ", report))
            self.assertLess(attributes["local_error"], 1e-3)
            self.assertEqual(attributes["local_error_steps"], attributes["steps"])
            self.assertEqual(attributes["stiff"], 0)
        # A short run is made twice without being asked, and never on request.
        report = self.tandem("run", "rolling_disk", *settings, "--output", "a.h5", "--force").stdout
        self.assertRegex(report, r"error at end +q [0-9]")
        report = self.tandem("run", "rolling_disk", *settings, "--no-error", "--output", "a.h5", "--force").stdout
        self.assertRegex(report, r"error at end +not estimated")
        report = self.tandem("run", "articulated_vehicle", "--set", "solver.step=1e-2", "--error", "--output", "a.h5",
                             "--force").stdout
        self.assertRegex(report, r"by a second run with half the step")
        self.assertNotIn("WARNING", report)
        self.tandem("run", "rolling_disk", *SHORT, "--no-error", "--output", "b.h5")
        with h5py.File(self.folder / "b.h5") as file:
            self.assertNotIn("global_error", file["report"].attrs)

    def test_rows_between_steps_are_as_exact_as_promised(self):
        """Against a run of a far smaller tolerance whose steps end at the rows. Rows at steps leave the steps alone."""
        settings = ["motorcycle", "--set", "solver.stepper=dop853", "--set", "time.end=5"]
        interval = ["--set", "output.interval=0.05"]
        self.tandem("run", *settings, *interval, "--set", "solver.rtol=1e-12", "--set", "solver.max_step=0.01", "--output", "a.h5")
        for rtol in (1e-4, 1e-6, 1e-8):
            report = self.tandem("run", *settings, *interval, "--set", f"solver.rtol={rtol}", "--force", "--output", "b.h5").stdout
            self.assertNotIn("between steps", report)
            with h5py.File(self.folder / "a.h5") as exact, h5py.File(self.folder / "b.h5") as rows:
                for name in ("q", "qd"):
                    a, b = (file[f"trajectory/{name}"][:] for file in (exact, rows))
                    self.assertLess(np.max(np.abs(a - b)/(1 + np.abs(a))), 15*rtol)
                    self.assertLess(rows["report"].attrs[f"dense_error_{name}"], 15*rtol)
                looked = rows["report"].attrs["steps"]
            self.tandem("run", *settings, "--set", f"solver.rtol={rtol}", "--set", "output.every=1", "--force", "--output", "c.h5")
            with h5py.File(self.folder / "c.h5") as file:
                self.assertLessEqual(file["report"].attrs["steps"], looked)
                self.assertEqual(file["report"].attrs["dense_error_q"], 0)

    def test_poor_dense_output_is_warned_of(self):
        report = self.tandem("run", "motorcycle", "--set", "solver.stepper=dop853", "--set", "solver.step=0.45", "--set",
                             "time.end=3", "--set", "output.interval=0.03", "--output", "a.h5").stdout
        self.assertRegex(report, r"WARNING +between steps, at output times,\s+positions[^W]*velocities[^W]*smaller steps")

    def test_the_error_of_a_run_that_fails(self):
        report = self.tandem("run", "rolling_disk", "--set", "solver.max_evaluations=100", "--error", code=1).stdout
        self.assertNotIn("error at end", report)

    def test_a_stiff_model_is_noticed(self):
        settings = ["--set", "model.stiffness=1.5e7", "--set", "model.damping=1.5e6", "--set", "solver.stepper=dopri5"]
        report = self.tandem("run", "motorcycle", *settings, "--set", "solver.rtol=1e-5", "--set", "time.end=0.05", "--output",
                             "a.h5").stdout
        self.assertRegex(report, r"  stiff +from t = \S+ s, steps are limited by stability, not by accuracy,")
        self.assertRegex(report, r"radau5 would take about \d+ % of the work")
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file["report"].attrs["stiff"], 1)
            self.assertGreater(file["report"].attrs["stiff_steps"], 100)

    def test_no_slower_stepper_is_advised(self):
        settings = ["--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-4", "--output", "a.h5", "--force"]
        report = self.tandem("run", "motorcycle", *settings).stdout
        self.assertRegex(report, r"steps are limited by stability, not by accuracy,\s+but an implicit stepper would hardly be faster")
        for scene in "rolling_disk", "articulated_vehicle":
            self.assertNotIn("implicit stepper", self.tandem("run", scene, *settings).stdout)

    def test_numbers_come_back_to_the_last_bit(self):
        numbers = [0.1, 1 / 3, 1e-300, 5e-324, 1.7976931348623157e308, 123456789.123456789, 1e22, 2**53 + 2.0, 1e-5]
        for number in numbers:
            text = self.tandem("show", "rolling_disk", "--set", f"model.mass={number!r}").stdout
            shown = re.search(r"\nmass = (\S+)", text)[1]
            self.assertEqual(float(shown), number)
            self.assertLessEqual(len(shown), 25)
        self.assertIn("\nstep = 0.001 ", self.tandem("show", "rolling_disk").stdout)

    def test_show_then_run_gives_the_same_motion(self):
        settings = [*SHORT, "--set", "model.mass=3.3333333333333335", "--set", "initial.omega=[-1.1, 0.01, 0.2]"]
        text = self.tandem("show", "rolling_disk", *settings).stdout
        self.tandem("run", self.scene(text), "--output", "a.h5")
        self.tandem("run", "rolling_disk", *settings, "--output", "b.h5")
        with h5py.File(self.folder / "a.h5") as a, h5py.File(self.folder / "b.h5") as b:
            np.testing.assert_array_equal(a["trajectory/q"], b["trajectory/q"])


if __name__ == "__main__":
    unittest.main()
