# SPDX-License-Identifier: MIT
"""Writes a drawing as an animation in a single HTML file, which needs no network."""

from __future__ import annotations

import html
import json
from pathlib import Path

import numpy as np

from .drawing import Drawing, radius_of
from .packing import packed, squeezed, steps_of

HERE = Path(__file__).parent
#: Speeds offered by the page.
SPEEDS = (0.02, 0.1, 0.25, 0.5, 1, 2, 5, 20)


def three(name: str) -> str:
    path = HERE / "three" / name
    if not path.exists():
        raise FileNotFoundError("three.js is not beside this package: it comes with the wheel, and with make python in a checkout")
    return path.read_text(encoding="utf-8")


def rounded(values, digits: int = 7) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in np.asarray(values, dtype=float).reshape(-1)]


def filled(positions: np.ndarray) -> np.ndarray:
    """Positions in which each missing one is replaced by the last known position."""
    good = np.isfinite(positions).all(axis=1)
    if good.all() or not good.any():
        return np.nan_to_num(positions)
    last = np.maximum.accumulate(np.where(good, np.arange(len(positions)), -1))
    return positions[np.where(last < 0, np.flatnonzero(good)[0], last)]


def channels_of(drawing: Drawing, least: float) -> tuple[np.ndarray, np.ndarray]:
    """All series as channels (nc, nf), in the order in which the page reads them, and the rounding steps of the channels."""
    rows, steps = [], []

    def add(values: np.ndarray, smallest: float) -> None:
        rows.append(values.T)
        steps.append(steps_of(values.T, smallest))

    for bodies in [bodies for _, bodies in drawing.takes] or [drawing.bodies]:
        for body in bodies:
            add(body.position, least)
            add(body.rotation, 2.0**-23)
    for track in drawing.tracks:
        add(filled(track.positions), least)
    for arrow in drawing.arrows:
        add(filled(arrow.positions), least)
        vectors = np.nan_to_num(arrow.vectors)
        # The legend shows three digits. The median ensures this for typical values if a few values are very large.
        sizes = np.linalg.norm(vectors, axis=1)
        middle = np.median(sizes[sizes > 1e-9*sizes.max()]) if sizes.max(initial=0) > 0 else 0.0
        add(vectors, max(1e-300, min(1e-4*sizes.max(initial=0), 1e-3*middle)))
    for curve in drawing.curves:
        add(curve.values[:, None], 1e-6*max(1e-300, np.abs(curve.values).max(initial=0)))
    nf = len(drawing.times)
    return (np.concatenate(rows), np.concatenate(steps)) if rows else (np.zeros((0, nf)), np.zeros(0))


def frame_of(drawing: Drawing) -> dict:
    """Initial view: size of the scene at one time, centre, direction of the camera, followed body."""
    low, high = drawing.bounds()
    moving = [body for body in drawing.bodies if np.ptp(body.position, axis=0).max() > 0 or len(drawing.bodies) == 1]
    reach = [max([float(np.linalg.norm(piece.at)) + radius_of(piece) for piece in body.pieces] or [0.0]) for body in drawing.bodies]
    positions = np.stack([body.position for body in drawing.bodies], axis=1) if drawing.bodies else np.zeros((1, 1, 3))
    at_once = max(float(np.max(np.ptp(positions, axis=1))) + 2*max(reach, default=0.0), drawing.extent)
    whole = float(np.max(high - low)) or 1.0
    travels = whole > 2.5*at_once
    size = at_once if travels else whole
    size = size or 1.0
    flat = drawing.planar and abs(drawing.up[2]) < 0.5
    up = drawing.up
    if flat:
        eye = np.array([0.0, 0, 1])
    else:
        first = np.array([1.0, 0, 0]) if abs(up[0]) < 0.7 else np.array([0, 1.0, 0])
        aside = first - up*(first @ up)
        aside /= np.linalg.norm(aside)
        forward = np.cross(up, aside)
        # View travelling bodies from the side, slightly from behind.
        heading = positions[-1].mean(axis=0) - positions[0].mean(axis=0)
        if travels and abs(heading @ aside) > abs(heading @ forward):
            eye = 0.75*up - 1.25*forward - 0.55*aside*np.sign(heading @ aside)
        elif travels:
            eye = 0.75*up + 1.25*aside - 0.55*forward*np.sign(heading @ forward)
        else:
            eye = 0.6*up - 1.0*forward + 0.65*aside
    duration = float(drawing.times[-1] - drawing.times[0])
    wanted = max(duration, 1e-9)/6.0
    speed = 1.0 if 2.0 <= duration <= 600 else min(SPEEDS, key=lambda each: abs(np.log(each/wanted)))
    return {"size": size, "centre": rounded((low + high)/2), "eye": rounded(eye/np.linalg.norm(eye)),
            "distance": 2.1*size, "follow": "*" if travels and moving else "", "flat": bool(flat), "speed": speed,
            "up": rounded(up), "normal": [0, 0, 1] if drawing.planar else rounded(up)}


def page(drawing: Drawing) -> str:
    """Text of the page."""
    look = frame_of(drawing)
    channels, steps = channels_of(drawing, 1e-7*look["size"])
    # The page uses the steps as written, so that channels must be rounded with the same values.
    steps = np.array(rounded(steps))
    scales = {is_torque: drawing.scale(is_torque, look["size"]) for is_torque in (False, True)}
    nf = len(drawing.times)
    content = {
        **look, "name": drawing.name,
        "times": {"first": float(drawing.times[0]), "step": float((drawing.times[-1] - drawing.times[0])/max(1, nf - 1)) or 1.0, "count": nf},
        "bodies": [{"name": body.name, "still": bool(np.ptp(body.position, axis=0).max() == 0 and len(drawing.bodies) > 1),
                    "pieces": [[piece.shape, rounded(piece.size, 5), piece.colour, rounded(piece.at), rounded(piece.rotation)]
                               for piece in body.pieces]} for body in drawing.bodies],
        "meshes": {name: squeezed(triangles.astype("<f4").tobytes()) for name, triangles in drawing.meshes.items()},
        "takes": [name for name, _ in drawing.takes],
        "springs": [{"bodies": spring.bodies, "positions": [rounded(position) for position in spring.positions], "radius": spring.radius}
                    for spring in drawing.springs],
        "tracks": [{"name": track.name, "colour": track.colour, "marker": look["size"]*(0.008 if track.is_contact else 0.012)}
                   for track in drawing.tracks],
        "arrows": [{"name": arrow.name, "colour": arrow.colour, "unit": arrow.unit, "on": arrow.on, "isTorque": arrow.is_torque,
                    "scale": scales[arrow.is_torque]} for arrow in drawing.arrows],
        "largest": largest_of(drawing),
        "curves": [{"name": curve.name, "unit": curve.unit, **limits(curve.values)} for curve in drawing.curves],
        "ground": rounded(drawing.ground) if drawing.ground is not None else None,
        "steps": steps.tolist(),
    }
    texts = {
        "TITLE": html.escape(drawing.name), "ABOUT": html.escape(drawing.about),
        "STYLE": (HERE / "page" / "page.css").read_text(encoding="utf-8"),
        "THREE_CORE": squeezed(three("three.core.min.js").encode()), "THREE": squeezed(three("three.module.min.js").encode()),
        "ORBIT": squeezed(three("OrbitControls.js").encode()),
        "PAGE": squeezed((HERE / "page" / "page.js").read_bytes()),
        # Escape "<", so that no name can end the script element.
        "DRAWING": json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        "NUMBERS": packed(channels, steps),
    }
    text = (HERE / "page" / "page.html").read_text(encoding="utf-8")
    parts = text.split("@")
    return "".join(texts.get(part, part) if i % 2 else part for i, part in enumerate(parts))


def largest_of(drawing: Drawing) -> str:
    """Text that states the largest force and torque."""
    found = {word: max([arrow.largest for arrow in drawing.arrows if arrow.is_torque == is_torque] or [0.0])
             for word, is_torque in (("forces", False), ("torques", True))}
    units = {"forces": "N", "torques": "N m"}
    return ", ".join(f"{word} up to {largest:.3g} {units[word]}" for word, largest in found.items() if largest)


def limits(values: np.ndarray) -> dict[str, float]:
    """Range of the ordinate of a plot, which is extended for a constant series."""
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-9*max(abs(low), abs(high), 1e-9):
        room = 0.1*max(abs(low), abs(high)) or 1.0
        low, high = low - room, high + room
    return {"low": low, "high": high}
