#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws the contents of result files and of the files of studies.

Usage: tools/plot.py FILE.h5... PICTURE [OPTION...]

    tools/plot.py run.h5 picture.png                track, and one coordinate against time
    tools/plot.py run.h5 picture.png --overview     and constraint errors, energy, steps, charts
    tools/plot.py study/precision_X.h5 picture.png  error against run time and evaluations; several files, a panel each
    tools/plot.py study/stability.h5 picture.png    the verdicts on stiff and extreme cases
    tools/plot.py study/stability.h5 picture.png --stiffness   steps against stiffness
    tools/plot.py build/bench/runs.h5 picture.png   the same of other solvers, a panel a problem (`make bench`)
    tools/plot.py build/bench/chain.h5 picture.png  time of a step against the size of a system
    tools/plot.py loci.csv picture.png              eigenvalues over a value (`tandem study modes --output loci.csv`)
    tools/plot.py vehicle.h5 picture.png --paper 2  a figure of the paper: 2, 4, or 6 with two files

PICTURE ends in .png, .svg or .pdf. Needs h5py and matplotlib, which `tools/setup.sh plot` brings into .venv: then call it by
.venv/bin/python tools/plot.py.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
try:
    from plots import loci, motion, performance, stability
    from tandem.plot import precision, save
    from tandem.result import read as read_result
    from tandem.study import kind_of
except ModuleNotFoundError as missing:
    print(f"plot.py: there is no package {missing.name} for {sys.executable}\n"
          "Call tools/setup.sh plot once, which brings all that is needed into .venv, and then .venv/bin/python tools/plot.py ...",
          file=sys.stderr)
    sys.exit(2)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE.h5")
    parser.add_argument("picture", metavar="PICTURE")
    parser.add_argument("--track", metavar="X,Y", help="coordinates of the track; the first two of the file")
    parser.add_argument("--against-time", metavar="Z", help="coordinate against time; the third of the file")
    parser.add_argument("--overview", action="store_true", help="everything that a result file tells")
    parser.add_argument("--stiffness", action="store_true", help="steps against stiffness, of a study of stability")
    parser.add_argument("--paper", choices=motion.PAPER, help="remake a figure of the paper")
    arguments = parser.parse_args()

    if [Path(path).suffix for path in arguments.files] == [".csv"]:
        return loci.draw(arguments.files[0], arguments.picture)
    kinds = {kind_of(path) or "result" for path in arguments.files}
    if kinds == {"stability"} and len(arguments.files) == 1:
        draw = stability.draw_steps if arguments.stiffness else stability.draw
        return draw(arguments.files, arguments.picture)
    if kinds == {"precision"}:
        return save(precision(arguments.files), arguments.picture)
    if kinds == {"bench"}:
        return performance.draw(arguments.files, arguments.picture)
    if kinds == {"chain"}:
        return performance.draw_chain(arguments.files, arguments.picture)
    if kinds != {"result"}:
        parser.error(f"there is no picture of {' and '.join(sorted(kinds))} in one")
    wanted = motion.PAPER[arguments.paper][1] if arguments.paper else 1
    if len(arguments.files) != wanted:
        parser.error(f"give {wanted} result file(s), not {len(arguments.files)}")
    if arguments.paper:
        return motion.PAPER[arguments.paper][0](arguments.files, arguments.picture)
    names = read_result(arguments.files[0]).names
    x, y = arguments.track.split(",") if arguments.track else names[:2]
    z = arguments.against_time or names[2]
    for name in (x, y, z):
        if name not in names:
            parser.error(f"there is no coordinate {name}; there are {', '.join(names)}")
    draw = motion.draw_overview if arguments.overview else motion.draw_two
    return draw(arguments.files[0], arguments.picture, x, y, z)


if __name__ == "__main__":
    main()
