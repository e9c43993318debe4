# SPDX-License-Identifier: MIT
"""Settings that pyproject.toml cannot hold: the version is that of the checkout, and the package holds the shared library, the program with
its scenes, and three.js for the pages of `tandem view`.

With TANDEM_PORTABLE set, library and program run on any Linux of this kind (`make wheel`). Otherwise the library is compiled for any
machine of this kind, or for the machine at hand with ARCH=-march=native, from the objects of `make install` with the same flags;
the program is the one that `make build` has left. three.js comes out of a package on PyPI that ships it, and has to have the
checksums that are pinned here.
"""

import hashlib
import importlib.util
import os
import re
import shutil
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent.parent
THREE = "0.180.0"
# The package that ships it, pinned in pyproject.toml. It names the file beside OrbitControls.js, where pages name a module.
THREE_CARRIER = "ifc_console_viewer"
THREE_IMPORT = b"from './three.module.min.js'", b"from 'three'"
# Of the files as npm has them.
THREE_SHA256 = {
    "three.core.min.js": "61ba0df005b05991361d040d8ff670e1aadfd0ce7aeebd1fdb0725957a8957de",
    "three.module.min.js": "e2b5ee6bccd38fd6d8a2428546b83c5f2426d84b152ef82be8055556e3b40eb6",
    "OrbitControls.js": "b97879c748170baadeb3fb84cea1ffdf4674e283dc06042f34e2acb95a76042c",
    "LICENSE.three.txt": "bfe119ea4fd413f5f7ca3fcd63adb0c4a073ed39daa2fe7d3e6b769e21272601",
}


def version():
    return re.search(r'^version = "([^"]+)"', (ROOT / "fpm.toml").read_text(), re.M)[1]


def add_files(target):
    """The shared library and the program, as below a prefix."""
    spec = importlib.util.spec_from_file_location("library", ROOT / "tools" / "library.py")
    library = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(library)
    portable = bool(os.environ.get("TANDEM_PORTABLE"))
    if portable:
        built = library.build_portable()
        program = built / "tandem"
    else:
        flags = ["-O3", "-funroll-loops", "-fno-loop-unroll-and-jam", *os.environ.get("ARCH", "").split()]
        built = library.build_libraries(ROOT / "build" / "library", flags)
        program = ROOT / "build" / "tandem"
        if not program.exists():
            print("tandem: there is no build/tandem (make build), so the package takes the program on the PATH", file=sys.stderr)
    for name, source in library.package_files(built / "libtandem.so", program, portable).items():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target / name)
        (target / name).chmod(0o755 if name.startswith("bin/") else 0o644)


def add_three(target):
    """The files of three.js, with its licence."""
    carrier = importlib.util.find_spec(THREE_CARRIER)
    if carrier is None:
        raise SystemExit(f"tandem: the package that ships three.js is missing: pip install {THREE_CARRIER}==0.1.4")
    target.mkdir(parents=True, exist_ok=True)
    for name, checksum in THREE_SHA256.items():
        content = (Path(carrier.origin).parent / "static" / "vendor" / name).read_bytes().replace(*THREE_IMPORT)
        if hashlib.sha256(content).hexdigest() != checksum:
            raise SystemExit(f"tandem: {name} of three {THREE} has another checksum than the one in python/setup.py")
        (target / name.replace("LICENSE.three.txt", "LICENSE")).write_bytes(content)
    (target / "VERSION").write_text(THREE + "\n")


class BuildPython(build_py):
    """The modules, and what else is in the package."""

    def run(self):
        super().run()
        package = Path(self.build_lib) / "tandem"
        for folder in ("lib", "viewer/three", "program"):
            shutil.rmtree(package / folder, ignore_errors=True)
        if not (ROOT / "tools" / "library.py").exists():
            raise SystemExit("tandem: the package is built in a checkout: pip install ./python, or make python")
        add_files(package / "program")
        add_three(package / "viewer" / "three")
        shutil.copyfile(ROOT / "LICENSE", package / "LICENSE")


class Wheel(bdist_wheel):
    """For any Python 3 on this kind of machine."""

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class Binary(Distribution):
    def has_ext_modules(self):
        return True


setup(version=version(), distclass=Binary, cmdclass={"build_py": BuildPython, "bdist_wheel": Wheel})
