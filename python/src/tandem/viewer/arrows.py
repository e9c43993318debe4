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

#: Forces below this fraction of the weight or of the largest force are rounding errors, and so are torques below this fraction of these
#: times the size of the model.
LEAST = 1e-9


def add_arrows(mechanism: Mechanism, drawing: Drawing, joints: list) -> None:
    """Add arrows for forces (N) and torques (N m), with components in the axes of the world, the largest of each first. Points of action:
    the position of a joint, the contact point of a wheel, the second point of a distance or a spring, and the point of a load. Torques
    along the axis of a joint act at the joint."""
    positions = points_of_action(mechanism, drawing, joints)
    arrows = []
    for kind in ("joints", "wheels", "constraints", "forces"):
        for name, series in mechanism.result.groups.get(kind, {}).items():
            arrows += arrows_of(mechanism, name, series, (kind, name), positions)
    for name, series in mechanism.result.sensors.items():
        sensor = mechanism.elements["sensor"].get(name, {})
        kinds = ("forces",) if "force" in sensor else ("joints", "wheels", "constraints")
        element = sensor.get("reaction", sensor.get("force", name))
        arrows += arrows_of(mechanism, name, series, next(((kind, element) for kind in kinds if (kind, element) in positions), None), positions)
    force, torque = (max([arrow.largest for arrow in arrows if arrow.is_torque == is_torque] or [0.0]) for is_torque in (False, True))
    force = max(force, weight(mechanism))
    torque = max(torque, force*float(np.max(np.subtract(*drawing.bounds()[::-1]))))
    for arrow in sorted(arrows, key=lambda arrow: (arrow.is_torque, -arrow.largest)):
        if arrow.largest > LEAST*(torque if arrow.is_torque else force):
            arrow.colour = ARROWS[len(drawing.arrows) % len(ARROWS)]
            drawing.arrows.append(arrow)


def weight(mechanism: Mechanism) -> float:
    """Of the bodies whose mass is given (N)."""
    masses = [mechanism.numbers.number(keys["mass"]) for keys in mechanism.elements["body"].values() if "mass" in keys]
    return float(np.linalg.norm(mechanism.gravity)*sum(masses))


def points_of_action(mechanism: Mechanism, drawing: Drawing, joints: list) -> dict[tuple[str, str], tuple[str, np.ndarray, np.ndarray | None]]:
    """For each element: the body on which its force acts (the second of two bodies, or the wheel), the point of action at the frames,
    and the axis if the force or torque has one component."""
    positions: dict[tuple[str, str], tuple[str, np.ndarray, np.ndarray | None]] = {}
    axes = {}
    for name, keys, ends in joints:
        carrier, position = next(((body, point) for body, point in reversed(ends) if body in mechanism.bodies and point is not None),
                                 ("", None))
        if position is None:
            continue
        body, on = mechanism.bodies[carrier], ends[1][0] if len(ends) == 2 else ""
        positions["joints", name] = on, body.point(position), None
        # The axis is fixed in both bodies of the joint, so that either body can be used.
        axis = mechanism.vector(keys["axis"]) if "axis" in keys else np.array([0.0, 0, 1])
        axis = mechanism.axis_in_body(carrier, axis/(np.linalg.norm(axis) or 1.0))
        axes[name] = rotated(body.rotation, np.broadcast_to(axis, body.position.shape))
    contacts = {track.name: track.positions for track in drawing.tracks if track.is_contact}
    for name, keys in mechanism.elements["wheel"].items():
        if name in contacts:
            positions["wheels", name] = mechanism.point(keys["at"])[0], contacts[name], None
    for kind, group in (("constraint", "constraints"), ("force", "forces")):
        for name, keys in mechanism.elements[kind].items():
            if len(keys.get("between", [])) == 2:
                on, second = mechanism.point(keys["between"][1])
                if "at" in keys and on in mechanism.bodies:
                    second = mechanism.to_body(on, mechanism.joint_position(keys))
                track = mechanism.bodies[on].point(second) if on in mechanism.bodies else mechanism.track(keys["between"][1])
                positions[group, name] = on, track, None
            elif "on" in keys:
                positions[group, name] = mechanism.point(keys["on"])[0], mechanism.track(keys["on"]), None
            elif ("joints", keys.get("joint")) in positions:
                on, position, _ = positions["joints", keys["joint"]]
                positions[group, name] = on, position, axes[keys["joint"]]
    return positions


def arrows_of(mechanism: Mechanism, name: str, series: dict, element: tuple[str, str] | None, positions: dict) -> list[Arrow]:
    """Arrows for the vectors among the series of an element, and for a force or torque along its axis, which is positive if it accelerates
    the coordinate of the joint."""
    if element not in positions:
        return []
    on, position, axis = positions[element]
    arrows = []
    for what, one in series.items():
        if one.unit not in ("N", "N m") or "body" in what:
            continue
        values = interpolated(mechanism.result.time, one.values.reshape(len(one.values), -1), None, None, mechanism.times)
        if values.shape[1] == 1 and axis is not None and what in ("force", "torque"):
            values = values*axis
        if values.shape[1] == 3:
            arrows.append(Arrow(f"{name} {what}", position, values, "", one.unit, on))
    return arrows
