# SPDX-License-Identifier: MIT
"""Installed files: the library, the program, three.js with its licence, and no place of the machine on which it was built."""

import ctypes
import os
import re
import subprocess
import sys
import tempfile
import unittest
import zipfile
from pathlib import Path

import tandem
from models import ROOT
from tandem.library import INTERFACE, library, library_path

PACKAGE = Path(tandem.__file__).parent
#: The checkout that the package was built in.
CHECKOUT = Path(os.environ.get("TANDEM_CHECKOUT", ROOT))
#: The wheel that was installed, if it was one: tools/check_wheel.sh.
WHEEL = os.environ.get("TANDEM_WHEEL")


class Installed(unittest.TestCase):
    def setUp(self):
        if PACKAGE.is_relative_to(ROOT / "python"):
            self.skipTest("the package is run out of the checkout")

    def test_what_is_in_it(self):
        self.assertTrue(Path(library_path()).is_relative_to(PACKAGE / "program" / "lib"), library_path())
        self.assertGreaterEqual(library().tandem_interface_version(), INTERFACE)
        self.assertEqual(Path(tandem.program_path()), PACKAGE / "program" / "bin" / "tandem")
        self.assertIn("MIT", (PACKAGE / "viewer" / "three" / "LICENSE").read_text())
        self.assertIn(tandem.__version__, tandem.run_program("--version"))
        for name in ("py.typed", "LICENSE", "viewer/page/page.html", "program/share/tandem/licences/program-toml-f.txt"):
            self.assertTrue((PACKAGE / name).exists(), name)

    def test_no_path_of_the_machine(self):
        place = str(CHECKOUT).encode()
        found = [path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts and place in path.read_bytes()]
        self.assertEqual(found, [])
        told = subprocess.run(["readelf", "-d", library_path()], capture_output=True, text=True).stdout
        self.assertNotRegex(told, r"R(UN)?PATH.*\[(?!\$ORIGIN)")

    def test_the_command(self):
        """pip puts the program beside the interpreter; its pages are drawn by this Python, whichever comes first on the PATH."""
        with tempfile.TemporaryDirectory() as folder:
            command = Path(sys.executable).parent / "tandem"
            environment = {name: value for name, value in os.environ.items() if name != "TANDEM_PYTHON"}
            for words in (["run", "slider_crank", "--set", "time.end=0.2", "--quiet"], ["plot", "slider_crank.h5"], ["view", "slider_crank.h5"]):
                done = subprocess.run([command, *words], cwd=folder, env=environment, capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(subprocess.run([command, "run", "nothing"], cwd=folder, capture_output=True).returncode, 2)
            self.assertGreater((Path(folder) / "slider_crank.html").stat().st_size, 100_000)

    def test_another_package_of_that_name(self):
        """The remedy is stated by `import tandem`, and by what the program draws, also where files of ours are overwritten."""
        with tempfile.TemporaryDirectory() as folder:
            other = Path(folder) / "tandem-0.4.3.dist-info" / "METADATA"
            other.parent.mkdir()
            other.write_text("Metadata-Version: 2.1\nName: tandem\nVersion: 0.4.3\n")
            environment = {**os.environ, "PYTHONPATH": folder, "TANDEM_PYTHON": sys.executable}
            for overwritten in (False, True):
                if overwritten:
                    (Path(folder) / "tandem").mkdir()
                    (Path(folder) / "tandem" / "__init__.py").write_text("data = None\n")
                else:
                    done = subprocess.run([sys.executable, "-c", "import tandem"], env=environment, capture_output=True, text=True)
                    self.assertIn("ImportError", done.stderr)
                    self.assertIn("pip uninstall tandem", done.stderr)
                done = subprocess.run([tandem.program_path(), "view", "a.h5"], cwd=folder, env=environment, capture_output=True, text=True)
                self.assertEqual(done.returncode, 2)
                self.assertIn("pip uninstall tandem", done.stderr)

    @unittest.skipUnless(WHEEL, "what is installed did not come in a wheel of its own")
    def test_the_wheel(self):
        """Small, for any Linux since 2021, with nothing but the C library to be found on the machine, and the licences of all that it holds."""
        self.assertLess(Path(WHEEL).stat().st_size, 20e6)
        platforms = Path(WHEEL).stem.split("-")[4].split(".")
        self.assertTrue(all(int(re.fullmatch(r"manylinux_2_(\d+)_x86_64", name)[1]) <= 34 for name in platforms), platforms)
        names = zipfile.ZipFile(WHEEL).namelist()
        for part in ("tandem", "program-toml-f", "openblas", "hdf5", "libaec", "zlib", "gfortran", "GPL-3", "LGPL-2.1"):
            self.assertIn(f"tandem/program/share/tandem/licences/{part}.txt", names)
        for file in (library_path(), tandem.program_path()):
            told = subprocess.run(["readelf", "-d", file], capture_output=True, text=True).stdout
            needed = set(re.findall(r"NEEDED.*\[(.*)\]", told)) - {"ld-linux-x86-64.so.2"}
            self.assertLessEqual(needed, {"libc.so.6", "libm.so.6", "libmvec.so.1", "libgcc_s.so.1", f"libtandem.so.{INTERFACE // 1000}", "libgfortran.so.5"}, file)
        self.assertLessEqual({f"tandem/program/lib/tandem/{name}" for name in ("libtandem-blas.so.1", "libgfortran.so.5", "libquadmath.so.0")},
                             set(names))

    @unittest.skipUnless(WHEEL, "what is installed did not come in a wheel of its own")
    def test_the_library_suits_the_processor(self):
        """Package and program load the library for newer processors if possible, otherwise the general one; both agree."""
        newer = {"avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"} <= set(Path("/proc/cpuinfo").read_text().split())
        code = ("import tandem\n"
                "print(tandem.solve(tandem.Model(n=1, mass_matrix=[[1.0]], applied_force=lambda t, q, qd: -q), (0, 1), [1], [0], rtol=1e-9).q[-1, 0])\n"
                "print([line.split()[-1] for line in open('/proc/self/maps') if 'libtandem.so' in line][0])")
        for tunables, expected in (("", newer), ("glibc.cpu.hwcaps=-AVX2", False)):
            environment = {**os.environ, "GLIBC_TUNABLES": tunables}
            done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
            value, loaded = done.stdout.split("\n")[:2]
            self.assertAlmostEqual(float(value), 0.5403023058681398, delta=1e-8)
            self.assertEqual("glibc-hwcaps/x86-64-v3" in loaded, expected, loaded)
            told = subprocess.run([tandem.program_path(), "version"], env={**environment, "LD_TRACE_LOADED_OBJECTS": "1"}, capture_output=True, text=True)
            self.assertEqual("glibc-hwcaps/x86-64-v3/libtandem.so" in told.stdout, expected, told.stdout)

    def test_the_header_has_all_that_is_called(self):
        """Functions, and how many arguments each has, are those of include/tandem.h."""
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
