# SPDX-License-Identifier: MIT
"""Arrows for the forces and torques of a mechanism that are contained in the file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drawing import ARROWS, Arrow, Drawing
from ..motion import interpolated
from .rotations import rotated

if TYPE_CHECKING:
    from .mechanisms import Mechanism

#: Forces below this fraction of the largest force are rounding errors, and so are torques below this fraction of the largest force
#: times the size of the model.
LEAST = 1e-9


def add_arrows(found: Mechanism, drawing: Drawing, joints: list) -> None:
    """Add arrows for forces (N) and torques (N m), with components in the axes of the world. Points of action: the position of a joint,
    the contact point of a wheel, the second point of a distance or a spring, and the point of a load. Torques along the axis of a joint
    act at the joint."""
    positions = points_of_action(found, drawing, joints)
    made = []
    for kind in ("joints", "wheels", "constraints", "forces"):
        for name, whats in found.result.groups.get(kind, {}).items():
            made += arrows_of(found, name, whats, (kind, name), positions)
    for name, whats in found.result.sensors.items():
        sensor = found.elements["sensor"].get(name, {})
        kinds = ("forces",) if "force" in sensor else ("joints", "wheels", "constraints")
        element = sensor.get("reaction", sensor.get("force", name))
        made += arrows_of(found, name, whats, next(((kind, element) for kind in kinds if (kind, element) in positions), None), positions)
    force, torque = (max([arrow.largest for arrow in made if arrow.unit == unit] or [0.0]) for unit in ("N", "N m"))
    torque = max(torque, force*float(np.max(np.subtract(*drawing.bounds()[::-1]))))
    for arrow in made:
        if arrow.largest > LEAST*(torque if arrow.is_torque else force):
            arrow.colour = ARROWS[len(drawing.arrows) % len(ARROWS)]
            drawing.arrows.append(arrow)


def points_of_action(found: Mechanism, drawing: Drawing, joints: list) -> dict[tuple[str, str], tuple[str, np.ndarray, np.ndarray | None]]:
    """For each element: the body on which its force acts (the second of two bodies, or the wheel), the point of action at the frames,
    and the axis if the force or torque has one component."""
    positions: dict[tuple[str, str], tuple[str, np.ndarray, np.ndarray | None]] = {}
    axes = {}
    for name, keys, ends in joints:
        carrier, position = next(((body, position) for body, position in reversed(ends) if body in found.bodies and position is not None), ("", None))
        if position is None:
            continue
        body, on = found.bodies[carrier], ends[1][0] if len(ends) == 2 else ""
        positions["joints", name] = on, body.point(position), None
        # The axis is fixed in both bodies of the joint, so that either body can be used.
        axis = found.vector(keys["axis"]) if "axis" in keys else np.array([0.0, 0, 1])
        axis = found.axis_in_body(carrier, axis/(np.linalg.norm(axis) or 1.0))
        axes[name] = rotated(body.rotation, np.broadcast_to(axis, body.position.shape))
    contacts = {track.name: track.positions for track in drawing.tracks if track.is_contact}
    for name, keys in found.elements["wheel"].items():
        if name in contacts:
            positions["wheels", name] = found.point(keys["at"])[0], contacts[name], None
    for kind, group in (("constraint", "constraints"), ("force", "forces")):
        for name, keys in found.elements[kind].items():
            if len(keys.get("between", [])) == 2:
                on, second = found.point(keys["between"][1])
                if "at" in keys and on in found.bodies:
                    second = found.to_body(on, found.joint_position(keys))
                positions[group, name] = on, found.bodies[on].point(second) if on in found.bodies else found.track(keys["between"][1]), None
            elif "on" in keys:
                positions[group, name] = found.point(keys["on"])[0], found.track(keys["on"]), None
            elif ("joints", keys.get("joint")) in positions:
                on, position, _ = positions["joints", keys["joint"]]
                positions[group, name] = on, position, axes[keys["joint"]]
    return positions


def arrows_of(found: Mechanism, name: str, whats: dict, element: tuple[str, str] | None, positions: dict) -> list[Arrow]:
    """Arrows for the vectors among the series of an element, and for a force or torque along its axis, which is positive if it accelerates
    the coordinate of the joint."""
    if element not in positions:
        return []
    on, position, axis = positions[element]
    made = []
    for what, one in whats.items():
        if one.unit not in ("N", "N m") or "body" in what:
            continue
        values = interpolated(found.result.time, one.values.reshape(len(one.values), -1), None, None, found.times)
        if values.shape[1] == 1 and axis is not None and what in ("force", "torque"):
            values = values*axis
        if values.shape[1] == 3:
            made.append(Arrow(f"{name} {what}", position, values, "", one.unit, on))
    return made
