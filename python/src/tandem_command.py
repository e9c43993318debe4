# SPDX-License-Identifier: MIT
"""`tandem` on the command line where pip has installed the package: becomes the program. It stands beside the package, so that it
starts without NumPy, and also where another package has taken the name `tandem`."""

import os
import sys
from pathlib import Path

CLASH = ("two packages for Python go by the name tandem here: tandem-multibody, which simulates multibody systems, and another one, "
         "called tandem, which has overwritten files of it or may have;\n"
         "pip uninstall tandem, then pip install --force-reinstall --no-deps with the wheel, or make python in a checkout")


def other_package() -> bool:
    """The environment holds the package of another project that is imported by the same name."""
    from importlib import metadata

    return any(True for _ in metadata.distributions(name="tandem"))


def main() -> None:
    """Become the program; this Python then makes its plots and animations."""
    program = Path(__file__).parent / "tandem" / "program" / "bin" / "tandem"
    os.environ.setdefault("TANDEM_PYTHON", sys.executable)
    try:
        os.execv(program, [str(program), *sys.argv[1:]])
    except OSError as error:
        sys.exit(f"tandem: the package holds no program that runs here, {program}: {error.strerror}\n"
                 "a wheel holds one, and so does what `make python` installs in a checkout")


def draw() -> None:
    """Run the package with the words of the command line: called by the program for plot, view and import."""
    if other_package():
        print(f"tandem: {CLASH}", file=sys.stderr)
        sys.exit(2)
    import runpy

    runpy.run_module("tandem", run_name="__main__", alter_sys=True)
