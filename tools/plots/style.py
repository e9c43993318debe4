# SPDX-License-Identifier: MIT
"""The colours and sizes of the package, for pictures that are made here."""

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from tandem.plot.style import BLUE, DPI, GREEN, GREY, ORANGE, PINK, RED, SETTINGS, SKY, STEPPERS, label

__all__ = ["BLUE", "DPI", "GREEN", "GREY", "ORANGE", "PINK", "RED", "SKY", "STEPPERS", "label", "plt", "save"]

plt.rcParams.update({name: value for name, value in SETTINGS.items() if name != "axes.prop_cycle"})


def save(figure, path):
    figure.savefig(path, dpi=DPI, metadata={"Software": None} if str(path).endswith(".png") else None)
    plt.close(figure)
