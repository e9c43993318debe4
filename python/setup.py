# SPDX-License-Identifier: MIT
"""What pyproject.toml cannot say: the version is that of the checkout, and the package holds the shared library, three.js for the
pages of `tandem view`, and the program where `make build` has left it.

The library is compiled by gfortran for any machine of this kind, or for the machine at hand with ARCH=-march=native; its objects are
those of `make install` with the same flags. three.js comes
through npm's client, in the version and with the checksum that are pinned here.
"""

import base64
import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:
    from wheel.bdist_wheel import bdist_wheel

ROOT = Path(__file__).resolve().parent.parent
THREE = "0.180.0"
THREE_SHA512 = "o+qycAMZrh+TsE01GqWUxUIKR1AL0S8pq7zDkYOQw8GqfX8b8VoCKYUoHbhiX5j+7hr8XsuHDVU6+gkQJQKg9w=="
THREE_FILES = {"package/build/three.core.min.js": "three.core.min.js", "package/build/three.module.min.js": "three.module.min.js",
               "package/examples/jsm/controls/OrbitControls.js": "OrbitControls.js", "package/LICENSE": "LICENSE"}


def say(text):
    print(f"tandem: {text}", file=sys.stderr, flush=True)


def version():
    return re.search(r'^version = "([^"]+)"', (ROOT / "fpm.toml").read_text(), re.M)[1]


def build_library(target):
    """libtandem.so by tools/library.py of the checkout; TANDEM_LIBRARY names one that is built already."""
    target.mkdir(parents=True, exist_ok=True)
    if "TANDEM_LIBRARY" in os.environ:
        built = Path(os.environ["TANDEM_LIBRARY"])
    else:
        spec = importlib.util.spec_from_file_location("library", ROOT / "tools" / "library.py")
        library = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(library)
        say("building the library")
        flags = ["-O3", "-funroll-loops", *os.environ.get("ARCH", "").split()]
        built = library.build_libraries(ROOT / "build" / "library", flags) / "libtandem.so"
    shutil.copyfile(built, target / "libtandem.so")


def fetch_three(target):
    """The files of three.js, with its licence. Without npm there is a package that cannot make pages, and says so."""
    kept = ROOT / "build" / f"three-{THREE}.tgz"
    if not kept.exists():
        if shutil.which("npm") is None:
            say("there is no npm, so three.js is left out: `tandem view` will write no page (apt-get install npm)")
            return
        say(f"fetching three {THREE} (npm)")
        kept.parent.mkdir(exist_ok=True)
        done = subprocess.run(["npm", "pack", f"three@{THREE}", "--silent"], cwd=kept.parent, capture_output=True, text=True)
        if done.returncode or not kept.exists():
            say(f"npm could not fetch three.js, so it is left out: `tandem view` will write no page\n{done.stderr}")
            return
    if base64.b64encode(hashlib.sha512(kept.read_bytes()).digest()).decode() != THREE_SHA512:
        kept.unlink()
        raise SystemExit(f"tandem: three {THREE} has another checksum than the one in python/setup.py")
    target.mkdir(parents=True, exist_ok=True)
    with tarfile.open(kept) as archive:
        for name, to in THREE_FILES.items():
            (target / to).write_bytes(archive.extractfile(name).read())
    (target / "VERSION").write_text(THREE + "\n")


def add_program(target):
    """The program with its scenes and the licence of what it holds, where it was built."""
    program = ROOT / "build" / "tandem"
    licence = ROOT / "build" / "dependencies" / "toml-f" / "LICENSE-MIT"
    if not (program.exists() and licence.exists()):
        say("there is no build/tandem (make build), so the package takes the program on the PATH")
        return
    for source, to in [(program, "bin/tandem"), (licence, "share/tandem/licences/program-toml-f.txt"),
                       *((scene, f"share/tandem/scenes/{scene.name}") for scene in (ROOT / "scenes").glob("*.toml"))]:
        (target / to).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target / to)
    (target / "bin/tandem").chmod(0o755)


class BuildPython(build_py):
    """The modules, and what else is in the package."""

    def run(self):
        super().run()
        package = Path(self.build_lib) / "tandem"
        for folder in ("lib", "viewer/three", "program"):
            shutil.rmtree(package / folder, ignore_errors=True)
        if not (ROOT / "tools" / "library.py").exists():
            raise SystemExit("tandem: the package is built in a checkout: pip install ./python, or make python")
        build_library(package / "lib")
        fetch_three(package / "viewer" / "three")
        add_program(package / "program")
        shutil.copyfile(ROOT / "LICENSE", package / "LICENSE")


class Wheel(bdist_wheel):
    """For any Python 3 on this kind of machine."""

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class Binary(Distribution):
    def has_ext_modules(self):
        return True


setup(version=version(), distclass=Binary, cmdclass={"build_py": BuildPython, "bdist_wheel": Wheel})
