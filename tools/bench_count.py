#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Counts instructions of short runs, which do not depend on other load of the machine, and their memory allocations, and
compares with bench/counts.txt.

Usage: tools/bench_count.py PROGRAM            compare; exit code 1 if a step needs over 3 % more than before
       tools/bench_count.py PROGRAM record     write bench/counts.txt

PROGRAM is the program `count` of bench/, without AVX-512, which valgrind does not know. `make bench-count` builds it and calls this.
Instructions are those of `integrate` as a whole; allocations are the calls of malloc, calloc and realloc in it.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "bench" / "counts.txt"
COUNTED = "__tandem_simulation_MOD_integrate"
TOLERANCE = 0.03


def allocations(text):
    """Calls of the allocating functions in a file of callgrind with instructions, from the number of executions of the first
        instruction of each. The file's own counts of calls include those before `integrate`."""
    costs_of, function, is_call = {}, "", False
    for line in text.splitlines():
        if line.startswith("fn="):
            function = line[len("fn="):]
        elif line.startswith("calls="):
            is_call = True
        elif line.startswith("0x") and function in ("malloc", "calloc", "realloc"):
            address, _, cost = line.split()
            if not is_call:
                costs_of.setdefault(function, {})[int(address, 16)] = int(cost)
            is_call = False
        else:
            is_call = False
    return sum(costs[min(costs)] for costs in costs_of.values())


def count(program):
    """{(scene, stepper, control): (steps, instructions, allocations)}, both within `integrate`."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(["valgrind", "--tool=callgrind", f"--toggle-collect={COUNTED}", f"--dump-after={COUNTED}",
                               "--dump-instr=yes", "--compress-strings=no", "--compress-pos=no",
                               f"--callgrind-out-file={folder}/out", program],
                              cwd=ROOT, check=True, capture_output=True, text=True)
        counts = {}
        for i, line in enumerate(done.stdout.splitlines(), 1):
            *key, steps = line.split()
            text = Path(folder, f"out.{i}").read_text()
            counts[tuple(key)] = int(steps), int(re.search(r"^totals: (\d+)", text, re.M)[1]), allocations(text)
    return counts


def tools():
    """Versions on which the counts depend besides the project."""
    compiler = subprocess.run(["gfortran", "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
    version = subprocess.run(["valgrind", "--version"], capture_output=True, text=True, check=True).stdout.strip()
    libraries = subprocess.run(["dpkg-query", "-W", "-f", "${Package} ${Version}, ", "libopenblas0", "libc6"],
                               capture_output=True, text=True).stdout.strip(" ,")
    return f"{compiler}; {version}; {libraries}; -O3 -funroll-loops -fno-loop-unroll-and-jam -fno-semantic-interposition -march=x86-64-v3"


def record(counts):
    lines = ["# Short runs, counted by callgrind; `make bench-count` compares. See tools/bench_count.py.",
             f"# of: {tools()}", "# scene stepper control steps instructions_a_step allocations"]
    lines += [f"{' '.join(key)} {steps} {total / steps:.0f} {heap}" for key, (steps, total, heap) in counts.items()]
    FILE.write_text("\n".join(lines) + "\n")


def compare(counts):
    before = {}
    for line in FILE.read_text().splitlines():
        if not line.startswith("#"):
            *key, steps, cost, heap = line.split()
            before[tuple(key)] = int(steps), float(cost), int(heap)
        elif line.startswith("# of:") and line != f"# of: {tools()}":
            print(f"the base line is of{line[5:]}\nthis is of          {tools()}")
    slower = 0
    for key, (steps, total, heap) in counts.items():
        old_steps, old_cost, old_heap = before.get(key, (steps, total / steps, heap))
        change = total / steps / old_cost - 1
        slower += change > TOLERANCE
        remarks = [] if abs(change) <= TOLERANCE else ["more" if change > 0 else "less"]
        remarks += [f"steps were {old_steps}"] * (steps != old_steps) + [f"allocations were {old_heap}"] * (heap != old_heap)
        print(f"{key[0]:20} {key[1]:10} {key[2]:10} {steps:5} steps, {total / steps:9.0f} instructions a step, {100 * change:+6.1f} %,"
              f" {heap} allocations" + "".join(f"; {remark}" for remark in remarks))
    print(f"{slower} of {len(counts)} runs need more than they did")
    return slower > 0


def main(program, what="compare"):
    counts = count(str(Path(program).resolve()))
    return record(counts) if what == "record" else compare(counts)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3) or sys.argv[2:] not in ([], ["record"]):
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
