# SPDX-License-Identifier: MIT
"""Tables of documents that come from studies: each stands between the lines <!-- table: NAME ARGUMENT --> and <!-- end -->."""

import re
from pathlib import Path

import numpy as np
from tandem.study import read_study

from .style import STEPPERS


def row(*cells):
    return "| " + " | ".join(cells) + " |"


def head(*cells):
    return [row(*cells), row(*("---" for _ in cells))]


def brief(value):
    """Two digits, as 1.3e-7."""
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def milliseconds(seconds):
    return f"{1e3 * seconds:.2g}" if seconds < 0.1 else f"{1e3 * seconds:.0f}"


class Tables:
    """The tables, from the files in a folder."""

    def __init__(self, folder):
        self.folder = Path(folder)

    def study(self, name, part="studies"):
        return read_study(self.folder / part / f"{name}.h5")

    def names(self):
        return sorted(path.stem for path in (self.folder / "studies").glob("precision_*.h5"))

    def fastest(self, scene):
        """The shortest run of each stepper at several errors; the shortest of all in bold."""
        study = self.study(f"precision_{scene}")
        lines = head("error at most", *STEPPERS)
        for exponent in range(-2, -13, -2):
            if 10.0**exponent < study.attributes["floor_q"]:
                break
            best = study.fastest(10.0**exponent)
            if best is None:
                break
            cells = []
            for stepper in STEPPERS:
                k = study.fastest(10.0**exponent, stepper)
                if k is None:
                    cells.append("-")
                    continue
                value = study.columns["value"][k]
                by_step = study.columns["control"][k] == "step"
                what = f"h = {1e3 * value:g} ms" if by_step else f"rtol 1e{round(np.log10(value))}"
                cell = f"{milliseconds(study.columns['cpu_seconds'][k])} ms"
                cells.append(f"**{cell}**, {what}" if k == best else f"{cell}, {what}")
            lines.append(row(f"1e{exponent}", *cells))
        return lines

    def references(self):
        """Accuracy of the references of the studies."""
        lines = head("scene", "its runs differ from it in q", "in qd", "errors quoted from")
        for name in self.names():
            study = self.study(name)
            a = study.attributes
            lines.append(row(study.settings["scene"]["name"], brief(a["agreement_q"]), brief(a["agreement_qd"]), brief(a["floor_q"])))
        return lines

    def check(self):
        """Errors against a study's own reference compared with those against the reference file."""
        lines = head("scene", "runs compared", "largest deviation of the error in q", "in qd")
        for scene in "rolling_disk", "articulated_vehicle":
            own, given = (self.study(f"precision_{scene}", part) for part in ("own", "file"))
            keys = [{key: i for i, key in enumerate(zip(*(study.columns[name].tolist() for name in ("stepper", "control", "value")),
                                                    strict=True))} for study in (own, given)]
            deviations = []
            for key, i in keys[0].items():
                if key in keys[1] and own.columns["status"][i] == "complete" and not own.columns["at_floor"][i]:
                    j = keys[1][key]
                    deviations.append([abs(own.columns[name][i] / given.columns[name][j] - 1) for name in ("error_q", "error_qd")])
            worst = 100 * np.max(deviations, axis=0)
            lines.append(row(scene, str(len(deviations)), *(f"{value:.1f} %" for value in worst)))
        return lines

    def orders(self):
        """Medians of the orders of fixed steps."""
        lines = head("scene", *STEPPERS)
        for name in self.names():
            study = self.study(name)
            cells = []
            for stepper in STEPPERS:
                orders = []
                for k in np.flatnonzero((study.columns["stepper"] == stepper) & (study.columns["control"] == "step")):
                    if study.columns["order"][k] < 1:
                        break  # rounding
                    # Unresolved motions show no order.
                    if study.attributes["floor_q"] < study.columns["error_q"][k] < 0.3:
                        orders.append(study.columns["order"][k])
                orders = [order for order in orders if np.isfinite(order)]
                cells.append(f"{np.median(orders):.1f}" if orders else "-")
            lines.append(row(study.settings["scene"]["name"], *cells))
        return lines

    def cost(self):
        """Time per step with fixed steps, and per right-hand side, medians over the finest rows."""
        lines = head("scene", *(f"`{name}`" for name in STEPPERS))
        for name in self.names():
            study = self.study(name)
            cells = []
            for stepper in STEPPERS:
                use = (study.columns["stepper"] == stepper) & (study.columns["control"] == "step")
                use &= study.columns["status"] == "complete"
                last = np.flatnonzero(use)[-3:]
                a_step = np.median(study.columns["cpu_seconds"][last] / study.columns["steps"][last])
                a_side = np.median(study.columns["cpu_seconds"][last] / study.columns["right_hand_sides"][last])
                cells.append(f"{1e6 * a_step:.1f}, {1e6 * a_side:.2f}")
            lines.append(row(study.settings["scene"]["name"], *cells))
        return lines

    def constraints(self):
        """Largest constraint errors over all runs of the studies, and of the energy where it is constant."""
        lines = head("scene", "runs", "failed", "position", "velocity", "acceleration")
        for name in self.names():
            c = self.study(name).columns
            lines.append(row(str(c["scene"][0]), str(len(c["scene"])), str(int((c["status"] != "complete").sum())),
                             *(brief(c[f"{level}_error"].max()) for level in ("position", "velocity", "acceleration"))))
        return lines

    def verdicts(self):
        """Number of verdicts of each kind per stepper."""
        c = self.study("stability").columns
        names = ("held", "degraded", "refused", "failed", "wrong")
        lines = head("steps", "stepper", "runs", *names)
        for control, words in ("step", "fixed"), ("rtol", "rtol 1e-6"):
            for stepper in STEPPERS:
                use = (c["control"] == control) & (c["stepper"] == stepper)
                if use.any():
                    lines.append(row(words, f"`{stepper}`", str(use.sum()), *(str((c["verdict"][use] == name).sum()) for name in names)))
        lines.append(row("all", "", str(len(c["case"])), *(str((c["verdict"] == name).sum()) for name in names)))
        return lines

    def stiffness(self):
        """Steps of the slow pendulum under error control against the frequency ratio of its spring; - where a run has no end."""
        c = self.study("stability").columns
        ratios = sorted({case for case in c["case"] if case.startswith("slow_")}, key=lambda case: float(case.removeprefix("slow_")))
        lines = head("stepper", *(case.removeprefix("slow_") for case in ratios))
        for stepper in STEPPERS:
            cells = []
            for case in ratios:
                use = np.flatnonzero((c["case"] == case) & (c["stepper"] == stepper) & (c["control"] == "rtol"))
                complete = len(use) and c["status"][use[0]] == "complete"
                cells.append(str(int(c["steps"][use[0]])) if complete else "-")
            if set(cells) != {"-"}:
                lines.append(row(f"`{stepper}`", *cells))
        return lines

    def endless(self):
        """Errors after a million steps."""
        c = self.study("stability").columns
        lines = head("case", "stepper", "energy change", "constraint errors, last tenth over first", "memory gained [pages]",
                     "microseconds a step")
        for i in np.flatnonzero(c["group"] == "million"):
            lines.append(row(str(c["case"][i]), f"`{c['stepper'][i]}`", brief(c["energy_change"][i]), f"{c['constraint_growth'][i]:.2f}",
                             f"{c['memory_growth'][i]:.0f}", f"{1e6 * c['cpu_seconds'][i] / c['steps'][i]:.1f}"))
        return lines

    def paper(self, number):
        """A table of the paper and the results of tandem."""
        c = self.study("tables").columns
        lines = head("Tol", "position: paper", "ours", "velocity: paper", "ours", "acceleration: paper", "ours")
        for tolerance in (1e-6, 1e-9, 1e-12):
            cells = []
            for level in "position", "velocity", "acceleration":
                k, = np.flatnonzero((c["place"] == f"table {number}") & np.isclose(c["tolerance"], tolerance, atol=0)
                                    & (c["quantity"] == f"{level} error"))
                cells += [str(c["paper"][k]), brief(c["ours"][k])]
            lines.append(row(f"1e{round(np.log10(tolerance))}", *cells))
        return lines

    def differences(self):
        """Remarks on the entries of the paper's tables that differ, each once."""
        c = self.study("tables").columns
        lines = []
        for k in np.flatnonzero(np.char.startswith(c["place"], "table")):
            if "same" not in c["difference"][k]:
                lines.append(f"- {str(c['place'][k]).capitalize()}, Tol 1e{round(np.log10(c['tolerance'][k]))}, "
                             f"{c['quantity'][k]}: {c['difference'][k]}.")
        return lines

    def text(self):
        """Charts, energies and lane changes that the paper's text gives."""
        c = self.study("tables").columns
        lines = head("scene", "stepper", "h", "what", "paper", "ours", "")
        for k in np.flatnonzero(c["place"] == "text"):
            ours = c["ours"][k]
            value = f"{ours:.0f}" if c["quantity"][k] == "charts" else f"{ours:.2f}" if ours > 1 else brief(ours)
            lines.append(row(str(c["scene"][k]), str(c["stepper"][k]), f"{1e3 * c['step'][k]:g} ms", str(c["quantity"][k]),
                             str(c["paper"][k]) or "-", value, str(c["difference"][k])))
        return lines

    def durations(self, study=""):
        """Durations of the studies, as noted by tools/plots.sh, or of one of them."""
        lines = head("command", "took")
        for line in (self.folder / "durations.txt").read_text().splitlines():
            seconds, command = line.split(" ", 1)
            if study in command:
                lines.append(row(f"`{command}`", f"{seconds} s"))
        return lines


def fill(document, tables):
    """Update the tables of a document, each by the method of its name; returns their number."""
    path = Path(document)
    text, count = re.subn(r"(<!-- table: (\w+) ?(\w*) -->\n).*?(<!-- end -->)", lambda found: found[1] + "\n".join(
        getattr(tables, found[2])(*([found[3]] if found[3] else []))) + "\n" + found[4], path.read_text(), flags=re.DOTALL)
    path.write_text(text)
    return count
