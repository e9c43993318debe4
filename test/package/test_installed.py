# SPDX-License-Identifier: MIT
"""What is installed: the library, the program, three.js with its licence, and no place of the machine on which it was built."""

import ctypes
import subprocess
import sys
import unittest
from pathlib import Path

import tandem
from models import ROOT
from tandem.library import INTERFACE, library, library_path

PACKAGE = Path(tandem.__file__).parent


class Installed(unittest.TestCase):
    def setUp(self):
        if PACKAGE.is_relative_to(ROOT / "python"):
            self.skipTest("the package is run out of the checkout")

    def test_what_is_in_it(self):
        self.assertEqual(Path(library_path()), PACKAGE / "lib" / "libtandem.so")
        self.assertGreaterEqual(library().tandem_interface_version(), INTERFACE)
        self.assertEqual(Path(tandem.program_path()), PACKAGE / "program" / "bin" / "tandem")
        self.assertIn("MIT", (PACKAGE / "viewer" / "three" / "LICENSE").read_text())
        self.assertIn(tandem.__version__, tandem.run_program("--version"))
        for name in ("py.typed", "LICENSE", "viewer/page/page.html", "program/share/tandem/licences/program-toml-f.txt"):
            self.assertTrue((PACKAGE / name).exists(), name)

    def test_no_path_of_the_machine(self):
        place = str(ROOT).encode()
        found = [path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts and place in path.read_bytes()]
        self.assertEqual(found, [])
        told = subprocess.run(["readelf", "-d", PACKAGE / "lib" / "libtandem.so"], capture_output=True, text=True).stdout
        self.assertNotRegex(told, "RPATH|RUNPATH")

    def test_the_header_has_all_that_is_called(self):
        """Functions, and how many arguments each has, are those of include/tandem.h."""
        import re

        from tandem.library import FUNCTIONS

        text = re.sub(r"/\*.*?\*/", " ", (ROOT / "include" / "tandem.h").read_text(), flags=re.S)
        for name, arguments in FUNCTIONS.items():
            declared = re.search(rf"\bint tandem_{name}\(([^;]*)\);", text)
            self.assertIsNotNone(declared, name)
            given = [part.strip() for part in declared[1].split(",")]
            self.assertEqual(len(given), len(arguments) + 1, name)
            for part, kind in zip(given[1:], arguments, strict=True):
                is_address = "*" in part or "_function" in part
                expected = ctypes.c_char_p if re.search(r"\bchar \*", part) else ctypes.c_void_p if is_address else (
                    ctypes.c_double if part.startswith("double") else ctypes.c_int)
                self.assertIs(kind, expected, f"{name}: {part}")

    def test_nothing_but_numpy_is_needed_for_a_run(self):
        code = ("import sys, tandem\n"
                "tandem.solve(tandem.Model(n=1, mass_matrix=[[1.0]]), (0, 1), [0], [1])\n"
                "print([name for name in ('matplotlib', 'xarray', 'h5py', 'scipy') if name in sys.modules])")
        self.assertEqual(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip(), "[]")


if __name__ == "__main__":
    unittest.main()
