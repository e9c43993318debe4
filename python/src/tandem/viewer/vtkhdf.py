# SPDX-License-Identifier: MIT
"""A drawing as VTKHDF, for ParaView and what else reads VTK's files: polygons of all bodies, lines of all springs and of all arrows, whose
corners have a place at each frame. What is connected to what is there once. Cells have the number of their body and a colour.

The format is that of VTK's documentation (VTKHDF 2.0, PolyData with Steps). A mode follows the other where there are several."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .drawing import Arrow, Body, Drawing
from .gltf import flat_mesh, mesh_of
from .rotations import turned

#: About so many numbers are in memory at a time.
BLOCK = 3_000_000


def corners_of(drawing: Drawing) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Of each body its corners in its axes (np, 3); triangles of all of them, and of each the body and the colour."""
    files = {name: flat_mesh(triangles) for name, triangles in drawing.meshes.items()}
    known: dict[str, tuple] = {}
    corners, triangles, owners, colours, first = [], [], [], [], 0
    for i, body in enumerate(drawing.bodies):
        own = [np.zeros((0, 3))]
        for piece in body.pieces:
            if piece.shape not in known:
                known[piece.shape] = files.get(piece.shape) or mesh_of(piece.shape)
            places, _, faces = known[piece.shape]
            own.append(piece.at + turned(piece.turn, places*np.asarray(piece.size)))
            triangles.append(first + faces)
            owners.append(np.full(len(faces), i))
            colours.append(np.tile([int(piece.colour[k:k + 2], 16) for k in (1, 3, 5)], (len(faces), 1)))
            first += len(places)
        corners.append(np.concatenate(own))
    if not triangles:
        return corners, np.zeros((0, 3), int), np.zeros(0, int), np.zeros((0, 3), int)
    return corners, np.concatenate(triangles), np.concatenate(owners), np.concatenate(colours)


def scale_of(drawing: Drawing) -> float:
    """The length of a newton: as in pages, the largest arrow has half the size of all."""
    largest = max([float(np.linalg.norm(np.nan_to_num(arrow.vectors), axis=1).max(initial=0)) for arrow in drawing.arrows] or [0.0])
    return 0.5*float(np.max(np.subtract(*drawing.bounds()[::-1])))/largest if largest else 0.0


def colours_of(arrows: list[Arrow]) -> np.ndarray:
    """Of each arrow its colour (number, 3)."""
    return np.array([[int(arrow.colour[k:k + 2], 16) for k in (1, 3, 5)] for arrow in arrows], int).reshape(-1, 3)


def places_at(drawing: Drawing, bodies: list[Body], corners: list[np.ndarray], frames: slice, scale: float = 0.0) -> np.ndarray:
    """All corners at frames (nf, np, 3): those of the bodies, then both ends of each spring and of each arrow, a newton as long as `scale`."""
    known = {body.name: body for body in bodies}
    nf = len(range(*frames.indices(len(drawing.times))))
    made = [body.place[frames, None] + turned(body.turn[frames, None], np.broadcast_to(own, (nf, *own.shape)))
            for body, own in zip(bodies, corners, strict=True)]
    for spring in drawing.springs:
        for name, place in zip(spring.bodies, spring.places, strict=True):
            made.append(known[name].point(place)[frames, None] if name else np.broadcast_to(place, (nf, 1, 3)))
    for arrow in drawing.arrows:
        place = np.nan_to_num(arrow.places[frames])
        made.append(np.stack([place, place + scale*np.nan_to_num(arrow.vectors[frames])], axis=1))
    return np.concatenate([np.zeros((nf, 0, 3)), *made], axis=1)


def write_vtkhdf(drawing: Drawing, path: str | Path) -> None:
    """Write it to a file."""
    import h5py

    corners, triangles, owners, colours = corners_of(drawing)
    bodies_at = sum(len(own) for own in corners)
    n_springs, n_arrows = len(drawing.springs), len(drawing.arrows)
    lines = bodies_at + np.arange(2*(n_springs + n_arrows)).reshape(-1, 2)
    takes = [bodies for _, bodies in drawing.takes] or [drawing.bodies]
    count, nf = bodies_at + lines.size, len(drawing.times)
    times = np.concatenate([drawing.times + k*(drawing.times[-1] - drawing.times[0]) for k in range(len(takes))])
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        root.attrs.create("Type", np.bytes_("PolyData"))
        root["NumberOfPoints"] = np.array([count])
        points = root.create_dataset("Points", (len(times)*count, 3), "<f4", chunks=(max(1, min(count, 100_000)), 3), compression=1,
                                     shuffle=True)
        block, scale = max(1, BLOCK//(3*max(1, count))), scale_of(drawing)
        for k, bodies in enumerate(takes):
            for f in range(0, nf, block):
                places = places_at(drawing, bodies, corners, slice(f, f + block), scale).reshape(-1, 3)
                points[(k*nf + f)*count:(k*nf + f)*count + len(places)] = places
        for name, cells in (("Vertices", np.zeros((0, 1), int)), ("Lines", lines), ("Polygons", triangles), ("Strips", np.zeros((0, 1), int))):
            group = root.create_group(name)
            group["NumberOfCells"], group["NumberOfConnectivityIds"] = np.array([len(cells)]), np.array([cells.size])
            group["Connectivity"], group["Offsets"] = cells.reshape(-1), np.arange(len(cells) + 1)*cells.shape[1]
        # VTK counts the cells in this order: vertices, lines, polygons. A spring belongs to no body, nor does an arrow: -2, -3, ...
        data = root.create_group("CellData")
        data["body"] = np.concatenate([np.full(n_springs, -1), -2 - np.arange(n_arrows), owners]).astype("<i4")
        data["colour"] = np.concatenate([np.full((n_springs, 3), 60), colours_of(drawing.arrows), colours]).astype("u1")
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = len(times)
        steps["Values"] = times
        steps["PointOffsets"] = np.arange(len(times))*count
        steps["NumberOfParts"] = np.ones(len(times), int)
        for name in ("PartOffsets", "CellDataOffsets/body", "CellDataOffsets/colour"):
            steps[name] = np.zeros(len(times), int)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = np.zeros((len(times), 4), int)
        # Beside what VTK reads: the names of the bodies, by number.
        file["bodies"] = [body.name for body in drawing.bodies]
        if drawing.arrows:
            file["arrows"] = [f"{arrow.name}{' on ' if arrow.on else ''}{arrow.on} [{arrow.unit}]" for arrow in drawing.arrows]
        if drawing.takes:
            file["modes"] = [name for name, _ in drawing.takes]
