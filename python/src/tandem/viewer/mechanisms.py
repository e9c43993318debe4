# SPDX-License-Identifier: MIT
"""The picture of a mechanism: bodies by the shapes of the scene, otherwise by their points and joints, otherwise by mass and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .arrows import add_arrows
from .drawing import BLUE, COLOURS, DARK, GREY, ORANGE, Body, Drawing, Piece, Spring, Track, bar, wheel
from .expressions import Numbers, evaluate, written_out
from .rotations import IDENTITY, carrying, conjugate, continuous, from_angle, from_matrix, from_vector, normalised, product, turned


class Mechanism:
    """The elements of a scene with their numbers, and the places of the drawing in the axes of the bodies."""

    def __init__(self, result, times: np.ndarray, values: dict[str, np.ndarray]):
        scene = result.scene
        self.result, self.times, self.values = result, times, values
        self.numbers = Numbers(scene.get("parameters", {}))
        self.elements = written_out(scene, self.numbers)
        self.planar = bool(scene.get("scene", {}).get("planar", False))
        self.ground_points = scene.get("ground", {}).get("points", {})
        self.gravity = self.vector(scene.get("gravity", {}).get("vector", [0, 0, 0]))
        # Poses of the bodies in the reference configuration, in which `at` and `axis` are given.
        self.drawn: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for name, keys in self.elements["body"].items():
            self.drawn[name] = self.vector(keys.get("position", [0, 0, 0])), self.drawn_turn(keys)
        self.bodies = {name: Body(name, *self.poses(name)) for name in self.elements["body"]}
        # Points of bodies at which something is attached, which give a body its looks where it has no shape.
        self.attached: dict[str, list[np.ndarray]] = {name: [] for name in self.bodies}

    # --- numbers and places ----------------------------------------------------------------------------------------------

    def vector(self, given: Any) -> np.ndarray:
        values = self.numbers.list(given)
        return np.array((values + [0.0, 0.0, 0.0])[:3])

    def drawn_turn(self, keys: dict) -> np.ndarray:
        if "euler_parameters" in keys:
            return normalised(self.numbers.list(keys["euler_parameters"]))
        if "rotation" in keys:
            return from_vector(self.numbers.list(keys["rotation"]))
        if "angle" in keys:
            return from_angle(self.numbers.number(keys["angle"]))
        return IDENTITY.copy()

    def poses(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Places and rotations of a body at the frames."""
        values, nf = self.values, len(self.times)
        axes = [values.get(f"{name}.{axis}", np.zeros(nf)) for axis in "xyz"]
        if f"{name}.angle" in values:
            turn = from_angle(values[f"{name}.angle"])
        elif f"{name}.e0" in values:
            turn = continuous(normalised(np.stack([values[f"{name}.e{i}"] for i in range(4)], axis=1)))
        else:
            turn = np.tile(IDENTITY, (nf, 1))
        return np.stack(axes, axis=1), turn

    def to_body(self, name: str, place: np.ndarray) -> np.ndarray:
        """A place of the drawing in the axes of a body."""
        if name not in self.drawn:
            return place
        at, turn = self.drawn[name]
        return turned(conjugate(turn), place - at)

    def axis_in(self, name: str, axis: np.ndarray) -> np.ndarray:
        return turned(conjugate(self.drawn[name][1]), axis) if name in self.drawn else axis

    def point(self, text: str) -> tuple[str, np.ndarray]:
        """A point `body`, `body.point` or `body:[x, y]` as its body and its place in the axes of that."""
        if ":" in text:
            name, place = text.split(":", 1)
            return name.strip(), self.vector([evaluate(one, self.numbers.known) for one in place.strip(" []").split(",")])
        if "." in text:
            name, point = text.split(".", 1)
            points = self.ground_points if name == "ground" else self.elements["body"][name].get("points", {})
            return name, self.vector(points[point])
        return text, np.zeros(3)

    def in_world(self, text: str) -> np.ndarray:
        """Position of a point in the reference configuration."""
        return self.from_body(*self.point(text))

    def from_body(self, name: str, place: np.ndarray) -> np.ndarray:
        """Position, in the reference configuration, of a point given in the axes of a body."""
        if name not in self.drawn:
            return place
        at, turn = self.drawn[name]
        return at + turned(turn, place)

    def track(self, text: str) -> np.ndarray:
        """Positions of a point at the frames."""
        name, place = self.point(text)
        return self.bodies[name].point(place) if name in self.bodies else np.tile(place, (len(self.times), 1))

    def attach(self, name: str, place: np.ndarray) -> None:
        if name in self.attached and not any(np.allclose(place, other, atol=1e-12) for other in self.attached[name]):
            self.attached[name].append(place)

    def joint_place(self, keys: dict) -> np.ndarray | None:
        """Position of a joint in the reference configuration."""
        at = keys.get("at")
        if isinstance(at, str):
            return self.in_world(at)
        if at is not None:
            return self.vector(at)
        named = [text for text in keys.get("bodies", []) if "." in text or ":" in text]
        return self.in_world(named[0]) if named else None

    def joint_ends(self, keys: dict) -> list[tuple[str, np.ndarray | None]]:
        """The bodies of a joint, each with the joint's place in its axes: that of its own point, else of where the joint is in the
        drawing. The two sides need not meet in a drawing that is assembled."""
        place, ends = self.joint_place(keys), []
        for text in keys.get("bodies", []):
            name, local = self.point(text)
            if "." in text or ":" in text:
                ends.append((name, local))
            else:
                ends.append((name, None if place is None else self.to_body(name, place)))
        return ends


def draw_mechanism(result, times: np.ndarray, values: dict[str, np.ndarray]) -> Drawing:
    """The drawing of a result whose model is a mechanism."""
    found = Mechanism(result, times, values)
    drawing = Drawing(result.name, times, planar=found.planar)
    joints = find_joints(found)
    for name, keys in found.elements["body"].items():
        for place in (keys.get("points") or {}).values():
            found.attach(name, found.vector(place))
    springs = [(name, [found.point(text) for text in keys["between"]]) for name, keys in found.elements["force"].items()
               if keys.get("type") == "spring"]
    for _, ends in springs:
        for name, place in ends:
            found.attach(name, place)
    rods = [(name, [found.point(text) for text in keys["between"]]) for name, keys in found.elements["constraint"].items()
            if keys.get("type") == "distance" and len(keys.get("between", [])) == 2]
    size = extent(found)
    anchors = [found.from_body(body, place) for _, _, ends in joints for body, place in ends if place is not None]
    anchors += [place for _, ends in [*springs, *rods] for body, place in ends if body not in found.bodies]
    drawing.extent = extent(found, anchors)
    size = max(size, min(drawing.extent, 3*size))
    wheeled = add_wheels(found, drawing, size)
    for i, (name, keys) in enumerate(found.elements["body"].items()):
        give_looks(found, found.bodies[name], keys, COLOURS[i % len(COLOURS)], size, name in wheeled)
    drawing.bodies = [*found.bodies.values()]
    add_joints(found, drawing, joints, size)
    for name, ends in springs:
        drawing.springs.append(Spring(name, tuple("" if body not in found.bodies else body for body, _ in ends),
                                      tuple(place for _, place in ends), 0.03*size))
    for name, ends in rods:
        drawing.springs.append(Spring(name, tuple("" if body not in found.bodies else body for body, _ in ends),
                                      tuple(place for _, place in ends), 0.0))
    add_sensors(found, drawing)
    add_arrows(found, drawing, joints)
    if np.linalg.norm(found.gravity) > 0:
        drawing.up = -found.gravity/np.linalg.norm(found.gravity)
    place_ground(found, drawing)
    return drawing


def find_joints(found: Mechanism) -> list[tuple[str, dict, list[tuple[str, np.ndarray | None]]]]:
    """Each joint with its bodies and its place in their axes; the points are attached to the bodies."""
    joints = []
    for name, keys in found.elements["joint"].items():
        ends = found.joint_ends(keys)
        for body, place in ends:
            if place is not None:
                found.attach(body, place)
        joints.append((name, keys, ends))
    for keys in found.elements["constraint"].values():
        if keys.get("type") == "distance":
            for text in keys.get("between", []):
                found.attach(*found.point(text))
    return joints


def extent(found: Mechanism, anchors: Sequence[np.ndarray] = ()) -> float:
    """Size of the mechanism in the reference configuration, without its travel; and the positions of its joints on the ground."""
    places = [*anchors, *(found.drawn[name][0] for name in found.drawn)]
    places += [found.in_world(name) + turned(found.drawn[name][1], place) for name in found.attached for place in found.attached[name]]
    places += [np.array(found.drawn[name][0]) + reach for name, keys in found.elements["body"].items() for reach in shape_reach(found, keys)]
    radii = [max(found.numbers.list(keys.get("radius", keys.get("semi_axes", 0)))) for keys in found.elements["wheel"].values()]
    span = float(np.max(np.ptp(places, axis=0))) if places else 0.0
    travel = max(float(np.max(np.ptp(body.place, axis=0))) for body in found.bodies.values()) if found.bodies else 0.0
    return max(span, 2*max(radii, default=0.0)) or min(1.0, travel) or 1.0


def shape_reach(found: Mechanism, keys: dict) -> list[np.ndarray]:
    reach = []
    for kind, sizes in (keys.get("shape") or {}).items():
        numbers = found.numbers.list(sizes)
        half = max(numbers)/2 if kind != "sphere" else numbers[0]
        reach += [np.full(3, half), np.full(3, -half)]
    return reach


def give_looks(found: Mechanism, body: Body, keys: dict, colour: str, size: float, is_wheel: bool) -> None:
    """The pieces of a body."""
    shape = keys.get("shape") or {}
    for kind, sizes in shape.items():
        numbers = found.numbers.list(sizes)
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
    ends = found.attached[body.name]
    reach = max((float(np.linalg.norm(place)) for place in ends), default=0.0)
    if reach > 0.01*size:
        # Bars to the points of attachment, from one point to the next if they lie in a row, otherwise from the centre.
        radius = 0.012*size
        outer = [place for place in ends if np.linalg.norm(place) > 1e-9*size]
        body.pieces += [bar(np.zeros(3), place, radius, colour) for place in outer]
        body.pieces.append(Piece("sphere", (1.8*radius,)*3, colour))
        if len(outer) > 1:
            return
    mass = found.numbers.number(keys.get("mass", 0)) if "mass" in keys else 0.0
    edges = edges_of(found, keys, mass)
    if edges is not None and not is_wheel and reach <= 0.01*size:
        sizes, turn = edges
        # A box of the same inertia, no larger than the mechanism.
        sizes = np.maximum(sizes, 0.01*size) * min(1.0, 1.5*size/max(sizes.max(), 1e-300) if len(found.bodies) > 1 else 1.0)
        body.pieces.append(Piece("box", tuple(sizes), colour, turn=turn))
    elif mass > 0 and reach <= 0.01*size:
        total = sum(found.numbers.number(one.get("mass", 0)) for one in found.elements["body"].values() if "mass" in one) or mass
        radius = 0.09*size*max(0.3, (mass/total)**(1/3))
        body.pieces.append(Piece("sphere", (radius,)*3, colour))
    elif not body.pieces:
        body.pieces.append(Piece("sphere", (0.015*size,)*3, colour))


def edges_of(found: Mechanism, keys: dict, mass: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The edges of a box of the same mass and inertia, and how it is turned in the body; None for a point mass."""
    inertia = found.numbers.list(keys["inertia"]) if "inertia" in keys else []
    if mass <= 0 or not inertia or max(inertia) <= 0:
        return None
    if found.planar:
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


def add_wheels(found: Mechanism, drawing: Drawing, size: float) -> set[str]:
    """Wheels, their pieces and the tracks that they leave; the names of bodies that are wheels."""
    wheeled = set()
    for name, keys in found.elements["wheel"].items():
        text = keys["at"]
        if not isinstance(text, str):
            continue
        body_name, centre = found.point(text)
        if body_name not in found.bodies:
            continue
        body, kind = found.bodies[body_name], keys.get("type")
        found.attach(body_name, centre)
        if kind == "knife_edge":
            across = found.axis_in(body_name, found.vector(keys.get("across", [0, 1, 0])))
            add_knife_edge(found, body, centre, across, keys, size)
            drawing.tracks.append(Track(name, body.point(centre), DARK, True))
            continue
        normal = found.vector(keys.get("normal", [0, 0, 1]))
        normal = normal/np.linalg.norm(normal)
        if kind == "massless":
            add_massless_wheel(found, drawing, name, body, centre, keys, normal)
            continue
        wheeled.add(body_name)
        if kind == "disk":
            radius = found.numbers.number(keys["radius"])
            axis = found.axis_in(body_name, found.vector(keys.get("axis", [0, 1, 0])))
            body.pieces += wheel(radius, BLUE, axis, centre)
            contact = disk_contact(body, centre, axis, radius, normal, found.numbers.number(keys.get("crown", 0)))
        else:
            axes = found.numbers.list(keys["semi_axes"]) if kind == "ellipsoid" else [found.numbers.number(keys["radius"])]*3
            if kind == "ellipsoid" or not found.elements["body"][body_name].get("shape"):
                body.pieces.append(Piece("sphere", tuple(axes), BLUE, centre))
                for turn in (IDENTITY, carrying([1, 0, 0])):
                    around = turned(conjugate(turn), np.array(axes))
                    body.pieces.append(Piece("rim", tuple(np.abs(around)*1.002), ORANGE, centre, turn))
            contact = ellipsoid_contact(body, centre, np.array(axes), normal)
        drawing.tracks.append(Track(name, contact, DARK, True))
        add_plane(found, drawing, name, keys, normal, size)
    return wheeled


def add_knife_edge(found: Mechanism, body: Body, centre: np.ndarray, across: np.ndarray, keys: dict, size: float) -> None:
    """A small wheel without slip along `across`; steered wheels are shown as in the reference configuration."""
    radius = 0.04*size
    up = np.array([0.0, 0, 1]) if found.planar else found.axis_in(body.name, np.array([0.0, 0, 1]))
    along = np.cross(across, up)
    if np.linalg.norm(along) < 1e-9:
        return
    body.pieces.append(Piece("cylinder", (radius, radius, 0.4*radius), DARK, centre, carrying(across)))


def add_massless_wheel(found: Mechanism, drawing: Drawing, name: str, body: Body, centre: np.ndarray, keys: dict,
                       normal: np.ndarray) -> None:
    """A wheel that is not a body of the mechanism, at the position given by its strut and its steering."""
    along = found.axis_in(body.name, found.vector(keys.get("along", [0, 0, 0])))
    pivot = found.axis_in(body.name, found.vector(keys.get("about", keys.get("along", [0, 0, 1]))))
    length = np.linalg.norm(along)
    way = found.values[f"{name}.displacement"] if length > 0 else np.zeros(len(found.times))
    place = body.place + turned(body.turn, centre + way[:, None]*along/(length or 1.0))
    try:
        half = np.array([found.numbers.at(keys["steer"], float(t)) for t in found.times])/2 if "steer" in keys else 0*way
    except ValueError:
        half = 0*way
    pivot = pivot/np.linalg.norm(pivot)
    steered = np.stack([np.cos(half), *(np.sin(half)*pivot[i] for i in range(3))], axis=1)
    axis = found.axis_in(body.name, found.vector(keys["axis"]))
    radius = found.numbers.number(keys["radius"])
    carried = Body(name, place, product(body.turn, steered))
    carried.pieces += wheel(radius, BLUE, axis, np.zeros(3))
    found.bodies[name] = carried
    contact = disk_contact(carried, np.zeros(3), axis, radius, normal, found.numbers.number(keys.get("crown", 0)))
    drawing.tracks.append(Track(name, contact, DARK, True))


def add_plane(found: Mechanism, drawing: Drawing, name: str, keys: dict, normal: np.ndarray, size: float) -> None:
    """A plane that turns, rises or slides, as a plate below the wheel."""
    if not any(key in keys for key in ("rotation", "rise", "slide")):
        return
    frames = found.times
    pivot = found.vector(keys.get("pivot", [0, 0, 0]))
    height = found.numbers.number(keys.get("height", 0))

    def over_time(key):
        try:
            return np.array([found.numbers.at(keys[key], float(t)) for t in frames]) if key in keys else np.zeros(len(frames))
        except ValueError:
            return np.zeros(len(frames))

    rise, turn, slide = over_time("rise"), over_time("rotation"), over_time("slide")
    along = found.vector(keys.get("along", [1, 0, 0]))
    base = pivot - normal*(pivot @ normal) + normal*height
    place = base + rise[:, None]*normal + slide[:, None]*along
    turns = np.stack([np.cos(turn/2), *(np.sin(turn/2)*normal[i] for i in range(3))], axis=1)
    reach = max(float(np.max(np.linalg.norm(body.place - base, axis=1))) for body in found.bodies.values())*1.15 + 0.2*size
    flat = carrying(normal)
    plate = Body(f"plane of {name}", place, turns)
    thin = 0.004*reach
    if "rotation" in keys:
        plate.pieces.append(Piece("cylinder", (reach, reach, thin), "#D7DBDF", -normal*thin, flat))
    else:
        plate.pieces.append(Piece("box", (2*reach, 2*reach, thin), "#D7DBDF", -normal*thin, flat))
    plate.pieces.append(Piece("box", (2*reach, 0.01*reach, thin), GREY, -normal*0.4*thin, flat))
    plate.pieces.append(Piece("box", (0.01*reach, 2*reach, thin), GREY, -normal*0.4*thin, flat))
    found.bodies[plate.name] = plate


def disk_contact(body: Body, centre, axis, radius: float, normal: np.ndarray, crown: float = 0.0) -> np.ndarray:
    """Contact point of a disk with its plane: r - R (n - (a.n) a)/|n - (a.n) a| - c n."""
    axis = np.asarray(axis, dtype=float)/np.linalg.norm(axis)
    a = turned(body.turn, np.broadcast_to(axis, body.place.shape))
    down = normal - (a @ normal)[:, None]*a
    size = np.linalg.norm(down, axis=1, keepdims=True)
    return body.point(centre) - (radius - crown)*down/np.where(size > 1e-12, size, np.nan) - crown*normal


def ellipsoid_contact(body: Body, centre, axes: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Contact point of an ellipsoid with its plane: D^2 m/|D m| from its centre, m downwards in the axes of the body."""
    m = turned(conjugate(body.turn), np.broadcast_to(-normal, body.place.shape))
    size = np.linalg.norm(axes*m, axis=1, keepdims=True)
    return body.point(centre) + turned(body.turn, axes**2*m/size)


def add_joints(found: Mechanism, drawing: Drawing, joints: list, size: float) -> None:
    """A marker for each joint, on its second body, or the first where that is the ground."""
    radius = 0.016*size
    for _, keys, ends in joints:
        carriers = [(name, place) for name, place in reversed(ends) if name in found.bodies and place is not None]
        if not carriers:
            continue
        body, at = found.bodies[carriers[0][0]], carriers[0][1]
        colour = ORANGE if len(carriers) > 1 else DARK
        kind = keys.get("type", "")
        axis = found.vector(keys["axis"]) if "axis" in keys else np.array([0.0, 0, 1])
        turn = carrying(found.axis_in(body.name, axis))
        if kind in ("spherical", "universal", "gimbal", "point_on_plane", "point_on_line", "planar"):
            body.pieces.append(Piece("sphere", (radius,)*3, colour, at))
        elif kind in ("prismatic", "cylindrical", "screw") or kind == "fixed":
            if found.planar:
                turn = carrying(found.axis_in(body.name, found.vector(keys.get("axis", [1, 0, 0]))))
            body.pieces.append(Piece("box", (1.3*radius, 1.3*radius, 4*radius), colour, at, turn))
        else:
            body.pieces.append(Piece("cylinder", (radius, radius, 2.6*radius), colour, at, turn))


def add_sensors(found: Mechanism, drawing: Drawing) -> None:
    """Tracks of sensors of points."""
    k = 0
    for name, keys in found.elements["sensor"].items():
        if isinstance(keys.get("point"), str):
            drawing.tracks.append(Track(name, found.track(keys["point"]), COLOURS[k % len(COLOURS)]))
            k += 1


def place_ground(found: Mechanism, drawing: Drawing) -> None:
    """The ground at the plane of the wheels, otherwise below everything."""
    planes = [keys for keys in found.elements["wheel"].values() if keys.get("type") != "knife_edge"]
    moving = any(key in keys for keys in planes for key in ("rotation", "rise", "slide"))
    if planes and not moving:
        normal = found.vector(planes[0].get("normal", [0, 0, 1]))
        drawing.up = normal/np.linalg.norm(normal)
        drawing.ground = drawing.up*found.numbers.number(planes[0].get("height", 0))
        return
    low, high = drawing.bounds()
    if found.planar:
        depth = 0.08*extent(found)
        drawing.ground = np.array([0, 0, -depth])
        return
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    drawing.ground = drawing.up*((corners @ drawing.up).min() - 0.03*float(np.max(high - low)))


