# SPDX-License-Identifier: MIT
"""Writes a drawing as a glTF 2.0 file (.glb): one animated node per body, meshes of the unit shapes, and tracks as lines.

The y axis of glTF points upwards; a root node rotates the upward direction of the drawing to it. Rotations are stored as 16-bit
integers with an accuracy of 3e-5 rad."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from .drawing import Body, Drawing
from .rotations import rotation_onto, conjugate, normalised

FLOAT, SHORT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5122, 5123, 5125
VERTICES, INDICES = 34962, 34963
#: Largest number of points of a track; longer tracks are thinned out.
MOST_POINTS = 1000


def mesh_of(shape: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, normals and triangles of a unit shape."""
    if shape == "box":
        positions, normals, triangles = [], [], []
        for axis in range(3):
            for sign in (-1, 1):
                normal = np.zeros(3)
                normal[axis] = sign
                u, v = np.zeros(3), np.zeros(3)
                u[(axis + 1) % 3], v[(axis + 2) % 3] = 1, sign
                k = len(positions)
                positions += [0.5*(normal + a*u + b*v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
                normals += [normal]*4
                triangles += [[k, k + 1, k + 2], [k, k + 2, k + 3]]
        return np.array(positions), np.array(normals), np.array(triangles)
    if shape == "cylinder":
        return revolved([(0, -0.5, 0, -1), (1, -0.5, 0, -1), (1, -0.5, 1, 0), (1, 0.5, 1, 0), (1, 0.5, 0, 1), (0, 0.5, 0, 1)], 24, (0, 2, 4))
    if shape == "sphere":
        angles = np.linspace(-np.pi/2, np.pi/2, 13)
        return revolved([(np.cos(a), np.sin(a), np.cos(a), np.sin(a)) for a in angles], 24, range(12))
    angles = np.linspace(-np.pi, np.pi, 9)
    return revolved([(1 + 0.05*np.cos(a), 0.05*np.sin(a), np.cos(a), np.sin(a)) for a in angles], 40, range(8))


def revolved(profile, count: int, spans) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surface of revolution about z of a profile (r, z, normal in r, normal in z); `spans` are the segments with faces."""
    angles = np.linspace(0, 2*np.pi, count + 1)
    c, s = np.cos(angles), np.sin(angles)
    positions, normals, triangles = [], [], []
    for r, z, nr, nz in profile:
        positions.append(np.stack([r*c, r*s, np.full(count + 1, z)], axis=1))
        normals.append(np.stack([nr*c, nr*s, np.full(count + 1, nz)], axis=1))
    for i in spans:
        for k in range(count):
            a, b = i*(count + 1) + k, (i + 1)*(count + 1) + k
            # Triangles at a pole have no area and are omitted.
            if profile[i][0] > 1e-12:
                triangles.append([a, a + 1, b + 1])
            if profile[i + 1][0] > 1e-12:
                triangles.append([a, b + 1, b])
    return np.concatenate(positions), normalised_rows(np.concatenate(normals)), np.array(triangles)


def flat_mesh(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, normals and triangles of a mesh (nt, 3, 3)."""
    normals = normalised_rows(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))
    return triangles.reshape(-1, 3), np.repeat(normals, 3, axis=0), np.arange(3*len(triangles)).reshape(-1, 3)


def normalised_rows(vectors: np.ndarray) -> np.ndarray:
    return vectors/np.linalg.norm(vectors, axis=1, keepdims=True)


class Writer:
    """Collects buffers, accessors and the objects that refer to them."""

    def __init__(self, meshes: dict[str, np.ndarray]):
        # In meshes of files, triangles do not share corners, so that each triangle has its own normal.
        self.files = {name: flat_mesh(triangles) for name, triangles in meshes.items()}
        self.data = bytearray()
        self.views, self.accessors, self.meshes, self.materials = [], [], [], []
        self.known: dict = {}

    def accessor(self, values: np.ndarray, kind: int, type_: str, target: int | None = None, *, bounds: bool = False,
                 is_normalised: bool = False) -> int:
        """Store numbers in a new view, and return the index of a new accessor for it."""
        numbers = {FLOAT: np.float32, SHORT: np.int16, UNSIGNED_SHORT: np.uint16, UNSIGNED_INT: np.uint32}[kind]
        array = np.ascontiguousarray(values, dtype=numbers)
        self.data += b"\0"*(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        if target:
            view["target"] = target
        self.views.append(view)
        self.data += array.tobytes()
        made = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(array), "type": type_}
        if is_normalised:
            made["normalized"] = True
        if bounds:
            rows = array.reshape(len(array), -1)
            made |= {"min": [float(x) for x in rows.min(axis=0)], "max": [float(x) for x in rows.max(axis=0)]}
        self.accessors.append(made)
        return len(self.accessors) - 1

    def material(self, colour: str, is_line: bool = False) -> int:
        key = ("material", colour, is_line)
        if key not in self.known:
            srgb = np.array([int(colour[i:i + 2], 16)/255 for i in (1, 3, 5)])
            linear = np.where(srgb <= 0.04045, srgb/12.92, ((srgb + 0.055)/1.055)**2.4)
            self.materials.append({"name": colour, "pbrMetallicRoughness": {
                "baseColorFactor": [*map(float, linear.round(5)), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6}})
            self.known[key] = len(self.materials) - 1
        return self.known[key]

    def mesh(self, shape: str, colour: str) -> int:
        """Index of the mesh of a shape with a colour; meshes of the same shape share their buffers."""
        key = ("mesh", shape, colour)
        if key not in self.known:
            if shape not in self.known:
                positions, normals, triangles = self.files[shape] if shape in self.files else mesh_of(shape)
                self.known[shape] = (self.accessor(positions, FLOAT, "VEC3", VERTICES, bounds=True),
                                     self.accessor(normals, FLOAT, "VEC3", VERTICES),
                                     self.accessor(triangles.reshape(-1), UNSIGNED_INT if len(positions) > 65535 else UNSIGNED_SHORT, "SCALAR", INDICES))
            position, normal, index = self.known[shape]
            self.meshes.append({"name": f"{shape} {colour}", "primitives": [
                {"attributes": {"POSITION": position, "NORMAL": normal}, "indices": index, "material": self.material(colour)}]})
            self.known[key] = len(self.meshes) - 1
        return self.known[key]

    def line(self, name: str, positions: np.ndarray, colour: str) -> int:
        position = self.accessor(positions, FLOAT, "VEC3", VERTICES, bounds=True)
        self.meshes.append({"name": name, "primitives": [
            {"attributes": {"POSITION": position}, "mode": 3, "material": self.material(colour)}]})
        return len(self.meshes) - 1


def gltf_rotation(p) -> list[float]:
    """Rotation in the order of glTF: x, y, z, w."""
    p = normalised(p)
    return [float(p[1]), float(p[2]), float(p[3]), float(p[0])]


def glb(drawing: Drawing) -> bytes:
    """Contents of the file."""
    writer = Writer(drawing.meshes)
    nodes: list[dict] = [{"name": drawing.name or "motion", "children": [],
                          "rotation": gltf_rotation(conjugate(rotation_onto(drawing.up, (0.0, 1.0, 0.0))))}]
    animations: list[dict] = []
    times = drawing.times - drawing.times[0]
    clock = writer.accessor(times, FLOAT, "SCALAR", bounds=True) if drawing.bodies and len(times) > 1 else None

    def animate(take: str, node: int, body: Body) -> None:
        """Add the motion of a body to an animation."""
        found = [(path, values) for path, series, values in (
            ("translation", body.position, lambda: writer.accessor(body.position, FLOAT, "VEC3")),
            ("rotation", body.rotation, lambda: writer.accessor(np.rint(normalised(body.rotation)[:, [1, 2, 3, 0]]*32767), SHORT, "VEC4", is_normalised=True)))
            if np.ptp(series, axis=0).max() > 0]
        for path, values in found:
            if not animations or animations[-1]["name"] != take:
                animations.append({"name": take, "samplers": [], "channels": []})
            samplers, channels = animations[-1]["samplers"], animations[-1]["channels"]
            samplers.append({"input": clock, "output": values(), "interpolation": "LINEAR"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

    of_body = {}
    for body in drawing.bodies:
        node = len(nodes)
        nodes[0]["children"].append(node)
        own = {"name": body.name, "translation": [float(x) for x in body.position[0]], "rotation": gltf_rotation(body.rotation[0])}
        nodes.append(own)
        children = []
        for piece in body.pieces:
            children.append(len(nodes))
            nodes.append({"mesh": writer.mesh(piece.shape, piece.colour), "translation": [float(x) for x in piece.at],
                          "rotation": gltf_rotation(piece.rotation), "scale": [float(x) for x in piece.size]})
        if children:
            own["children"] = children
        of_body[body.name] = node
    for take, bodies in (drawing.takes or [("motion", drawing.bodies)]) if clock is not None else []:
        for body in bodies:
            animate(take, of_body[body.name], body)
    for track in drawing.tracks:
        positions = track.positions[np.isfinite(track.positions).all(axis=1)]
        positions = positions[::max(1, -(-len(positions)//MOST_POINTS))]
        if len(positions) > 1:
            nodes[0]["children"].append(len(nodes))
            nodes.append({"name": f"track of {track.name}", "mesh": writer.line(f"track of {track.name}", positions, track.colour)})
    if not nodes[0]["children"]:
        del nodes[0]["children"]
    content = {"asset": {"version": "2.0", "generator": "tandem"}, "scene": 0, "scenes": [{"name": drawing.name or "motion", "nodes": [0]}],
               "nodes": nodes}
    for name, values in (("meshes", writer.meshes), ("materials", writer.materials), ("accessors", writer.accessors),
                         ("bufferViews", writer.views)):
        if values:
            content[name] = values
    if animations:
        content["animations"] = animations
    if writer.data:
        writer.data += b"\0"*(-len(writer.data) % 4)
        content["buffers"] = [{"byteLength": len(writer.data)}]
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" "*(-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if writer.data:
        chunks += struct.pack("<I4s", len(writer.data), b"BIN\0") + bytes(writer.data)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def write_glb(drawing: Drawing, path: str | Path) -> None:
    Path(path).write_bytes(glb(drawing))
