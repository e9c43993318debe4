# SPDX-License-Identifier: MIT
"""What all pictures share: colours that colour-blind eyes tell apart (Okabe, Ito 2008), sizes, axes, labels with units."""

from __future__ import annotations

import io
from pathlib import Path

try:
    import matplotlib
    from matplotlib.figure import Figure
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("pictures need matplotlib: pip install matplotlib") from error

BLUE, ORANGE, GREEN, RED, SKY, PINK, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#777777"
COLOURS = [BLUE, ORANGE, GREEN, PINK, SKY, RED, "#000000"]
#: A colour and a marker of each stepper.
STEPPERS = {"rk4": (ORANGE, "s"), "dopri5": (SKY, "o"), "dop853": (BLUE, "D"), "trapezoid": (PINK, "v"), "sdirk54": (GREEN, "^"),
            "radau5": (RED, "P"), "radau": ("black", "p"), "auto": (GREY, "X")}
#: Several files in one picture: a line style each.
STYLES = ["-", "--", ":", "-."]
DPI = 110

SETTINGS = {
    "font.size": 9, "axes.titlesize": 9.5, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.linewidth": 0.4, "grid.alpha": 0.5, "lines.linewidth": 1.1, "legend.frameon": False, "legend.fontsize": 8,
    "axes.prop_cycle": matplotlib.cycler(color=COLOURS), "svg.fonttype": "none", "pdf.fonttype": 42,
}


class Picture(Figure):
    """A figure that shows itself in a notebook, also without pyplot."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", metadata={"Software": None})
        return file.getvalue()


def new_figure(rows: int = 1, columns: int = 1, size: tuple[float, float] | None = None, **options):
    """A figure with its axes as an array (rows, columns), without the global state of pyplot."""
    with matplotlib.rc_context(SETTINGS):
        figure = Picture(figsize=size or (4.2 * columns + 0.8, 3.2 * rows), layout="constrained", dpi=DPI)
        axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes


def in_style(draw):
    """A function whose text and lines look as all pictures do."""
    import functools

    @functools.wraps(draw)
    def styled(*arguments, **options):
        with matplotlib.rc_context(SETTINGS):
            return draw(*arguments, **options)

    return styled


def shown(text: str) -> str:
    """A text of the user's as it is: a dollar begins no formula, and what begins with _ is a label too."""
    text = text.replace("$", r"\$")
    return f"\u200b{text}" if text.startswith("_") else text


def label(name: str, unit: str) -> str:
    return shown(f"{name} [{unit}]" if unit not in ("", "1") else name)


def save(figure, path: str | Path) -> None:
    """Write a figure as PNG, SVG or PDF, the same bytes for the same data: no date, no name of a program."""
    ending = Path(path).suffix.lower()
    if ending not in (".png", ".svg", ".pdf"):
        raise ValueError(f"{path}: a picture ends in .png, .svg or .pdf")
    metadata = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[ending]
    with matplotlib.rc_context({**SETTINGS, "svg.hashsalt": "tandem"}):
        figure.savefig(path, metadata=metadata)
