# SPDX-License-Identifier: MIT
"""Meshes of bodies from STL files (text or binary) and OBJ files. Coordinates are in the axes of the body, in metres or with a scale."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from .drawing import Drawing, Piece

#: Limit that keeps pages small and fast.
MOST_TRIANGLES = 200_000
#: A larger file exceeds the number of triangles, or is not a mesh.
MOST_BYTES = 100_000_000
VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_mesh(path: str | Path) -> np.ndarray:
    """Read the triangles of a file (nt, 3, 3)."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    # The size of the file is checked after reading, because the file may grow meanwhile.
    with open(path, "rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size/1e6:.0f} MB: make it simpler, a mesh of {MOST_TRIANGLES} triangles at most "
                         f"is read from {MOST_BYTES/1e6:.0f} MB")
    try:
        triangles = obj(data) if path.suffix.lower() == ".obj" else stl(data)
    except (UnicodeDecodeError, ValueError, IndexError) as error:
        raise ValueError(f"{path} cannot be read as a mesh (STL, OBJ): {error}") from error
    # Triangles without area are invisible and have no normal.
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    triangles = triangles[~(areas <= 0)]
    if len(triangles) == 0 or not np.isfinite(triangles).all():
        raise ValueError(f"{path} cannot be read as a mesh (STL, OBJ): it has no triangles, or some are no numbers")
    if len(triangles) > MOST_TRIANGLES:
        raise ValueError(f"{path} has {len(triangles)} triangles: make it simpler, a page shows {MOST_TRIANGLES} at most")
    return triangles


def stl(data: bytes) -> np.ndarray:
    """Read STL data. They are binary if their length agrees with the number of triangles, with 50 bytes each; otherwise they are text."""
    if len(data) >= 84:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50*count:
            kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
            return np.frombuffer(data, kind, count, 84)["corners"].astype(float)
    if data[:100].split()[:1] != [b"solid"]:
        raise ValueError("it is neither a binary STL file nor one of text")
    corners = []
    for found in VERTEX.finditer(data):
        corners.append([float(number) for number in found.groups()])
        refuse_more(len(corners)//3)
    return np.array(corners, dtype=float).reshape(-1, 3, 3)


def refuse_more(count: int) -> None:
    """Raise an error if there are too many triangles, before they fill the memory."""
    if count > MOST_TRIANGLES:
        raise ValueError(f"it has more than {MOST_TRIANGLES} triangles; make it simpler")


def obj(data: bytes) -> np.ndarray:
    """Read OBJ data; faces with more than three corners are divided into triangles."""
    positions, triangles = [], []
    for line in io.BytesIO(data):
        words = line.decode().split(maxsplit=MOST_TRIANGLES + 3)
        if words[:1] == ["v"]:
            positions.append([float(word) for word in words[1:4]])
            # A mesh needs at most three corners per triangle.
            refuse_more(len(positions)//3)
        elif words[:1] == ["f"]:
            refuse_more(len(words) - 3)
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            corners = [positions[number - 1 if number > 0 else number] for number in numbers]
            triangles += [[corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1)]
            refuse_more(len(triangles))
    return np.array(triangles, dtype=float).reshape(-1, 3, 3)


def put_meshes(drawing: Drawing, meshes: dict[str, Any]) -> None:
    """Replace the pieces of bodies by meshes. For each body, a path or a tuple of path and scale is given."""
    bodies = {body.name: body for body in drawing.bodies}
    for name, given in meshes.items():
        if name not in bodies:
            raise KeyError(f"there is no body {name!r}; there are {', '.join(bodies)}")
        path, scale = given if isinstance(given, tuple) else (given, 1.0)
        triangles = read_mesh(path)*float(scale)
        kind = f"mesh {name}"
        drawing.meshes[kind] = triangles
        colour = next((piece.colour for piece in bodies[name].pieces), "#9AA0A6")
        bodies[name].pieces = [Piece(kind, (1.0, 1.0, 1.0), colour, reach=float(np.linalg.norm(triangles, axis=2).max()))]
