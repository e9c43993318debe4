# SPDX-License-Identifier: MIT
"""Writes a drawing as VTKHDF, for ParaView and other readers of VTK: polygons of bodies, and lines of springs, arrows and tracks. The
positions of all corners are stored for each frame, the connections only once. Each cell has the number of its body and a colour.

The format is VTKHDF 2.0, PolyData with Steps, as in the documentation of VTK. If there are several modes, they follow each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .drawing import Arrow, Body, Drawing, Spring, Track
from .gltf import flat_mesh, mesh_of
from .html import filled
from .rotations import rotation_onto, rotated

#: Approximate count of numbers in memory at a time.
BLOCK = 3_000_000
#: Number of corners of the arc of a torque, and largest number of corners of a track.
ARC, MOST_PLACES = 25, 200


def rgb(colour: str) -> list[int]:
    return [int(colour[k:k + 2], 16) for k in (1, 3, 5)]


def corners_of(drawing: Drawing) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Corners of each body in its axes (np, 3); all triangles, with the number of the body and the colour of each."""
    files = {name: flat_mesh(triangles) for name, triangles in drawing.meshes.items()}
    known: dict[str, tuple] = {}
    corners, triangles, owners, colours, first = [], [], [], [], 0
    for i, body in enumerate(drawing.bodies):
        own = [np.zeros((0, 3))]
        for piece in body.pieces:
            if piece.shape not in known:
                known[piece.shape] = files.get(piece.shape) or mesh_of(piece.shape)
            positions, _, faces = known[piece.shape]
            own.append(piece.at + rotated(piece.rotation, positions*np.asarray(piece.size)))
            triangles.append(first + faces)
            owners.append(np.full(len(faces), i))
            colours.append(np.tile(rgb(piece.colour), (len(faces), 1)))
            first += len(positions)
        corners.append(np.concatenate(own))
    if not triangles:
        return corners, np.zeros((0, 3), int), np.zeros(0, int), np.zeros((0, 3), int)
    return corners, np.concatenate(triangles), np.concatenate(owners), np.concatenate(colours)


@dataclass
class Strand:
    """Corners connected by lines: a spring, an arrow or a track. `positions` computes them at frames of a take (nf, np, 3)."""

    #: Number of the body to which the cells belong.
    number: int
    colour: str
    #: Indices of the corners connected by each line (nl, 2).
    lines: np.ndarray
    positions: Callable[[dict[str, Body], np.ndarray], np.ndarray]


def consecutive_lines(count: int) -> np.ndarray:
    """Lines that connect each of `count` corners to the next one."""
    return np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)


def spring_of(spring: Spring) -> Strand:
    def positions(known: dict[str, Body], frames: np.ndarray) -> np.ndarray:
        return np.stack([known[name].point(position)[frames] if name else np.broadcast_to(position, (len(frames), 3))
                         for name, position in zip(spring.bodies, spring.positions, strict=True)], axis=1)

    return Strand(-1, "#3C3C3C", consecutive_lines(2), positions)


def force_of(arrow: Arrow, number: int, scale: float) -> Strand:
    """A line from the point of action along the force."""
    def positions(_, frames: np.ndarray) -> np.ndarray:
        position = np.nan_to_num(arrow.positions[frames])
        return np.stack([position, position + scale*np.nan_to_num(arrow.vectors[frames])], axis=1)

    return Strand(number, arrow.colour, consecutive_lines(2), positions)


def torque_of(arrow: Arrow, number: int, scale: float) -> Strand:
    """Three quarters of a circle about the torque, in the right-handed sense, and its axis. The radius and the length of the axis are
    proportional to the torque."""
    angles = np.linspace(0, 1.5*np.pi, ARC)

    def positions(_, frames: np.ndarray) -> np.ndarray:
        position, vector = np.nan_to_num(arrow.positions[frames]), scale*np.nan_to_num(arrow.vectors[frames])
        size = np.linalg.norm(vector, axis=1, keepdims=True)
        rotation = np.array([rotation_onto(one) for one in np.where(size > 0, vector, [0.0, 0.0, 1.0])])
        circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(ARC)], axis=1)
        around = rotated(rotation[:, None], np.broadcast_to(circle, (len(rotation), ARC, 3)))*size[:, None]
        return np.concatenate([position[:, None] + around, position[:, None], (position + vector)[:, None]], axis=1)

    return Strand(number, arrow.colour, np.concatenate([consecutive_lines(ARC), [[ARC, ARC + 1]]]), positions)


def track_of(track: Track, number: int) -> Strand:
    """A growing track: points of later frames are at the current position."""
    whole = filled(track.positions)
    at = np.unique(np.linspace(0, len(whole) - 1, min(len(whole), MOST_PLACES)).round().astype(int))

    def positions(_, frames: np.ndarray) -> np.ndarray:
        return whole[np.minimum(at, frames[:, None])]

    return Strand(number, track.colour, consecutive_lines(len(at)), positions)


def strands_of(drawing: Drawing) -> list[Strand]:
    """Springs (number -1), arrows (-2 and downwards) and tracks (numbers after those of the arrows)."""
    size = float(np.max(np.subtract(*drawing.bounds()[::-1])))
    scales = {is_torque: drawing.scale(is_torque, size) for is_torque in (False, True)}
    made = [spring_of(spring) for spring in drawing.springs]
    made += [(torque_of if arrow.is_torque else force_of)(arrow, -2 - i, scales[arrow.is_torque]) for i, arrow in enumerate(drawing.arrows)]
    return made + [track_of(track, -2 - len(drawing.arrows) - i) for i, track in enumerate(drawing.tracks)]


def positions_at(bodies: list[Body], corners: list[np.ndarray], strands: list[Strand], frames: np.ndarray) -> np.ndarray:
    """Positions of all corners at frames (nf, np, 3): corners of the bodies, then corners of the strands."""
    known = {body.name: body for body in bodies}
    made = [body.position[frames, None] + rotated(body.rotation[frames, None], np.broadcast_to(own, (len(frames), *own.shape)))
            for body, own in zip(bodies, corners, strict=True)]
    return np.concatenate([np.zeros((len(frames), 0, 3)), *made, *(strand.positions(known, frames) for strand in strands)], axis=1)


def write_vtkhdf(drawing: Drawing, path: str | Path) -> None:
    """Write a drawing to a file."""
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
                positions = positions_at(bodies, corners, strands, np.arange(f, min(nf, f + block))).reshape(-1, 3)
                points[(k*nf + f)*count:(k*nf + f)*count + len(positions)] = positions
        for name, cells in (("Vertices", np.zeros((0, 1), int)), ("Lines", lines), ("Polygons", triangles), ("Strips", np.zeros((0, 1), int))):
            group = root.create_group(name)
            group["NumberOfCells"], group["NumberOfConnectivityIds"] = np.array([len(cells)]), np.array([cells.size])
            group["Connectivity"], group["Offsets"] = cells.reshape(-1), np.arange(len(cells) + 1)*cells.shape[1]
        # VTK numbers cells in the order vertices, lines, polygons.
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
        # Names of the bodies, arrows, tracks and modes, which VTK does not read.
        file["bodies"] = [body.name for body in drawing.bodies]
        if drawing.arrows:
            file["arrows"] = [f"{arrow.name}{' on ' if arrow.on else ''}{arrow.on} [{arrow.unit}]" for arrow in drawing.arrows]
        if drawing.tracks:
            file["tracks"] = [track.name for track in drawing.tracks]
        if drawing.takes:
            file["modes"] = [name for name, _ in drawing.takes]
