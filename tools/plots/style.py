# SPDX-License-Identifier: MIT
"""What all pictures share: colours that colour-blind eyes tell apart (Okabe, Ito 2008), sizes, axes."""

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

BLUE, ORANGE, GREEN, RED, SKY, PINK, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#777777"
# A colour and a marker a stepper, the same in every picture.
STEPPERS = {"rk4": (ORANGE, "s"), "dopri5": (SKY, "o"), "dop853": (BLUE, "D"), "trapezoid": (PINK, "v"), "sdirk54": (GREEN, "^"),
            "radau5": (RED, "P")}
DPI = 110

plt.rcParams.update({
    "font.size": 9, "axes.titlesize": 9.5, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.linewidth": 0.4, "grid.alpha": 0.5, "lines.linewidth": 1.1, "legend.frameon": False,
})


def label(name, unit):
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def save(figure, path):
    figure.savefig(path, dpi=DPI, metadata={"Software": None} if str(path).endswith(".png") else None)
    plt.close(figure)
