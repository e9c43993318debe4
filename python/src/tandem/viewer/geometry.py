# SPDX-License-Identifier: MIT
"""Geometry of a mechanism: the group /drawing of a file, and conversions between the world and the axes of bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..motion import interpolated
from .drawing import Body
from .rotations import IDENTITY, continuous, from_angle, normalised, rotated


@dataclass
class End:
    """Where an element is attached: the body ("ground" for the ground), and position (m), axis and sizes (m) in its axes."""

    body: str
    position: np.ndarray
    axis: np.ndarray
    sizes: np.ndarray


@dataclass
class Element:
    """An element: its table in the scene and its type, such as `joint` and `revolute`; its name; one or two ends. For a sensor of a
    reaction or a force also the name of the measured element."""

    table: str
    type: str
    name: str
    ends: list[End]
    measured: str = ""


class Geometry:
    """The bodies and elements of a result, with the poses of the bodies at the frames."""

    def __init__(self, result, times: np.ndarray, values: dict[str, np.ndarray]):
        drawing = result.drawing
        if "bodies" not in drawing:
            raise ValueError(f"{result.path or result.name} cannot be shown: it has no /drawing, because an earlier version of "
                             "tandem wrote it; run its scene again")
        self.result, self.times, self.values = result, times, values
        self.planar = bool(result.scene.get("scene", {}).get("planar", False))
        self.gravity = drawing["gravity"]
        names, numbers = drawing["body"], drawing["bodies"]
        self.mass = dict(zip(names, numbers[:, 0], strict=True))
        # xx, yy, zz, xy, xz, yz.
        self.inertia = dict(zip(names, numbers[:, 1:7], strict=True))
        # Poses of the bodies in the reference configuration.
        self.reference = {name: (row[7:10], row[10:14]) for name, row in zip(names, numbers, strict=True)}
        self.bodies = {name: Body(name, *self.poses(name)) for name in names}
        # Points of each body at which joints or other elements are attached; they define the drawing of a body without shapes.
        self.attached: dict[str, list[np.ndarray]] = {name: [] for name in self.bodies}
        self.elements: list[Element] = []
        for kind, name, row in zip(drawing["kind"], drawing["name"], drawing["elements"], strict=True):
            table, of_type, measured = (*kind.split(" ", 2), "", "")[:3]
            end = End(["ground", *names][int(row[0])], row[1:4], row[4:7], row[7:10])
            last = self.elements[-1] if self.elements else None
            if last is not None and (last.table, last.type, last.name) == (table, of_type, name) and table not in ("point", "sensor"):
                last.ends.append(end)
            else:
                self.elements.append(Element(table, of_type, name, [end], measured))
        self.functions = {name: 1 + 2*i for i, name in enumerate(drawing.get("function", ()))}

    def of(self, *tables: str) -> list[Element]:
        """Elements of some tables."""
        return [one for one in self.elements if one.table in tables]

    def find(self, table: str, name: str) -> Element | None:
        return next((one for one in self.elements if (one.table, one.name) == (table, name)), None)

    def over_time(self, name: str) -> np.ndarray:
        """Values at the frames of a function of time that steers a wheel or moves a plane; zero if there is none."""
        if name not in self.functions:
            return np.zeros(len(self.times))
        k, samples = self.functions[name], self.result.drawing["functions"]
        return interpolated(samples[:, 0], samples[:, k:k + 1], samples[:, k + 1:k + 2], None, self.times)[:, 0]

    def poses(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions and rotations of a body at the frames."""
        values, nf = self.values, len(self.times)
        axes = [values.get(f"{name}.{axis}", np.zeros(nf)) for axis in "xyz"]
        if f"{name}.angle" in values:
            rotation = from_angle(values[f"{name}.angle"])
        elif f"{name}.e0" in values:
            rotation = continuous(normalised(np.stack([values[f"{name}.e{i}"] for i in range(4)], axis=1)))
        else:
            rotation = np.tile(IDENTITY, (nf, 1))
        return np.stack(axes, axis=1), rotation

    def in_world(self, end: End) -> np.ndarray:
        """Position of an end in the reference configuration."""
        if end.body not in self.reference:
            return end.position
        at, rotation = self.reference[end.body]
        return at + rotated(rotation, end.position)

    def track(self, end: End) -> np.ndarray:
        """Positions of an end at the frames."""
        return self.bodies[end.body].point(end.position) if end.body in self.bodies else np.tile(end.position, (len(self.times), 1))

    def attach(self, end: End) -> None:
        """Record a point of a body at which an element is attached."""
        points = self.attached.get(end.body)
        if points is not None and not any(np.allclose(end.position, other, atol=1e-12) for other in points):
            points.append(end.position)

    def carrier(self, element: Element) -> End | None:
        """The end at the second body, or at the first one if the second is the ground; None if both are."""
        return next((end for end in reversed(element.ends) if end.body in self.bodies), None)
