# SPDX-License-Identifier: MIT
"""Pictures of motions: of results of the program, of their files, and of solutions of `tandem.solve`; one or several, which are
compared. Each function gives a figure of matplotlib; `save` writes it as PNG, SVG or PDF.

    tandem.plot.overview("rolling_disk.h5")
    tandem.plot.coordinates(["a.h5", "b.h5"], ["rod.x", "d(rod.x)", "tip position y"])

of the tables of sweeps: `scatter`, `histogram`, `surface`, `bands`; and of studies of precision: `precision`.
"""

from .data import names_of
from .pictures import coordinates, energies, errors, overview, phase, reactions, sensors, tracks
from .studies import precision
from .style import COLOURS, save
from .tables import bands, histogram, read_table, scatter, surface

__all__ = ["COLOURS", "bands", "coordinates", "energies", "errors", "histogram", "names_of", "overview", "phase", "precision",
           "reactions", "read_table", "save", "scatter", "sensors", "surface", "tracks"]
