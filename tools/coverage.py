#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Measures the coverage of src/ by the tests, and lists the lines that are not run.

Usage: tools/coverage.py [--report]        `make coverage` calls it without the option

Builds the Fortran tests without optimization and with gfortran's counters, and the library too for the tests of the interfaces of C
and Fortran 77 (test/linking), runs both, and adds up what gcov counts, so a line counts that any of them has run. The table goes
to standard output and to build/coverage/coverage.txt, with the lines that were not run and their text. `--report` makes the table
of the last measurement anew.

The exit code is 1 if a test fails, or if less than 90 % of all lines were run.
"""

import argparse
import collections
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "build" / "coverage"
FLAGS = "-O0 -g --coverage"
LIBRARY = ROOT / "build" / "library-coverage"
LEAST = 90.0


def objects():
    """Folders with counters of the sources in src/: fpm's own, and the library's."""
    found = {path.parent for path in (ROOT / "build").glob("gfortran_*/tandem/src_*.gcno")}
    return [*sorted(found), LIBRARY]


def forget():
    """Remove the counts of an earlier run."""
    for folder in objects():
        for file in folder.glob("*.gcda"):
            file.unlink()


def run(*command, **options):
    """Run a command; its output goes to a log, and is shown if it fails."""
    log = OUT / "log.txt"
    with open(log, "ab") as file:
        code = subprocess.run(command, cwd=ROOT, stdout=file, stderr=file, stdin=subprocess.DEVNULL, **options).returncode
    if code:
        tail = log.read_text(errors="replace").splitlines()[-15:]
        sys.exit("\n".join([f"coverage: {' '.join(command)} ended with {code}; the end of {log}:", *tail]))


def measure():
    """Build and run the tests with counters."""
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    forget()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    run(str(ROOT / ".venv/bin/fpm"), "test", "tandem-test", "--flag", FLAGS)
    prefix = OUT / "installed"
    run("tools/library.py", "install", "--prefix", str(prefix), "--build", str(LIBRARY), "--flags", FLAGS, "--parts", "library")
    linking = OUT / "linking"
    shutil.copytree(ROOT / "test/linking", linking)
    run("make", "-C", str(linking), f"PREFIX={prefix}", "interface_c", "interface_f77", "mechanism_f77", "threads")
    for program in ("interface_c", "interface_f77", "mechanism_f77", "threads"):
        run(str(linking / program))


def counts():
    """Number of runs of each line: {source: {line: times}}."""
    total = collections.defaultdict(lambda: collections.defaultdict(int))
    for folder in objects():
        for notes in sorted(folder.glob("*.gcno")):
            done = subprocess.run(
                ["gcov", "--json-format", "--stdout", notes.name], cwd=folder, capture_output=True, text=True, check=True
            )
            for report in done.stdout.splitlines():
                for file in json.loads(report)["files"]:
                    name = os.path.normpath(file["file"])
                    if not name.startswith("src/"):
                        continue
                    for line in file["lines"]:
                        total[name][line["line_number"]] += line["count"]
    # The line that ends a module stands for procedures of the compiler's own, which copy its types.
    for name, lines in total.items():
        text = (ROOT / name).read_text().splitlines()
        for number in [number for number in lines if re.match(r"end (sub)?module\b", text[number - 1])]:
            del lines[number]
    return total


def spans(numbers):
    """Abbreviated numbers of lines: 3-5, 9."""
    text = []
    for number in numbers:
        if text and number == text[-1][1] + 1:
            text[-1][1] = number
        else:
            text.append([number, number])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in text)


def report():
    """The table; the share of all lines in percent."""
    total = counts()
    if not total:
        sys.exit("coverage: there are no counts; run it without --report")
    table, details = [f"{'file':50}{'lines':>7}{'run':>7}{'%':>8}   not run"], []
    everything = reached = 0
    for name, lines in sorted(total.items()):
        if not lines:
            continue
        text = (ROOT / name).read_text().splitlines()
        missed = sorted(number for number, times in lines.items() if times == 0)
        everything += len(lines)
        reached += len(lines) - len(missed)
        share = 100 * (len(lines) - len(missed)) / len(lines)
        table.append(f"{name:50}{len(lines):7}{len(lines) - len(missed):7}{share:8.1f}   {spans(missed)}".rstrip())
        details += [f"{name}:{number}: {text[number - 1].strip()}" for number in missed]
    share = 100 * reached / everything
    table.append(f"{'all':50}{everything:7}{reached:7}{share:8.1f}")
    (OUT / "coverage.txt").write_text("\n".join([*table, "", *details]) + "\n")
    print("\n".join(table))
    return share


def main():
    parser = argparse.ArgumentParser(description="Which lines of src/ the tests run.")
    parser.add_argument("--report", action="store_true", help="only the table of the last measurement")
    if not parser.parse_args().report:
        measure()
    share = report()
    if share < LEAST:
        sys.exit(f"coverage: {share:.1f} % of the lines were run, less than {LEAST:g} %")


if __name__ == "__main__":
    main()
