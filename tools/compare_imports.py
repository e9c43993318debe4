#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Imported robots of public packages: accelerations at random states beside MuJoCo and Pinocchio, and a run of 0.2 s.

Usage: tools/compare_imports.py [--states N] [--run] [TEXT...]      files whose paths contain a text; all without

Installs dm-control, gymnasium, gymnasium-robotics, mujoco, example-robot-data, pin and h5py from PyPI into build/robots (1 GB), and the
files of brax, metaworld, playground and robosuite without what these packages require; or takes the environment that ROBOTS names. The
program is build/tandem, or what TANDEM names. Files that are not robots are omitted: those without joints, and parts that other files
include. Prints a line for each file; exit code 1 if an acceleration differs by more than 1e-9 or, with --run, a run with `auto` and rtol
1e-6 fails.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLACE = Path(os.environ.get("ROBOTS", ROOT / "build" / "robots")).resolve()
PACKAGES = {"mjcf": ("dm_control", "gymnasium", "gymnasium_robotics", "mujoco", "brax", "metaworld", "mujoco_playground", "robosuite"),
            "urdf": ("cmeel.prefix/share/example-robot-data",)}
BOUND = 1e-9
SECONDS = 300


def enter():
    """Go on in an environment that has the packages."""
    python = PLACE / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PLACE)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", "dm-control", "gymnasium", "gymnasium-robotics", "mujoco", "example-robot-data",
                        "pin", "h5py"], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", "--no-deps", "brax", "metaworld", "playground", "robosuite"], check=True)
    if Path(sys.prefix).resolve() != PLACE:
        os.execv(str(python), [str(python), *sys.argv])


def files():
    site = next(PLACE.glob("lib/python*/site-packages"))
    for kind, packages in PACKAGES.items():
        for package in packages:
            for path in sorted((site / package).rglob("*.xml" if kind == "mjcf" else "*.urdf")):
                if kind == "urdf" or b"<worldbody" in path.read_bytes():
                    yield kind, path, path.relative_to(site)


def trial(path, states, runs):
    """A word on a file, and if it passes; None if it is not a robot."""
    from tandem import import_check, imports
    from tandem.errors import ProgramError

    floating = False
    try:
        try:
            text, lost = imports.convert(path, looks=False)
        except ValueError as error:
            if "use --floating" not in str(error):
                raise
            floating = True
            text, lost = imports.convert(path, looks=False, floating=True)
        parts = []
        good = True
        if states and not floating:
            largest = import_check.verify(path, states)["largest"]
            parts.append(f"{largest:.1e}")
            good = largest <= BOUND
        if runs:
            began = time.monotonic()
            done = run(text)
            good = good and done.returncode == 0
            parts.append(f"{time.monotonic() - began:.1f} s" if done.returncode == 0 else done.stderr.strip().splitlines()[0][:150])
        return " ".join([*parts, f"{len(lost)} kinds of losses"]), good
    except ValueError as error:
        said = str(error).splitlines()[0][:150]
        return said, None if "nothing moves" in said or "refuses it" in said else False
    except (ProgramError, subprocess.TimeoutExpired) as error:
        return str(error).splitlines()[0][:150], False


def run(text):
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "model.toml").write_text(text)
        return subprocess.run([os.environ["TANDEM_PROGRAM"], "run", "model.toml", "--set", "time.end=0.2", "--quiet", "--no-error"], cwd=folder,
                              capture_output=True, text=True, timeout=SECONDS, check=False)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("text", nargs="*")
    parser.add_argument("--states", type=int, default=20)
    parser.add_argument("--run", action="store_true")
    given = parser.parse_args()
    os.environ["TANDEM_PROGRAM"] = os.path.abspath(os.environ.get("TANDEM", ROOT / "build" / "tandem"))
    sys.path.insert(0, str(ROOT / "python" / "src"))
    counts = {True: 0, False: 0, None: 0}
    for kind, path, name in files():
        if given.text and not any(text in str(path) for text in given.text):
            continue
        said, good = trial(path, given.states, given.run)
        counts[good] += 1
        print(f"{ {True: 'ok  ', False: 'FAIL', None: '-   '}[good]} {str(name)[-70:]:70s} {said}", flush=True)
    print(f"{counts[True]} pass, {counts[False]} fail, {counts[None]} are not robots")
    return 1 if counts[False] else 0


if __name__ == "__main__":
    enter()
    sys.exit(main())
