# SPDX-License-Identifier: MIT
"""Error against run time of tandem and of other solvers, measured by `make bench`; the tables of doc/performance.md."""

from pathlib import Path

import h5py
import numpy as np
from matplotlib.lines import Line2D
from tandem.plot.studies import ERROR
from tandem.study import read_study

from .style import GREY, RED, STEPPERS, plt, save
from .tables import brief, head, row

# Colour, marker and line of the solvers that are not tandem's.
OTHERS = {"index-1 LU": (RED, "x", "-"), "index-1 sweeps": (RED, "+", "--"), "index-1 LAPACK": (GREY, "x", "-"),
          "IDA": ("black", "*", "-"), "RADAU5": ("black", "P", "--"), "minimal coordinates": (GREY, "", ":")}
EXPONENTS = (4, 6, 8, 10)


def style_of(solver):
    if solver in OTHERS:
        return OTHERS[solver]
    stepper, _, at_ends = solver.removeprefix("tandem ").partition(", ")
    return *STEPPERS[stepper], "--" if at_ends else "-"


def draw(paths, picture):
    """One panel per problem."""
    c = read_study(paths[0]).columns
    scenes = list(dict.fromkeys(c["scene"]))
    columns = 2
    figure, grid = plt.subplots(-(-len(scenes) // columns), columns, figsize=(10, 3.6 * -(-len(scenes) // columns)),
                                layout="constrained", squeeze=False)
    solvers = list(dict.fromkeys(c["solver"]))
    for axes, scene in zip(grid.flat, scenes, strict=False):
        for solver in solvers:
            rows = (c["scene"] == scene) & (c["solver"] == solver) & (c["error_q"] > 0)
            colour, marker, line = style_of(solver)
            axes.loglog(c["cpu_seconds"][rows], c["error_q"][rows], line, color=colour, marker=marker, markersize=4, linewidth=1)
        axes.set_title(scene.replace("_", " "))
        axes.set_ylim(1e-13, 10)
    for axes in grid[-1]:
        axes.set_xlabel("run time [s]")
    for axes in grid[:, 0]:
        axes.set_ylabel(f"{ERROR}\nat t = 10 s")
    spare = list(grid.flat[len(scenes):])
    for axes in spare:
        axes.set_visible(False)
    entries = [Line2D([], [], color=style_of(solver)[0], marker=style_of(solver)[1], linestyle=style_of(solver)[2], label=solver)
               for solver in solvers]
    figure.legend(handles=entries, loc="outside lower center", ncols=5)
    save(figure, picture)


def draw_chain(paths, picture):
    """The time of a step against the number of rods."""
    c = read_study(paths[0]).columns
    figure, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    for stepper in dict.fromkeys(c["stepper"]):
        rows = c["stepper"] == stepper
        colour, marker = STEPPERS[stepper]
        axes.loglog(c["rods"][rows], 1e6 * c["step_seconds"][rows], color=colour, marker=marker, markersize=4.5, label=stepper)
    last = c["stepper"] == "rk4"
    n, t = c["rods"][last][-3:], 1e6 * c["step_seconds"][last][-1]
    axes.loglog(n, 0.4 * t * (n / n[-1]) ** 3, ":", color=GREY, label="slope 3")
    axes.set_xticks(c["rods"][last], c["rods"][last])
    axes.set(xlabel="rods", ylabel="time of a step [us]", title="a chain of N rods")
    axes.legend()
    save(figure, picture)


def number(value, factor=1.0, digits=2):
    """A few digits without an exponent, a dash for missing values."""
    if not np.isfinite(value):
        return "-"
    value *= factor
    decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value))))) if value else 0
    return f"{value:.{decimals}f}"


class Tables:
    """The tables, from the files in a folder."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.summary = read_study(self.folder / "summary.h5").columns
        self.runs = read_study(self.folder / "runs.h5").columns
        self.rods = read_study(self.folder / "chain.h5").columns

    def times(self, scene):
        """Milliseconds to errors, and their ratios."""
        c = self.summary
        lines = head("solver", *(f"1e-{k}" for k in EXPONENTS), *(f"ratio at 1e-{k}" for k in EXPONENTS))
        for k in np.flatnonzero(c["scene"] == scene):
            lines.append(row(str(c["solver"][k]), *(number(c[f"seconds_{e}"][k], 1e3) for e in EXPONENTS),
                             *(number(c[f"ratio_{e}"][k]) for e in EXPONENTS)))
        return lines

    def evaluations(self):
        """Microseconds per step and per evaluation."""
        c = self.summary
        lines = head("scene", "solver", "a step [us]", "an evaluation [us]", "ratio", "ratio to the better index-1 solver")
        for k in range(len(c["scene"])):
            if "minimal" in c["solver"][k] and not np.isfinite(c["evaluation_ratio"][k]):
                continue
            lines.append(row(str(c["scene"][k]), str(c["solver"][k]), number(c["step_seconds"][k], 1e6, 3),
                             number(c["evaluation_seconds"][k], 1e6, 3), number(c["evaluation_ratio"][k]),
                             number(c["best_ratio"][k])))
        return lines

    def tolerances(self):
        """Times of dop853 over those of the index-1 solver with the same tolerance, and both errors."""
        c = self.runs
        lines = head("scene", "rtol", "time ratio", "error of tandem", "error of index-1")
        for k in np.flatnonzero((c["solver"] == "tandem dop853") & np.isfinite(c["ratio"])):
            exponent = -np.log10(c["value"][k])
            if abs(exponent - round(exponent)) > 1e-6 or round(exponent) not in EXPONENTS:
                continue
            same = (c["scene"] == c["scene"][k]) & (c["solver"] == "index-1 LU") & (c["value"] == c["value"][k])
            lines.append(row(str(c["scene"][k]), f"1e-{round(exponent)}", number(c["ratio"][k]), brief(c["error_q"][k]),
                             brief(c["error_q"][same][0])))
        return lines

    def projection(self):
        """dop853 projected at the ends of steps over dop853 projected at stages, and both errors."""
        c = self.runs
        lines = head("scene", "rtol", "time ratio", "evaluations", "of stages", "error", "of stages")
        for k in np.flatnonzero(c["solver"] == "tandem dop853, step ends"):
            exponent = -np.log10(c["value"][k])
            if abs(exponent - round(exponent)) > 1e-6 or round(exponent) not in range(4, 11):
                continue
            same = np.flatnonzero((c["scene"] == c["scene"][k]) & (c["solver"] == "tandem dop853") & (c["value"] == c["value"][k]))[0]
            lines.append(row(str(c["scene"][k]), f"1e-{round(exponent)}", number(c["cpu_seconds"][k] / c["cpu_seconds"][same]),
                             str(c["evaluations"][k]), str(c["evaluations"][same]), brief(c["error_q"][k]),
                             brief(c["error_q"][same])))
        return lines

    def chain(self):
        """Microseconds per step against the number of rods, and their growth."""
        c = self.rods
        steppers = list(dict.fromkeys(c["stepper"]))
        lines = head("rods", "coordinates", "constraints", *(f"{stepper} [us]" for stepper in steppers),
                     *(f"slope {stepper}" for stepper in steppers))
        for n in dict.fromkeys(c["rods"]):
            rows = [np.flatnonzero((c["rods"] == n) & (c["stepper"] == stepper))[0] for stepper in steppers]
            lines.append(row(str(n), str(c["coordinates"][rows[0]]), str(c["constraints"][rows[0]]),
                             *(number(c["step_seconds"][k], 1e6, 3) for k in rows), *(number(c["slope"][k]) for k in rows)))
        return lines

    def agreement(self):
        """Distances between the references."""
        c = self.runs
        lines = head("scene", "two solutions differ by")
        for scene in dict.fromkeys(c["scene"]):
            value = c["agreement"][c["scene"] == scene][0]
            if value > 0:
                lines.append(row(scene, brief(value)))
        return lines

    def profile(self, name):
        """Time of a run, part by part."""
        lines = head("part", "", "calls", "time [ms]", "share [%]", "a call [ns]")
        with h5py.File(self.folder / f"profile_{name}.h5") as file:
            table = file["report/profile"]
            total = table.attrs["seconds"]
            texts = {key: [text.decode() for text in table[key][:]] for key in ("group", "part")}
            calls, seconds = table["calls"][:], table["seconds"][:]
        order = [group for group in ("model", "chart", "Newton", "stepper and control", "output", "start", "watching")
                 if group in texts["group"]]
        for group in order:
            members = [k for k in range(len(calls)) if texts["group"][k] == group]
            alone = len(members) == 1 and texts["part"][members[0]] == group
            for rows, part in [(members, "")] + [([k], texts["part"][k]) for k in members if not alone]:
                n, time = calls[rows].sum(), seconds[rows].sum()
                lines.append(row(group if not part else "", part, str(n) if n else "", f"{1e3 * time:.2f}", f"{100 * time / total:.1f}",
                                 f"{1e9 * time / n:.0f}" if n else ""))
        lines.append(row("all", "", "", f"{1e3 * total:.2f}", "100.0", ""))
        return lines

    def clocks(self):
        """Cost of the clocks of profiles, and time of the output."""
        lines = head("run", "output over the rest [%]", "readings", "two readings, taken off [ns]", "in a loop [ns]")
        for path in sorted(self.folder.glob("profile_*.h5")):
            with h5py.File(path) as file:
                a = file["report/profile"].attrs
                lines.append(row(path.stem.removeprefix("profile_"), number(100 * a["output_seconds"] / a["bare_seconds"]),
                                 str(2 * a["clock_pairs"]), f"{1e9 * a['clock_pair_seconds']:.0f}",
                                 f"{1e9 * a['clock_pair_seconds_in_loop']:.0f}"))
        return lines

    def mechanisms(self):
        """Output of bench/mechanisms.py."""
        return (self.folder / "mechanisms.md").read_text().splitlines()
