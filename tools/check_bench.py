#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks that the benchmarks compile, without a warning: they are a separate project, and building them requires SUNDIALS.

Usage: tools/check_bench.py FOLDER FLAGS

Below FOLDER lie the module files of tandem and tandem-io; FLAGS selects the warnings. Prints "ok FILE" or
"not ok FILE" for each source below bench/, and the messages of the compiler; tools/verify.py counts them.
"""

import graphlib
import subprocess
import sys
import tempfile
from pathlib import Path

import library


def main(folder, flags):
    bench = library.ROOT / "bench"
    modules = next(Path(folder).rglob("tandem_io.mod"), None)
    if modules is None:
        print(f"check_bench: there is no module file of tandem-io below {folder}", file=sys.stderr)
        return 2
    flags = [*flags.split(), f"-I{modules.parent}", f"-I{bench / 'include'}"]
    sources = sorted([*bench.glob("src/**/*.f90"), *bench.glob("app/*.f90")])
    failures = 0
    with tempfile.TemporaryDirectory() as own:
        for source in graphlib.TopologicalSorter(library.dependencies(sources)).static_order():
            name = source.relative_to(library.ROOT)
            run = subprocess.run(
                [library.FC, "-fsyntax-only", *flags, "-J", own, str(name)],
                cwd=library.ROOT,
                capture_output=True,
                text=True,
            )
            fails = run.returncode != 0 or run.stderr != ""
            failures += fails
            print(f"not ok {name}\n{run.stderr}" if fails else f"ok {name}")
    return 1 if failures else 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print(__doc__.strip(), file=sys.stderr)
        sys.exit(2)
    sys.exit(main(*sys.argv[1:]))
