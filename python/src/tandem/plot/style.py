# SPDX-License-Identifier: MIT
"""Style of all plots: colours that colour-blind people can distinguish (Okabe, Ito 2008), sizes, axes, labels with units."""

from __future__ import annotations

import io
from pathlib import Path

try:
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.transforms import ScaledTranslation
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("plots require matplotlib: pip install matplotlib") from error

BLUE, ORANGE, GREEN, RED, SKY, PINK, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#777777"
COLOURS = [BLUE, ORANGE, GREEN, PINK, SKY, RED, "#000000"]
#: Colour and marker of each stepper.
STEPPERS = {"rk4": (ORANGE, "s"), "dopri5": (SKY, "o"), "dop853": (BLUE, "D"), "trapezoid": (PINK, "v"), "sdirk54": (GREEN, "^"),
            "radau5": (RED, "P"), "radau": ("black", "p"), "auto": (GREY, "X")}
#: Line styles of several files in one plot.
STYLES = ["-", "--", ":", "-."]
DPI = 110
#: Largest number of entries of a legend, and their font size.
MOST_ENTRIES, LEGEND_SIZE = 6, 8
#: Height of a line of a legend in inches.
LEGEND_LINE = 1.35*LEGEND_SIZE/72

SETTINGS = {
    "font.size": 9, "axes.titlesize": 9.5, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.linewidth": 0.4, "grid.alpha": 0.5, "lines.linewidth": 1.1, "legend.frameon": False, "legend.fontsize": LEGEND_SIZE,
    "axes.prop_cycle": matplotlib.cycler(color=COLOURS), "svg.fonttype": "none", "pdf.fonttype": 42,
}


class Picture(Figure):
    """A figure that is displayed in notebooks without pyplot, and that grows with its legends."""

    #: Height of the legends above each row of axes, in inches.
    above: dict[int, float]

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self.above = {}

    def make_room(self, row: int, height: float) -> None:
        """Increase the height of the figure for a legend above a row of axes; a legend of one line needs no increase."""
        before = self.above.get(row, LEGEND_LINE)
        if height > before:
            self.set_figheight(self.get_figheight() + height - before)
            self.above[row] = height

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", metadata={"Software": None})
        return file.getvalue()


def new_figure(rows: int = 1, columns: int = 1, size: tuple[float, float] | None = None, **options):
    """Create a figure and an array of axes (rows, columns), without the global state of pyplot."""
    with matplotlib.rc_context(SETTINGS):
        figure = Picture(figsize=size or (4.2 * columns + 0.8, 3.2 * rows), layout="constrained", dpi=DPI)
        axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes


def in_style(draw):
    """Decorator that applies the common style to a plot function."""
    import functools

    @functools.wraps(draw)
    def styled(*arguments, **options):
        with matplotlib.rc_context(SETTINGS):
            return draw(*arguments, **options)

    return styled


def shown(text: str) -> str:
    """Escape a text for display by matplotlib, in which dollars mark formulas and labels that begin with _ are hidden."""
    text = text.replace("$", r"\$")
    return f"\u200b{text}" if text.startswith("_") else text


def label(name: str, unit: str) -> str:
    return shown(f"{name} [{unit}]" if unit not in ("", "1") else name)


def width_of(text: str, size: float = LEGEND_SIZE) -> float:
    """Width of a text in inches."""
    from matplotlib.textpath import TextPath

    return TextPath((0, 0), text.replace("\u200b", "").replace("$", r"\$") or " ", size=size).get_extents().xmax/72


def shortened(text: str, width: float) -> str:
    """Shorten a text to a width in inches. The beginning and the end are kept, which distinguish most names."""
    if width_of(text) <= width:
        return text
    kept = len(text) - 1
    while kept > 4 and width_of(f"{text[:-(-kept//2)]}\u2026{text[-(kept//2):]}") > width:
        kept -= 1
    return f"{text[:-(-kept//2)]}\u2026{text[-(kept//2):]}"


def legend(axes, entries, more: int = 0) -> None:
    """Add a legend between the axes and their title; the limits of the axes must be set. Entries are (handle, text). At most six of them
    are shown; the number of the others, including `more` lines without entry, is stated."""
    entries = list(entries)
    more += max(0, len(entries) - MOST_ENTRIES)
    entries = entries[:MOST_ENTRIES]
    if not entries:
        return
    figure, place = axes.get_figure(), axes.get_subplotspec()
    columns = place.get_gridspec().ncols if place else 1
    # The numbers and the label of the ordinate take the remaining width.
    room = figure.get_figwidth()/columns - 0.85
    line, gap = 0.26, 0.12
    texts = [shortened(text, room - line) for _, text in entries] + ([f"and {more} more"] if more else [])
    handles = [handle for handle, _ in entries] + ([Line2D([], [], linestyle="none")] if more else [])
    widths = [line + width_of(text) for text in texts]
    per_row = len(texts)
    while per_row > 1 and sum(max(widths[column::per_row]) + gap for column in range(per_row)) - gap > room:
        per_row -= 1
    rows = -(-len(texts)//per_row)
    # matplotlib fills legends by columns; the entries are reordered such that they appear by rows.
    order = [i for column in range(per_row) for i in range(column, len(texts), per_row)]
    # A common factor or offset of the ordinate is also shown above the axes.
    formatter = axes.yaxis.get_major_formatter()
    formatter.set_locs(axes.get_yticks())
    lift = LEGEND_LINE if formatter.get_offset() else 0.0
    axes.legend([handles[i] for i in order], [shown(texts[i]) for i in order], ncols=per_row, loc="lower left", bbox_to_anchor=(0, 1),
                bbox_transform=axes.transAxes + ScaledTranslation(0, lift, figure.dpi_scale_trans), borderaxespad=0.1, borderpad=0.1, columnspacing=1, handlelength=1.4, handletextpad=0.6, labelspacing=0.2)
    if axes.get_title():
        axes.set_title(axes.get_title(), pad=5 + 72*(rows*LEGEND_LINE + lift))
    if place and isinstance(figure, Picture):
        figure.make_room(place.rowspan.start, rows*LEGEND_LINE + lift)


def save(figure, path: str | Path) -> None:
    """Write a figure as PNG, SVG or PDF. The file contains no date and no program name, so that equal figures give equal files."""
    ending = Path(path).suffix.lower()
    if ending not in (".png", ".svg", ".pdf"):
        raise ValueError(f"{path}: a picture ends in .png, .svg or .pdf")
    metadata = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[ending]
    with matplotlib.rc_context({**SETTINGS, "svg.hashsalt": "tandem"}):
        figure.savefig(path, metadata=metadata)
