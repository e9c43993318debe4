# SPDX-License-Identifier: MIT
"""What the pictures of studies share: the colours and sizes of the package, and a colour and a marker a stepper."""

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from tandem.plot.style import BLUE, DPI, GREEN, GREY, ORANGE, PINK, RED, SETTINGS, SKY, label

__all__ = ["BLUE", "DPI", "GREEN", "GREY", "ORANGE", "PINK", "RED", "SKY", "STEPPERS", "label", "plt", "save"]

# The same in every picture.
STEPPERS = {"rk4": (ORANGE, "s"), "dopri5": (SKY, "o"), "dop853": (BLUE, "D"), "trapezoid": (PINK, "v"), "sdirk54": (GREEN, "^"),
            "radau5": (RED, "P"), "radau": ("black", "p"), "auto": (GREY, "X")}

plt.rcParams.update({name: value for name, value in SETTINGS.items() if name != "axes.prop_cycle"})


def save(figure, path):
    figure.savefig(path, dpi=DPI, metadata={"Software": None} if str(path).endswith(".png") else None)
    plt.close(figure)
