# SPDX-License-Identifier: MIT
"""Arrows for the forces and torques of a mechanism that are contained in the file."""

from __future__ import annotations

import numpy as np

from ..motion import interpolated
from .drawing import ARROWS, Arrow, Drawing
from .geometry import Element, Geometry
from .rotations import rotated

#: Forces below this fraction of the weight or of the largest force are rounding errors, and so are torques below this fraction of these
#: times the size of the model.
LEAST = 1e-9


def add_arrows(mechanism: Geometry, drawing: Drawing) -> None:
    """Add arrows for forces (N) and torques (N m), with components in the axes of the world, the largest of each first. Points of action:
    the position of a joint, the contact point of a wheel, the second point of a distance or a spring, and the point of a load. Torques
    along the axis of a joint act at the joint."""
    contacts = {track.name: track.positions for track in drawing.tracks if track.is_contact}
    arrows = []
    for table in ("joint", "wheel", "constraint", "force"):
        for name, series in mechanism.result.groups.get(f"{table}s", {}).items():
            arrows += arrows_of(mechanism, name, series, mechanism.find(table, name), contacts)
    for name, series in mechanism.result.sensors.items():
        sensor = mechanism.find("sensor", name)
        if sensor is None:
            continue
        tables = ("force",) if sensor.type == "force" else ("joint", "wheel", "constraint")
        elements = [mechanism.find(table, sensor.measured) for table in tables]
        arrows += arrows_of(mechanism, name, series, next((one for one in elements if one is not None), None), contacts)
    force, torque = (max([arrow.largest for arrow in arrows if arrow.is_torque == is_torque] or [0.0]) for is_torque in (False, True))
    force = max(force, float(np.linalg.norm(mechanism.gravity)*sum(mechanism.mass.values())))
    torque = max(torque, force*float(np.max(np.subtract(*drawing.bounds()[::-1]))))
    for arrow in sorted(arrows, key=lambda arrow: (arrow.is_torque, -arrow.largest)):
        if arrow.largest > LEAST*(torque if arrow.is_torque else force):
            arrow.colour = ARROWS[len(drawing.arrows) % len(ARROWS)]
            drawing.arrows.append(arrow)


def action_of(mechanism: Geometry, one: Element, contacts: dict[str, np.ndarray]) -> tuple[str, np.ndarray, np.ndarray | None] | None:
    """The body on which the force of an element acts (the second of two bodies, or the wheel), the point of action at the frames, and the
    axis if the force or torque has one component; None if there is no such point."""
    last = one.ends[-1]
    if one.table == "wheel":
        return (last.body, contacts[one.name], None) if one.name in contacts else None
    if one.table != "joint" and one.type != "torsion":
        return last.body, mechanism.track(last), None
    # The axis is fixed in both bodies of the joint, so that either body can be used.
    end = mechanism.carrier(one)
    if end is None:
        return None
    body = mechanism.bodies[end.body]
    axis = rotated(body.rotation, np.broadcast_to(end.axis, body.position.shape)) if one.type == "torsion" else None
    return last.body, body.point(end.position), axis


def arrows_of(mechanism: Geometry, name: str, series: dict, one: Element | None, contacts: dict[str, np.ndarray]) -> list[Arrow]:
    """Arrows for the vectors among the series of an element, and for a force or torque along its axis, which is positive if it accelerates
    the coordinate of the joint."""
    action = None if one is None else action_of(mechanism, one, contacts)
    if action is None:
        return []
    on, position, axis = action
    arrows = []
    for what, one_series in series.items():
        if one_series.unit not in ("N", "N m") or "body" in what:
            continue
        values = interpolated(mechanism.result.time, one_series.values.reshape(len(one_series.values), -1), None, None, mechanism.times)
        if values.shape[1] == 1 and axis is not None and what in ("force", "torque"):
            values = values*axis
        if values.shape[1] == 3:
            arrows.append(Arrow(f"{name} {what}", position, values, "", one_series.unit, on))
    return arrows
