# SPDX-License-Identifier: MIT
"""Plots of motions: results of the program, result files, and solutions of `tandem.solve`. Several of them are compared in one figure.
Each function returns a figure of matplotlib; `save` writes it as PNG, SVG or PDF.

    tandem.plot.overview("rolling_disk.h5")
    tandem.plot.coordinates(["a.h5", "b.h5"], ["rod.x", "d(rod.x)", "tip position y"])

Plots of the tables of sweeps are `scatter`, `histogram`, `surface` and `bands`; the plot of precision studies is `precision`.
"""

from .data import names_of
from .pictures import coordinates, energies, errors, overview, phase, reactions, sensors, tracks
from .studies import precision
from .style import COLOURS, save
from .tables import bands, histogram, read_table, scatter, surface

__all__ = ["COLOURS", "bands", "coordinates", "energies", "errors", "histogram", "names_of", "overview", "phase", "precision",
           "reactions", "read_table", "save", "scatter", "sensors", "surface", "tracks"]
