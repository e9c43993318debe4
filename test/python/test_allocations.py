# SPDX-License-Identifier: MIT
"""Steps allocate nothing: the number of allocations of a run does not grow with its number of steps. Reading asks for memory in
proportion to what is read.

Runs build/tandem, or what the environment variable TANDEM names, under a counter of malloc, calloc and realloc that the C
compiler makes; without one, or where programs cannot be preloaded, the tests are skipped.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
COMPILER = shutil.which("cc") or shutil.which("gcc")

COUNTER = """
#include <stddef.h>
#include <stdio.h>
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
static _Atomic long calls, bytes;
void *malloc(size_t size) { calls++; bytes += size; return __libc_malloc(size); }
void *calloc(size_t n, size_t size) { calls++; bytes += n*size; return __libc_calloc(n, size); }
void *realloc(void *old, size_t size) { calls++; bytes += size; return __libc_realloc(old, size); }
__attribute__((destructor)) static void report(void) { fprintf(stderr, "allocations: %ld of %ld bytes\\n", calls, bytes); }
"""

#: Repeated elements of all kinds but such with expressions of the state, which may name all bodies.
REPEATED = """
[scene]
model = "mechanism"

[parameters]
n = 3

[repeat.copy]
count = "n"

[repeat.copy.body."arm{i}"]
mass = 1.0
inertia = [0.1, 0.1, 0.1]
position = ["i", 0, 0]
points = { end = [0.5, 0, 0] }

[repeat.copy.body."slide{i}"]
mass = 1.0
inertia = [0.1, 0.1, 0.1]
position = ["i", 1, 0]

[repeat.copy.joint."hinge{i}"]
type = "revolute"
bodies = ["ground", "arm{i}"]
at = ["i - 0.5", 0, 0]
axis = [0, 0, 1]

[repeat.copy.joint."rail{i}"]
type = "prismatic"
bodies = ["ground", "slide{i}"]
at = ["i", 1, 0]
axis = [1, 0, 0]
motion = "0.1*sin(t)"

[repeat.copy.constraint."rod{i}"]
type = "distance"
between = ["ground:[i, 0, 3]", "arm{i}.end"]

[repeat.copy.force."spring{i}"]
type = "spring"
between = ["arm{i}.end", "slide{i}"]
stiffness = 10.0
law = "-rate^3"

[repeat.copy.force."twist{i}"]
type = "torsion"
joint = "hinge{i}"
damping = 0.1

[repeat.copy.force."load{i}"]
type = "load"
on = "slide{i}"
force = [0, 0, 1]

[repeat.copy.sensor."end{i}"]
point = "arm{i}.end"

[results]
bodies = "all"
joints = "all"
forces = "all"

[time]
end = 1.0
"""


@unittest.skipUnless(COMPILER and sys.platform == "linux", "wants a C compiler and Linux")
class Counted(unittest.TestCase):
    """Programs under the counter, in a folder of their own."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        (cls.folder / "counter.c").write_text(COUNTER, encoding="utf-8")
        subprocess.run([COMPILER, "-shared", "-fPIC", "-o", "counter.so", "counter.c"], cwd=cls.folder, check=True)

    def run_counted(self, *arguments):
        """Number of allocations of a command, and their bytes."""
        done = subprocess.run([TANDEM, *arguments], cwd=self.folder, capture_output=True, text=True, timeout=120,
                              env=os.environ | {"LD_PRELOAD": str(self.folder / "counter.so"), "OPENBLAS_NUM_THREADS": "1"})
        self.assertEqual(done.returncode, 0, done.stderr)
        counts = [line.split() for line in done.stderr.splitlines() if line.startswith("allocations:")]
        if not counts:
            self.skipTest("programs cannot be preloaded here")
        return int(counts[-1][1]), int(counts[-1][3])


class Steps(Counted):
    def count(self, scene, end, *settings):
        """The allocations of a run that writes nothing between its start and its end, however long that takes."""
        arguments = ["--no-error", "--quiet", "--force", "--output", "run.h5"]
        for setting in (f"time.end={end}", "output.every=1000000", "output.flush=1000", *settings):
            arguments += ["--set", setting]
        return self.run_counted("run", scene, *arguments)[0]

    def check(self, *settings):
        for scene in ("rolling_disk", "articulated_vehicle", "motorcycle"):
            with self.subTest(scene=scene):
                # 200 and 5200 steps; one allocation a step would be 5000; a breakpoint would come later. Texts of measured
                # times take some tens more or less, as their digits fall: what grows with the steps does so every time.
                for _ in range(4):
                    short, long = self.count(scene, 0.2, *settings), self.count(scene, 5.2, *settings)
                    if long <= short + 60:
                        break
                self.assertLessEqual(long, short + 60)

    def test_rk4(self):
        self.check("solver.stepper=rk4")

    def test_dopri5(self):
        self.check("solver.stepper=dopri5")

    def test_dop853(self):
        self.check("solver.stepper=dop853")

    def test_sdirk54(self):
        self.check("solver.stepper=sdirk54")

    def test_trapezoid(self):
        self.check("solver.stepper=trapezoid")


class Reading(Counted):
    def test_repeated_elements(self):
        """Four times as many copies take four times as much memory in all, given back or not; lists that are copied for each element
        more would take sixteen times as much."""
        (self.folder / "repeated.toml").write_text(REPEATED, encoding="utf-8")
        for scene in ("trailers", "repeated.toml"):
            with self.subTest(scene=scene):
                few, many = (self.run_counted("show", scene, "--set", f"parameters.n={n}")[1] for n in (500, 2000))
                # Lists double, so that the used part of their room depends on their sizes: a tenth more or less.
                self.assertLess(many, 4.5*few)


if __name__ == "__main__":
    unittest.main()
