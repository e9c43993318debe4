# SPDX-License-Identifier: MIT
"""Creates the drawing of a mechanism. A body is shown by the shape in the scene; without a shape by bars to its points and joints;
otherwise by its mass and inertia."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .arrows import add_arrows
from .drawing import BLUE, COLOURS, DARK, GREY, ORANGE, Body, Drawing, Piece, Spring, Track, bar, wheel
from .geometry import Element, End, Geometry
from .rotations import IDENTITY, rotation_onto, conjugate, from_matrix, product, rotated


def draw_mechanism(result, times: np.ndarray, values: dict[str, np.ndarray]) -> Drawing:
    """Create the drawing of a result whose model is a mechanism."""
    mechanism = Geometry(result, times, values)
    drawing = Drawing(result.name, times, planar=mechanism.planar)
    joints = mechanism.of("joint")
    rods = [one for one in mechanism.of("constraint") if one.type == "distance"]
    springs = [one for one in mechanism.of("force") if one.type == "spring"]
    for one in [*joints, *rods, *mechanism.of("point"), *springs]:
        for end in one.ends:
            mechanism.attach(end)
    size = extent(mechanism)
    anchors = [mechanism.in_world(end) for one in joints for end in one.ends]
    anchors += [end.position for one in [*springs, *rods] for end in one.ends if end.body not in mechanism.bodies]
    drawing.extent = extent(mechanism, anchors)
    size = max(size, min(drawing.extent, 3*size))
    wheeled = add_wheels(mechanism, drawing, size)
    shapes = {one.name: one for one in mechanism.of("shape")}
    for i, name in enumerate(mechanism.reference):
        add_pieces(mechanism, mechanism.bodies[name], shapes.get(name), COLOURS[i % len(COLOURS)], size, name in wheeled)
    drawing.bodies = [*mechanism.bodies.values()]
    add_joints(mechanism, joints, size)
    for one in [*springs, *rods]:
        drawing.springs.append(Spring(one.name, tuple("" if end.body not in mechanism.bodies else end.body for end in one.ends),
                                      tuple(end.position for end in one.ends), 0.03*size if one.table == "force" else 0.0))
    for k, one in enumerate(sensor for sensor in mechanism.of("sensor") if sensor.type == "point"):
        drawing.tracks.append(Track(one.name, mechanism.track(one.ends[0]), COLOURS[k % len(COLOURS)]))
    add_arrows(mechanism, drawing)
    if np.linalg.norm(mechanism.gravity) > 0:
        drawing.up = -mechanism.gravity/np.linalg.norm(mechanism.gravity)
    place_ground(mechanism, drawing)
    return drawing


def extent(mechanism: Geometry, anchors: Sequence[np.ndarray] = ()) -> float:
    """Size of the mechanism in the reference configuration, including given points on the ground; the motion is not included."""
    positions = [*anchors, *(position for position, _ in mechanism.reference.values())]
    for name, points in mechanism.attached.items():
        at, rotation = mechanism.reference[name]
        positions += [at + rotated(rotation, point) for point in points]
    for shape in mechanism.of("shape"):
        half = max(shape.ends[0].sizes)/(1 if shape.type == "sphere" else 2)
        positions += [mechanism.reference[shape.name][0] + side*half for side in (1, -1)]
    radii = [max(one.ends[0].sizes) for one in mechanism.of("wheel")]
    span = float(np.max(np.ptp(positions, axis=0))) if positions else 0.0
    travel = max(float(np.max(np.ptp(body.position, axis=0))) for body in mechanism.bodies.values()) if mechanism.bodies else 0.0
    return max(span, 2*max(radii, default=0.0)) or min(1.0, travel) or 1.0


def add_pieces(mechanism: Geometry, body: Body, shape: Element | None, colour: str, size: float, is_wheel: bool) -> None:
    """Add pieces to a body."""
    if shape is not None:
        a, b, _ = sizes = shape.ends[0].sizes
        if shape.type == "bar":
            body.pieces.append(Piece("box", (a, b, max(0.3*b, 0.005*size)), colour))
        elif shape.type == "box":
            body.pieces.append(Piece("box", tuple(sizes), colour))
        elif shape.type == "cylinder":
            body.pieces.append(Piece("cylinder", (a, a, b), colour))
            body.pieces.append(Piece("box", (1.8*a, 0.12*a, 1.02*b), DARK))
        else:
            body.pieces.append(Piece("sphere", (a,)*3, colour))
            body.pieces.append(Piece("rim", (a,)*3, DARK))
    if shape is not None or (is_wheel and body.pieces):
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
    mass = mechanism.mass[body.name]
    edges = edges_of(mechanism, body.name)
    if edges is not None and not is_wheel and reach <= 0.01*size:
        sizes, rotation = edges
        # A box with the same inertia, but not larger than the mechanism.
        sizes = np.maximum(sizes, 0.01*size) * min(1.0, 1.5*size/max(sizes.max(), 1e-300) if len(mechanism.bodies) > 1 else 1.0)
        body.pieces.append(Piece("box", tuple(sizes), colour, rotation=rotation))
    elif mass > 0 and reach <= 0.01*size:
        radius = 0.09*size*max(0.3, (mass/sum(mechanism.mass.values()))**(1/3))
        body.pieces.append(Piece("sphere", (radius,)*3, colour))
    elif not body.pieces:
        body.pieces.append(Piece("sphere", (0.015*size,)*3, colour))


def edges_of(mechanism: Geometry, name: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Edges of a box with the same mass and inertia, and its rotation in the axes of the body; None for a point mass."""
    mass, (xx, yy, zz, xy, xz, yz) = mechanism.mass[name], mechanism.inertia[name]
    if mass <= 0 or max(xx, yy, zz) <= 0:
        return None
    if mechanism.planar:
        length = np.sqrt(12*zz/mass/1.25)
        return np.array([length, length/2, length/8]), IDENTITY.copy()
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    squares = 6*(moments.sum() - 2*moments)/mass
    return np.sqrt(np.maximum(squares, 0)), from_matrix(axes)


def add_wheels(mechanism: Geometry, drawing: Drawing, size: float) -> set[str]:
    """Add the pieces and the tracks of wheels. Returns the names of the bodies that are wheels."""
    wheeled = set()
    planes = {one.name: one.ends[0] for one in mechanism.of("plane")}
    for one in mechanism.of("wheel"):
        end = one.ends[0]
        if end.body not in mechanism.bodies:
            continue
        body, centre = mechanism.bodies[end.body], end.position
        mechanism.attach(end)
        if one.type == "knife_edge":
            add_knife_edge(mechanism, body, end, size)
            drawing.tracks.append(Track(one.name, body.point(centre), DARK, True))
            continue
        plane, (radius, crown, _) = planes[one.name], end.sizes
        if one.type == "massless":
            body, centre = massless_wheel(mechanism, one), np.zeros(3)
            mechanism.bodies[one.name] = body
        else:
            wheeled.add(end.body)
        if one.type in ("disk", "massless"):
            body.pieces += wheel(radius, BLUE, end.axis, centre)
            contact = disk_contact(body, centre, end.axis, radius, plane.axis, crown)
        else:
            axes = end.sizes if one.type == "ellipsoid" else np.full(3, radius)
            if one.type == "ellipsoid" or mechanism.find("shape", end.body) is None:
                body.pieces.append(Piece("sphere", tuple(axes), BLUE, centre))
                for rotation in (IDENTITY, rotation_onto([1, 0, 0])):
                    around = rotated(conjugate(rotation), axes)
                    body.pieces.append(Piece("rim", tuple(np.abs(around)*1.002), ORANGE, centre, rotation))
            contact = ellipsoid_contact(body, centre, axes, plane.axis)
        drawing.tracks.append(Track(one.name, contact, DARK, True))
        if one.type != "massless":
            add_plane(mechanism, one.name, plane, size)
    return wheeled


def add_knife_edge(mechanism: Geometry, body: Body, end: End, size: float) -> None:
    """Add a small wheel with the axis across the edge. Steering is not shown."""
    radius = 0.04*size
    up = np.array([0.0, 0, 1])
    if not mechanism.planar:
        up = rotated(conjugate(mechanism.reference[body.name][1]), up)
    if np.linalg.norm(np.cross(end.axis, up)) >= 1e-9:
        body.pieces.append(Piece("cylinder", (radius, radius, 0.4*radius), DARK, end.position, rotation_onto(end.axis)))


def massless_wheel(mechanism: Geometry, one: Element) -> Body:
    """A wheel that is not a body of the mechanism; its pose follows from its strut and its steering."""
    end, strut, steering = one.ends[0], mechanism.find("strut", one.name), mechanism.find("steering", one.name)
    body, local = mechanism.bodies[end.body], np.tile(end.position, (len(mechanism.times), 1))
    if strut is not None:
        local = local + mechanism.values[f"{one.name}.displacement"][:, None]*strut.ends[0].axis
    pivot = np.zeros(3) if steering is None else steering.ends[0].axis
    half = mechanism.over_time(f"{one.name} steer")/2
    steered = np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None]*pivot], axis=1)
    return Body(one.name, body.position + rotated(body.rotation, local), product(body.rotation, steered))


def is_moving(mechanism: Geometry, name: str) -> bool:
    """True if the plane of a wheel rotates, rises or slides."""
    return any(f"{name} {how}" in mechanism.functions for how in ("rotation", "rise", "slide"))


def add_plane(mechanism: Geometry, name: str, plane: End, size: float) -> None:
    """Add a plate for a plane that rotates, rises or slides."""
    if not is_moving(mechanism, name):
        return
    base, normal = plane.position, plane.axis
    rise, rotation, slide = (mechanism.over_time(f"{name} {how}") for how in ("rise", "rotation", "slide"))
    position = base + rise[:, None]*normal + slide[:, None]*plane.sizes
    rotations = np.concatenate([np.cos(rotation/2)[:, None], np.sin(rotation/2)[:, None]*normal], axis=1)
    reach = max(float(np.max(np.linalg.norm(body.position - base, axis=1))) for body in mechanism.bodies.values())*1.15 + 0.2*size
    flat = rotation_onto(normal)
    plate = Body(f"plane of {name}", position, rotations)
    thin = 0.004*reach
    if f"{name} rotation" in mechanism.functions:
        plate.pieces.append(Piece("cylinder", (reach, reach, thin), "#D7DBDF", -normal*thin, flat))
    else:
        plate.pieces.append(Piece("box", (2*reach, 2*reach, thin), "#D7DBDF", -normal*thin, flat))
    plate.pieces.append(Piece("box", (2*reach, 0.01*reach, thin), GREY, -normal*0.4*thin, flat))
    plate.pieces.append(Piece("box", (0.01*reach, 2*reach, thin), GREY, -normal*0.4*thin, flat))
    mechanism.bodies[plate.name] = plate


def disk_contact(body: Body, centre, axis, radius: float, normal: np.ndarray, crown: float = 0.0) -> np.ndarray:
    """Contact point of a disk with its plane: r - R (n - (a.n) a)/|n - (a.n) a| - c n."""
    a = rotated(body.rotation, np.broadcast_to(axis, body.position.shape))
    down = normal - (a @ normal)[:, None]*a
    size = np.linalg.norm(down, axis=1, keepdims=True)
    return body.point(centre) - (radius - crown)*down/np.where(size > 1e-12, size, np.nan) - crown*normal


def ellipsoid_contact(body: Body, centre, axes: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Contact point of an ellipsoid with its plane: D^2 m/|D m| from its centre, where m points downwards in the axes of the body."""
    m = rotated(conjugate(body.rotation), np.broadcast_to(-normal, body.position.shape))
    size = np.linalg.norm(axes*m, axis=1, keepdims=True)
    return body.point(centre) + rotated(body.rotation, axes**2*m/size)


def add_joints(mechanism: Geometry, joints: list[Element], size: float) -> None:
    """Add a marker for each joint to its second body, or to the first one if the second is the ground."""
    radius = 0.016*size
    for one in joints:
        end = mechanism.carrier(one)
        if end is None:
            continue
        pieces, at = mechanism.bodies[end.body].pieces, end.position
        colour = ORANGE if all(end.body in mechanism.bodies for end in one.ends) else DARK
        if one.type in ("spherical", "universal", "gimbal", "point_on_plane", "point_on_line", "planar"):
            pieces.append(Piece("sphere", (radius,)*3, colour, at))
        elif one.type in ("prismatic", "cylindrical", "screw", "fixed"):
            pieces.append(Piece("box", (1.3*radius, 1.3*radius, 4*radius), colour, at, rotation_onto(end.axis)))
        else:
            pieces.append(Piece("cylinder", (radius, radius, 2.6*radius), colour, at, rotation_onto(end.axis)))


def place_ground(mechanism: Geometry, drawing: Drawing) -> None:
    """Set the ground: the plane of the wheels, otherwise a plane below all bodies."""
    planes = mechanism.of("plane")
    if planes and not any(is_moving(mechanism, one.name) for one in planes):
        plane = planes[0].ends[0]
        drawing.up = plane.axis
        drawing.ground = drawing.up*(drawing.up @ plane.position)
        return
    low, high = drawing.bounds()
    if mechanism.planar:
        drawing.ground = np.array([0, 0, -0.08*extent(mechanism)])
        return
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    drawing.ground = drawing.up*((corners @ drawing.up).min() - 0.03*float(np.max(high - low)))
