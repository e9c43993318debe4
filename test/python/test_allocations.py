# SPDX-License-Identifier: MIT
"""Steps allocate nothing: how often a run asks for memory does not grow with its number of steps.

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
static _Atomic long calls;
void *malloc(size_t size) { calls++; return __libc_malloc(size); }
void *calloc(size_t n, size_t size) { calls++; return __libc_calloc(n, size); }
void *realloc(void *old, size_t size) { calls++; return __libc_realloc(old, size); }
__attribute__((destructor)) static void report(void) { fprintf(stderr, "allocations: %ld\\n", calls); }
"""


@unittest.skipUnless(COMPILER and sys.platform == "linux", "wants a C compiler and Linux")
class Allocations(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        (cls.folder / "counter.c").write_text(COUNTER, encoding="utf-8")
        subprocess.run([COMPILER, "-shared", "-fPIC", "-o", "counter.so", "counter.c"], cwd=cls.folder, check=True)

    def count(self, scene, end, *settings):
        """The allocations of a run that writes nothing between its start and its end, however long that takes."""
        arguments = ["--no-error", "--quiet", "--force", "--output", "run.h5"]
        for setting in (f"time.end={end}", "output.every=1000000", "output.flush=1000", *settings):
            arguments += ["--set", setting]
        done = subprocess.run([TANDEM, "run", scene, *arguments], cwd=self.folder, capture_output=True, text=True, timeout=120,
                              env=os.environ | {"LD_PRELOAD": str(self.folder / "counter.so"), "OPENBLAS_NUM_THREADS": "1"})
        self.assertEqual(done.returncode, 0, done.stderr)
        counts = [int(line.split()[1]) for line in done.stderr.splitlines() if line.startswith("allocations:")]
        if not counts:
            self.skipTest("programs cannot be preloaded here")
        return counts[-1]

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


if __name__ == "__main__":
    unittest.main()
