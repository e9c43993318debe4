# SPDX-License-Identifier: MIT
"""The readers of tools/verify.py: each failure that they must not overlook."""

import importlib.util
import os
import sys
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("verify", ROOT / "tools" / "verify.py")
verify = importlib.util.module_from_spec(spec)
sys.modules["verify"] = verify
spec.loader.exec_module(verify)

STARTING = "  Starting one ... (1/2)"
PASSED = "       ... one [PASSED]"


def text(*lines):
    return "\n".join(lines) + "\n"


class Readers(unittest.TestCase):
    def assert_counts(self, count, passed, failed, skipped=0):
        self.assertEqual((count.passed, count.failed, count.skipped), (passed, failed, skipped), count.notes)

    def test_test_drive(self):
        two = ["  Starting two ... (2/2)", "       ... two [FAILED]", "  Message: off by 1", "  at t = 3"]
        count = verify.test_drive(text(STARTING, PASSED, *two))
        self.assert_counts(count, 1, 1)
        self.assertEqual(count.notes, ["two [FAILED]", "Message: off by 1", "  at t = 3"])

    def test_test_drive_verdicts(self):
        verdicts = ["PASSED", "FAILED", "SKIPPED", "EXPECTED FAIL", "UNEXPECTED PASS"]
        self.assert_counts(verify.test_drive(text(*(f"       ... {n} [{v}]" for n, v in enumerate(verdicts)))), 2, 2, 1)

    def test_test_that_crashes(self):
        count = verify.test_drive(text(STARTING, PASSED, "  Starting two ... (2/2)", "Program received signal SIGSEGV"))
        self.assert_counts(count, 1, 1)
        self.assertEqual((count.notes[0], count.notes[-1]), ("two [did not end]:", "  Program received signal SIGSEGV"))

    def test_array_temporary(self):
        def warned(place):
            return [f"At line 7 of file {place}", "Fortran runtime warning: An array temporary was created"]

        quiet = warned("test/test_x.f90") + warned("build/dependencies/toml-f/src/tomlf.f90")
        self.assert_counts(verify.test_drive_checked(text(STARTING, PASSED, *quiet)), 2, 0)
        count = verify.test_drive_checked(text(STARTING, *2 * warned("././src/tandem/x.f90"), PASSED))
        self.assert_counts(count, 1, 1)
        self.assertEqual(count.notes[1], "  src/tandem/x.f90:7: An array temporary was created (2 times)")

    def test_compiler(self):
        compiled = [f" + gfortran -c ././{file}   -Wall -o x.o" for file in verify.own_sources()]
        theirs = ["build/dependencies/x/src/x.f90:1:2:", "Warning: unused"]
        self.assert_counts(verify.compiler(text(*compiled, *theirs)), 2, 0)
        ours = ["././src/tandem/x.f90:3:4:", "", "    3 | x", "      | 1", "Warning: Unused variable [-Wunused]"]
        count = verify.compiler(text(*compiled, *ours))
        self.assert_counts(count, 1, 1)
        self.assertEqual(count.notes[1], "  src/tandem/x.f90:3: Warning: Unused variable [-Wunused]")
        self.assert_counts(verify.compiler(text(*compiled, "/usr/bin/ld: warning: x.o: requires executable stack")), 1, 1)
        self.assert_counts(verify.compiler(text(*compiled[1:])), 1, 1)

    def test_unittest(self):
        self.assert_counts(verify.unittest_text(text("Ran 3 tests in 0.1s", "", "OK")), 3, 0)
        self.assert_counts(verify.unittest_text(text("Ran 3 tests in 0.1s", "", "OK (skipped=1)")), 2, 0, 1)
        lines = ["=" * 70, "FAIL: x", "Ran 5 tests in 0.1s", "", "FAILED (failures=1, errors=1, skipped=1)"]
        self.assert_counts(verify.unittest_text(text(*lines)), 2, 2, 1)
        self.assert_counts(verify.unittest_text(text("Ran 2 tests in 0s", "", "FAILED (unexpected successes=1)")), 1, 1)
        self.assert_counts(verify.unittest_text(text(*lines, "Ran 3 tests in 0.1s", "", "OK (skipped=1)")), 4, 2, 2)

    def test_ok_lines(self):
        count = verify.ok_lines(text("ok one", "building", "not ok two", "expected 3, got 4"))
        self.assert_counts(count, 1, 1)
        self.assertEqual(count.notes, ["not ok two", "expected 3, got 4"])


class Runs(unittest.TestCase):
    def count(self, script, reader=verify.ok_lines, **options):
        with tempfile.TemporaryDirectory() as logs, mock.patch.object(verify, "LOGS", Path(logs)):
            count = verify.run(verify.Part("part", ["sh", "-c", script], reader, **options))
        return count.passed, count.failed

    def test_passes(self):
        self.assertEqual(self.count("echo ok one"), (1, 0))
        self.assertEqual(self.count("true", verify.one_test), (1, 0))

    def test_failure_that_no_test_shows(self):
        self.assertEqual(self.count("echo ok one; exit 3"), (1, 1))
        self.assertEqual(self.count("exit 3", verify.one_test), (0, 1))
        self.assertEqual(self.count("echo ok one; kill -SEGV $$"), (1, 1))

    def test_no_test(self):
        self.assertEqual(self.count("echo nothing"), (0, 1))

    def test_hang(self):
        # A busy machine may need some of these seconds for the first line.
        self.assertEqual(self.count("echo ok one; sleep 60", minutes=0.05), (1, 1))

    def test_the_callers_language_and_hooks_do_not_matter(self):
        own = {"LC_ALL": "de_DE.ISO-8859-1", "LANGUAGE": "de", "GIT_DIR": "/nonexistent", "OPENBLAS_NUM_THREADS": "7"}
        with mock.patch.dict(os.environ, own):
            script = 'test "$LC_ALL, $LANGUAGE, $GIT_DIR, $OPENBLAS_NUM_THREADS" = "C.UTF-8, , , 7" && echo ok one'
            self.assertEqual(self.count(script), (1, 0))

    def order(self, parts, lanes=2):
        """Run parts that write their names when they begin and end: the names, ended ones in capitals."""
        with tempfile.TemporaryDirectory() as logs, mock.patch.object(verify, "LOGS", Path(logs)):
            notes = Path(logs) / "notes"
            script = 'echo {0} >>"$1"; sleep {1}; echo {0} | tr a-z A-Z >>"$1"; echo ok'
            parts = [verify.Part(name, ["sh", "-c", script.format(name, seconds), "sh", str(notes)], verify.ok_lines, **options)
                     for name, seconds, options in parts]
            counts = [count for _, count, _ in verify.results(parts, lanes)]
            self.assertEqual([(count.passed, count.failed) for count in counts], [(1, 0)]*len(parts))
            return "".join(notes.read_text().split())

    def test_two_parts_at_a_time(self):
        order = self.order([("a", 1.5, {}), ("b", 0.3, {}), ("c", 0.3, {})])
        self.assertEqual((order[2:], set(order[:2])), ("BcCA", {"a", "b"}))
        self.assertEqual(self.order([("a", 0.3, {}), ("b", 0, {})], lanes=1), "aAbB")

    def test_a_part_waits_for_what_it_needs_and_for_builds_of_the_same_project(self):
        for of_b in {"needs": "a"}, {"builds": "x"}:
            order = self.order([("a", 1.5, {"builds": "x"}), ("b", 0, of_b), ("c", 0.3, {"builds": "y"})])
            self.assertEqual((order[2:], set(order[:2])), ("CAbB", {"a", "c"}))

    def test_no_part_outlives_an_interrupted_caller(self):
        with tempfile.TemporaryDirectory() as logs, mock.patch.object(verify, "LOGS", Path(logs)):
            results = verify.results([verify.Part(name, ["sleep", seconds], verify.one_test) for name, seconds in (("a", "0"), ("b", "60"))], 2)
            next(results)
            begin = time.monotonic()
            results.close()
            self.assertLess(time.monotonic() - begin, 30)

    def test_command_not_found(self):
        part = verify.Part("part", ["/nonexistent"], verify.one_test)
        with tempfile.TemporaryDirectory() as logs, mock.patch.object(verify, "LOGS", Path(logs)):
            self.assertEqual(verify.run(part).failed, 1)


if __name__ == "__main__":
    unittest.main()
