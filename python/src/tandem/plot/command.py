# SPDX-License-Identifier: MIT
"""Plots result files; several files are compared.

    tandem plot run.h5                                        an overview, run.png
    tandem plot run.h5 --output run.pdf --kind tracks --plane xz
    tandem plot a.h5 b.h5 --kind coordinates --names "rod.x,d(rod.x),tip position y"
    tandem plot table.h5 --kind histogram --names rz_min      the table of a sweep
    tandem plot study/precision_rolling_disk.h5               error against run time; several studies have one panel each
"""

from __future__ import annotations

import inspect
from pathlib import Path


def add_arguments(parser) -> None:
    kinds = "overview, tracks, coordinates, sensors, reactions, errors, energies, phase; for tables scatter, histogram, surface, bands; for studies precision"
    parser.add_argument("files", nargs="+", metavar="FILE")
    parser.add_argument("--output", metavar="PATH", help="file of the plot: .png, .svg or .pdf (default: name of the first file with .png)")
    parser.add_argument("--kind", default="overview", metavar="KIND", help=kinds)
    parser.add_argument("--names", metavar="A,B...", help="plotted quantities: coordinates, d(coordinate), sensors, points")
    parser.add_argument("--plane", metavar="XY", help="plane of tracks: two of x, y and z")
    parser.add_argument("--title", metavar="TEXT")


def run(given) -> int:
    from ..study import kind_of
    from ..table import is_table
    from .data import motions_of
    from .pictures import KINDS
    from .style import save
    from .tables import TABLE_KINDS

    studies = [kind_of(file) for file in given.files]
    if any(studies):
        return draw_studies(given, studies)
    of_table = is_table(given.files[0])
    if of_table and len(given.files) > 1:
        raise ValueError("only one table can be plotted")
    kinds = TABLE_KINDS if of_table else KINDS
    if given.kind not in kinds:
        raise ValueError(f"there is no kind {given.kind!r} of pictures{' of tables' if of_table else ''}; there are {', '.join(kinds)}")
    draw = kinds[given.kind]
    known = inspect.signature(draw).parameters
    options = {"names": given.names.split(",") if given.names else None, "plane": given.plane, "title": given.title}
    unused = [name for name, value in options.items() if value is not None and name not in known]
    if unused:
        raise ValueError(f"--{unused[0]} is not for the kind {given.kind}")
    picture = given.output or f"{Path(given.files[0]).stem}.png"
    results = given.files if of_table else motions_of(given.files)
    one = len(results) == 1 or given.kind == "errors"
    figure = draw(results[0] if one else results, **{name: value for name, value in options.items() if value is not None})
    save(figure, picture)
    print(picture)
    return 0


def draw_studies(given, studies: list[str]) -> int:
    """Plot precision studies."""
    from .studies import precision
    from .style import save

    for file, study in zip(given.files, studies, strict=True):
        if study != "precision":
            raise ValueError(f"{file} is {f'a study of {study}' if study else 'not a study'}: only studies of precision are drawn"
                             + (" here; tools/plot.py draws this one" if study else " in one picture"))
    if given.kind not in ("overview", "precision") or given.names or given.plane:
        raise ValueError("a study of precision has one kind of picture, and takes neither --names nor --plane")
    picture = given.output or f"{Path(given.files[0]).stem}.png"
    save(precision(given.files, title=given.title), picture)
    print(picture)
    return 0
