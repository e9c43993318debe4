#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Compares the end states of short runs of every shipped scene with those on record, test/frozen/results.txt.

Usage: test/frozen/frozen.py [NAME...]           compare; exit code 1 if a result is off
       test/frozen/frozen.py --report [NAME...]  also list every run, the largest deviation first
       test/frozen/frozen.py --record            write results.txt; state in the commit why results have changed

NAME selects the runs whose name contains it, such as rolling_disk, radau5 or rolling_disk/radau5/fixed/dense. The environment
variable TANDEM names the program, otherwise build/tandem.

A run is a scene with a stepper, fixed steps or error control, and a chart. Its record has the status, the number of steps, the
scales max|q| and max|qd|, and one weighted sum each of q/max|q| and qd/max|qd| at the end.

Numbers of fixed steps must agree, others within a tenth or 2. Rounding differs between processors and compiler options, and the
motion amplifies it: between -O0 and -O2 -march=native, and between OpenBLAS kernels with and without AVX-512, sums of fixed steps
differed by up to 4e-11 (a spatial slider-crank with implicit steps; most by less than 1e-13), those of controlled steps by up to
6e-8.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
FILE = Path(__file__).with_name("results.txt")
PROGRAM = Path(os.environ.get("TANDEM", ROOT / "build" / "tandem")).resolve()

# Length of the run and size of its fixed steps, in seconds. Steps are small enough for explicit methods to be stable.
SCENES = {
    "a01_pendulum": (1.0, 0.02),
    "a02_four_bars": (0.2, 0.005),
    "a03_andrews": (0.004, 0.0001),
    "a04_bricard": (0.5, 0.01),
    "a05_governor": (0.04, 0.0002),
    "articulated_vehicle": (1.0, 0.02),
    "bicycle": (0.5, 0.01),
    "centric_slider_crank": (0.1, 0.002),
    "chaplygin_sphere": (1.0, 0.02),
    "mechanism_chopper": (0.5, 0.01),
    "mechanism_disk": (2.0, 0.04),
    "mechanism_motorcycle": (0.5, 0.01),
    "mechanism_vehicle": (1.0, 0.02),
    "motorcycle": (0.5, 0.01),
    "motorcycle_chopper": (0.5, 0.01),
    "parallelogram": (0.1, 0.002),
    "rattleback": (0.2, 0.004),
    "rolling_disk": (2.0, 0.04),
    "slider_crank": (0.5, 0.01),
    "spatial_slider_crank": (0.5, 0.01),
    "trailers": (1.0, 0.02),
    "turntable": (1.0, 0.02),
}
# Fixed steps of auto are those of rk4.
METHODS = {
    "fixed": ("rk4", "dopri5", "dop853", "trapezoid", "sdirk54", "radau5"),
    "adaptive": ("dopri5", "dop853", "trapezoid", "sdirk54", "radau5", "radau", "auto"),
}
# Charts of all scenes, and other policies of dense charts, for some scenes only.
CHARTS = {"dense": ["chart_kind=dense"], "sparse": ["chart_kind=sparse"]}
POLICIES = {
    "moving": ["chart_kind=dense", "chart=adaptive"],
    "paper": ["chart_kind=dense", "chart=paper"],
    "refined": ["chart_kind=dense", "refresh=refine"],
    "svd": ["chart_kind=dense", "basis=svd"],
    "stages": ["chart_kind=dense", "projection=stages"],
}
WITH_POLICIES = ("articulated_vehicle", "mechanism_disk", "rolling_disk")
RTOL = 1e-7
# Largest deviation: of fixed steps, and of controlled ones, of which a single one more moves the result by the error of the run.
BOUNDS = {"fixed": 1e-9, "adaptive": 10*RTOL}


def cases():
    """The names of all runs that may be recorded."""
    charts = [(scene, chart) for scene in SCENES for chart in [*CHARTS, *(POLICIES if scene in WITH_POLICIES else ())]]
    return [f"{scene}/{stepper}/{control}/{chart}" for scene, chart in charts
            for control, steppers in METHODS.items() for stepper in steppers]


def weighted(values):
    """The scale of a state, and the sum of its scaled values with weights in [-1, 1] that differ from entry to entry."""
    scale = max(map(abs, values))
    return scale, sum(math.cos(1 + i)*value for i, value in enumerate(values))/(scale or 1)


def run(name, folder):
    """The record of a run as a list of words: status, steps, scales and sums; the status alone of a run that is refused."""
    scene, stepper, control, chart = name.split("/")
    end, step = SCENES[scene]
    settings = [f"time.end={end}", f"solver.stepper={stepper}", *(f"solver.{setting}" for setting in (CHARTS | POLICIES)[chart]),
                *([f"solver.step={step}", "solver.rtol=0", "solver.atol=0"] if control == "fixed" else
                  ["solver.step=0", f"solver.rtol={RTOL}", f"solver.atol={RTOL}"]),
                "output.every=1000000", f"output.file={folder}/{name.replace('/', '-')}.h5"]
    done = subprocess.run([PROGRAM, "run", ROOT / "scenes" / f"{scene}.toml", "--json", "--quiet", "--no-error", "--force",
                           *(word for setting in settings for word in ("--set", setting))],
                          capture_output=True, text=True, check=False, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    if not done.stdout:
        return [done.stderr.removeprefix("tandem: ").split(":")[0] or f"exit_{done.returncode}"]
    told = json.loads(done.stdout)
    (q_scale, q_sum), (qd_scale, qd_sum) = weighted(told["q"]), weighted(told["qd"])
    return [told["status"], str(told["figures"]["steps"]), f"{q_scale:.16e}", f"{q_sum:.16e}", f"{qd_scale:.16e}", f"{qd_sum:.16e}"]


def deviation(now, before):
    """The largest deviation of the scales, relative, and of the sums."""
    q_scale, q_sum, qd_scale, qd_sum = (float(word) for word in now[2:])
    q_before, q_sum_before, qd_before, qd_sum_before = (float(word) for word in before[2:])
    return max(abs(q_scale - q_before)/(q_before or 1), abs(q_sum - q_sum_before),
               abs(qd_scale - qd_before)/(qd_before or 1), abs(qd_sum - qd_sum_before))


def judge(name, now, before):
    """The deviation of a run and a sentence about what is off, empty if nothing is."""
    if now[0] != before[0] or len(now) != len(before):
        return math.inf, f"status {now[0]}, on record {before[0]}"
    off = deviation(now, before)
    control = name.split("/")[2]
    steps, steps_before = int(now[1]), int(before[1])
    if abs(steps - steps_before) > (0 if control == "fixed" else max(2, 0.1*steps_before)):
        return off, f"{steps} steps, on record {steps_before}"
    return off, f"deviation {off:.1e}, bound {BOUNDS[control]:.1e}" if not off <= BOUNDS[control] else ""


def run_all(names):
    """The records of several runs by name, on all processors."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(names, pool.map(lambda name: run(name, folder), names), strict=True))


def write():
    """Record all runs but the combinations that are refused."""
    lines = [f"# scene/stepper/control/chart status steps max|q| sum(q) max|qd| sum(qd), rtol = {RTOL}; see frozen.py"]
    lines += [" ".join([name, *words]) for name, words in run_all(cases()).items() if len(words) > 1]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(lines) - 1} runs are on record")


def compare(parts, report):
    """Compare runs with their records: a line for each, and whether any is off."""
    table = [line.split() for line in FILE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    record = {name: words for name, *words in table if not parts or any(part in name for part in parts)}
    results = run_all(list(record))
    judged = {name: judge(name, results[name], record[name]) for name in record}
    if report:
        for name in sorted(judged, key=lambda name: -judged[name][0]):
            print(f'{judged[name][0]:8.1e}  {name:44} {record[name][1]:>5} -> {" ".join(results[name][1:2])} steps')
    for name, (_, off) in judged.items():
        print(f"not ok {name}: {off}" if off else f"ok {name}")
    missing = sorted({path.stem for path in (ROOT / "scenes").glob("*.toml")} - set(SCENES))
    print(f"not ok scenes without runs: {' '.join(missing)}" if missing else "ok every scene has runs")
    return any(off for _, off in judged.values()) or bool(missing)


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--report", action="store_true")
    chosen = parser.parse_args()
    if not PROGRAM.exists():
        sys.exit(f"frozen: there is no program {PROGRAM}; run make build, or name one by the variable TANDEM")
    if chosen.record:
        return write()
    return compare(chosen.names, chosen.report)


if __name__ == "__main__":
    sys.exit(main())
