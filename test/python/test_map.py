# SPDX-License-Identifier: MIT
"""The map of test/README.md names tests that exist, and the suites that hold them."""

import re
import unittest
from pathlib import Path

TEST = Path(__file__).resolve().parents[1]


class Map(unittest.TestCase):
    def test_every_test_named_exists(self):
        suites = re.findall(r"new_testsuite\('(\w+)', collect_(\w+)\)", (TEST / "main.f90").read_text())
        fortran = set()
        for suite, name in suites:
            (path,) = (TEST / "src").glob(f"*/test_{name}.f90")
            source = path.read_text()
            fortran |= {f"{suite}/{test}" for test in re.findall(r"new_unittest\('([^']+)'", source)}
        python = {f"{path.name} {test}" for path in TEST.glob("p*/test_*.py")
                  for test in re.findall(r"def (test_\w+)\(self", path.read_text())}
        rows = [line for line in (TEST / "README.md").read_text().splitlines() if line.startswith("| ")][1:]
        self.assertGreater(len(rows), 35)
        for row in rows:
            what, tests = row.strip("| ").split(" | ")
            named = re.findall(r"`([^`]+)`", tests)
            self.assertTrue(named, what)
            for name in named:
                self.assertTrue(name in fortran or name in python, f"{what}: there is no test {name}")


if __name__ == "__main__":
    unittest.main()
