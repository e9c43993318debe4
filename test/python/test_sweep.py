# SPDX-License-Identifier: MIT
"""Sweeps as their users meet them: the table, whoever runs the cases, what kills leave, and wrong files.

Runs build/tandem, or what the environment variable TANDEM names. TANDEM_KILLS=20 kills sweeps that often.
"""

import csv
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
ENVIRONMENT = {key: value for key, value in os.environ.items() if key != "TANDEM_SCENES"} | {"OPENBLAS_NUM_THREADS": "1"}
KILLS = int(os.environ.get("TANDEM_KILLS", "4"))

DISKS = """
[sweep]
scene = "rolling_disk"
set = ["time.end=0.05"]
draws = 60
points = "latin"
seed = 3

[[vary]]
key = "model.mass"
uniform = [5.0, 15.0]

[[vary]]
key = "initial.omega[2]"
normal = [0.01, 0.02]

[[vary]]
key = "initial.tilt"
uniform = [-0.1, 0.1]

[[keep]]
quantity = "rz"

[[keep]]
quantity = "rz"
take = "min"

[[keep]]
quantity = "energy"
at = [0.0, 0.025, 0.05]

[[keep]]
quantity = "figure:steps"
"""


def table(path):
    """All that a table says but for times: from the name of each dataset to its values and attributes."""
    found = {}

    def take(name, item):
        if isinstance(item, h5py.Dataset) and name != "seconds":
            values = item[()]
            found[name] = (values.tobytes() if values.dtype != object else tuple(values), sorted(map(str, item.attrs.items())))

    with h5py.File(path) as file:
        file.visititems(take)
        found["/"] = sorted(map(str, file.attrs.items()))
    return found


class Case(unittest.TestCase):
    """A test in an empty folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def write(self, text, name="sweep.toml"):
        (self.folder / name).write_text(text)

    def command(self, *arguments, sweep="sweep.toml"):
        return [TANDEM, "sweep", sweep, *arguments]

    def sweep(self, *arguments, code=0, says=(), sweep="sweep.toml", **kwargs):
        done = subprocess.run(self.command(*arguments, sweep=sweep), cwd=self.folder, env=ENVIRONMENT, capture_output=True,
                              text=True, timeout=300, **kwargs)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertNotIn("Backtrace", done.stderr)
        for words in [says] if isinstance(says, str) else says:
            self.assertIn(words, done.stderr)
        return done

    def whole(self):
        """The table of a sweep that nothing disturbs."""
        self.sweep("--output", "whole.h5", "--jobs", "1", "--quiet")
        return table(self.folder / "whole.h5")


class Tables(Case):
    def test_rows_are_the_runs_of_their_scenes(self):
        self.write(DISKS)
        self.sweep("--quiet")
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file.attrs["cases"], 60)
            self.assertEqual(file["inputs/model.mass"].attrs["unit"], "kg")
            self.assertEqual(file["outputs/rz_end"].attrs["unit"], "m")
            self.assertEqual(file["outputs/energy"].shape, (60, 3))
            for case in (1, 37, 60):
                settings = []
                mass, tilt = file["inputs/model.mass"][case - 1], file["inputs/initial.tilt"][case - 1]
                omega = file["inputs/initial.omega[2]"][case - 1]
                for setting in ("time.end=0.05", f"model.mass={mass!r}", f"initial.omega=[-1.0, {omega!r}, 0.0]",
                                f"initial.tilt={tilt!r}", "output.every=1"):
                    settings += ["--set", setting.replace("np.float64(", "").replace(")", "")]
                fields = 'output.fields=["q", "kinetic_energy", "potential_energy"]'
                subprocess.run([TANDEM, "run", "rolling_disk", *settings, "--set", fields, "--output", "run.h5", "--force",
                                "--quiet"], cwd=self.folder, env=ENVIRONMENT, check=True)
                with h5py.File(self.folder / "run.h5") as run:
                    rz = run["trajectory/q"][:, 2]
                    energy = run["diagnostics/kinetic_energy"][:] + run["diagnostics/potential_energy"][:]
                # The same run: the same bits.
                self.assertEqual(file["outputs/rz_end"][case - 1], rz[-1])
                self.assertEqual(file["outputs/rz_min"][case - 1], rz.min())
                self.assertEqual(file["outputs/energy"][case - 1].tolist(), energy[[0, 25, 50]].tolist())
                self.assertEqual(file["outputs/steps"][case - 1], 50)

    def test_csv_says_the_same(self):
        self.write(DISKS)
        self.sweep("--quiet")
        with open(self.folder / "sweep.csv", newline="", encoding="utf-8") as text:
            rows = list(csv.DictReader(text))
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual([float(row["model.mass"]) for row in rows], file["inputs/model.mass"][:].tolist())
            self.assertEqual([float(row["energy@0.025"]) for row in rows], file["outputs/energy"][:, 1].tolist())
        self.assertEqual({row["status"] for row in rows}, {"ok"})

    def test_cases_from_a_file(self):
        # With the mark that spreadsheets put in front.
        (self.folder / "cases.csv").write_text("\ufeffmodel.mass,solver.stepper\n5.0,rk4\n7.5,dop853\n", encoding="utf-8")
        self.write('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.1"]\ncsv = "cases.csv"\n')
        self.sweep("--quiet")
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file["inputs/model.mass"][:].tolist(), [5.0, 7.5])
            labels = [str(label) for label in file["inputs/solver.stepper"].attrs["labels"]]
            self.assertEqual([labels[i - 1] for i in file["inputs/solver.stepper"]], ["rk4", "dop853"])
            # Without [[keep]], all coordinates at the end.
            self.assertEqual(len(file["outputs"]), 9)

    def test_sensors_and_parameters_of_a_mechanism(self):
        self.write('[sweep]\nscene = "a01_pendulum"\nset = ["time.end=1.0"]\n[[vary]]\nkey = "parameters.l"\n'
                   'values = [0.5, 1.0]\n[[keep]]\nquantity = "sensor:mass/position[2]"\ntake = "min"\nname = "lowest"\n')
        self.sweep("--quiet")
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file["outputs/lowest"].attrs["unit"], "m")
            # The bob passes the lowest place between two steps, of 0.05 s or less and 6 m/s^2 there: 1e-2 off at most.
            for lowest, length in zip(file["outputs/lowest"][:], [0.5, 1.0]):
                self.assertGreaterEqual(lowest, -length - 1e-9)
                self.assertLess(lowest, -length + 2e-2)

    def test_failed_cases_are_rows(self):
        self.write('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.05"]\n[[vary]]\nkey = "solver.max_steps"\n'
                   'values = [100, 10, 100]\n[[vary]]\nkey = "initial.tilt"\nvalues = [0.0, 2.0]\n')
        done = self.sweep("--json")
        summary = json.loads(done.stdout)
        self.assertEqual(summary["failures"], {"invalid_option": 3, "step_limit": 1})
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file["failures/case"][:].tolist(), [2, 3, 4, 6])
            self.assertIn("tilt must lie between", file["failures/message"][0].decode())
            self.assertIn("2.0", file["failures/message"][0].decode())
            self.assertEqual(np.isnan(file["outputs/rz_end"][:]).tolist(), [False, True, True, True, False, True])
        with open(self.folder / "sweep.csv", newline="", encoding="utf-8") as text:
            self.assertEqual([row["status"] for row in csv.DictReader(text)],
                             ["ok", "invalid_option", "step_limit", "invalid_option", "ok", "invalid_option"])

    def test_whole_trajectories(self):
        (self.folder / "runs").mkdir()
        self.write(DISKS.replace("draws = 60", 'draws = 3\ntrajectories = "runs"'))
        self.sweep("--quiet")
        self.assertEqual(sorted(path.name for path in (self.folder / "runs").iterdir()),
                         [f"case_{i:06}.h5" for i in (1, 2, 3)])
        with h5py.File(self.folder / "runs/case_000002.h5") as run, h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(run["trajectory/q"][-1, 2], file["outputs/rz_end"][1])
            self.assertEqual(run.attrs["status"], "complete")

    def test_a_table_is_not_overwritten(self):
        self.write(DISKS)
        self.sweep("--quiet")
        self.sweep("--quiet", code=2, says="exists")
        self.sweep("--quiet", "--force")

    def test_files_of_others_are_not_overwritten(self):
        cases = "model.mass\n5.0\n7.5\n"
        text = '[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.01"]\ncsv = "cases.csv"\n'
        self.write(cases, "cases.csv")
        self.write(text)
        # The values of a table with the name of the file of cases; also by force, and by another spelling.
        for output in ("cases.h5", "./cases.h5", str(self.folder / "cases.h5")):
            for force in ([], ["--force"]):
                self.sweep("--output", output, *force, "--quiet", code=2,
                           says="would overwrite the sweep, the scene or the file of cases")
        self.write("mine\n", "other.csv")
        self.sweep("--output", "other.h5", "--quiet", code=2, says="other.csv exists")
        self.write(text.replace("cases.csv", "sweep.csv"))
        (self.folder / "cases.csv").rename(self.folder / "sweep.csv")
        self.sweep("--quiet", code=2, says="would overwrite")
        self.assertEqual((self.folder / "sweep.csv").read_text(), cases)
        self.assertEqual((self.folder / "other.csv").read_text(), "mine\n")
        self.assertEqual(sorted(path.name for path in self.folder.iterdir()), ["other.csv", "sweep.csv", "sweep.toml"])
        self.sweep("--output", "other.h5", "--quiet", "--force")
        self.assertIn("model.mass", (self.folder / "other.csv").read_text())

    def test_starts_that_settle(self):
        # The bob's lowest position, relative to the middle of its path: it is there in the equilibrium, for each length.
        self.write('[sweep]\nscene = "a01_pendulum"\nset = ["time.end=0.1", "initial.equilibrium=true"]\n[[vary]]\n'
                   'key = "parameters.l"\nvalues = [0.5, 1.0, 2.0]\n[[keep]]\nquantity = "sensor:mass/position[1]"\ntake = "max"\n'
                   'name = "x"\n[[keep]]\nquantity = "sensor:mass/position[2]"\nname = "y"\n')
        self.sweep("--quiet")
        with h5py.File(self.folder / "sweep.h5") as file:
            # Equilibria are found to 1e-10 or so of the forces.
            np.testing.assert_allclose(file["outputs/x"][:], 0, atol=1e-8)
            np.testing.assert_allclose(abs(file["outputs/y"][:]), [0.5, 1.0, 2.0], rtol=1e-8)

    def test_models_of_another_shape(self):
        # Indices of a coordinate, a row and a sensor in the model depend on the number of bodies.
        self.write('[sweep]\nscene = "a02_four_bars"\nset = ["time.end=0.1"]\n[[vary]]\nkey = "parameters.n"\n'
                   'values = [2, 3, 1, 4, 2]\n[[keep]]\nquantity = "coupler1.x"\n[[keep]]\nquantity = "coupler2.x"\n'
                   '[[keep]]\nquantity = "lambda:LAST"\n'.replace("LAST", self.last_row()))
        summary = json.loads(self.sweep("--json").stdout)
        self.assertEqual(summary["failures"], {"invalid_option": 1})
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file["failures/case"][:].tolist(), [3])
            self.assertIn('"coupler2.x" is not a coordinate', file["failures/message"][0].decode())
            for case, n in ((1, 2), (2, 3), (4, 4), (5, 2)):
                subprocess.run([TANDEM, "run", "a02_four_bars", "--set", f"parameters.n={n}", "--set", "time.end=0.1", "--set",
                                'output.fields=["q", "lambda"]', "--output", "run.h5", "--force", "--quiet"],
                               cwd=self.folder, env=ENVIRONMENT, check=True)
                with h5py.File(self.folder / "run.h5") as run:
                    names = [str(name) for name in run["trajectory/q"].attrs["names"]]
                    for name in ("coupler1.x", "coupler2.x"):
                        self.assertEqual(file[f"outputs/{name}_end"][case - 1], run["trajectory/q"][-1, names.index(name)])
                    rows = [str(name) for name in run["trajectory/lambda"].attrs["names"]]
                    self.assertEqual(file["outputs/row"][case - 1], run["trajectory/lambda"][-1, rows.index(self.row)])

    def last_row(self):
        """The name of the last constraint row of the two four-bars."""
        subprocess.run([TANDEM, "run", "a02_four_bars", "--set", "time.end=0.01", "--set", 'output.fields=["q", "lambda"]',
                        "--output", "rows.h5", "--force", "--quiet"], cwd=self.folder, env=ENVIRONMENT, check=True)
        with h5py.File(self.folder / "rows.h5") as run:
            self.row = str(run["trajectory/lambda"].attrs["names"][-1])
        return f'{self.row}"\nname = "row'

    def test_errors_of_cases(self):
        # The error of each case is what tandem run states of the same run; a second run changes nothing in the first.
        kept = '[[keep]]\nquantity = "error:{0}"\n'
        text = ('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.5", "solver.step=0.02"]\n[[vary]]\nkey = "model.mass"\n'
                'values = [5.0, 8.0]\n[[keep]]\nquantity = "rz"\n')
        self.write(text)
        self.sweep("--output", "without.h5", "--quiet")
        self.write(text + "".join(kept.format(name) for name in ("end", "largest", "q", "qd")))
        self.sweep("--quiet")
        with h5py.File(self.folder / "sweep.h5") as file, h5py.File(self.folder / "without.h5") as without:
            self.assertEqual(file["outputs/rz_end"][:].tolist(), without["outputs/rz_end"][:].tolist())
            for case, mass in enumerate((5.0, 8.0)):
                run = subprocess.run([TANDEM, "run", "rolling_disk", "--set", "time.end=0.5", "--set", "solver.step=0.02", "--set",
                                      f"model.mass={mass}", "--error", "--json", "--force"], cwd=self.folder, env=ENVIRONMENT,
                                     capture_output=True, text=True, check=True)
                error = json.loads(run.stdout)["error_at_end"]
                for name in ("largest", "q", "qd"):
                    self.assertEqual(file[f"outputs/error_{name}"][case], error[name])
                self.assertLessEqual(file["outputs/error_end"][case], error["largest"])
                self.assertGreater(file["outputs/error_end"][case], 0)
            # The step is coarse enough for the error to be one of the method: against a run of a twentieth of the step.
            subprocess.run([TANDEM, "run", "rolling_disk", "--set", "time.end=0.5", "--set", "solver.step=0.001", "--set",
                            "model.mass=5.0", "--output", "fine.h5", "--force", "--quiet"], cwd=self.folder, env=ENVIRONMENT,
                           check=True)
            with h5py.File(self.folder / "fine.h5") as fine:
                self.assertLess(abs(fine["trajectory/q"][-1, 2] - file["outputs/rz_end"][0]), 2 * file["outputs/error_q"][0])

    def test_errors_that_are_not_known(self):
        self.write('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.05", \'event=[{name="half", watch="ry", '
                   'value=0.02, action="stop"}]\']\n'
                   '[[vary]]\nkey = "model.mass"\nvalues = [5.0]\n[[keep]]\nquantity = "error:q"\n[[keep]]\nquantity = "rz"\n')
        self.sweep("--quiet")
        with open(self.folder / "sweep.csv", newline="", encoding="utf-8") as text:
            row = next(csv.DictReader(text))
        self.assertEqual((row["status"], row["error_q"]), ("ok", ""))
        self.assertNotEqual(row["rz_end"], "")
        self.assertIn("error not estimated: invalid_option: an event has stopped", row["message"])

    def test_memory_of_a_sweep_that_is_only_begun(self):
        """A thousand million draws take no memory before they are made."""
        self.write('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.002"]\ndraws = 1_000_000_000\n\n'
                   '[[vary]]\nkey = "initial.tilt"\nuniform = [0.1, 0.2]\n\n[[keep]]\nquantity = "energy"\n')
        # A program that a shell starts in the background ignores interrupts.
        process = subprocess.Popen(self.command("--output", "large.h5", "--jobs", "1", "--quiet"), cwd=self.folder,
                                   env=ENVIRONMENT, stderr=subprocess.PIPE, text=True,
                                   preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
        journal = self.folder / "large.h5.journal"
        end = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < end and not (journal.exists() and journal.stat().st_size > 20_000):
            time.sleep(0.05)
        self.assertIsNone(process.poll())
        status = Path(f"/proc/{process.pid}/status")
        if status.exists():
            self.assertLess(int(re.search(r"VmHWM:\s+(\d+) kB", status.read_text())[1]), 500_000)
        process.send_signal(signal.SIGINT)
        self.assertIn("of 1000000000 cases done", process.communicate(timeout=60)[1])
        self.assertEqual(process.returncode, 130)

    def test_a_pipe(self):
        """Input from a pipe is read once; another sweep does not take over its journal."""
        def piped(text, *arguments):
            return subprocess.run([TANDEM, "sweep", "/dev/stdin", *(arguments if "--output" in arguments else
                                   ("--output", "piped.h5", *arguments)), "--quiet"], cwd=self.folder,
                                  env=ENVIRONMENT, input=text, capture_output=True, text=True, timeout=60)

        text = DISKS.replace("draws = 60", "draws = 4")
        self.assertEqual(piped(text, "--cases", "1:2").returncode, 0)
        other = piped(text.replace("[5.0, 15.0]", "[50.0, 150.0]"), "--cases", "1:2")
        self.assertEqual(other.returncode, 2, other.stderr)
        self.assertIn("another sweep", other.stderr)
        done = piped(text)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.write(text)
        self.assertEqual(table(self.folder / "piped.h5"), self.whole())
        # Paths are those from the working folder.
        self.write("model.mass\n5.0\n7.5\n", "cases.csv")
        done = piped('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.01"]\ncsv = "cases.csv"\n', "--output", "cases2.h5")
        self.assertEqual(done.returncode, 0, done.stderr)
        # A scene is read several times.
        self.write(text.replace('"rolling_disk"', '"/dev/stdin"'))
        self.sweep("--quiet", code=2, says="must be a regular file", input="[scene]\n")

    def test_indices_of_a_line(self):
        # The end of a free disk's x is linear in nothing simple, but a sum of squares of its own inputs is: the energy.
        self.write(DISKS.replace('points = "latin"', 'points = "sobol"\nindices = true').replace("draws = 60", "draws = 64"))
        summary = json.loads(self.sweep("--json").stdout)
        steps = next(output for output in summary["outputs"] if output["name"] == "steps")
        # Constant outputs have no indices.
        self.assertEqual(steps["first_order"], [None] * 3)
        rz = next(output for output in summary["outputs"] if output["name"] == "rz_end")
        self.assertGreater(rz["total"][2], 0.9)
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file["indices/rz_end"].shape, (3, 4))
            self.assertEqual(file["indices/rz_end"].attrs["blocks"], 64)


class Points(Case):
    """Designs against SciPy, if it is installed."""

    def setUp(self):
        super().setUp()
        try:
            from scipy.stats import norm, qmc
        except ImportError:
            self.skipTest("SciPy is not installed")
        self.norm, self.qmc = norm, qmc

    def inputs(self, points, draws=64):
        self.write(f'[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.002"]\ndraws = {draws}\npoints = "{points}"\n'
                   'shift = false\n[[vary]]\nkey = "model.mass"\nuniform = [1.0, 2.0]\n[[vary]]\nkey = "initial.tilt"\n'
                   'normal = [0.0, 0.1]\n[[vary]]\nkey = "model.gravity"\nuniform = [1.0, 2.0]\n')
        self.sweep("--quiet")
        with h5py.File(self.folder / "sweep.h5") as file:
            tilt = self.norm.cdf(file["inputs/initial.tilt"][:] / 0.1)
            return np.stack([file["inputs/model.mass"][:] - 1, tilt, file["inputs/model.gravity"][:] - 1], axis=1)

    def test_sobol_points(self):
        known = self.qmc.Sobol(3, scramble=False, bits=32).random(64)
        # Half a unit of the last of 32 bits is added; the ends of the normal distribution are rounded back with 1e-12.
        np.testing.assert_allclose(self.inputs("sobol"), known + 2.0**-33, rtol=0, atol=1e-12)

    def test_distributions(self):
        """Each value is the quantile of SciPy at the place where uniform draws of the same column lie."""
        from scipy.stats import lognorm, triang, truncnorm

        head = '[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.002"]\ndraws = 200\npoints = "latin"\n'
        ways = {"normal = [1.0, 0.3]\nlimits = [0.5, 1.2]": truncnorm(-0.5 / 0.3, 0.2 / 0.3, 1.0, 0.3),
                # Both limits far above the mean.
                "normal = [1.0, 0.1]\nlimits = [1.5, 1.6]": truncnorm(5, 6, 1.0, 0.1),
                "log_normal = [0.1, 0.5]": lognorm(0.5, scale=math.exp(0.1)),
                "triangular = [1.0, 1.2, 3.0]": triang(0.1, 1.0, 2.0),
                "triangular = [1.0, 1.0, 3.0]": triang(0.0, 1.0, 2.0)}

        def draws(way):
            self.write(f'{head}[[vary]]\nkey = "model.mass"\n{way}\n')
            self.sweep("--quiet", "--force")
            with h5py.File(self.folder / "sweep.h5") as file:
                return file["inputs/model.mass"][:]

        u = draws("uniform = [1.0, 2.0]") - 1
        for way, known in ways.items():
            # The probability is exact to a unit of the last digit of 1 to 2, and quantiles of both to 1e-12 or better.
            np.testing.assert_allclose(draws(way), known.ppf(u), rtol=1e-11, err_msg=way)
        cut = draws("log_normal = [0.0, 1.0]\nlimits = [0.5, 2.0]")
        normal = self.norm.cdf([-math.log(2), math.log(2)])
        np.testing.assert_allclose(cut, np.exp(self.norm.ppf(normal[0] + u * (normal[1] - normal[0]))), rtol=1e-11)
        places = np.floor(4 * u).astype(int)
        self.assertEqual(draws("choice = [1.0, 2.0, 5.0, 7.0]").tolist(), np.array([1.0, 2.0, 5.0, 7.0])[places].tolist())
        self.write(f'{head}[[vary]]\nkey = "solver.stepper"\nchoice = ["rk4", "dopri5", "dop853", "trapezoid"]\n')
        self.sweep("--quiet", "--force")
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual((file["inputs/solver.stepper"][:] - 1).tolist(), places.tolist())

    def test_latin_draws_have_low_discrepancy(self):
        u = self.inputs("latin")
        for column in u.T:
            self.assertEqual(sorted((column * 64).astype(int)), list(range(64)))
        ours = self.qmc.discrepancy(u)
        # Of 200 Latin hypercubes of SciPy, ours is not worse than the worst.
        self.assertLess(ours, max(self.qmc.discrepancy(self.qmc.LatinHypercube(3, seed=i).random(64)) for i in range(200)))


class Runners(Case):
    """The same table, whoever runs the cases."""

    def setUp(self):
        super().setUp()
        self.write(DISKS)
        self.expected = self.whole()

    def test_jobs(self):
        for jobs in ("2", "5"):
            self.sweep("--output", "jobs.h5", "--jobs", jobs, "--quiet", "--force")
            self.assertEqual(table(self.folder / "jobs.h5"), self.expected)

    def test_array_tasks(self):
        for i in range(4):
            self.sweep("--output", "array.h5", "--jobs", "1", "--cases", f"{15 * i + 1}:{15 * i + 15}", "--quiet")
        parts = [path.name for path in self.folder.glob("array.h5.*-*.journal")]
        self.assertEqual(len(parts), 4)
        self.sweep("--output", "array.h5", "--merge", *parts[:3], "--quiet", code=2, says="15 of 60 cases are missing")
        (self.folder / "array.h5.journal").unlink()
        self.sweep("--output", "array.h5", "--merge", *parts, "--quiet")
        self.assertEqual(table(self.folder / "array.h5"), self.expected)

    def test_journals_of_other_sweeps_are_not_merged(self):
        self.sweep("--output", "array.h5", "--cases", "1:60", "--quiet")
        self.write(DISKS.replace("seed = 3", "seed = 4"))
        self.sweep("--output", "array.h5", "--merge", "array.h5.1-60.journal", "--quiet", code=2, says="no cases of this sweep")


def children(process):
    """The processes that a sweep has started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[1]) == process:
            found.append(int(path.parent.name))
    return found


class Kills(Case):
    """After kills of any process at any time, a restarted sweep is complete, with an identical table."""

    def setUp(self):
        super().setUp()
        self.write(DISKS.replace("time.end=0.05", "time.end=1.0"))
        begin = time.monotonic()
        self.expected = self.whole()
        self.seconds = time.monotonic() - begin
        self.random = random.Random(1)

    def kill_and_finish(self, kill):
        for _ in range(KILLS):
            process = subprocess.Popen(self.command("--output", "killed.h5", "--jobs", "2", "--quiet"), cwd=self.folder,
                                       env=ENVIRONMENT, stderr=subprocess.DEVNULL, start_new_session=True)
            time.sleep(self.random.uniform(0.02, 1.1 * self.seconds))
            kill(process)
            process.wait(timeout=120)
            if process.returncode != 0:
                # No worker outlives the one that it works for.
                time.sleep(0.1)
                self.assertEqual(children(process.pid), [])
                # One that was killed behind its last act, the removal of its journal, has left the whole table.
                if (self.folder / "killed.h5.journal").exists() or not (self.folder / "killed.h5").exists():
                    self.sweep("--output", "killed.h5", "--jobs", "2", "--quiet")
            self.assertEqual(table(self.folder / "killed.h5"), self.expected)
            self.assertEqual(list(self.folder.glob("killed.h5.*")), [])
            (self.folder / "killed.h5").unlink()
            (self.folder / "killed.csv").unlink()

    def test_the_first_process(self):
        self.kill_and_finish(lambda process: process.kill())

    def test_a_worker(self):
        def kill(process):
            workers = children(process.pid)
            if workers:
                os.kill(self.random.choice(workers), signal.SIGKILL)

        self.kill_and_finish(kill)

    def test_the_whole_job(self):
        def kill(process):
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass

        self.kill_and_finish(kill)

    def test_a_signal_that_asks(self):
        self.kill_and_finish(lambda process: process.terminate())

    def test_the_writer_of_the_table(self):
        """Killed while the HDF5 file is open: the moments are those at which it is there."""
        for _ in range(KILLS):
            process = subprocess.Popen(self.command("--output", "killed.h5", "--jobs", "2", "--quiet"), cwd=self.folder,
                                       env=ENVIRONMENT, stderr=subprocess.DEVNULL)
            while process.poll() is None and not (self.folder / "killed.h5.new").exists():
                pass
            time.sleep(self.random.uniform(0.0, 0.003))
            process.kill()
            process.wait()
            if (self.folder / "killed.h5.journal").exists():
                self.sweep("--output", "killed.h5", "--quiet")
            self.assertEqual(table(self.folder / "killed.h5"), self.expected)
            for path in self.folder.glob("killed.*"):
                path.unlink()


class Disks(Case):
    """Files that cannot grow."""

    def test_no_room_for_the_journal(self):
        self.write(DISKS)
        expected = self.whole()

        self.sweep("--quiet", "--cases", "1:1")
        part = self.folder / "sweep.h5.1-1.journal"
        room = part.stat().st_size
        part.unlink()
        # None for what it begins with, and some for records.
        for bytes_, words in ((1024, "cannot write"), (room + 2000, "cannot append to")):
            def limit(bytes_=bytes_):
                resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_, bytes_))

            self.sweep("--quiet", "--jobs", "1", code=1, says=f"{words} sweep.h5.journal", preexec_fn=limit)
        self.sweep("--quiet", "--jobs", "1")
        self.assertEqual(table(self.folder / "sweep.h5"), expected)

    def test_no_room_for_the_table(self):
        self.write(DISKS)
        expected = self.whole()
        journal = 60 * 14 * 8 + 4400

        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (journal, journal))

        self.sweep("--quiet", "--jobs", "1", code=1, says="no case is lost", preexec_fn=limit)
        # Unfinished files are removed.
        self.assertEqual(list(self.folder.glob("*.new")), [])
        self.sweep("--quiet", "--jobs", "1")
        self.assertEqual(table(self.folder / "sweep.h5"), expected)


#: Tells what is brought to the disk, renamed and removed, in that order.
SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
static void tell(const char *what, const char *path)
{
    FILE *log = fopen(getenv("TOLD"), "a");
    const char *slash = strrchr(path, '/');
    fprintf(log, "%s %s\n", what, slash ? slash + 1 : path);
    fclose(log);
}
int fsync(int file)
{
    char name[64], path[4096];
    snprintf(name, sizeof name, "/proc/self/fd/%d", file);
    ssize_t length = readlink(name, path, sizeof path - 1);
    path[length < 0 ? 0 : length] = 0;
    tell("sync", path);
    return ((int (*)(int))dlsym(RTLD_NEXT, "fsync"))(file);
}
int rename(const char *from, const char *to)
{
    tell("rename", from);
    return ((int (*)(const char *, const char *))dlsym(RTLD_NEXT, "rename"))(from, to);
}
int unlink(const char *path)
{
    tell("unlink", path);
    return ((int (*)(const char *))dlsym(RTLD_NEXT, "unlink"))(path);
}
"""


class Power(Case):
    """Loss of power: only synchronised data are certain to survive; any part of the others may."""

    def test_what_is_on_the_disk_when(self):
        if shutil.which("gcc") is None:
            self.skipTest("gcc is not there")
        self.write(SHIM, "shim.c")
        subprocess.run(["gcc", "-shared", "-fPIC", "-o", "shim.so", "shim.c", "-ldl"], cwd=self.folder, check=True)
        self.write(DISKS.replace("draws = 60", "draws = 3"))
        environment = ENVIRONMENT | {"LD_PRELOAD": str(self.folder / "shim.so"), "TOLD": str(self.folder / "told")}
        subprocess.run(self.command("--quiet"), cwd=self.folder, env=environment, check=True)
        told = (self.folder / "told").read_text().splitlines()
        folder = f"sync {self.folder.name}"
        # The journal and its name; then both files before either takes its name, and these before the journal goes.
        self.assertEqual(told, ["sync sweep.h5.journal", folder, "sync sweep.csv.new", "sync sweep.h5.new", "rename sweep.csv.new",
                                "rename sweep.h5.new", folder, "unlink sweep.h5.journal"])
        # A task leaves its journal on the disk.
        (self.folder / "told").unlink()
        subprocess.run(self.command("--quiet", "--cases", "1:2"), cwd=self.folder, env=environment, check=True)
        self.assertEqual((self.folder / "told").read_text().splitlines()[-1], "sync sweep.h5.1-2.journal")
        # Whole motions and their names, before the journal that calls their cases done.
        (self.folder / "told").unlink()
        (self.folder / "runs").mkdir()
        self.write(DISKS.replace("draws = 60", 'draws = 3\ntrajectories = "runs"'))
        subprocess.run(self.command("--quiet", "--jobs", "1", "--cases", "1:3"), cwd=self.folder, env=environment, check=True)
        told = [line for line in (self.folder / "told").read_text().splitlines() if line != folder and not line.startswith("unlink")]
        self.assertEqual(told[-7:], [line for i in (1, 2, 3) for line in (f"sync case_{i:06}.h5", "sync runs")]
                         + ["sync sweep.h5.1-3.journal"])

    def test_journals_of_which_parts_are_missing(self):
        """Blocks of 512 bytes after the head that never came to the disk, or the end of the file; also all of it."""
        self.write(DISKS)
        expected = self.whole()
        self.sweep("--quiet", "--cases", "1:60")
        part = self.folder / "sweep.h5.1-60.journal"
        whole = part.read_bytes()
        part.unlink()
        draw = random.Random(2)
        head = 512 * -(-(len(whole) - 60 * 14 * 8) // 512)
        states = [b"", bytes(len(whole)), bytes(600), whole[:100]]
        for _ in range(max(4, KILLS)):
            blocks = bytearray(whole[:draw.randrange(head, len(whole) + 1)])
            for place in range(head, len(blocks), 512):
                if draw.random() < 0.2:
                    blocks[place:place + 512] = bytes(len(blocks[place:place + 512]))
            states.append(bytes(blocks))
        for state in states:
            (self.folder / "sweep.h5.journal").write_bytes(state)
            self.sweep("--quiet")
            self.assertEqual(table(self.folder / "sweep.h5"), expected)
            (self.folder / "sweep.h5").unlink()
            (self.folder / "sweep.csv").unlink()


VARY = '[[vary]]\nkey = "model.mass"\nuniform = [1.0, 2.0]\n'
HEAD = '[sweep]\nscene = "rolling_disk"\n'

#: Wrong files: the text, and what the message must name.
WRONG = [
    ("", "scene"),
    ("[sweep]\n" + VARY, "scene"),
    ('[sweep]\nscene = 3\n' + VARY, "scene must be a string"),
    ('[sweep]\nscene = "roling_disk"\n' + VARY, 'did you mean "rolling_disk"'),
    ('[sweep]\nscene = "nowhere.toml"\n' + VARY, "nowhere.toml"),
    (HEAD, "[[vary]]"),
    (HEAD + "drawz = 3\n" + VARY, 'did you mean "draws"'),
    (HEAD + "draws = 0\n" + VARY, "draws must be positive"),
    (HEAD + "draws = 1.5\n" + VARY, "draws must be an integer"),
    (HEAD + "draws = 99999999999\n" + VARY, "draws must lie between"),
    (HEAD + 'points = "grid"\n' + VARY, "points must be one of random, latin, sobol"),
    (HEAD + "seed = -1\n" + VARY, "seed must not be negative"),
    (HEAD + 'trajectories = "nowhere"\n' + VARY, "trajectories must be a folder"),
    (HEAD + "max_seconds = -1.0\n" + VARY, "max_seconds must not be negative"),
    (HEAD + "set = \"time.end=1.0\"\n" + VARY, "set must be a list"),
    (HEAD + "set = [1.0]\n" + VARY, "set must be a list of strings"),
    (HEAD + 'set = ["time.ende=1.0"]\n' + VARY, 'did you mean "end"'),
    (HEAD + 'csv = "none.csv"\n', "csv names a file that cannot be read"),
    (HEAD + "draws = 5\n[[vary]]\nkey = \"model.mass\"\nvalues = [1.0]\n", "draws have no effect"),
    (HEAD + "[vary]\nkey = \"model.mass\"\n", "write [[vary]]"),
    (HEAD + "[vary]\n[[vary]]\n", "vary"),
    (HEAD + "[extra]\n" + VARY, 'unknown table or key "extra"'),
    (HEAD + "[[vary]]\nuniform = [1.0, 2.0]\n", "the key key is missing"),
    (HEAD + "[[vary]]\nkey = \"mass\"\nuniform = [1.0, 2.0]\n", "key must be table.key"),
    (HEAD + "[[vary]]\nkey = \"model.mas\"\nuniform = [1.0, 2.0]\n", 'did you mean "mass"'),
    (HEAD + "[[vary]]\nkey = \"model.mass[1]\"\nuniform = [1.0, 2.0]\n", "not a list of numbers"),
    (HEAD + "[[vary]]\nkey = \"initial.omega[4]\"\nuniform = [1.0, 2.0]\n", "fewer elements"),
    (HEAD + "[[vary]]\nkey = \"initial.omega[x]\"\nuniform = [1.0, 2.0]\n", "index of an element"),
    (HEAD + "[[vary]]\nkey = \"output.file\"\nvalues = [\"a\"]\n", "must not be one of [output]"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\n", "needs its values"),
    (HEAD + VARY + "normal = [1.0, 2.0]\n", "must have one"),
    (HEAD + VARY + VARY, "gives the name of another input"),
    (HEAD + VARY + '[[vary]]\nkey = "model.mass"\nname = "m"\nvalues = [1.0]\n', "a second time"),
    (HEAD + 2*'[[vary]]\nkey = "initial.omega[2]"\nvalues = [1.0]\n' + 'name = "again"\n', "a second time"),
    ('[sweep]\nscene = "a01_pendulum"\n[[vary]]\nkey = "parameters.ll"\nvalues = [1.0]\n', "not a parameter of the scene"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nuniform = [2.0, 1.0]\n", "the latter larger"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nuniform = [2.0]\n", "uniform has 1 element;"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nnormal = [2.0, 0.0]\n", "the latter positive"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nlog_uniform = [0.0, 1.0]\n", "positive ends"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nvalues = 3.0\n", "values must be a list"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nvalues = []\n", "empty list"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nvalues = [1.0, \"a\"]\n", "all numbers, all strings or all truth values"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nvalues = [-1.0]\n", "mass must be positive"),
    (HEAD + "[[vary]]\nkey = \"solver.stepper\"\nvalues = [\"rk4\", \"rk5\"]\n", 'did you mean "rk4"'),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nfrom = 1.0\ncount = 3\n", "the key to is missing"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nfrom = 1.0\nto = 2.0\n", "needs to and count"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nfrom = 1.0\nto = 2.0\ncount = 1\n", "at least 2"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nfrom = -1.0\nto = 2.0\ncount = 3\nspacing = \"log\"\n", "positive numbers only"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nfrom = 1.0\nto = 2.0\ncount = 3\nspacing = \"cubic\"\n", "spacing must be one of"),
    (HEAD + "[[vary]]\nkey = \"model.mass\"\nvalues = [1.0]\ncount = 3\n", "count"),
    (HEAD + 'lists = "rows"\n[[vary]]\nkey = "model.mass"\nvalues = [1.0, 2.0]\n[[vary]]\nkey = "initial.tilt"\nvalues = [0.0]\n',
     "equally long"),
    (HEAD + 'lists = "columns"\n' + VARY, "lists must be one of grid, rows"),
    (HEAD + "indices = true\n" + VARY, "at least 8"),
    (HEAD + 'indices = true\ndraws = 8\n[[vary]]\nkey = "model.mass"\nvalues = [1.0]\n', "no input is random"),
    (HEAD + VARY + "[[keep]]\n", "the key quantity is missing"),
    (HEAD + VARY + '[[keep]]\nquantity = "rzz"\n', 'did you mean "rz"'),
    (HEAD + VARY + '[[keep]]\nquantity = "sensor:tip"\n', "needs a model with sensors"),
    (HEAD + VARY + '[[keep]]\nquantity = "event:hit"\n', "is not an event"),
    (HEAD + VARY + '[[keep]]\nquantity = "figure:stepz"\n', "is not a figure"),
    (HEAD + VARY + '[[keep]]\nquantity = "speed:rz"\n', "must begin with one of"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\ntake = "median"\n', "take must be one of"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\ntake = "first"\n', "an event has first"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\ntake = "end"\nat = [0.0]\n', "remove take"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\nat = [1.0, 0.5]\n', "ascending"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\nat = [-1.0]\n', "must not begin before"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\n[[keep]]\nquantity = "rz"\n', "has the name of another"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\nname = "a/b"\n', "not contain a slash"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\nname = "z"\nat = [0.0]\n[[keep]]\nquantity = "rx"\nname = "z.times"\n', "times"),
    (HEAD + VARY + '[[keep]]\nquantity = "rx"\nname = "z.times"\n[[keep]]\nquantity = "rz"\nname = "z"\nat = [0.0]\n', "times"),
    (HEAD + VARY + '[[keep]]\nquantity = "rx"\nname = "z@0.0"\n[[keep]]\nquantity = "rz"\nname = "z"\nat = [0.0]\n', "times"),
    (HEAD + "indices = true\ndraws = 8\n" + VARY + '[[keep]]\nquantity = "rz"\nname = "inputs"\n', "reserved in the table of indices"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\nname = "status"\n', "reserved in the table"),
    (HEAD + VARY + '[[keep]]\nquantity = "rz"\nname = "model.mass"\n', "the name of an input"),
    (HEAD + VARY + 'name = "seconds"\n', "reserved in the table"),
    (HEAD + VARY + '[[keep]]\nquantity = "error:qdd"\n', "is not an error of a run"),
    (HEAD + VARY + '[[keep]]\nquantity = "error:q"\nat = [0.0]\n', "number of the complete run"),
    (HEAD + 'points = "sobol"\nindices = true\ndraws = 8\nset = ["initial.q=[0,0,1,1,0,0,0,0,0]", '
     '"initial.qd=[0,0,0,0,0,0,0,0,0]"]\n'
     + "".join(f'[[vary]]\nkey = "initial.{q}[{i}]"\nuniform = [0.0, 1.0]\n' for q in ("q", "qd") for i in range(1, 10))
     + "".join(f'[[vary]]\nkey = "{key}"\nuniform = [1.0, 2.0]\n' for key in ("model.mass", "model.gravity", "model.radius")),
     "40 columns at most, and there are 42"),
    (HEAD + VARY + "limits = [1.0, 2.0]\n", "belongs to normal or log_normal"),
    (HEAD + '[[vary]]\nkey = "model.mass"\nnormal = [1.0, 0.1]\nlimits = [2.0, 1.0]\n', "the latter larger"),
    (HEAD + '[[vary]]\nkey = "model.mass"\nnormal = [1.0, 0.1]\nlimits = [2.0, 3.0]\n', "less than 1e-12"),
    (HEAD + '[[vary]]\nkey = "model.mass"\nlog_normal = [1.0, 0.0]\n', "the latter positive"),
    (HEAD + '[[vary]]\nkey = "model.mass"\nlog_normal = [1.0, 0.1]\nlimits = [-1.0, 3.0]\n', "must be positive"),
    (HEAD + '[[vary]]\nkey = "model.mass"\ntriangular = [1.0, 3.0, 2.0]\n', "in that order"),
    (HEAD + '[[vary]]\nkey = "model.mass"\ntriangular = [1.0, 3.0]\n', "triangular has 2 elements"),
    (HEAD + '[[vary]]\nkey = "solver.stepper"\nchoice = ["rk4", "rk5"]\n', 'did you mean "rk4"'),
    (HEAD + '[[vary]]\nkey = "solver.stepper"\nchoice = []\n', "empty list"),
    ("[sweep\n", "sweep.toml"),
    ("\x00\x01", "binary"),
]


class Wrong(Case):
    """Wrong files end with exit code 2, a message that names the key, and nothing on the disk."""

    def test_files(self):
        self.assertGreaterEqual(len(WRONG), 40)
        for text, words in WRONG:
            with self.subTest(text=text):
                self.write(text)
                self.sweep("--quiet", code=2, says=words)
                left = [path.name for path in self.folder.iterdir()]
                for name in set(left) - {"sweep.toml"}:
                    (self.folder / name).unlink()
                self.assertEqual(left, ["sweep.toml"])

    def test_files_of_cases(self):
        for text, words in [("", "not a list of keys"), ("model.mass\n", "contains no cases"), ("model.mass,\n1,2\n", "not a list of keys"),
                            ("model.mass\n1,2\n", "line 2 does not have 1 values"), ("model.mass\n1\nx\n", "line 3 has"),
                            ("model.mass,model.mass\n1,2\n", "two columns"), ("mass\n1\n", "must be table.key"),
                            ("model.weight\n1\n", "refused by the scene"), ("model.mass\n1-5\n", "refused by the scene"),
                            ("model.mass\n2+3\n", "refused by the scene"), ("model.mass\n+1.5e+0\n1.2.3\n", "line 3 has"),
                            ("model.mass,initial.tilt\n1,\n", "no value of")]:
            with self.subTest(text=text):
                (self.folder / "cases.csv").write_text(text)
                self.write(HEAD + 'csv = "cases.csv"\n')
                self.sweep("--quiet", code=2, says=words)

    def test_command_lines(self):
        self.write(HEAD + VARY)
        for arguments, words in [(["--jobs", "0"], "--jobs"), (["--jobs", "x"], "--jobs"), (["--cases", "3"], "first:last"),
                                 (["--cases", "3:2"], "first:last"), (["--cases", "a:b"], "first:last"),
                                 (["--cases", "7:9"], "there are 1"), (["other.toml"], "takes one SWEEP"),
                                 (["--merge", "--cases", "1:1"], "not both"), (["--merge", "none.journal"], "none.journal"),
                                 (["--output", "sweep.toml"], "overwrite the sweep"), (["--steps", "3"], "no option")]:
            with self.subTest(arguments=arguments):
                done = subprocess.run(self.command(*arguments, "--quiet"), cwd=self.folder, env=ENVIRONMENT, capture_output=True,
                                      text=True, timeout=60)
                self.assertIn(done.returncode, (1, 2), done.stderr)
                self.assertIn(words, done.stderr)


class Summary(Case):
    def test_what_is_printed(self):
        self.write(DISKS)
        done = self.sweep()
        self.assertIn("60 cases, 0 failed", done.stdout)
        self.assertIn("rz_min [m]: mean", done.stdout)
        self.assertIn("files: sweep.h5, sweep.csv", done.stdout)
        # A line per 10 % where no terminal is.
        self.assertIn("60 of 60 cases, 0 failed", done.stderr)
        self.assertIn("a second", done.stderr)
        self.assertIn("load", done.stderr)

    def test_figures(self):
        self.write(DISKS)
        summary = json.loads(self.sweep("--json").stdout)
        with h5py.File(self.folder / "sweep.h5") as file:
            values = file["outputs/rz_end"][:]
        rz = next(output for output in summary["outputs"] if output["name"] == "rz_end")
        # Sums of 60 numbers in another order.
        self.assertTrue(math.isclose(rz["mean"], values.mean(), rel_tol=1e-14))
        self.assertTrue(math.isclose(rz["deviation"], values.std(ddof=1), rel_tol=1e-12))
        self.assertEqual((rz["least"], rz["case_of_least"]), (values.min(), 1 + values.argmin()))
        self.assertEqual((rz["most"], rz["case_of_most"]), (values.max(), 1 + values.argmax()))


class Pictures(Case):
    """Pictures of tables by `tandem plot`, if matplotlib is installed."""

    def setUp(self):
        super().setUp()
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest("matplotlib is not installed")
        self.write(DISKS.replace('key = "initial.tilt"\nuniform = [-0.1, 0.1]', 'key = "initial.tilt"\nuniform = [-2.0, 1.0]'))
        self.sweep("--quiet")

    def plot(self, *arguments, code=0, says=""):
        done = subprocess.run([sys.executable, "-m", "tandem", "plot", "sweep.h5", *arguments], cwd=self.folder,
                              capture_output=True, text=True, timeout=120,
                              env=ENVIRONMENT | {"PYTHONPATH": str(ROOT / "python" / "src")})
        self.assertEqual(done.returncode != 0, code != 0, done.stdout + done.stderr)
        self.assertIn(says, done.stderr)

    def test_kinds(self):
        names = {"surface": ["--names", "model.mass,initial.omega[2],rz_end"]}
        for kind in ("overview", "scatter", "histogram", "surface", "bands"):
            self.plot("--kind", kind, "--output", f"{kind}.png", *names.get(kind, []))
            self.assertGreater((self.folder / f"{kind}.png").stat().st_size, 5000)
        self.plot("--kind", "tracks", code=1, says="there is no kind 'tracks' of pictures of tables")
        self.plot("--kind", "histogram", "--names", "rzz", code=1, says="there is no column")

    def test_data(self):
        sys.path.insert(0, str(ROOT / "python" / "src"))
        self.addCleanup(sys.path.remove, str(ROOT / "python" / "src"))
        from tandem.plot import bands, histogram, read_table, scatter

        seen = read_table(self.folder / "sweep.h5")
        failed = seen.status != 0
        self.assertTrue(0 < failed.sum() < 60)
        self.assertEqual((seen.outputs["energy"].times.tolist(), seen.outputs["energy"].unit), ([0.0, 0.025, 0.05], "J"))
        axes = scatter(seen, ["rz_end", "model.mass"]).axes
        points = axes[0].collections[0].get_offsets()
        self.assertEqual(points[~failed, 1].tolist(), seen.outputs["rz_end"].values[~failed].tolist())
        self.assertEqual(axes[0].lines[0].get_xdata().tolist(), seen.inputs["model.mass"].values[failed].tolist())
        heights = [patch.get_height() for patch in histogram(seen, ["rz_end"]).axes[0].patches]
        self.assertEqual(sum(heights), (~failed).sum())
        median = bands(seen).axes[0].lines[0].get_ydata()
        np.testing.assert_allclose(median, np.median(seen.outputs["energy"].values[~failed], axis=0), rtol=1e-15)


if __name__ == "__main__":
    unittest.main()
