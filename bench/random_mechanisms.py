#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Random mechanisms: the automatic choice of the chart compared with both charts.

Usage: bench/random_mechanisms.py [--count N] [--seed S] [--steppers A,B] [--rtols A,B] [--rounds R] [--write] [--from FILE]

Writes N (300) scenes from the seed S (1) into build/bench/random: bodies in the plane and in space with 6 to 100 coordinates, hinges,
sliders, spherical, universal and other joints, distances, loops, redundant rows, springs, torsions, bushings, loads, friction and
driven motions. Everything is defined in one configuration, so that loops are closed there; velocities are assembled. Scene k depends
on S and k alone. With --write nothing is run.

Each scene is run by build/bench/motion, or what MOTION names (`tools/bench.sh mechanisms` builds it), with each stepper and rtol on the
dense chart, on the sparse one, and with the automatic choice. A time is the least of at least three repeats in each of R (2) rounds.
Prints a line per run: scene, coordinates, stepper, rtol, milliseconds and steps dense and sparse, milliseconds and chart of the
automatic choice; then its time over that of the better chart. Where a run is not possible on a chart the fields are -. With --from
nothing is run: FILE has the lines that were printed.
"""

import argparse
import math
import os
import random
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOTION = os.environ.get("MOTION", str(ROOT / "build" / "bench" / "motion"))
PLACE = ROOT / "build" / "bench" / "random"
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
STEPPERS = ("dop853", "dopri5", "radau5", "sdirk54", "auto")
RTOLS = ("1e-4", "1e-6", "1e-9")
FEWEST, MOST = 6, 100
#: A run that takes longer is given up (s).
LONGEST = 60.0
#: Rows of a joint, in the plane and in space, and how often it is chosen in a tree.
JOINTS = {True: {"revolute": (2, 8), "prismatic": (2, 3), "point_on_line": (1, 2), "fixed": (3, 1)},
          False: {"revolute": (5, 6), "prismatic": (5, 2), "cylindrical": (4, 1), "spherical": (3, 4), "universal": (4, 3),
                  "planar": (3, 1), "point_on_line": (2, 1), "point_on_plane": (1, 1), "screw": (5, 1), "fixed": (6, 1)}}
#: Those that close loops.
CLOSING = {True: {"revolute": (2, 2), "point_on_line": (1, 2), "distance": (1, 2)},
           False: {"spherical": (3, 2), "point_on_line": (2, 1), "point_on_plane": (1, 2), "distance": (1, 3), "universal": (4, 1)}}
#: Joints that a motion drives, and those with a coordinate for torsions and friction.
DRIVEN = ("revolute", "prismatic")


class Scene:
    """One random mechanism; `text` is its file, `n` the number of its coordinates."""

    def __init__(self, seed, k):
        self.random = random.Random(f"{seed}/{k}")
        self.is_planar = self.random.random() < 0.4
        self.dimension = 2 if self.is_planar else 3
        self.width = 3 if self.is_planar else 7
        wanted = math.exp(self.random.uniform(math.log(FEWEST), math.log(MOST)))
        self.count = max(math.ceil(FEWEST / self.width), min(MOST // self.width, round(wanted / self.width)))
        self.n = self.count*self.width
        self.free = self.count*(3 if self.is_planar else 6)
        self.places, self.joints, self.names = [], [], 0
        self.lines = ["[scene]", 'model = "mechanism"'] + ["planar = true"]*self.is_planar
        self.add("gravity", vector=[0.0]*(self.dimension - 1) + [-9.81])
        self.spread = self.random.choice((0.0, 0.15, 0.5))
        for i in range(self.count):
            self.add_body(i)
        for i in range(self.count):
            self.hang(i)
        self.close_loops()
        self.repeat_rows()
        self.add_forces()
        self.add("initial", assemble=True)
        self.add("time", end=self.number(0.2, 0.6))
        self.text = "\n".join(self.lines) + "\n"

    def number(self, low, high):
        return float(f"{self.random.uniform(low, high):.4g}")

    def ratio(self, low, high):
        """A number whose logarithm is uniform."""
        return float(f"{math.exp(self.random.uniform(math.log(low), math.log(high))):.4g}")

    def vector(self, size=1.0):
        return [self.number(-size, size) for _ in range(self.dimension)]

    def direction(self):
        if self.random.random() < 0.4:
            axis = [0.0]*self.dimension
            axis[self.random.randrange(self.dimension)] = self.random.choice((-1.0, 1.0))
            return axis
        while True:
            axis = [self.random.gauss(0, 1) for _ in range(self.dimension)]
            length = math.hypot(*axis)
            if length > 0.1:
                return [x / length for x in axis]

    def across(self, axis):
        """A direction at right angles to one in space."""
        while True:
            other = self.direction()
            part = sum(a*b for a, b in zip(axis, other))
            other = [b - part*a for a, b in zip(axis, other)]
            length = math.hypot(*other)
            if length > 0.3:
                return [x / length for x in other]

    def pick(self, choices):
        return self.random.choices(list(choices), [weight for _, weight in choices.values()])[0]

    def add(self, name, **keys):
        def show(value):
            if isinstance(value, bool):
                return str(value).lower()
            if isinstance(value, str):
                return f'"{value}"'
            return f"[{', '.join(show(x) for x in value)}]" if isinstance(value, list) else repr(value)

        self.lines += ["", f"[{name}]"] + [f"{key} = {show(value)}" for key, value in keys.items()]

    def name(self, letter):
        self.names += 1
        return f"{letter}{self.names}"

    def add_body(self, i):
        mass = self.ratio(0.2, 5.0)
        place = self.vector()
        if i > 0 and self.random.random() < 0.5:
            place = [float(f"{a + self.number(-0.6, 0.6):.4g}") for a in self.places[-1]]
        self.places.append(place)
        keys = {"mass": mass, "position": place, "velocity": self.vector(1.0)}
        if self.is_planar:
            keys |= {"inertia": float(f"{mass*self.ratio(0.003, 0.1):.4g}"), "angle": self.number(-2, 2), "omega": self.number(-3, 3)}
        else:
            box = [self.number(0.1, 1.0) for _ in range(3)]
            squares = sum(x*x for x in box)
            keys |= {"inertia": [float(f"{mass*(squares - x*x)/12:.6g}") for x in box], "omega": self.vector(3.0)}
            if self.random.random() < 0.7:
                keys["rotation"] = self.vector(1.5)
        self.add(f"body.b{i}", **keys)

    def between(self, i, j):
        """A point near the line between the centres of two bodies; -1 is the ground."""
        first, second = (self.places[k] if k >= 0 else self.vector(0.3) for k in (i, j))
        part = self.random.random()
        return [float(f"{a + part*(b - a) + self.number(-0.3, 0.3):.4g}") for a, b in zip(first, second)]

    def connect(self, kind, i, j, at=None, axis=None, drives=False):
        """A joint or a distance between two bodies, with its rows taken from the degrees of freedom."""
        bodies = [f"b{k}" if k >= 0 else "ground" for k in (i, j)]
        if kind == "distance":
            self.add(f"constraint.{self.name('d')}", type=kind, between=bodies)
            self.free -= 1
            return
        at = at or self.between(i, j)
        axis = axis or self.direction()
        keys = {"type": kind, "bodies": bodies, "at": at}
        name = self.name("j")
        if kind not in ("spherical", "fixed") and not (self.is_planar and kind == "revolute"):
            keys["axis"] = axis
        if kind == "universal":
            keys["across"] = self.across(axis)
        if kind == "screw":
            keys["pitch"] = self.ratio(0.01, 0.1)
        if drives:
            keys["motion"] = f"{self.number(0.1, 0.5)}*sin({self.number(1, 6)}*t)"
        self.add(f"joint.{name}", **keys)
        self.free -= (JOINTS[self.is_planar] | CLOSING[self.is_planar])[kind][0] + drives
        self.joints.append((name, kind, i, j, at, axis, drives))

    def hang(self, i):
        """The joint of body i in the tree; some bodies move freely."""
        draw = self.random.random()
        if draw < 0.05:
            return
        parent = -1 if i == 0 or draw < 0.2 else i - 1 if self.random.random() > self.spread else self.random.randrange(i)
        kind = self.pick(JOINTS[self.is_planar])
        self.connect(kind, i, parent, drives=kind in DRIVEN and self.random.random() < 0.1)

    def close_loops(self):
        for _ in range(round(self.count*self.random.choice((0.0, 0.0, 0.2, 0.5, 0.8)))):
            i = self.random.randrange(self.count)
            j = self.random.choice((-1, max(i - 2, -1), max(i - 3, -1), self.random.randrange(-1, self.count)))
            kind = self.pick(CLOSING[self.is_planar])
            if j != i and self.free - CLOSING[self.is_planar][kind][0] >= 1:
                self.connect(kind, i, j)

    def repeat_rows(self):
        """Redundant rows: a second hinge on the axis of another, a second slider along it, a second distance on the plane."""
        if self.random.random() > 0.2:
            return
        usable = [joint for joint in self.joints if joint[1] in ("revolute", "prismatic", "cylindrical", "point_on_plane")]
        for name, kind, i, j, at, axis, drives in self.random.sample(usable, min(len(usable), self.random.choice((1, 1, 2, 4)))):
            if self.is_planar and kind == "revolute":
                axis = [0.0, 0.0]
            free = self.free
            self.connect(kind, i, j, [float(f"{a + 0.2*b:.12g}") for a, b in zip(at, axis)], axis)
            self.free = free

    def add_forces(self):
        for _ in range(round(self.count*self.random.choice((0.0, 0.3, 0.6, 1.0)))):
            i, j = self.random.randrange(self.count), self.random.randrange(-1, self.count)
            kind = self.random.choices(("spring", "bushing", "torsion", "load", "friction"), (4, 2, 2, 3, 0.3))[0]
            stiffness, damping = self.ratio(10.0, 1000.0), self.ratio(0.05, 5.0)
            turning = [joint for joint in self.joints if joint[1] in DRIVEN and not joint[-1]]
            points = [f"b{k}:[{', '.join(str(x) for x in self.vector(0.4))}]" if k >= 0 else "ground" for k in (i, j)]
            if kind == "load":
                keys = {"on": points[0], "force": self.vector(5.0), "factor": f"sin({self.number(1, 10)}*t)"}
            elif kind == "spring" and i != j:
                keys = {"between": points, "stiffness": stiffness, "damping": damping}
            elif kind == "bushing" and i != j:
                size = 3 if self.is_planar else 6
                keys = {"between": [f"b{i}", "ground" if j < 0 else f"b{j}"], "at": self.between(i, j),
                        "axis": [1.0] + [0.0]*(self.dimension - 1), "stiffness": [self.number(10, 200) for _ in range(size)],
                        "damping": [self.number(0.1, 3) for _ in range(size)]}
                if not self.is_planar:
                    keys["across"] = [0.0, 1.0, 0.0]
            elif kind == "torsion" and turning:
                keys = {"joint": self.random.choice(turning)[0], "stiffness": self.ratio(1.0, 100.0), "damping": self.ratio(0.01, 1.0)}
            elif kind == "friction" and turning:
                keys = {"joint": self.random.choice(turning)[0], "dynamic": 0.3, "static": 0.4, "speed": 0.1, "viscous": 0.0,
                        "normal": self.number(1, 5)}
            else:
                continue
            self.add(f"force.{self.name('f')}", type=kind, **keys)


def run(scene, *settings):
    """(seconds, steps, chart) of the least of the repeats; None if it fails."""
    try:
        done = subprocess.run([MOTION, str(scene), *settings], capture_output=True, text=True, timeout=LONGEST, env=ENVIRONMENT,
                              check=False)
    except subprocess.TimeoutExpired:
        return None
    if done.returncode:
        return None
    seconds, steps, chart = done.stdout.splitlines()[0].split()
    return float(seconds), int(steps), chart


def measure(name, n, stepper, rtol, rounds):
    """One line of figures of the scene."""
    plain = (f"solver.stepper={stepper}", f"solver.rtol={rtol}")
    best = {}
    for _ in range(rounds):
        for kind in ("dense", "sparse", "auto"):
            found = run(PLACE / f"{name}.toml", *plain, *([] if kind == "auto" else [f"solver.chart_kind={kind}"]))
            if found is None:
                continue
            best[kind] = min(best.get(kind, found), found)
    if "auto" not in best:
        return None
    fields = [name, n, stepper, rtol]
    for kind in ("dense", "sparse"):
        fields += [f"{1e3*best[kind][0]:.4f}", best[kind][1]] if kind in best else ["-", "-"]
    return " ".join(str(x) for x in fields + [f"{1e3*best['auto'][0]:.4f}", best["auto"][2]])


def summarise(lines):
    """Time of the chosen chart, and of the automatic run, over that of the better chart."""
    rows = [line.split() for line in lines]
    scenes = {row[0] for row in rows}
    both = [row for row in rows if "-" not in row]
    print(f"{len(scenes)} mechanisms, {len(rows)} runs, {len(rows) - len(both)} of them on one chart alone")

    def show(what, selected):
        ratios = [float(row[4 if row[9] == "dense" else 6])/min(float(row[4]), float(row[6])) for row in selected]
        whole = [float(row[8])/min(float(row[4]), float(row[6])) for row in selected]
        if not ratios:
            return
        shares = [statistics.median(float(row[6])/float(row[4]) for row in selected), sum(row[9] == "sparse" for row in selected)]
        print(f"{what:14s} {len(ratios):5d} runs, sparse over dense {shares[0]:.2f}, sparse chosen {shares[1]:5d}; chosen over better: "
              f"within 1.1 {100*sum(r <= 1.1 for r in ratios)/len(ratios):.1f} %, within 1.2 "
              f"{100*sum(r <= 1.2 for r in ratios)/len(ratios):.1f} %, above 1.3 {sum(r > 1.3 for r in ratios)}, worst {max(ratios):.2f}; "
              f"with its own time: within 1.1 {100*sum(r <= 1.1 for r in whole)/len(whole):.1f} %, worst {max(whole):.2f}")

    show("all", both)
    for stepper in STEPPERS:
        show(stepper, [row for row in both if row[2] == stepper])
    for rtol in RTOLS:
        show(f"rtol {rtol}", [row for row in both if row[3] == rtol])
    for low, high in ((6, 7), (8, 13), (14, 19), (20, 26), (27, 39), (40, 59), (60, 100)):
        show(f"{low} to {high}", [row for row in both if low <= int(row[1]) <= high])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steppers", default=",".join(STEPPERS))
    parser.add_argument("--rtols", default=",".join(RTOLS))
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--from", dest="source")
    options = parser.parse_args()
    if options.source:
        summarise([line for line in Path(options.source).read_text().splitlines() if len(line.split()) == 10])
        return
    if not options.write and not Path(MOTION).exists():
        sys.exit(f"{MOTION} is missing: tools/bench.sh mechanisms")
    PLACE.mkdir(parents=True, exist_ok=True)
    lines, found, k = [], 0, 0
    while found < options.count:
        k += 1
        scene = Scene(options.seed, k)
        name = f"{options.seed}_{k:04d}"
        (PLACE / f"{name}.toml").write_text(scene.text)
        if options.write:
            found += 1
            continue
        # A mechanism that is locked, or whose motion is not determined, is left out.
        if run(PLACE / f"{name}.toml", "solver.stepper=dop853", "solver.rtol=1e-4", "solver.chart_kind=dense") is None:
            continue
        found += 1
        for stepper in options.steppers.split(","):
            for rtol in options.rtols.split(","):
                line = measure(name, scene.n, stepper, rtol, options.rounds)
                if line is not None:
                    print(line, flush=True)
                    lines.append(line)
    if not options.write:
        summarise(lines)


if __name__ == "__main__":
    main()
