# SPDX-License-Identifier: MIT
"""The studies as their users meet them: exit codes, tables, files, and what an interruption leaves.

Runs build/tandem, or what the environment variable TANDEM names.
"""

import csv
import importlib.util
import os
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
ENVIRONMENT = {key: value for key, value in os.environ.items() if key != "TANDEM_SCENES"} | {"OPENBLAS_NUM_THREADS": "1"}
FAST = ["--repeats", "1", "--budget", "0.02"]


def read(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


class Case(unittest.TestCase):
    """A test in an empty folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def study(self, *arguments, code=0, says=()):
        done = subprocess.run([TANDEM, "study", *arguments], cwd=self.folder, env=ENVIRONMENT, capture_output=True,
                              text=True, timeout=120)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertNotIn("Backtrace", done.stderr)
        for words in [says] if isinstance(says, str) else says:
            self.assertIn(words, done.stderr)
        return done


class Precision(Case):
    def precision(self, *arguments, **kwargs):
        return self.study("precision", *arguments, **kwargs)

    def test_files_and_table(self):
        done = self.precision("articulated_vehicle", "--set", "time.end=2", "--steppers", "rk4,sdirk54", *FAST)
        rows = read(self.folder / "study/precision_articulated_vehicle.csv")
        self.assertEqual({(row["stepper"], row["control"]) for row in rows},
                         {("rk4", "step"), ("sdirk54", "step"), ("sdirk54", "rtol")})
        with h5py.File(self.folder / "study/precision_articulated_vehicle.h5") as file:
            group = file["precision"]
            self.assertEqual(file.attrs["study"], "precision")
            self.assertIn('model = "articulated_vehicle"', file.attrs["settings"])
            self.assertGreater(group.attrs["floor_q"], 0)
            self.assertEqual(list(group), sorted(rows[0]))
            self.assertEqual(group["wall_seconds"].attrs["unit"], "s")
            for name, column in group.items():
                self.assertIn("meaning", column.attrs)
                values = column.asstr()[:] if column.dtype == object else column[:]
                for row, value in zip(rows, values, strict=True):
                    if column.dtype == object:
                        self.assertEqual(row[name], value)
                    else:
                        np.testing.assert_equal(float(row[name] or "nan"), value)
        # Each row is a line of the table, under the headings.
        lines = done.stdout.splitlines()
        self.assertEqual(sum(line.startswith(("rk4", "sdirk54")) for line in lines), len(rows))
        self.assertLess(max(len(line) for line in lines if line.startswith(("rk4", "sdirk54", "stepper"))), 132)
        self.assertIn("confirmed by dopri5", done.stdout)
        # A line a row on stderr, nothing with --quiet.
        self.assertEqual(done.stderr.count("articulated_vehicle, "), len(rows))
        rk4 = [row for row in rows if row["stepper"] == "rk4"]
        self.assertEqual([float(row["right_hand_sides"]) for row in rk4],
                         [1 + 4 * float(row["steps"]) for row in rk4])
        self.assertEqual({row["newton_corrections"] for row in rk4}, {"0"})

    def test_errors_agree_with_the_reference_files(self):
        """Wherever a study quotes an error against its own reference, it is right to ten per cent."""
        for scene, name, arguments in (("rolling_disk", "disk", ["--set", "time.end=10", "--samples", "20"]),
                                       ("articulated_vehicle", "vehicle", ["--samples", "40"])):
            common = [scene, *arguments, "--steppers", "dopri5,sdirk54", "--repeats", "1", "--budget", "0.6", "--quiet"]
            done = self.precision(*common, "--output", "own")
            self.assertEqual(done.stderr, "")
            self.precision(*common, "--output", "file", "--reference", str(ROOT / f"test/reference/{name}.txt"))
            own, file = ({(row["stepper"], row["control"], row["value"]): row
                          for row in read(self.folder / folder / f"precision_{scene}.csv")} for folder in ("own", "file"))
            compared = 0
            for key, row in own.items():
                if key in file and row["status"] == "complete" and row["at_floor"] == "0":
                    for error in "error_q", "error_qd":
                        ratio = float(row[error]) / float(file[key][error])
                        self.assertAlmostEqual(ratio, 1, delta=0.1, msg=f"{scene} {key} {error}")
                    compared += 1
            # Four series; how far each goes within its budget depends on the machine.
            self.assertGreater(compared, 3, scene)

    def test_resumes_after_an_interruption(self):
        """An interrupted study is continued: no row twice, none lost, those that were there untouched."""
        arguments = [TANDEM, "study", "precision", "motorcycle", "--steppers", "rk4,trapezoid", "--repeats", "1",
                     "--budget", "1"]
        path = self.folder / "study/precision_motorcycle.csv"
        process = subprocess.Popen(arguments, cwd=self.folder, env=ENVIRONMENT, stderr=subprocess.PIPE,
                                   stdout=subprocess.DEVNULL, text=True)
        for _ in range(3):
            process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.stderr.close()
        self.assertNotEqual(process.wait(timeout=30), 0)
        before = read(path)
        self.assertGreaterEqual(len(before), 3)
        done = self.precision(*arguments[3:], says=f"continues with the {len(before)} rows")
        after = read(path)
        self.assertGreater(len(after), len(before))
        self.assertEqual(after[:len(before)], before)
        keys = [(row["stepper"], row["control"], row["value"]) for row in after]
        self.assertEqual(len(keys), len(set(keys)))
        self.assertEqual(done.stdout.count("complete"), len([row for row in after if row["status"] == "complete"]))
        # Once more: nothing is left to do, and no row is measured.
        again = self.precision(*arguments[3:])
        self.assertNotIn("motorcycle, ", again.stderr)
        self.assertEqual(read(path), after)

    def test_other_settings_start_anew(self):
        arguments = ["articulated_vehicle", "--steppers", "rk4", *FAST]
        self.precision(*arguments, "--set", "time.end=1")
        self.precision(*arguments, "--set", "time.end=2", says="starts anew")
        self.precision(*arguments, "--set", "time.end=2", says="continues")

    def test_another_build_starts_anew(self):
        """Rows of another program, whose errors and costs may be others, are not mixed with new ones."""
        arguments = ["articulated_vehicle", "--steppers", "rk4", *FAST, "--set", "time.end=1"]
        self.precision(*arguments)
        path = self.folder / "study/precision_articulated_vehicle.toml"
        build = tomllib.loads(path.read_text())["program"]["build"]
        self.assertRegex(build, "^[0-9A-F]{16}$")
        path.write_text(path.read_text().replace(build, build[::-1]))
        self.precision(*arguments, says="starts anew")
        self.assertEqual(tomllib.loads(path.read_text())["program"]["build"], build)
        self.precision(*arguments, says="continues")

    def test_a_failed_run_is_a_row(self):
        # A quarter of a turn in the largest step. Time enough for a slow machine: a run that takes longer is a row of another kind.
        self.precision("rolling_disk", "--set", "time.end=5", "--set", "initial.omega=[-20.0, 0.01, 0.0]", "--steppers", "dop853",
                       "--repeats", "1", "--budget", "1")
        rows = read(self.folder / "study/precision_rolling_disk.csv")
        self.assertEqual(rows[0]["status"], "position_diverged")
        self.assertEqual(rows[0]["error_q"], "")
        self.assertEqual(rows[1]["status"], "complete")

    def test_an_assembled_start_is_assembled_once(self):
        off = ["--set", "initial.q=[0, 0.01, 0, -6, 0, 0]", "--set", "initial.qd=[15, 0, 0, 15, 0, 0]",
               "--set", "initial.assemble=true", "--set", "time.end=0.5"]
        self.precision("articulated_vehicle", *off, "--steppers", "dop853", *FAST)
        rows = read(self.folder / "study/precision_articulated_vehicle.csv")
        # The finest run may be over its budget where the machine is busy.
        self.assertEqual({row["status"] for row in rows} - {"over_budget"}, {"complete"})

    def test_an_event_that_stops_is_refused(self):
        shown = subprocess.run([TANDEM, "show", "rolling_disk"], env=ENVIRONMENT, capture_output=True, text=True, timeout=60)
        scene = self.folder / "scene.toml"
        scene.write_text(shown.stdout + '[[event]]\nname = "low"\nwatch = "rz"\nvalue = 0.5\naction = "stop"\n')
        self.precision(str(scene), *FAST, code=2, says=['"low"', "only whole runs compare", "time.end"])

    def test_a_result_file_as_reference(self):
        subprocess.run([TANDEM, "run", "articulated_vehicle", "--quiet", "--set", "time.end=1", "--set", "solver.stepper=dop853",
                        "--set", "solver.rtol=1e-12", "--set", "output.interval=0.01", "--output", "true.h5"],
                       cwd=self.folder, env=ENVIRONMENT, check=True, capture_output=True)
        self.precision("articulated_vehicle", "--set", "time.end=1", "--reference", "true.h5", "--steppers", "rk4",
                       "--repeats", "1", "--budget", "0.5")
        # The finest run may be over its budget where the machine is busy.
        rows = [row for row in read(self.folder / "study/precision_articulated_vehicle.csv") if row["status"] == "complete"]
        self.assertGreater(len(rows), 3)
        self.assertLess(float(rows[-1]["error_q"]), 1e-6)

    def test_usage(self):
        self.study(code=2, says="study precision")
        self.study("precison", code=2, says='"study precision"')
        self.precision(code=2, says="needs a SCENE")
        self.precision("rolling_dsk", code=2, says="rolling_disk")
        self.precision("rolling_disk", "--steppers", "rk5", code=2, says='"rk4"')
        self.precision("rolling_disk", "--samples", "0", code=2, says="an integer from 1 to 10000")
        self.precision("rolling_disk", "--samples", "2.7", code=2, says="an integer from 1 to 10000")
        self.precision("rolling_disk", "--repeats", "99999999999", code=2, says="an integer from 1 to 1000 ")
        self.precision("rolling_disk", "--budget", "soon", code=2, says="number")
        self.precision("rolling_disk", "--reference", "nowhere", code=2, says="nowhere")
        self.precision("rolling_disk", "rolling_disk", code=2, says="two scenes")
        self.precision("rolling_disk", "--reference", str(ROOT / "test/reference/vehicle.txt"), code=2, says="coordinates")
        self.precision("rolling_disk", "--set", "solver.step=-1", code=2, says="step")
        off = ["--set", "initial.q=[0, 0, 2, 1, 0, 0, 0, 0, -1]", "--set", "initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]",
               "--set", "initial.assemble=true", "--set", 'initial.fixed=["rz"]']
        self.precision("rolling_disk", *off, code=2, says="no consistent position near")
        self.assertIn("--budget", self.precision("--help").stdout)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_pipe_is_not_waited_for(self):
        os.mkfifo(self.folder / "pipe")
        self.precision("rolling_disk", "--reference", "pipe", code=2, says="the reference pipe cannot be read: ")
        (self.folder / "study").mkdir()
        os.mkfifo(self.folder / "study/precision_rolling_disk.h5")
        self.precision("rolling_disk", "--force", code=2, says="not a regular file")

    def test_strange_files_are_spared(self):
        (self.folder / "study").mkdir()
        path = self.folder / "study/precision_rolling_disk.csv"
        path.write_text("mine")
        self.precision("rolling_disk", code=2, says="--force")
        self.assertEqual(path.read_text(), "mine")


class Tables(Case):
    def test_the_paper_beside_ours(self):
        """Interrupted and continued: the paper's charts, its orders of magnitude, and a sentence on each difference."""
        path = self.folder / "study/tables.csv"
        process = subprocess.Popen([TANDEM, "study", "tables"], cwd=self.folder, env=ENVIRONMENT, stderr=subprocess.PIPE,
                                   stdout=subprocess.DEVNULL, text=True)
        for _ in range(2):
            process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.stderr.close()
        self.assertNotEqual(process.wait(timeout=30), 0)
        before = read(path)
        self.assertGreaterEqual(len(before), 6)
        done = self.study("tables", says=f"continues with the {len(before)} rows")
        rows = read(path)
        self.assertEqual(rows[:len(before)], before)
        self.assertEqual(len(rows), 9 * 3 + 10 * 2 + 4)
        self.assertEqual(len({(row["place"], row["scene"], row["stepper"], row["tolerance"], row["quantity"])
                              for row in rows}), len(rows))
        charts = {(row["scene"], row["stepper"]): (row["paper"], row["ours"])
                  for row in rows if row["quantity"] == "charts"}
        for scene, count in ("articulated_vehicle", "22"), ("rolling_disk", "127"), ("motorcycle", "8"):
            for stepper in "rk4", "trapezoid", "sdirk54":
                printed = "" if (scene, stepper) == ("rolling_disk", "trapezoid") else count
                self.assertEqual(charts[scene, stepper], (printed, count))
        for row in rows:
            self.assertTrue(row["difference"], row)
            if row["quantity"] == "energy change":
                self.assertLess(float(row["ours"]), 1e-5)
            if row["place"] == "table 3" and row["tolerance"] == "1e-6" and row["quantity"] != "velocity error":
                # The orders of magnitude of the first row come out.
                self.assertLess(abs(np.log10(float(row["ours"])) - float(row["paper"][1:])), 1.5)
        self.assertIn("E-11", done.stdout)
        with h5py.File(self.folder / "study/tables.h5") as file:
            self.assertEqual(list(file["tables/paper"].asstr()[:]), [row["paper"] for row in rows])
            np.testing.assert_array_equal(file["tables/ours"][:], [float(row["ours"]) for row in rows])


class Stability(Case):
    def test_verdicts_and_files(self):
        """A row a run, in the files as on the terminal; nothing is wrong."""
        done = self.study("stability", "masses", "kinks")
        rows = read(self.folder / "study/stability.csv")
        self.assertEqual(len(rows), 13 * 13)
        self.assertEqual(done.stderr.count(" of 169: "), 169)
        verdicts = {(row["case"], row["stepper"], row["control"]): row for row in rows}
        self.assertEqual(len(verdicts), len(rows))
        self.assertNotIn("wrong", {row["verdict"] for row in rows})
        self.assertEqual({row["status"] for row in rows if row["case"] == "light_0"}, {"singular_mass"})
        self.assertEqual({row["verdict"] for row in rows if row["case"] == "light_0"}, {"refused"})
        for row in rows:
            if row["status"] == "complete":
                within = float(row["error"]) <= float(row["allowed"])
                self.assertEqual(row["verdict"], "held" if within else "degraded", row)
                self.assertTrue(within or (int(row["warnings"]) > 0 and row["remark"]), row)
            else:
                self.assertIn(row["verdict"], ("failed", "refused"))
                self.assertEqual(row["error"], "")
        self.assertIn("0 wrong", done.stdout)
        # Every stepper notices the jump of the steering, declared or not.
        for stepper in "dopri5", "dop853", "trapezoid", "sdirk54":
            self.assertEqual(verdicts["hiddenjump", stepper, "rtol"]["verdict"], "degraded")
            self.assertIn("nu_jumps", verdicts["hiddenjump", stepper, "rtol"]["remark"])
        with h5py.File(self.folder / "study/stability.h5") as file:
            self.assertEqual(file.attrs["study"], "stability")
            self.assertEqual(list(file["stability/verdict"].asstr()[:]), [row["verdict"] for row in rows])
            np.testing.assert_array_equal(file["stability/steps"][:], [int(row["steps"]) for row in rows])

    def test_resumes_after_an_interruption(self):
        path = self.folder / "study/stability.csv"
        process = subprocess.Popen([TANDEM, "study", "stability", "parallel"], cwd=self.folder, env=ENVIRONMENT,
                                   stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        for _ in range(5):
            process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.stderr.close()
        process.wait(timeout=60)
        before = read(path)
        self.assertGreaterEqual(len(before), 5)
        self.study("stability", "parallel", says=f"continues with the {len(before)} rows")
        rows = read(path)
        self.assertEqual(rows[:len(before)], before)
        self.assertEqual(len({(row["case"], row["stepper"], row["control"]) for row in rows}), 4 * 13)
        self.assertEqual(len(rows), 4 * 13)
        # Another case is added to them.
        self.study("stability", "edge")
        self.assertEqual(len(read(path)), 5 * 13)

    def test_usage(self):
        self.study("stability", "egde", code=2, says='"edge"')
        # The cases that there are, in their groups, as in the help.
        told = self.study("stability", "foo", code=2, says='there is no case "foo"').stderr
        for line in r"  stiff: \w+, ", r"  disk: .*\bedge\b", "  million: milliondisk, millionvehicle$":
            self.assertRegex(told, "(?m)^" + line)
        self.study("stability", "paralel", code=2, says='did you mean "parallel"?')
        self.study("stability", "--set", "a=1", code=2, says="no option")
        self.assertIn("study stability", self.study("stability", "--help").stdout)
        self.assertEqual(list(self.folder.iterdir()), [])


class PicturesWithoutPackages(Case):
    def test_what_to_do_is_said(self):
        # -I and -S leave out all packages but those of Python itself.
        done = subprocess.run([sys.executable, "-I", "-S", ROOT / "tools/plot.py", "a.h5", "a.png"], cwd=self.folder,
                              capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2)
        self.assertNotIn("Traceback", done.stderr)
        self.assertRegex(done.stderr, r"^plot\.py: there is no package (numpy|h5py|matplotlib) for ")
        self.assertIn("tools/setup.sh plot", done.stderr)
        self.assertIn(".venv/bin/python", done.stderr)


@unittest.skipUnless(importlib.util.find_spec("matplotlib"), "needs matplotlib: tools/setup.sh plot")
class Pictures(Case):
    def plot(self, *arguments, code=0):
        done = subprocess.run([sys.executable, ROOT / "tools/plot.py", *arguments], cwd=self.folder, capture_output=True,
                              text=True, timeout=120)
        self.assertEqual(done.returncode, code, done.stderr)
        return done

    def tandem_run(self, scene, name, *settings):
        subprocess.run([TANDEM, "run", scene, "--quiet", "--output", name, *settings], cwd=self.folder, env=ENVIRONMENT,
                       check=True, capture_output=True)

    def test_a_study(self):
        for scene in "articulated_vehicle", "motorcycle":
            self.study("precision", scene, "--set", "time.end=1", "--steppers", "rk4,dop853", *FAST)
        files = [f"study/precision_{scene}.h5" for scene in ("articulated_vehicle", "motorcycle")]
        self.plot(files[0], "one.png")
        self.plot(*files, "two.svg")
        self.study("stability", "edge", "light_0")
        self.plot("study/stability.h5", "matrix.svg")
        self.assertIn("</svg>", (self.folder / "matrix.svg").read_text())
        self.assertTrue((self.folder / "one.png").read_bytes().startswith(b"\x89PNG"))
        drawn = (self.folder / "two.svg").read_text()
        self.assertIn("</svg>", drawn)

    def test_runs(self):
        self.tandem_run("rolling_disk", "disk.h5", "--set", "time.end=2")
        self.tandem_run("articulated_vehicle", "vehicle.h5", "--set", "time.end=1", "--set", 'output.fields=["q"]')
        self.plot("disk.h5", "two.png", "--track", "ry,rx")
        # Also where the file holds little.
        self.plot("disk.h5", "all.png", "--overview")
        self.plot("vehicle.h5", "little.png", "--overview")
        self.plot("vehicle.h5", "paper.png", "--paper", "2")
        self.assertTrue(all((self.folder / f"{name}.png").stat().st_size > 10000 for name in ("two", "all", "little", "paper")))
        self.assertIn("rx", self.plot("disk.h5", "no.png", "--against-time", "nothing", code=2).stderr)
        self.assertIn("2 result", self.plot("disk.h5", "no.png", "--paper", "6", code=2).stderr)


if __name__ == "__main__":
    unittest.main()
