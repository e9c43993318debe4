#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Mechanisms compared with Exudyn, MuJoCo and Pinocchio: true error at the end against processor time of the integration.

Usage: bench/mechanisms.py [--repeats N] [--figure PATH] [--table PATH] [--from FILE] [NAME...]      names of scenes; all without

Installs exudyn, mujoco, pin, scipy, h5py, matplotlib from PyPI into build/others. tandem runs in build/bench/motion, or what MOTION names
(`tools/bench.sh mechanisms` builds it): start and steps, without a result file, as the others run. Exudyn integrates the same
bodies, joints and forces with its generalised-alpha methods, index 2 and 3; the pendulum also in minimal coordinates as a kinematic tree
with its explicit DOPRI5. MuJoCo has minimal coordinates, loops by equalities (mechanism_loops.py), and its RK4; Pinocchio gives accelerations, with
loops at that level, to SciPy's DOP853, of the governor to LSODA and Radau. Prints every point, what a solver cannot do, and for errors of 1e-3, 1e-6, 1e-9 the times, interpolated. Times are the best
of the repeats. With --from nothing is measured: FILE has the points that were printed.
"""

import argparse
import itertools
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOTION = os.environ.get("MOTION", str(ROOT / "build" / "bench" / "motion"))
PLACE = Path(os.environ.get("OTHERS", ROOT / "build" / "others"))
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
TARGETS = (1e-3, 1e-6, 1e-9)
STEPPERS = ("dopri5", "dop853", "radau5")
#: A new chart at every step, as usual, and a chart that is kept while it is valid.
CHARTS = {"": "every_step", " adaptive": "adaptive"}
#: Tolerances.
LOGARITHMS = range(2, 13)
#: A method that takes longer than this is not run with smaller errors (s); each next setting of Exudyn takes four times as long.
LONGEST = 1.0


def enter():
    """Restart in an environment with the other packages."""
    python = PLACE / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PLACE)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", "exudyn", "mujoco", "pin", "scipy", "h5py", "matplotlib"], check=True)
    if Path(sys.prefix).resolve() != PLACE.resolve():
        os.execve(str(python), [str(python), __file__, *sys.argv[1:]], ENVIRONMENT)


class State:
    """Coordinates of tandem by name, with their rates: {"body.x": (q, qd)}."""

    def __init__(self, values, start=None):
        self.values, self.start = values, start

    def parameters(self, body, k):
        return [self.values[f"{body}.e{i}"][k] for i in range(4)]

    def rotation(self, body):
        import numpy as np

        if f"{body}.angle" in self.values:
            angle = self.values[f"{body}.angle"][0]
            return np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
        if f"{body}.e0" not in self.values:
            return np.eye(3)
        e0, e1, e2, e3 = self.parameters(body, 0)
        return np.array([[e0*e0 + e1*e1 - e2*e2 - e3*e3, 2*(e1*e2 - e0*e3), 2*(e1*e3 + e0*e2)],
                         [2*(e1*e2 + e0*e3), e0*e0 - e1*e1 + e2*e2 - e3*e3, 2*(e2*e3 - e0*e1)],
                         [2*(e1*e3 - e0*e2), 2*(e2*e3 + e0*e1), e0*e0 - e1*e1 - e2*e2 + e3*e3]])

    def point(self, body, place=(0, 0, 0)):
        return [self.values.get(f"{body}.{c}", (0, 0))[0] for c in "xyz"] + self.rotation(body) @ place

    def spin(self, body):
        import numpy as np

        e0, e1, e2, e3 = self.parameters(body, 0)
        return 2*np.array([[-e1, e0, e3, -e2], [-e2, -e3, e0, e1], [-e3, e2, -e1, e0]]) @ self.parameters(body, 1)

    def turned(self, body):
        return self.values[f"{body}.angle"][0] - self.start[f"{body}.angle"][0]


def integrate(scene, *settings):
    """Processor time and the values at the end; infinite and none if the run ended with an error."""
    done = subprocess.run([MOTION, scene, *settings], env=ENVIRONMENT, capture_output=True, text=True, cwd=ROOT, check=False)
    if done.returncode:
        return math.inf, {}
    first, *lines = done.stdout.splitlines()
    values = {name: (float(q), float(qd)) for name, q, qd in (line.split() for line in lines)}
    return float(first.split()[0]), values


class Problem:
    """A case with its scene and the start of tandem."""

    def __init__(self, name, folder):
        from mechanism_cases import CASES, free_crank, parameters, scene_of

        self.name, self.case = name, CASES[name]
        self.scene = free_crank(folder) if name == "slider_crank" else name
        _, self.start = integrate(self.scene, *self.case.settings, "time.end=1e-12")
        if not self.start:
            raise SystemExit(f"mechanisms.py: {MOTION} cannot run {name}; build it by tools/bench.sh mechanisms")
        self.doubt = 0.0
        if callable(self.case.reference):
            self.case.reference = self.case.reference(self.case.end, parameters(scene_of(name))["speed"])
        elif self.case.reference is None:
            self.case.reference = self.measure(self.tandem("dop853", 1e-13)[1])
            self.doubt = self.error(self.tandem("radau5", 1e-12)[1])

    def tandem(self, stepper, tolerance, chart="every_step"):
        projection = () if stepper == "radau5" else ('solver.projection="step_ends"',)
        return integrate(self.scene, *self.case.settings, *projection, f"time.end={self.case.end}", f'solver.stepper="{stepper}"',
                         f"solver.rtol={tolerance}", f"solver.atol={tolerance}", f'solver.chart="{chart}"')

    def measure(self, values):
        return [float(x) for x in self.case.measure(State(values, self.start))]

    def error(self, values):
        if not values:
            return math.nan
        return max(abs(x - y) for x, y in zip(self.measure(values), self.case.reference))

    def points(self, repeats):
        """{solver: [(error, time)]}, printed one by one, and the reasons of missing ones."""
        import mechanism_exudyn as exudyn
        import mechanism_others as others

        found, missing = {}, missing_of(self.name)
        for stepper, (label, chart) in itertools.product(STEPPERS, CHARTS.items()):
            def run(k, stepper=stepper, chart=chart):
                taken, values = min((self.tandem(stepper, 10.0**-k, chart) for _ in range(repeats)), key=lambda done: done[0])
                return self.error(values), taken
            self.try_all(found, f"tandem {stepper}{label}", ((f"rtol 1e-{k}", lambda k=k, run=run: run(k)) for k in LOGARITHMS))
        if "Exudyn" not in missing:
            for method in (3, 2):
                self.try_all(found, f"Exudyn index {method}", ((f"{n} steps", lambda n=n, method=method: exudyn.run(
                    self.name, method, n, self.start, repeats)) for n in (100*4**k for k in range(9))))
        if self.name == "a01_pendulum":
            self.try_all(found, "Exudyn tree", ((f"rtol 1e-{k}", lambda k=k: exudyn.run(
                self.name, "tree", 10.0**-k, self.start, repeats)) for k in LOGARITHMS))
        if "MuJoCo" not in missing:
            first = 6000 if self.name == "a05_governor" else 50
            self.try_all(found, "MuJoCo", ((f"{n} steps", lambda n=n: others.run_mujoco(self.name, n, repeats))
                                           for n in (first*2**k for k in range(14))))
        if "Pinocchio" not in missing:
            methods = others.METHODS.get(self.name, ("DOP853",))
            for method in methods:
                self.try_all(found, " ".join(["Pinocchio", method][:len(methods)]), ((f"rtol 1e-{k}", lambda k=k, method=method: others.run_pinocchio(
                    self.name, 10.0**-k, repeats, method)) for k in LOGARITHMS))
        return found, missing

    def try_all(self, found, label, settings):
        """Runs with decreasing errors until they take too long."""
        found[label] = []
        for setting, run in settings:
            error, taken = run()
            print(f"{self.name:22s} {label:16s} {setting:14s} {error:8.1e} {taken:9.5f}", flush=True)
            if math.isfinite(taken) and math.isfinite(error):
                found[label].append((max(error, 1e-16), taken))
            if math.isfinite(taken) and taken > LONGEST:
                break


def missing_of(name):
    """{solver: reason for having no points}."""
    import mechanism_exudyn as exudyn
    import mechanism_others as others

    reasons = {"Exudyn": exudyn.CANNOT, "MuJoCo": others.MUJOCO_CANNOT, "Pinocchio": others.PINOCCHIO_CANNOT}
    return {other: those[name] for other, those in reasons.items() if name in those}


def read_points(path):
    """{mechanism: {solver: [(error, time)]}} as they were printed."""
    results = {}
    for line in Path(path).read_text().splitlines():
        parts = re.fullmatch(r"(\w+) +((?:tandem|Exudyn|MuJoCo|Pinocchio)[\w ]*?) +(?:rtol \S+|\d+ steps) +(\S+) +(\S+)", line)
        if parts:
            error, taken = float(parts[3]), float(parts[4])
            points = results.setdefault(parts[1], {}).setdefault(parts[2], [])
            if math.isfinite(error) and math.isfinite(taken):
                points.append((max(error, 1e-16), taken))
    return results


def time_at(points, target):
    """Shortest time with an error of at most the target, log-linear between neighbours; infinite if there is none."""
    best = min((taken for error, taken in points if error <= target), default=math.inf)
    for (e1, t1), (e2, t2) in zip(points, points[1:]):
        if e1 > target >= e2 > 0 and t1 < t2:
            share = math.log(e1/target)/math.log(e1/e2)
            best = min(best, t1*(t2/t1)**share)
    return best


def best_of(found, start, target):
    """Time and solver."""
    return min(((time_at(points, target), label) for label, points in found.items() if label.startswith(start)), default=(math.inf, ""))


def plain(value):
    """Three digits without an exponent."""
    return f"{value:.{max(0, 2 - math.floor(math.log10(value)))}f}"


def table_of(results):
    """The summary as Markdown, times in ms."""
    lines = ["| mechanism | error | tandem [ms] | Exudyn [ms] | Exudyn / tandem | MuJoCo [ms] | Pinocchio [ms] |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for name, (found, missing, _) in results.items():
        for target in TARGETS:
            ours, how = best_of(found, "tandem", target)
            cells = [name if target == TARGETS[0] else "", f"{target:.0e}".replace("e-0", "e-"),
                     f"{plain(1e3*ours)} ({how.removeprefix('tandem ')})" if math.isfinite(ours) else "not reached"]
            for other in ("Exudyn", "MuJoCo", "Pinocchio"):
                theirs, their_way = best_of(found, other, target)
                if other in missing:
                    cells += ["-"] + ["-"]*(other == "Exudyn")
                elif not math.isfinite(theirs):
                    cells += ["not reached"] + [""]*(other == "Exudyn")
                else:
                    cells.append(plain(1e3*theirs) + (" (tree)" if their_way.endswith("tree") else ""))
                    if other == "Exudyn":
                        cells.append(f"{theirs/ours:.1f}" if theirs < 10*ours else f"{theirs/ours:.0f}")
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def draw(results, path):
    """One panel per mechanism."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as pyplot

    colours = {"tandem dopri5": "#6baed6", "tandem dop853": "#08519c", "tandem radau5": "#41ab5d", "Exudyn index 3": "#e6550d",
               "Exudyn index 2": "#fdae6b", "Exudyn tree": "#a50f15", "MuJoCo": "#756bb1", "Pinocchio": "#636363", "Pinocchio LSODA": "#636363",
               "Pinocchio Radau": "#bdbdbd"}
    rows = math.ceil(len(results)/3)
    figure, panels = pyplot.subplots(rows, 3, figsize=(10, 2.6*rows + 0.6), squeeze=False, layout="constrained")
    for panel in panels.flat[len(results):]:
        panel.axis("off")
    shown = {}
    for panel, (name, (found, _, _)) in zip(panels.flat, results.items()):
        for label, points in found.items():
            if points:
                errors, times = zip(*points)
                faint = label.endswith(" adaptive")
                shown[label], = panel.loglog(errors, times, "--" if faint else "o-", ms=3, lw=1.0 if faint else 1.2,
                                             color=colours[label.removesuffix(" adaptive")])
        panel.set_xlim(3e-1, 1e-12)
        panel.set_title(name, fontsize=9)
        panel.tick_params(labelsize=7)
        panel.grid(alpha=0.3)
    for panel in panels[:, 0]:
        panel.set_ylabel("CPU time [s]", fontsize=8)
    for panel in panels[-1]:
        panel.set_xlabel("true error at the end", fontsize=8)
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(path, dpi=110)


def main(words):
    from mechanism_cases import CASES

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--figure")
    parser.add_argument("--table")
    parser.add_argument("--from", dest="points")
    given = parser.parse_args(words)
    results = {name: (found, missing_of(name), 0.0) for name, found in read_points(given.points).items()} if given.points else {}
    with tempfile.TemporaryDirectory() as folder:
        for name in () if given.points else given.names or CASES:
            problem = Problem(name, folder)
            results[name] = (*problem.points(given.repeats), problem.doubt)
    table = table_of(results)
    print("\n" + table)
    for name, (_, missing, doubt) in results.items():
        for other, reason in missing.items():
            print(f"{name}: {other}: {reason}")
        if doubt:
            print(f"{name}: the reference is a run of dop853 at 1e-13, {doubt:.1e} from one of radau5 at 1e-12")
    if given.table:
        Path(given.table).write_text(table)
    if given.figure:
        draw(results, given.figure)
    return 0


if __name__ == "__main__":
    enter()
    sys.exit(main(sys.argv[1:]))
