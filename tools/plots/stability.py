# SPDX-License-Identifier: MIT
"""The verdicts on stiff and extreme cases as a matrix: one row per case, one column per stepper with its control."""

import numpy as np
from matplotlib.patches import Patch, Rectangle
from tandem.study import read_study

from .style import STEPPERS, plt, save

# A colour and a letter per verdict, light enough for black letters, dark enough to be distinct in grey.
VERDICTS = {"held": ("#9BD8C4", "h"), "degraded": ("#F6D27A", "d"), "refused": ("#D9D9D9", "r"), "failed": ("#B5B5B5", "f"),
            "wrong": ("#E2622F", "W")}
MEANINGS = {"held": "held: the error, a part of s + |y|, is within what is allowed",
            "degraded": "degraded: it is not, and a warning says so",
            "refused": "refused at the start", "failed": "failed, with a status", "wrong": "wrong: it is not, and nobody is warned"}
# Long names of statuses, as a cell shows them.
SHORT = {"position_diverged": "diverged", "work_limit": "work limit", "singular_mass": "singular M", "newton_failed": "Newton",
         "rank_deficient": "rank", "not_finite": "not finite", "chart_left": "chart left", "step_underflow": "underflow",
         "constraints_not_held": "constraints", "step_limit": "step limit"}
GROUPS = {"stiff": "stiff", "disk": "disk", "vehicle": "vehicle", "masses": "mass ratios", "units": "km and µm", "steps": "step size",
          "parallel": "nearly parallel\nconstraints", "kinks": "kinks, jumps\nof the steering", "million": "a million\nsteps"}


def columns_of(study):
    """(control, stepper) of every column, fixed steps first."""
    there = set(zip(study.columns["control"], study.columns["stepper"], strict=True))
    return [(control, stepper) for control in ("step", "rtol") for stepper in STEPPERS if (control, stepper) in there]


def content(study, row):
    """Content of a cell: the letter of the verdict, and the error or the status."""
    verdict, status = study.columns["verdict"][row], study.columns["status"][row]
    letter = VERDICTS[verdict][1]
    if status != "complete":
        return f"{letter} {SHORT.get(status, status)}"
    error = study.columns["error"][row]
    if error == 0 or error < 1e-20:
        return f"{letter} 0"
    mantissa, exponent = f"{error:.0e}".split("e")
    return f"{letter} {mantissa}e{int(exponent)}"


def draw(paths, picture):
    study = read_study(paths[0])
    cases = list(dict.fromkeys(study.columns["case"]))
    group_of = dict(zip(study.columns["case"], study.columns["group"], strict=True))
    columns = columns_of(study)
    rows = {(case, control, stepper): i for i, (case, control, stepper) in enumerate(
        zip(study.columns["case"], study.columns["control"], study.columns["stepper"], strict=True))}
    # A gap between groups, and between fixed steps and error control.
    top, y = {}, 0.0
    for i, case in enumerate(cases):
        if i and group_of[case] != group_of[cases[i - 1]]:
            y += 0.5
        top[case] = y
        y += 1.0
    left = {column: i + (0.15 if column[0] == "rtol" else 0.0) for i, column in enumerate(columns)}
    figure, axes = plt.subplots(figsize=(2.8 + 0.6 * len(columns), 1.6 + 0.185 * y), layout="constrained")
    for case in cases:
        for column in columns:
            row = rows.get((case, *column))
            if row is None:
                continue
            axes.add_patch(Rectangle((left[column], top[case]), 1, 1, facecolor=VERDICTS[study.columns["verdict"][row]][0],
                                     edgecolor="white", linewidth=0.8))
            axes.text(left[column] + 0.5, top[case] + 0.5, content(study, row), ha="center", va="center", fontsize=7)
    for control, name in ("step", "fixed steps"), ("rtol", "error control, rtol 1e-6"):
        at = [left[column] for column in columns if column[0] == control]
        if at:
            axes.text((min(at) + max(at) + 1) / 2, -1.9, name, ha="center", va="center", fontweight="bold")
    for group in dict.fromkeys(group_of.values()):
        at = [top[case] for case in cases if group_of[case] == group]
        axes.text(max(left.values()) + 1.12, (min(at) + max(at) + 1) / 2, GROUPS.get(group, group), ha="left", va="center")
    for column in columns:
        axes.text(left[column] + 0.5, -0.6, column[1], ha="center", va="center")
    axes.set(xlim=(0, max(left.values()) + 1), ylim=(y, -2.4), xticks=[])
    axes.set_yticks([top[case] + 0.5 for case in cases], cases, fontsize=8)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    counts = {verdict: int(np.sum(study.columns["verdict"] == verdict)) for verdict in VERDICTS}
    handles = [Patch(facecolor=VERDICTS[verdict][0], label=f"{VERDICTS[verdict][1]}  {MEANINGS[verdict]} ({counts[verdict]})")
               for verdict in VERDICTS]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, columnspacing=1.3)
    save(figure, picture)


def draw_steps(paths, picture):
    """Steps under error control against the frequency ratio of the spring of a slow pendulum: complete cases slow_X."""
    c = read_study(paths[0]).columns
    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    for stepper, (colour, marker) in STEPPERS.items():
        there = [(float(case.removeprefix("slow_")), steps) for case, of, control, status, steps in zip(
            c["case"], c["stepper"], c["control"], c["status"], c["steps"], strict=True)
            if case.startswith("slow_") and of == stepper and control == "rtol" and status == "complete"]
        if there:
            axes.loglog(*zip(*sorted(there), strict=True), color=colour, marker=marker, label=stepper)
    axes.set(xlabel="frequency of the spring over that of the pendulum", ylabel="steps to t = 2 s, rtol 1e-6")
    axes.legend()
    save(figure, picture)
