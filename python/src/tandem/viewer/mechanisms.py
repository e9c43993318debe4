# SPDX-License-Identifier: MIT
"""Creates the drawing of a mechanism. A body is shown by the shapes in the scene; without shapes by bars to its points and joints;
otherwise by its mass and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .arrows import add_arrows
from .drawing import BLUE, COLOURS, DARK, GREY, ORANGE, Body, Drawing, Piece, Spring, Track, bar, wheel
from .expressions import Numbers, evaluate, written_out
from .rotations import IDENTITY, rotation_onto, conjugate, continuous, from_angle, from_matrix, from_vector, normalised, product, rotated


class Mechanism:
    """The elements of a scene with evaluated numbers, and conversions between the world and the axes of bodies."""

    def __init__(self, result, times: np.ndarray, values: dict[str, np.ndarray]):
        scene = result.scene
        self.result, self.times, self.values = result, times, values
        self.numbers = Numbers(scene.get("parameters", {}))
        self.elements = written_out(scene, self.numbers)
        self.planar = bool(scene.get("scene", {}).get("planar", False))
        self.ground_points = scene.get("ground", {}).get("points", {})
        self.gravity = self.vector(scene.get("gravity", {}).get("vector", [0, 0, 0]))
        # Poses of the bodies in the reference configuration, in which `at` and `axis` are given.
        self.reference: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for name, keys in self.elements["body"].items():
            self.reference[name] = self.vector(keys.get("position", [0, 0, 0])), self.reference_rotation(keys)
        self.bodies = {name: Body(name, *self.poses(name)) for name in self.elements["body"]}
        # Points of each body at which joints or other elements are attached; they define the drawing of a body without shapes.
        self.attached: dict[str, list[np.ndarray]] = {name: [] for name in self.bodies}

    # --- numbers and positions ----------------------------------------------------------------------------------------------

    def vector(self, given: Any) -> np.ndarray:
        """Convert numbers or expressions to a vector of three components; missing ones are zero."""
        values = self.numbers.list(given)
        return np.array((values + [0.0, 0.0, 0.0])[:3])

    def reference_rotation(self, keys: dict) -> np.ndarray:
        """Rotation of a body in the reference configuration."""
        if "euler_parameters" in keys:
            return normalised(self.numbers.list(keys["euler_parameters"]))
        if "rotation" in keys:
            return from_vector(self.numbers.list(keys["rotation"]))
        if "angle" in keys:
            return from_angle(self.numbers.number(keys["angle"]))
        return IDENTITY.copy()

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

    def to_body(self, name: str, position: np.ndarray) -> np.ndarray:
        """Convert a position in the reference configuration to the axes of a body."""
        if name not in self.reference:
            return position
        at, rotation = self.reference[name]
        return rotated(conjugate(rotation), position - at)

    def axis_in_body(self, name: str, axis: np.ndarray) -> np.ndarray:
        """Convert an axis in the reference configuration to the axes of a body."""
        return rotated(conjugate(self.reference[name][1]), axis) if name in self.reference else axis

    def point(self, text: str) -> tuple[str, np.ndarray]:
        """Body of a point `body`, `body.point` or `body:[x, y]`, and position of the point in the axes of this body."""
        if ":" in text:
            name, position = text.split(":", 1)
            return name.strip(), self.vector([evaluate(one, self.numbers.known) for one in position.strip(" []").split(",")])
        if "." in text:
            name, point = text.split(".", 1)
            points = self.ground_points if name == "ground" else self.elements["body"][name].get("points", {})
            return name, self.vector(points[point])
        return text, np.zeros(3)

    def in_world(self, text: str) -> np.ndarray:
        """Position of a point in the reference configuration."""
        return self.from_body(*self.point(text))

    def from_body(self, name: str, position: np.ndarray) -> np.ndarray:
        """Convert a position in the axes of a body to the reference configuration."""
        if name not in self.reference:
            return position
        at, rotation = self.reference[name]
        return at + rotated(rotation, position)

    def track(self, text: str) -> np.ndarray:
        """Positions of a point at the frames."""
        name, position = self.point(text)
        return self.bodies[name].point(position) if name in self.bodies else np.tile(position, (len(self.times), 1))

    def attach(self, name: str, position: np.ndarray) -> None:
        """Record a point of a body at which an element is attached."""
        if name in self.attached and not any(np.allclose(position, other, atol=1e-12) for other in self.attached[name]):
            self.attached[name].append(position)

    def joint_position(self, keys: dict) -> np.ndarray | None:
        """Position of a joint in the reference configuration."""
        at = keys.get("at")
        if isinstance(at, str):
            return self.in_world(at)
        if at is not None:
            return self.vector(at)
        named = [text for text in keys.get("bodies", []) if "." in text or ":" in text]
        return self.in_world(named[0]) if named else None

    def joint_ends(self, keys: dict) -> list[tuple[str, np.ndarray | None]]:
        """Bodies of a joint, each with the position of the joint in its axes. The position is that of the point given for the body,
        otherwise that of the joint in the reference configuration. If the mechanism is assembled, the positions for the two bodies need
        not coincide in the reference configuration."""
        position, ends = self.joint_position(keys), []
        for text in keys.get("bodies", []):
            name, local = self.point(text)
            if "." in text or ":" in text:
                ends.append((name, local))
            else:
                ends.append((name, None if position is None else self.to_body(name, position)))
        return ends


def draw_mechanism(result, times: np.ndarray, values: dict[str, np.ndarray]) -> Drawing:
    """Create the drawing of a result whose model is a mechanism."""
    mechanism = Mechanism(result, times, values)
    drawing = Drawing(result.name, times, planar=mechanism.planar)
    joints = find_joints(mechanism)
    for name, keys in mechanism.elements["body"].items():
        for position in (keys.get("points") or {}).values():
            mechanism.attach(name, mechanism.vector(position))
    springs = [(name, [mechanism.point(text) for text in keys["between"]]) for name, keys in mechanism.elements["force"].items()
               if keys.get("type") == "spring"]
    for _, ends in springs:
        for name, position in ends:
            mechanism.attach(name, position)
    rods = [(name, [mechanism.point(text) for text in keys["between"]]) for name, keys in mechanism.elements["constraint"].items()
            if keys.get("type") == "distance" and len(keys.get("between", [])) == 2]
    size = extent(mechanism)
    anchors = [mechanism.from_body(body, position) for _, _, ends in joints for body, position in ends if position is not None]
    anchors += [position for _, ends in [*springs, *rods] for body, position in ends if body not in mechanism.bodies]
    drawing.extent = extent(mechanism, anchors)
    size = max(size, min(drawing.extent, 3*size))
    wheeled = add_wheels(mechanism, drawing, size)
    for i, (name, keys) in enumerate(mechanism.elements["body"].items()):
        add_pieces(mechanism, mechanism.bodies[name], keys, COLOURS[i % len(COLOURS)], size, name in wheeled)
    drawing.bodies = [*mechanism.bodies.values()]
    add_joints(mechanism, drawing, joints, size)
    for name, ends in springs:
        drawing.springs.append(Spring(name, tuple("" if body not in mechanism.bodies else body for body, _ in ends),
                                      tuple(position for _, position in ends), 0.03*size))
    for name, ends in rods:
        drawing.springs.append(Spring(name, tuple("" if body not in mechanism.bodies else body for body, _ in ends),
                                      tuple(position for _, position in ends), 0.0))
    add_sensors(mechanism, drawing)
    add_arrows(mechanism, drawing, joints)
    if np.linalg.norm(mechanism.gravity) > 0:
        drawing.up = -mechanism.gravity/np.linalg.norm(mechanism.gravity)
    place_ground(mechanism, drawing)
    return drawing


def find_joints(mechanism: Mechanism) -> list[tuple[str, dict, list[tuple[str, np.ndarray | None]]]]:
    """List the joints with their bodies and positions, and record the positions as attached points of the bodies."""
    joints = []
    for name, keys in mechanism.elements["joint"].items():
        ends = mechanism.joint_ends(keys)
        for body, position in ends:
            if position is not None:
                mechanism.attach(body, position)
        joints.append((name, keys, ends))
    for keys in mechanism.elements["constraint"].values():
        if keys.get("type") == "distance":
            for text in keys.get("between", []):
                mechanism.attach(*mechanism.point(text))
    return joints


def extent(mechanism: Mechanism, anchors: Sequence[np.ndarray] = ()) -> float:
    """Size of the mechanism in the reference configuration, including given points on the ground; the motion is not included."""
    positions = [*anchors, *(mechanism.reference[name][0] for name in mechanism.reference)]
    positions += [mechanism.in_world(name) + rotated(mechanism.reference[name][1], point)
                  for name, points in mechanism.attached.items() for point in points]
    positions += [np.array(mechanism.reference[name][0]) + reach
                  for name, keys in mechanism.elements["body"].items() for reach in shape_reach(mechanism, keys)]
    radii = [max(mechanism.numbers.list(keys.get("radius", keys.get("semi_axes", 0)))) for keys in mechanism.elements["wheel"].values()]
    span = float(np.max(np.ptp(positions, axis=0))) if positions else 0.0
    travel = max(float(np.max(np.ptp(body.position, axis=0))) for body in mechanism.bodies.values()) if mechanism.bodies else 0.0
    return max(span, 2*max(radii, default=0.0)) or min(1.0, travel) or 1.0


def shape_reach(mechanism: Mechanism, keys: dict) -> list[np.ndarray]:
    reach = []
    for kind, sizes in (keys.get("shape") or {}).items():
        numbers = mechanism.numbers.list(sizes)
        half = max(numbers)/2 if kind != "sphere" else numbers[0]
        reach += [np.full(3, half), np.full(3, -half)]
    return reach


def add_pieces(mechanism: Mechanism, body: Body, keys: dict, colour: str, size: float, is_wheel: bool) -> None:
    """Add pieces to a body."""
    shape = keys.get("shape") or {}
    for kind, sizes in shape.items():
        numbers = mechanism.numbers.list(sizes)
        if kind == "bar":
            body.pieces.append(Piece("box", (numbers[0], numbers[1], max(0.3*numbers[1], 0.005*size)), colour))
        elif kind == "box":
            body.pieces.append(Piece("box", tuple(numbers), colour))
        elif kind == "cylinder":
            body.pieces.append(Piece("cylinder", (numbers[0], numbers[0], numbers[1]), colour))
            body.pieces.append(Piece("box", (1.8*numbers[0], 0.12*numbers[0], 1.02*numbers[1]), DARK))
        elif kind == "sphere":
            body.pieces.append(Piece("sphere", (numbers[0],)*3, colour))
            body.pieces.append(Piece("rim", (numbers[0],)*3, DARK))
    if shape or (is_wheel and body.pieces):
        return
    ends = mechanism.attached[body.name]
    reach = max((float(np.linalg.norm(position)) for position in ends), default=0.0)
    if reach > 0.01*size:
        # Bars from the centre to the attached points.
        radius = 0.012*size
        outer = [position for position in ends if np.linalg.norm(position) > 1e-9*size]
        body.pieces += [bar(np.zeros(3), position, radius, colour) for position in outer]
        body.pieces.append(Piece("sphere", (1.8*radius,)*3, colour))
        if len(outer) > 1:
            return
    mass = mechanism.numbers.number(keys.get("mass", 0)) if "mass" in keys else 0.0
    edges = edges_of(mechanism, keys, mass)
    if edges is not None and not is_wheel and reach <= 0.01*size:
        sizes, rotation = edges
        # A box with the same inertia, but not larger than the mechanism.
        sizes = np.maximum(sizes, 0.01*size) * min(1.0, 1.5*size/max(sizes.max(), 1e-300) if len(mechanism.bodies) > 1 else 1.0)
        body.pieces.append(Piece("box", tuple(sizes), colour, rotation=rotation))
    elif mass > 0 and reach <= 0.01*size:
        total = sum(mechanism.numbers.number(one.get("mass", 0)) for one in mechanism.elements["body"].values() if "mass" in one) or mass
        radius = 0.09*size*max(0.3, (mass/total)**(1/3))
        body.pieces.append(Piece("sphere", (radius,)*3, colour))
    elif not body.pieces:
        body.pieces.append(Piece("sphere", (0.015*size,)*3, colour))


def edges_of(mechanism: Mechanism, keys: dict, mass: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Edges of a box with the same mass and inertia, and its rotation in the axes of the body; None for a point mass."""
    inertia = mechanism.numbers.list(keys["inertia"]) if "inertia" in keys else []
    if mass <= 0 or not inertia or max(inertia) <= 0:
        return None
    if mechanism.planar:
        length = np.sqrt(12*inertia[0]/mass/1.25)
        return np.array([length, length/2, length/8]), IDENTITY.copy()
    matrix = np.diag(inertia[:3])
    if len(inertia) == 6:
        for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), inertia[3:], strict=True):
            matrix[i, j] = matrix[j, i] = value
    moments, axes = np.linalg.eigh(matrix)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    squares = 6*(moments.sum() - 2*moments)/mass
    return np.sqrt(np.maximum(squares, 0)), from_matrix(axes)


def add_wheels(mechanism: Mechanism, drawing: Drawing, size: float) -> set[str]:
    """Add the pieces and the tracks of wheels. Returns the names of the bodies that are wheels."""
    wheeled = set()
    for name, keys in mechanism.elements["wheel"].items():
        text = keys["at"]
        if not isinstance(text, str):
            continue
        body_name, centre = mechanism.point(text)
        if body_name not in mechanism.bodies:
            continue
        body, kind = mechanism.bodies[body_name], keys.get("type")
        mechanism.attach(body_name, centre)
        if kind == "knife_edge":
            across = mechanism.axis_in_body(body_name, mechanism.vector(keys.get("across", [0, 1, 0])))
            add_knife_edge(mechanism, body, centre, across, keys, size)
            drawing.tracks.append(Track(name, body.point(centre), DARK, True))
            continue
        normal = mechanism.vector(keys.get("normal", [0, 0, 1]))
        normal = normal/np.linalg.norm(normal)
        if kind == "massless":
            add_massless_wheel(mechanism, drawing, name, body, centre, keys, normal)
            continue
        wheeled.add(body_name)
        if kind == "disk":
            radius = mechanism.numbers.number(keys["radius"])
            axis = mechanism.axis_in_body(body_name, mechanism.vector(keys.get("axis", [0, 1, 0])))
            body.pieces += wheel(radius, BLUE, axis, centre)
            contact = disk_contact(body, centre, axis, radius, normal, mechanism.numbers.number(keys.get("crown", 0)))
        else:
            axes = mechanism.numbers.list(keys["semi_axes"]) if kind == "ellipsoid" else [mechanism.numbers.number(keys["radius"])]*3
            if kind == "ellipsoid" or not mechanism.elements["body"][body_name].get("shape"):
                body.pieces.append(Piece("sphere", tuple(axes), BLUE, centre))
                for rotation in (IDENTITY, rotation_onto([1, 0, 0])):
                    around = rotated(conjugate(rotation), np.array(axes))
                    body.pieces.append(Piece("rim", tuple(np.abs(around)*1.002), ORANGE, centre, rotation))
            contact = ellipsoid_contact(body, centre, np.array(axes), normal)
        drawing.tracks.append(Track(name, contact, DARK, True))
        add_plane(mechanism, drawing, name, keys, normal, size)
    return wheeled


def add_knife_edge(mechanism: Mechanism, body: Body, centre: np.ndarray, across: np.ndarray, keys: dict, size: float) -> None:
    """Add a small wheel with the axis `across`. Steering is not shown."""
    radius = 0.04*size
    up = np.array([0.0, 0, 1]) if mechanism.planar else mechanism.axis_in_body(body.name, np.array([0.0, 0, 1]))
    along = np.cross(across, up)
    if np.linalg.norm(along) < 1e-9:
        return
    body.pieces.append(Piece("cylinder", (radius, radius, 0.4*radius), DARK, centre, rotation_onto(across)))


def add_massless_wheel(mechanism: Mechanism, drawing: Drawing, name: str, body: Body, centre: np.ndarray, keys: dict,
                       normal: np.ndarray) -> None:
    """Add a wheel that is not a body of the mechanism; its pose follows from its strut and its steering."""
    along = mechanism.axis_in_body(body.name, mechanism.vector(keys.get("along", [0, 0, 0])))
    pivot = mechanism.axis_in_body(body.name, mechanism.vector(keys.get("about", keys.get("along", [0, 0, 1]))))
    length = np.linalg.norm(along)
    displacement = mechanism.values[f"{name}.displacement"] if length > 0 else np.zeros(len(mechanism.times))
    position = body.position + rotated(body.rotation, centre + displacement[:, None]*along/(length or 1.0))
    try:
        half = np.array([mechanism.numbers.at(keys["steer"], float(t)) for t in mechanism.times])/2 if "steer" in keys else 0*displacement
    except ValueError:
        half = 0*displacement
    pivot = pivot/np.linalg.norm(pivot)
    steered = np.stack([np.cos(half), *(np.sin(half)*pivot[i] for i in range(3))], axis=1)
    axis = mechanism.axis_in_body(body.name, mechanism.vector(keys["axis"]))
    radius = mechanism.numbers.number(keys["radius"])
    carried = Body(name, position, product(body.rotation, steered))
    carried.pieces += wheel(radius, BLUE, axis, np.zeros(3))
    mechanism.bodies[name] = carried
    contact = disk_contact(carried, np.zeros(3), axis, radius, normal, mechanism.numbers.number(keys.get("crown", 0)))
    drawing.tracks.append(Track(name, contact, DARK, True))


def add_plane(mechanism: Mechanism, drawing: Drawing, name: str, keys: dict, normal: np.ndarray, size: float) -> None:
    """Add a plate for a plane that rotates, rises or slides."""
    if not any(key in keys for key in ("rotation", "rise", "slide")):
        return
    frames = mechanism.times
    pivot = mechanism.vector(keys.get("pivot", [0, 0, 0]))
    height = mechanism.numbers.number(keys.get("height", 0))

    def over_time(key):
        try:
            return np.array([mechanism.numbers.at(keys[key], float(t)) for t in frames]) if key in keys else np.zeros(len(frames))
        except ValueError:
            return np.zeros(len(frames))

    rise, rotation, slide = over_time("rise"), over_time("rotation"), over_time("slide")
    along = mechanism.vector(keys.get("along", [1, 0, 0]))
    base = pivot - normal*(pivot @ normal) + normal*height
    position = base + rise[:, None]*normal + slide[:, None]*along
    rotations = np.stack([np.cos(rotation/2), *(np.sin(rotation/2)*normal[i] for i in range(3))], axis=1)
    reach = max(float(np.max(np.linalg.norm(body.position - base, axis=1))) for body in mechanism.bodies.values())*1.15 + 0.2*size
    flat = rotation_onto(normal)
    plate = Body(f"plane of {name}", position, rotations)
    thin = 0.004*reach
    if "rotation" in keys:
        plate.pieces.append(Piece("cylinder", (reach, reach, thin), "#D7DBDF", -normal*thin, flat))
    else:
        plate.pieces.append(Piece("box", (2*reach, 2*reach, thin), "#D7DBDF", -normal*thin, flat))
    plate.pieces.append(Piece("box", (2*reach, 0.01*reach, thin), GREY, -normal*0.4*thin, flat))
    plate.pieces.append(Piece("box", (0.01*reach, 2*reach, thin), GREY, -normal*0.4*thin, flat))
    mechanism.bodies[plate.name] = plate


def disk_contact(body: Body, centre, axis, radius: float, normal: np.ndarray, crown: float = 0.0) -> np.ndarray:
    """Contact point of a disk with its plane: r - R (n - (a.n) a)/|n - (a.n) a| - c n."""
    axis = np.asarray(axis, dtype=float)/np.linalg.norm(axis)
    a = rotated(body.rotation, np.broadcast_to(axis, body.position.shape))
    down = normal - (a @ normal)[:, None]*a
    size = np.linalg.norm(down, axis=1, keepdims=True)
    return body.point(centre) - (radius - crown)*down/np.where(size > 1e-12, size, np.nan) - crown*normal


def ellipsoid_contact(body: Body, centre, axes: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Contact point of an ellipsoid with its plane: D^2 m/|D m| from its centre, where m points downwards in the axes of the body."""
    m = rotated(conjugate(body.rotation), np.broadcast_to(-normal, body.position.shape))
    size = np.linalg.norm(axes*m, axis=1, keepdims=True)
    return body.point(centre) + rotated(body.rotation, axes**2*m/size)


def add_joints(mechanism: Mechanism, drawing: Drawing, joints: list, size: float) -> None:
    """Add a marker for each joint to its second body, or to the first one if the second is the ground."""
    radius = 0.016*size
    for _, keys, ends in joints:
        carriers = [(name, position) for name, position in reversed(ends) if name in mechanism.bodies and position is not None]
        if not carriers:
            continue
        body, at = mechanism.bodies[carriers[0][0]], carriers[0][1]
        colour = ORANGE if len(carriers) > 1 else DARK
        kind = keys.get("type", "")
        axis = mechanism.vector(keys["axis"]) if "axis" in keys else np.array([0.0, 0, 1])
        rotation = rotation_onto(mechanism.axis_in_body(body.name, axis))
        if kind in ("spherical", "universal", "gimbal", "point_on_plane", "point_on_line", "planar"):
            body.pieces.append(Piece("sphere", (radius,)*3, colour, at))
        elif kind in ("prismatic", "cylindrical", "screw") or kind == "fixed":
            if mechanism.planar:
                rotation = rotation_onto(mechanism.axis_in_body(body.name, mechanism.vector(keys.get("axis", [1, 0, 0]))))
            body.pieces.append(Piece("box", (1.3*radius, 1.3*radius, 4*radius), colour, at, rotation))
        else:
            body.pieces.append(Piece("cylinder", (radius, radius, 2.6*radius), colour, at, rotation))


def add_sensors(mechanism: Mechanism, drawing: Drawing) -> None:
    """Add the tracks of points with sensors."""
    k = 0
    for name, keys in mechanism.elements["sensor"].items():
        if isinstance(keys.get("point"), str):
            drawing.tracks.append(Track(name, mechanism.track(keys["point"]), COLOURS[k % len(COLOURS)]))
            k += 1


def place_ground(mechanism: Mechanism, drawing: Drawing) -> None:
    """Set the ground: the plane of the wheels, otherwise a plane below all bodies."""
    planes = [keys for keys in mechanism.elements["wheel"].values() if keys.get("type") != "knife_edge"]
    moving = any(key in keys for keys in planes for key in ("rotation", "rise", "slide"))
    if planes and not moving:
        normal = mechanism.vector(planes[0].get("normal", [0, 0, 1]))
        drawing.up = normal/np.linalg.norm(normal)
        drawing.ground = drawing.up*mechanism.numbers.number(planes[0].get("height", 0))
        return
    low, high = drawing.bounds()
    if mechanism.planar:
        depth = 0.08*extent(mechanism)
        drawing.ground = np.array([0, 0, -depth])
        return
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    drawing.ground = drawing.up*((corners @ drawing.up).min() - 0.03*float(np.max(high - low)))


