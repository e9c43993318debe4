# SPDX-License-Identifier: MIT
"""tandem run --profile: the run is the one without it, the parts sum to the whole, and calls are those of the counters."""

import re
import signal
import subprocess
import time
import unittest

import h5py
import numpy as np
from test_output import ROOT, TANDEM, Case

TERMS = ["phi", "jacobian", "nu", "gamma", "mass", "force"]
RUNS = {
    "rk4": ["rolling_disk", "--set", "time.end=0.5"],
    "implicit": ["motorcycle_chopper", "--set", "time.end=0.5", "--set", "solver.stepper=sdirk54", "--set", "solver.rtol=1e-8"],
    "interval": ["articulated_vehicle", "--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-8", "--set",
                 "output.interval=0.05", "--set", 'output.fields=["q", "lambda", "kinetic_energy"]'],
}


def values(path):
    """Everything in a result file that a run makes: datasets, and counters without times."""
    found = {}
    with h5py.File(path) as file:
        for group in "trajectory", "diagnostics":
            for name, dataset in file.get(group, {}).items():
                rows = dataset[:]
                # The bytes of texts are addresses.
                found[f"{group}/{name}"] = rows.tolist() if rows.dtype == object else rows.tobytes()
        found |= {name: value for name, value in file["report"].attrs.items() if "seconds" not in name}
    return found


class Profile(Case):
    def profile(self, *arguments, code=0, name="profile.h5"):
        done = self.tandem("run", *arguments, "--profile", "--no-error", "--output", name, "--force", code=code)
        with h5py.File(self.folder / name) as file:
            group = file["report/profile"]
            table = {key: group[key][:] for key in ("calls", "seconds")}
            table |= {key: [text.decode() for text in group[key][:]] for key in ("part", "group")}
            return done, table, dict(group.attrs), dict(file["report"].attrs)

    def test_the_run_is_the_same(self):
        for name, arguments in RUNS.items():
            with self.subTest(name):
                self.tandem("run", *arguments, "--no-error", "--quiet", "--output", "plain.h5", "--force")
                done, *_ = self.profile(*arguments)
                self.assertIn("part of the run", done.stdout)
                self.assertEqual(values(self.folder / "plain.h5"), values(self.folder / "profile.h5"))
                with h5py.File(self.folder / "plain.h5") as file:
                    self.assertNotIn("profile", file["report"])

    def test_the_parts_sum_to_the_whole(self):
        for name, arguments in RUNS.items():
            with self.subTest(name):
                done, table, attributes, _ = self.profile(*arguments)
                total = attributes["seconds"]
                self.assertGreater(total, 0)
                self.assertAlmostEqual(table["seconds"].sum() / total, 1, 9)
                output = sum(s for s, group in zip(table["seconds"], table["group"]) if group == "output")
                # The work of the model and the chart for output is in the other attribute.
                self.assertGreaterEqual(attributes["output_seconds"] / output, 1 - 1e-9)
                self.assertLess(attributes["output_seconds"] + attributes["bare_seconds"], total * (1 + 1e-9))
                # Which of the two is larger, noise may decide where a run takes a millisecond.
                self.assertGreater(attributes["compared_with_clocks"], 0)
                self.assertGreater(attributes["compared_without"], 0)
                self.assertGreaterEqual(attributes["clock_pair_seconds"], attributes["clock_pair_seconds_in_loop"])
                self.assertAlmostEqual((total + attributes["clock_seconds"]) / attributes["measured_seconds"], 1, 9)
                self.assertEqual(attributes["clock_pairs"], table["calls"].sum())
                groups = re.findall(r"^  (?! |total )\S.*? -?\d+\.\d{6} +(-?\d+\.\d)", done.stdout, re.M)
                shares = [float(share) for share in groups]
                self.assertGreaterEqual(len(shares), 5)
                self.assertAlmostEqual(sum(shares), 100, delta=0.05 * len(shares) + 1e-9)

    def test_calls_are_those_of_the_counters(self):
        for name, arguments in RUNS.items():
            with self.subTest(name):
                _, table, _, report = self.profile(*arguments)
                calls = dict(zip(zip(table["group"], table["part"]), table["calls"]))
                for term in TERMS:
                    self.assertEqual(sum(n for (group, part), n in calls.items() if group == "model" and term in part.split()),
                                     report[f"evaluations_{term}"], term)
                self.assertEqual(sum(n for (_, part), n in calls.items() if part.startswith("evaluate: ")), report["fused_calls"])
                self.assertEqual(calls.get(("Newton", "corrections"), 0), report["newton_corrections"])
                self.assertEqual(calls.get(("Newton", "matrices"), 0), report["newton_matrices"])
                self.assertEqual(calls.get(("chart", "multipliers"), 0), report["multipliers"])
                self.assertEqual(sum(n for (_, part), n in calls.items() if part == "kinetic energy" or part == "kinetic_energy"),
                                 report["kinetic_energies"])
                if name == "implicit":
                    self.assertEqual(calls["model", "evaluate_derivatives: all"], report["newton_matrices"])

    def test_a_run_that_fails(self):
        done, table, attributes, _ = self.profile("rolling_disk", "--set", "solver.max_steps=50", code=1)
        self.assertIn("part of the run", done.stdout)
        self.assertEqual(attributes["compared_without"], 0)
        self.assertAlmostEqual(table["seconds"].sum() / attributes["seconds"], 1, 9)

    def test_a_run_that_is_interrupted_and_goes_on(self):
        process = subprocess.Popen([TANDEM, "run", "rolling_disk", "--set", "time.end=20000", "--profile", "--output", "a.h5"],
                                   cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 30
        while not (self.folder / "a.h5").exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.3)
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 128 + signal.SIGTERM)
        self.assertIn("part of the run", out)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file.attrs["status"], "interrupted")
            self.assertIn("profile", file["report"])
            end = file["trajectory/time"][-1] + 0.1
        self.refused("resume", "a.h5", "--profile", says="tandem resume has no option --profile")
        self.tandem("resume", "a.h5", "--set", f"time.end={end}", "--no-error", "--quiet")
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file.attrs["status"], "complete")
            # It would be that of a part of the run.
            self.assertNotIn("profile", file["report"])

    def test_nothing_is_forgotten(self):
        """Every deferred procedure of a chart is timed or known to be negligible; so is every procedure of a model."""
        # Positions and velocities of `restore` are timed in the charts; the others are done once, or take some products or copies.
        untimed = {"do_attach", "start_step", "get_memory", "set_memory", "forget", "remove_normal", "pack_state"}
        source = ROOT / "src" / "tandem"
        asked, timed = set(), set()
        for file in ("chart.f90", "implicit.f90"):
            text = (source / "chart" / file).read_text()
            asked |= set(re.findall(r"procedure\(\w+\), deferred :: (\w+)", text))
            timed |= set(re.findall(r"timer%begin_operation.*\n(?:.*counts.*\n)?.*call self%(do_\w+)", text))
        for file in ("dense/motion.f90", "sparse/motion.f90"):
            text = (source / "chart" / file).read_text()
            if all(re.search(rf"begin_operation\(of_{part}\)\n.*restore_{part}", text) for part in ("position", "velocity")):
                timed.add("restore")
        self.assertGreater(len(timed), 13)
        self.assertEqual(asked - untimed, timed)
        models = (source / "model" / "model.f90").read_text() + (source / "model" / "procedures.f90").read_text()
        pointers = set(re.findall(r"(\w+) => null\(\)", models)) - {"timer"}
        # Sensors are evaluated for output only and timed with it; symmetries and rates of forces are evaluated before a run, and a change
        # by an event takes the time of an assignment.
        self.assertEqual(len(pointers), 21)
        # Friction is an applied force, and its normal forces are some sums of multipliers; derivatives by bodies are derivatives.
        booked_as = {"friction_directions": "applied_force", "evaluate_stiffness": "evaluate_derivatives"}
        pointers |= set(booked_as)
        told = set()
        for file in ["model/procedures.f90", "model/evaluator.f90", "model/differences.f90", "model/kinetic_energy.f90", "simulate/answers.f90"]:
            lines = (source / file).read_text().splitlines()
            for before, line in zip(lines, lines[1:]):
                # Parts of derivatives are booked by their number.
                part = re.search(r"case \(of_(\w+)\); call self%(\w+)\(", line)
                if part:
                    self.assertEqual(part[1], part[2])
                    told.add(part[2])
                    continue
                owner = "self" if "procedures" in file else "(?:self%)?model"
                call = re.search(rf"\bcall ({owner})%(\w+)\(", line)
                # `evaluate` of an evaluator that its owner calls the model is not a call of one.
                if not call or call[2] not in pointers or "self%terms, stat" in line:
                    continue
                part = booked_as.get(call[2], call[2])
                self.assertIn(f"if (associated({call[1]}%state%timer)) call {call[1]}%state%timer%begin_call(of_{part}", before, line)
                told.add(call[2])
        self.assertEqual(pointers, told)
        self.assertIn("if (associated(self%state%timer)) call self%state%timer%begin_call(part)\n        select case (part)\n", models)
        names = re.search(r"single_name\(.*?\[character\(len=24\) :: (.*?)\]", (source / "profile" / "parts.f90").read_text(), re.S)[1]
        calls = (source / "model" / "timer.f90").read_text().split("Numbers of operations")[0]
        numbers = re.findall(r"of_(\w+) = (\d+)", calls)
        self.assertEqual([name for name, _ in numbers[:-1]], re.findall(r"'(\w+)'", names))
        self.assertEqual([int(number) for _, number in numbers[:-1]], list(np.arange(len(numbers) - 1) + 1))


if __name__ == "__main__":
    unittest.main()
