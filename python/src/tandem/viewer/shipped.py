# SPDX-License-Identifier: MIT
"""Drawings of the shipped models from the paper, and of other models according to the names of their coordinates."""

from __future__ import annotations

import re

import numpy as np

from .drawing import BLUE, COLOURS, DARK, GREY, ORANGE, SKY, Body, Drawing, Piece, Spring, Track, bar, wheel
from .rotations import IDENTITY, rotation_onto, continuous, from_angle, normalised, product, rotated


def spatial(values: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    position = np.stack([values[f"r{axis}"] for axis in "xyz"], axis=1)
    return position, continuous(normalised(np.stack([values[f"e{i}"] for i in range(4)], axis=1)))


def along_path(position: np.ndarray) -> np.ndarray:
    """Distance travelled in the x, y plane."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1))])


def about(axis, angle: np.ndarray) -> np.ndarray:
    """Rotations about a fixed axis."""
    axis = np.asarray(axis, dtype=float)/np.linalg.norm(axis)
    return np.concatenate([np.cos(angle/2)[:, None], np.sin(angle/2)[:, None]*axis], axis=1)


def steering(model: dict, times: np.ndarray, sign: float) -> np.ndarray:
    """Steering angle: one period of a sine, then zero."""
    frequency = model.get("frequency", 1.0)
    if frequency == 0:
        return np.zeros_like(times)
    phase = frequency*(times - times[0])
    return np.where(phase <= 2*np.pi, sign*model.get("amplitude", 0.0)*np.sin(phase), 0.0)


def draw_disk(result, times, values) -> Drawing:
    radius = result.scene["model"].get("radius", 1.0)
    position, rotation = spatial(values)
    disk = Body("disk", position, rotation, wheel(radius, BLUE, (1, 0, 0)))
    contact = position + rotated(rotation, np.stack([np.zeros(len(times)), values["a1"], values["a2"]], axis=1))
    return Drawing(result.name, times, [disk], tracks=[Track("contact", contact, DARK, True), Track("centre", position, ORANGE)],
                   ground=np.zeros(3))


def draw_vehicle(result, times, values) -> Drawing:
    model = result.scene["model"]
    half = model.get("half_length", 3.0)
    rotation = about((0, 0, 1), steering(model, times, 1.0))
    bodies, high = [], 0.16*half
    for number, colour in (("1", BLUE), ("2", ORANGE)):
        position = np.stack([values[f"x{number}"], values[f"y{number}"], np.full(len(times), 2*high)], axis=1)
        body = Body("front chassis" if number == "1" else "rear chassis", position, from_angle(values[f"phi{number}"]))
        body.pieces.append(Piece("box", (1.5*half, 0.62*half, 0.3*half), colour, np.array([0, 0, 0.05*half])))
        body.pieces.append(bar([-half, 0, -high*0.6], [half, 0, -high*0.6], 0.03*half, DARK))
        bodies.append(body)
    front, rear = bodies
    low = np.array([0, 0, -high])
    bodies += rolling(front, "front wheels", np.array([half, 0, 0]) + low, high, 0.3*half, rotation, (0, 1, 0))
    bodies += rolling(front, "joint wheels", np.array([-half, 0, 0]) + low, high, 0.3*half, None, (0, 1, 0))
    bodies += rolling(rear, "rear wheels", np.array([-half, 0, 0]) + low, high, 0.3*half, None, (0, 1, 0))
    front.pieces.append(Piece("cylinder", (0.05*half, 0.05*half, 0.4*half), DARK, np.array([-half, 0, 0])))
    tracks = [Track("front axle", front.point([half, 0, -2*high]), DARK, True), Track("rear axle", rear.point([-half, 0, -2*high]), GREY, True)]
    return Drawing(result.name, times, bodies, tracks=tracks, ground=np.zeros(3))


def rolling(body: Body, name: str, at: np.ndarray, radius: float, half_track: float, rotation: np.ndarray | None, axis) -> list[Body]:
    """Two wheels at the ends of an axle, or one if `half_track` is 0, which roll without slip."""
    axis = np.asarray(axis, dtype=float)
    made = []
    sides = ((f"{name}, left", half_track), (f"{name}, right", -half_track)) if half_track else ((name, 0.0),)
    for each, aside in sides:
        position = body.point(at + aside*axis)
        distance = along_path(position)
        own = body.rotation if rotation is None else product(body.rotation, rotation)
        made.append(Body(each, position, product(own, about(axis, distance/radius)), wheel(radius, SKY, axis, width=0.35*radius)))
    return made


def draw_motorcycle(result, times, values) -> Drawing:
    model = result.scene["model"]
    phi = model.get("fork_angle", 0.2)
    radius, back, half = model.get("wheel_radius", 0.3), model.get("rear_length", 0.6), model.get("half_track", 0.5)
    top = np.array([0.0, model.get("fork_forward", 0.6), model.get("fork_height", 0.6)])
    along = np.array([0.0, -np.sin(phi), np.cos(phi)])
    position, rotation = spatial(values)
    chassis = Body("chassis", position, rotation)
    axle = np.array([0.0, -back, 0.0])
    thick = 0.03
    chassis.pieces += [bar([-half, -back, 0], [half, -back, 0], thick, BLUE), bar(axle, [0, 0, 0], thick, BLUE),
                       bar([0, 0, 0], top, thick, BLUE), bar(axle, top*0.55 + axle*0.45 + [0, 0, 0.1], thick, BLUE),
                       Piece("box", (0.28, 0.5, 0.3), BLUE, np.array([0, -0.05, 0.05])),
                       Piece("box", (0.25, 0.45, 0.08), DARK, np.array([0, -0.3, 0.36])),
                       bar(top + [-0.3, -0.08, 0.08], top + [0.3, -0.08, 0.08], 0.6*thick, DARK)]
    steer = about(along, steering(model, times, -1.0))
    hub = top - values["s"][:, None]*along
    fork_place = position + rotated(rotation, hub)
    fork = Body("fork", fork_place, product(rotation, steer), [Piece("cylinder", (0.02, 0.02, 0.5), ORANGE, 0.25*along, rotation_onto(along))])
    front = Body("front wheel", fork_place, product(product(rotation, steer), about((1, 0, 0), -along_path(fork_place)/radius)),
                 wheel(radius, SKY, (1, 0, 0), width=0.12))
    bodies = [chassis, fork, front]
    for each in rolling(chassis, "rear wheel", axle, radius, half, None, (1, 0, 0)):
        # A wheel that travels along y rotates about the negative x axis.
        each.rotation = product(rotation, about((1, 0, 0), -along_path(each.position)/radius))
        bodies.append(each)
    contact = position + rotated(rotation, hub + front_contact(values, steer, along))
    tracks = [Track("front contact", contact, DARK, True), Track("centre", position, ORANGE)]
    spring = Spring("suspension", ("chassis", "fork"), (top, 0.28*along), 0.05)
    return Drawing(result.name, times, bodies, [spring], tracks, ground=np.zeros(3))


def front_contact(values: dict[str, np.ndarray], steer: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Vector from the centre of the front wheel to its contact point, in the axes of the chassis."""
    across = rotated(steer, np.broadcast_to(np.cross(along, [1.0, 0, 0]), (len(steer), 3)))
    return values["a1"][:, None]*across + values["a2"][:, None]*along


def draw_by_names(result, times, values) -> Drawing | None:
    """Create points and bodies from the coordinates NAME.x, NAME.y, NAME.z, NAME.angle and NAME.e0 to NAME.e3, or x, y, z. Returns None
    if there are none."""
    bodies, nf = [], len(times)
    groups: dict[str, set[str]] = {}
    for name in values:
        if match := re.fullmatch(r"(?:(.+)\.)?(x|y|z|angle|e[0-3])", name):
            groups.setdefault(match[1] or "", set()).add(match[2])
    size = 1.0
    for i, (name, parts) in enumerate(groups.items()):
        if not {"x", "y"} <= parts and not {"x", "z"} <= parts:
            continue
        prefix = f"{name}." if name else ""
        position = np.stack([values.get(prefix + axis, np.zeros(nf)) for axis in "xyz"], axis=1)
        size = max(1e-3, float(np.max(np.ptp(position, axis=0))))
        rotation = np.tile(IDENTITY, (nf, 1))
        piece = Piece("sphere", (0.05*size,)*3, COLOURS[i % len(COLOURS)])
        if "angle" in parts:
            rotation = from_angle(values[prefix + "angle"])
            piece = Piece("box", (0.2*size, 0.1*size, 0.05*size), COLOURS[i % len(COLOURS)])
        elif "e0" in parts:
            rotation = continuous(normalised(np.stack([values[f"{prefix}e{k}"] for k in range(4)], axis=1)))
            piece = Piece("box", (0.2*size, 0.1*size, 0.05*size), COLOURS[i % len(COLOURS)])
        bodies.append(Body(name or "point", position, rotation, [piece]))
    if not bodies:
        return None
    drawing = Drawing(result.name, times, bodies, planar=all("z" not in parts for parts in groups.values()))
    drawing.tracks = [Track(body.name, body.position, COLOURS[i % len(COLOURS)]) for i, body in enumerate(bodies)]
    # The sizes of the bodies are unknown, so that the view shows the complete motion.
    drawing.extent = max(float(np.max(np.ptp(body.position, axis=0))) for body in bodies)
    if drawing.planar:
        drawing.ground = np.array([0, 0, -0.1*size])
        drawing.up = np.array([0.0, 1, 0])
    return drawing


DRAW = {"rolling_disk": draw_disk, "articulated_vehicle": draw_vehicle, "motorcycle": draw_motorcycle}
