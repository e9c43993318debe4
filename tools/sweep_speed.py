#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Speed of a sweep compared with a bare loop of the library, on one hardware thread and on two, and the limit of two threads.

Usage: tools/sweep_speed.py [--cases N] [--rounds N] [--threads A,B]

Runs the disks of bench/disks.toml: by `build/bench/disks` on thread A, by two copies of it at once, one on each thread, by
`build/optimised/tandem sweep --jobs 1` on thread A, and by `--jobs 2` on both. Two copies have only the machine in common, so the ratio
of their joint throughput to that of one is the limit of the machine, with which the speed-up of two jobs is compared. The four take
turns, so that other load of the machine disturbs all of them alike; ratios are formed within a round, and their median is
printed. A sweep is timed from the start of the program to the end, its table included; a bare loop times itself.
"""

import argparse
import os
import re
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TANDEM = Path(os.environ.get("TANDEM", ROOT / "build" / "optimised" / "tandem"))
LOOP = Path(os.environ.get("DISKS", ROOT / "build" / "bench" / "disks"))
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}


def sweep(folder, threads, jobs):
    """Time of a sweep."""
    begin = time.monotonic()
    subprocess.run(["taskset", "-c", threads, str(TANDEM), "sweep", "disks.toml", "--jobs", str(jobs), "--quiet", "--force"],
                   cwd=folder, env=ENVIRONMENT, check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - begin


def loops(folder, threads):
    """The time of the slowest of some copies, one on each thread, all of which find the heights of the table."""
    copies = [subprocess.Popen(["taskset", "-c", thread, str(LOOP), "disks.csv"], cwd=folder, env=ENVIRONMENT, text=True,
                               stdout=subprocess.PIPE) for thread in threads]
    told = [re.search(r"(\d+) disks in ([\d.]+) s, .* a second, (\d+) with", copy.communicate()[0]) for copy in copies]
    for found in told:
        if not found or found[1] != found[3]:
            raise SystemExit("sweep_speed: the bare loop does not find what the table has")
    return max(float(found[2]) for found in told)


def spread(name, ratios):
    ordered = sorted(ratios)
    print(f"{name}: {statistics.median(ordered):.3f} in the median of {len(ordered)} rounds, {ordered[0]:.3f} to {ordered[-1]:.3f}")


def main():
    parser = argparse.ArgumentParser(description="How fast a sweep is beside a bare loop of the library.")
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--threads", default="0,1", help="two hardware threads")
    options = parser.parse_args()
    one, other = options.threads.split(",")
    text = (ROOT / "bench" / "disks.toml").read_text()
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "disks.toml").write_text(re.sub(r"draws = \d+", f"draws = {options.cases}", text))
        sweep(folder, options.threads, 2)
        found = []
        for _ in range(options.rounds):
            found.append((loops(folder, [one]), loops(folder, [one, other]), sweep(folder, one, 1), sweep(folder, options.threads, 2)))
            print("a bare loop {:.2f} s, two at once {:.2f} s, one job {:.2f} s, two jobs {:.2f} s".format(*found[-1]), flush=True)
    spread("one job over a bare loop", [alone / job for alone, _, job, _ in found])
    spread("two bare loops over one, the machine's limit", [2 * alone / both for alone, both, _, _ in found])
    spread("two jobs over one", [job / jobs for _, _, job, jobs in found])
    spread("two jobs over two bare loops", [both / 2 / jobs for _, both, _, jobs in found])


if __name__ == "__main__":
    main()
