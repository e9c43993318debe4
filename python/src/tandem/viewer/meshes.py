# SPDX-License-Identifier: MIT
"""Bodies that look as a file of triangles says: STL, as text or binary, and OBJ. Numbers are metres in the axes of the body, or other
lengths with a scale."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from .drawing import Drawing, Piece

#: A page of more triangles would be slow, and large.
MOST_TRIANGLES = 200_000
#: Larger files have more triangles, or other content.
MOST_BYTES = 100_000_000
VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_mesh(path: str | Path) -> np.ndarray:
    """The triangles of a file (nt, 3, 3)."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    # A file may grow while it is read.
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
    """Binary files contain the number of triangles, 50 bytes each; others are text."""
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
    """Reject more triangles than an animation shows, before they fill the memory."""
    if count > MOST_TRIANGLES:
        raise ValueError(f"it has more than {MOST_TRIANGLES} triangles; make it simpler")


def obj(data: bytes) -> np.ndarray:
    """Faces of more corners are fans of triangles."""
    places, triangles = [], []
    for line in io.BytesIO(data):
        words = line.decode().split(maxsplit=MOST_TRIANGLES + 3)
        if words[:1] == ["v"]:
            places.append([float(word) for word in words[1:4]])
            # Each triangle has three of its own at most.
            refuse_more(len(places)//3)
        elif words[:1] == ["f"]:
            refuse_more(len(words) - 3)
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            corners = [places[number - 1 if number > 0 else number] for number in numbers]
            triangles += [[corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1)]
            refuse_more(len(triangles))
    return np.array(triangles, dtype=float).reshape(-1, 3, 3)


def put_meshes(drawing: Drawing, meshes: dict[str, Any]) -> None:
    """Let bodies look as files say: of each a path, or a path and a scale."""
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
