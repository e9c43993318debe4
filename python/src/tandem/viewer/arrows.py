# SPDX-License-Identifier: MIT
"""Forces and torques of a mechanism as arrows, if the file contains them: bodies and points on which they act."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drawing import ARROWS, Arrow, Drawing
from ..motion import interpolated
from .rotations import turned

if TYPE_CHECKING:
    from .mechanisms import Mechanism

#: Forces below this part of the largest one, and torques below it times the size of the model, are rounding errors.
LEAST = 1e-9


def add_arrows(found: Mechanism, drawing: Drawing, joints: list) -> None:
    """Forces (N) and torques (N m), three components in the axes of the world: of joints at their place, of wheels where they touch, of
    distances and springs at the second point, of loads where they act; torsions about the axis of their joint."""
    places = places_of(found, drawing, joints)
    made = []
    for kind in ("joints", "wheels", "constraints", "forces"):
        for name, whats in found.result.groups.get(kind, {}).items():
            made += arrows_of(found, name, whats, (kind, name), places)
    for name, whats in found.result.sensors.items():
        sensor = found.elements["sensor"].get(name, {})
        kinds = ("forces",) if "force" in sensor else ("joints", "wheels", "constraints")
        element = sensor.get("reaction", sensor.get("force", name))
        made += arrows_of(found, name, whats, next(((kind, element) for kind in kinds if (kind, element) in places), None), places)
    force, torque = (max([arrow.largest for arrow in made if arrow.unit == unit] or [0.0]) for unit in ("N", "N m"))
    torque = max(torque, force*float(np.max(np.subtract(*drawing.bounds()[::-1]))))
    for arrow in made:
        if arrow.largest > LEAST*(torque if arrow.turns else force):
            arrow.colour = ARROWS[len(drawing.arrows) % len(ARROWS)]
            drawing.arrows.append(arrow)


def places_of(found: Mechanism, drawing: Drawing, joints: list) -> dict[tuple[str, str], tuple[str, np.ndarray, np.ndarray | None]]:
    """Of an element the body that its force acts on (the second of two, the wheel), where at the frames, and the axis of what is along one."""
    places: dict[tuple[str, str], tuple[str, np.ndarray, np.ndarray | None]] = {}
    axes = {}
    for name, keys, ends in joints:
        carrier, place = next(((body, place) for body, place in reversed(ends) if body in found.bodies and place is not None), ("", None))
        if place is None:
            continue
        body, on = found.bodies[carrier], ends[1][0] if len(ends) == 2 else ""
        places["joints", name] = on, body.point(place), None
        # A joint's axis lies in both of its bodies.
        axis = found.vector(keys["axis"]) if "axis" in keys else np.array([0.0, 0, 1])
        axis = found.axis_in(carrier, axis/(np.linalg.norm(axis) or 1.0))
        axes[name] = turned(body.turn, np.broadcast_to(axis, body.place.shape))
    contacts = {track.name: track.places for track in drawing.tracks if track.is_contact}
    for name, keys in found.elements["wheel"].items():
        if name in contacts:
            places["wheels", name] = found.point(keys["at"])[0], contacts[name], None
    for kind, group in (("constraint", "constraints"), ("force", "forces")):
        for name, keys in found.elements[kind].items():
            if len(keys.get("between", [])) == 2:
                on, second = found.point(keys["between"][1])
                if "at" in keys and on in found.bodies:
                    second = found.to_body(on, found.joint_place(keys))
                places[group, name] = on, found.bodies[on].point(second) if on in found.bodies else found.track(keys["between"][1]), None
            elif "on" in keys:
                places[group, name] = found.point(keys["on"])[0], found.track(keys["on"]), None
            elif ("joints", keys.get("joint")) in places:
                on, place, _ = places["joints", keys["joint"]]
                places[group, name] = on, place, axes[keys["joint"]]
    return places


def arrows_of(found: Mechanism, name: str, whats: dict, element: tuple[str, str] | None, places: dict) -> list[Arrow]:
    """The vectors among the series of an element, and the force or torque along its axis, positive where it accelerates the joint's coordinate."""
    if element not in places:
        return []
    on, place, axis = places[element]
    made = []
    for what, one in whats.items():
        if one.unit not in ("N", "N m") or "body" in what:
            continue
        values = interpolated(found.result.time, one.values.reshape(len(one.values), -1), None, None, found.times)
        if values.shape[1] == 1 and axis is not None and what in ("force", "torque"):
            values = values*axis
        if values.shape[1] == 3:
            made.append(Arrow(f"{name} {what}", place, values, "", one.unit, on))
    return made
