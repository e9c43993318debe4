# SPDX-License-Identifier: MIT
"""A drawing as VTKHDF, for ParaView and other readers of VTK: polygons of all bodies, lines of all springs, arrows and tracks, whose corners
have a position at each frame. Connections are stored once. Cells have the number of their body and a colour.

The format is that of VTK's documentation (VTKHDF 2.0, PolyData with Steps). Several modes follow each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .drawing import Arrow, Body, Drawing, Spring, Track
from .gltf import flat_mesh, mesh_of
from .html import filled
from .rotations import carrying, turned

#: About so many numbers are in memory at a time.
BLOCK = 3_000_000
#: Corners of a torque's arc, and the most of a track.
ARC, MOST_PLACES = 25, 200


def rgb(colour: str) -> list[int]:
    return [int(colour[k:k + 2], 16) for k in (1, 3, 5)]


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
            colours.append(np.tile(rgb(piece.colour), (len(faces), 1)))
            first += len(places)
        corners.append(np.concatenate(own))
    if not triangles:
        return corners, np.zeros((0, 3), int), np.zeros(0, int), np.zeros((0, 3), int)
    return corners, np.concatenate(triangles), np.concatenate(owners), np.concatenate(colours)


@dataclass
class Strand:
    """Corners that lines join: a spring, an arrow, a track. `places` gives them at frames of a take (nf, np, 3)."""

    #: Number of the body to which the cells belong.
    number: int
    colour: str
    #: Which of its corners its lines join (nl, 2).
    lines: np.ndarray
    places: Callable[[dict[str, Body], np.ndarray], np.ndarray]


def in_a_row(count: int) -> np.ndarray:
    """The lines from each of so many corners to the next."""
    return np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)


def spring_of(spring: Spring) -> Strand:
    def places(known: dict[str, Body], frames: np.ndarray) -> np.ndarray:
        return np.stack([known[name].point(place)[frames] if name else np.broadcast_to(place, (len(frames), 3))
                         for name, place in zip(spring.bodies, spring.places, strict=True)], axis=1)

    return Strand(-1, "#3C3C3C", in_a_row(2), places)


def force_of(arrow: Arrow, number: int, scale: float) -> Strand:
    """A line from the point of action with the length of the force."""
    def places(_, frames: np.ndarray) -> np.ndarray:
        place = np.nan_to_num(arrow.places[frames])
        return np.stack([place, place + scale*np.nan_to_num(arrow.vectors[frames])], axis=1)

    return Strand(number, arrow.colour, in_a_row(2), places)


def torque_of(arrow: Arrow, number: int, scale: float) -> Strand:
    """Three quarters of a circle about it, as a right hand turns, whose radius is how large it is; and its axis, as long as that."""
    angles = np.linspace(0, 1.5*np.pi, ARC)

    def places(_, frames: np.ndarray) -> np.ndarray:
        place, vector = np.nan_to_num(arrow.places[frames]), scale*np.nan_to_num(arrow.vectors[frames])
        size = np.linalg.norm(vector, axis=1, keepdims=True)
        turn = np.array([carrying(one) for one in np.where(size > 0, vector, [0.0, 0.0, 1.0])])
        circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(ARC)], axis=1)
        around = turned(turn[:, None], np.broadcast_to(circle, (len(turn), ARC, 3)))*size[:, None]
        return np.concatenate([place[:, None] + around, place[:, None], (place + vector)[:, None]], axis=1)

    return Strand(number, arrow.colour, np.concatenate([in_a_row(ARC), [[ARC, ARC + 1]]]), places)


def track_of(track: Track, number: int) -> Strand:
    """A growing track: future points are placed at the current position."""
    whole = filled(track.places)
    at = np.unique(np.linspace(0, len(whole) - 1, min(len(whole), MOST_PLACES)).round().astype(int))

    def places(_, frames: np.ndarray) -> np.ndarray:
        return whole[np.minimum(at, frames[:, None])]

    return Strand(number, track.colour, in_a_row(len(at)), places)


def strands_of(drawing: Drawing) -> list[Strand]:
    """Springs, then arrows, numbered from -2 downwards, then tracks, numbered on."""
    size = float(np.max(np.subtract(*drawing.bounds()[::-1])))
    scales = {turns: drawing.scale(turns, size) for turns in (False, True)}
    made = [spring_of(spring) for spring in drawing.springs]
    made += [(torque_of if arrow.turns else force_of)(arrow, -2 - i, scales[arrow.turns]) for i, arrow in enumerate(drawing.arrows)]
    return made + [track_of(track, -2 - len(drawing.arrows) - i) for i, track in enumerate(drawing.tracks)]


def places_at(bodies: list[Body], corners: list[np.ndarray], strands: list[Strand], frames: np.ndarray) -> np.ndarray:
    """All corners at frames (nf, np, 3): those of the bodies, then those of the strands."""
    known = {body.name: body for body in bodies}
    made = [body.place[frames, None] + turned(body.turn[frames, None], np.broadcast_to(own, (len(frames), *own.shape)))
            for body, own in zip(bodies, corners, strict=True)]
    return np.concatenate([np.zeros((len(frames), 0, 3)), *made, *(strand.places(known, frames) for strand in strands)], axis=1)


def write_vtkhdf(drawing: Drawing, path: str | Path) -> None:
    """Write it to a file."""
    import h5py

    corners, triangles, owners, colours = corners_of(drawing)
    strands = strands_of(drawing)
    count, lines = sum(len(own) for own in corners), [np.zeros((0, 2), int)]
    for strand in strands:
        lines.append(count + strand.lines)
        count += strand.lines.max() + 1
    lines, of = np.concatenate(lines), np.array([len(strand.lines) for strand in strands], int)
    takes, nf = [bodies for _, bodies in drawing.takes] or [drawing.bodies], len(drawing.times)
    times = np.concatenate([drawing.times + k*(drawing.times[-1] - drawing.times[0]) for k in range(len(takes))])
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        root.attrs.create("Type", np.bytes_("PolyData"))
        root["NumberOfPoints"] = np.array([count])
        points = root.create_dataset("Points", (len(times)*count, 3), "<f4", chunks=(max(1, min(count, 100_000)), 3), compression=1,
                                     shuffle=True)
        block = max(1, BLOCK//(3*max(1, count)))
        for k, bodies in enumerate(takes):
            for f in range(0, nf, block):
                places = places_at(bodies, corners, strands, np.arange(f, min(nf, f + block))).reshape(-1, 3)
                points[(k*nf + f)*count:(k*nf + f)*count + len(places)] = places
        for name, cells in (("Vertices", np.zeros((0, 1), int)), ("Lines", lines), ("Polygons", triangles), ("Strips", np.zeros((0, 1), int))):
            group = root.create_group(name)
            group["NumberOfCells"], group["NumberOfConnectivityIds"] = np.array([len(cells)]), np.array([cells.size])
            group["Connectivity"], group["Offsets"] = cells.reshape(-1), np.arange(len(cells) + 1)*cells.shape[1]
        # VTK counts the cells in this order: vertices, lines, polygons. Lines belong to no body: those of a spring have -1.
        data = root.create_group("CellData")
        data["body"] = np.concatenate([np.repeat([strand.number for strand in strands], of).astype(int), owners]).astype("<i4")
        drawn = np.array([rgb(strand.colour) for strand in strands], int).reshape(-1, 3)
        data["colour"] = np.concatenate([np.repeat(drawn, of, axis=0), colours]).astype("u1")
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
        if drawing.tracks:
            file["tracks"] = [track.name for track in drawing.tracks]
        if drawing.takes:
            file["modes"] = [name for name, _ in drawing.takes]
