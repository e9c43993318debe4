#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Several hinges on one body compared with a composite joint: processor time of the integration.

Usage: bench/hinge_pairs.py [--rounds N] [--keys KEY=VALUE...] [LINKS...]

Two chains in space with the same motion: links connected by universal joints, and by two hinges each with a body without mass in between;
once with nothing on the hinges, once with springs and dampers. LINKS is 3, 10, 30 and 100 by default; KEYS are settings of the run. Runs
alternate on one core; the time is the median of the report's processor time, that of the pairs over that of the universal joints.
The program is build/tandem, or what TANDEM names; requires h5py.
"""

import argparse
import os
import statistics
import subprocess
import tempfile
from pathlib import Path

import h5py

ROOT = Path(__file__).resolve().parent.parent
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
KEYS = ("solver.rtol=1e-6", "output.rows=0", "time.end=1")
CHARTS = ("dense", "sparse", "automatic")
#: Larger chains on dense charts take minutes.
LARGEST_DENSE = 30


def scene(links, pairs, springs):
    """A chain along x; its joints rotate about y of the previous link, then about z of the next one."""
    lines = ['[scene]\nmodel = "mechanism"\n[gravity]\nvector = [0, 3, -9.81]\n[time]\nend = 1.0']
    for i in range(links):
        before = f"link{i - 1}" if i else "ground"
        lines.append(f"[body.link{i}]\nmass = 1.0\ninertia = [0.02, 0.09, 0.1]\nposition = [{i + 0.5}, 0, 0]")
        if pairs:
            lines.append(f"[body.between{i}]\nmass = 0\ninertia = [0, 0, 0]\nposition = [{i}, 0, 0]")
            for k, (one, two, axis) in enumerate(((before, f"between{i}", "[0, 1, 0]"), (f"between{i}", f"link{i}", "[0, 0, 1]")), 1):
                lines.append(f'[joint.hinge{k}_{i}]\ntype = "revolute"\nbodies = ["{one}", "{two}"]\nat = [{i}, 0, 0]\naxis = {axis}')
        else:
            lines.append(f'[joint.cross{i}]\ntype = "universal"\nbodies = ["{before}", "link{i}"]\nat = [{i}, 0, 0]\n'
                         "axis = [0, 1, 0]\nacross = [0, 0, 1]")
        for k in (1, 2) if springs else ():
            joint = f"hinge{k}_{i}" if pairs else f"cross{i}.angle{k}"
            lines.append(f'[force.spring{k}_{i}]\ntype = "torsion"\njoint = "{joint}"\nstiffness = 3.0\ndamping = 0.1')
    return "\n".join(lines) + "\n"


def run(path, keys, chart):
    """Processor time of the integration (s), steps, and evaluations."""
    target = path.with_suffix(".h5")
    words = [word for key in (*KEYS, *keys, f"solver.chart_kind={chart}") for word in ("--set", key)]
    found = subprocess.run([TANDEM, "run", str(path), "--no-error", "--force", "--output", str(target), *words], env=ENVIRONMENT,
                           capture_output=True, text=True)
    if found.returncode != 0:
        raise SystemExit(found.stdout + found.stderr)
    with h5py.File(target) as file:
        report = file["report"].attrs
        return float(report["cpu_seconds"]), int(report["steps"]), int(report["right_hand_sides"])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--keys", nargs="*", default=())
    parser.add_argument("--charts", nargs="*", default=CHARTS)
    parser.add_argument("links", nargs="*", type=int)
    given = parser.parse_args()
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[-1]})
    print("| links | springs | chart | universal [ms], steps, evaluations | hinges [ms], steps, evaluations | ratio |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for links in given.links or (3, 10, 30, 100):
            for springs in (False, True):
                paths = [Path(folder) / f"{name}.toml" for name in ("universal", "hinges")]
                for path, pairs in zip(paths, (False, True), strict=True):
                    path.write_text(scene(links, pairs, springs), encoding="utf-8")
                for chart in given.charts:
                    if chart == "dense" and links > LARGEST_DENSE:
                        continue
                    found = [[run(path, given.keys, chart) for path in paths] for _ in range(given.rounds)]
                    times = [statistics.median(each[k][0] for each in found) for k in (0, 1)]
                    cells = [f"{1e3*times[k]:.2f}, {found[0][k][1]}, {found[0][k][2]}" for k in (0, 1)]
                    print(f"| {links} | {'yes' if springs else 'no'} | {chart} | {cells[0]} | {cells[1]} | {times[1]/times[0]:.2f} |",
                          flush=True)


if __name__ == "__main__":
    main()
