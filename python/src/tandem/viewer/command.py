# SPDX-License-Identifier: MIT
"""Writes an animation of a result file as an HTML page, which needs no network, and as glTF 2.0 with animated nodes (.glb) for
Blender and other viewers.

    tandem view run.h5                              run.html and run.glb
    tandem view run.h5 --output motion.html         only the page (with .glb: only the glTF file)
    tandem view run.h5 --output motion.vtkhdf       the motion for ParaView; --frames 10 for a smaller file
    tandem view modes.h5                            the mode shapes of a linearised system (tandem linearise)
    tandem view run.h5 --names "tip position y"     series that can be plotted beside the motion
"""

from __future__ import annotations

from pathlib import Path


def add_arguments(parser) -> None:
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--output", metavar="PATH", help=".html or .glb (default: both, with the name of the file), or .vtkhdf for ParaView")
    parser.add_argument("--names", metavar="A,B...", help="series that can be plotted: coordinates, d(coordinate), sensors")
    parser.add_argument("--mesh", metavar="BODY=FILE", action="append", default=[],
                        help="show a body by an STL or OBJ file; BODY=FILE:0.001 if it is in millimetres")
    parser.add_argument("--frames", metavar="N", type=float, default=60.0, help="frames per second (60)")


def run(given) -> int:
    from . import drawing_of
    from .gltf import write_glb
    from .html import page
    from .meshes import put_meshes
    from .vtkhdf import write_vtkhdf

    if not 0 < given.frames <= 1000:
        raise ValueError("--frames: more than 0 and at most 1000 a second")
    outputs = [Path(given.output)] if given.output else [Path(f"{Path(given.file).stem}{ending}") for ending in (".html", ".glb")]
    for path in outputs:
        if path.suffix.lower() not in (".html", ".glb", ".vtkhdf"):
            raise ValueError(f"{path}: a page ends in .html, a glTF file in .glb, a file for ParaView in .vtkhdf")
    drawing = drawing_of(given.file, per_second=given.frames, names=given.names.split(",") if given.names else None)
    put_meshes(drawing, dict(mesh_of(word) for word in given.mesh))
    for path in outputs:
        if path.suffix.lower() == ".html":
            path.write_text(page(drawing), encoding="utf-8")
        elif path.suffix.lower() == ".vtkhdf":
            write_vtkhdf(drawing, path)
        else:
            write_glb(drawing, path)
        print(path)
    return 0


def mesh_of(word: str) -> tuple[str, object]:
    """Split BODY=FILE or BODY=FILE:SCALE into the body and its mesh."""
    body, equals, file = word.partition("=")
    if not (body and equals and file):
        raise ValueError(f"--mesh {word}: BODY=FILE, or BODY=FILE:SCALE")
    path, colon, scale = file.rpartition(":")
    if colon:
        try:
            return body, (path, float(scale))
        except ValueError:
            pass
    return body, file
