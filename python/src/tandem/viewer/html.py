# SPDX-License-Identifier: MIT
"""A drawing as an animation in a single file, without a network."""

from __future__ import annotations

import html
import json
from pathlib import Path

import numpy as np

from .drawing import Drawing, radius_of
from .packing import packed, squeezed, steps_of

HERE = Path(__file__).parent
#: The speeds that the page offers.
SPEEDS = (0.02, 0.1, 0.25, 0.5, 1, 2, 5, 20)


def three(name: str) -> str:
    path = HERE / "three" / name
    if not path.exists():
        raise FileNotFoundError("three.js is not beside this package: it comes with the wheel, and with make python in a checkout")
    return path.read_text(encoding="utf-8")


def rounded(values, digits: int = 7) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in np.asarray(values, dtype=float).reshape(-1)]


def filled(places: np.ndarray) -> np.ndarray:
    """Positions, with missing ones replaced by the last known one."""
    good = np.isfinite(places).all(axis=1)
    if good.all() or not good.any():
        return np.nan_to_num(places)
    last = np.maximum.accumulate(np.where(good, np.arange(len(places)), -1))
    return places[np.where(last < 0, np.flatnonzero(good)[0], last)]


def channels_of(drawing: Drawing, least: float) -> tuple[np.ndarray, np.ndarray]:
    """All series as channels (nc, nf) in the order in which the page reads them, and their steps."""
    rows, steps = [], []

    def add(values: np.ndarray, smallest: float) -> None:
        rows.append(values.T)
        steps.append(steps_of(values.T, smallest))

    for bodies in [bodies for _, bodies in drawing.takes] or [drawing.bodies]:
        for body in bodies:
            add(body.place, least)
            add(body.turn, 2.0**-23)
    for track in drawing.tracks:
        add(filled(track.places), least)
    for arrow in drawing.arrows:
        add(filled(arrow.places), least)
        vectors = np.nan_to_num(arrow.vectors)
        # The legend shows three digits: of the typical value if there are very large ones at times.
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
    moving = [body for body in drawing.bodies if np.ptp(body.place, axis=0).max() > 0 or len(drawing.bodies) == 1]
    reach = [max([float(np.linalg.norm(piece.at)) + radius_of(piece) for piece in body.pieces] or [0.0]) for body in drawing.bodies]
    places = np.stack([body.place for body in drawing.bodies], axis=1) if drawing.bodies else np.zeros((1, 1, 3))
    at_once = max(float(np.max(np.ptp(places, axis=1))) + 2*max(reach, default=0.0), drawing.extent)
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
        # From the side of what travels, a little from behind.
        heading = places[-1].mean(axis=0) - places[0].mean(axis=0)
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
    """The page as a text."""
    look = frame_of(drawing)
    channels, steps = channels_of(drawing, 1e-7*look["size"])
    # The page multiplies by what is written: so it is rounded by these numbers too.
    steps = np.array(rounded(steps))
    scales = {turns: drawing.scale(turns, look["size"]) for turns in (False, True)}
    nf = len(drawing.times)
    content = {
        **look, "name": drawing.name,
        "times": {"first": float(drawing.times[0]), "step": float((drawing.times[-1] - drawing.times[0])/max(1, nf - 1)) or 1.0, "count": nf},
        "bodies": [{"name": body.name, "still": bool(np.ptp(body.place, axis=0).max() == 0 and len(drawing.bodies) > 1),
                    "pieces": [[piece.shape, rounded(piece.size, 5), piece.colour, rounded(piece.at), rounded(piece.turn)]
                               for piece in body.pieces]} for body in drawing.bodies],
        "meshes": {name: squeezed(triangles.astype("<f4").tobytes()) for name, triangles in drawing.meshes.items()},
        "takes": [name for name, _ in drawing.takes],
        "springs": [{"bodies": spring.bodies, "places": [rounded(place) for place in spring.places], "radius": spring.radius}
                    for spring in drawing.springs],
        "tracks": [{"name": track.name, "colour": track.colour, "marker": look["size"]*(0.008 if track.is_contact else 0.012)}
                   for track in drawing.tracks],
        "arrows": [{"name": arrow.name, "colour": arrow.colour, "unit": arrow.unit, "on": arrow.on, "turns": arrow.turns,
                    "scale": scales[arrow.turns]} for arrow in drawing.arrows],
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
        # Nothing in the names can end the script.
        "DRAWING": json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        "NUMBERS": packed(channels, steps),
    }
    text = (HERE / "page" / "page.html").read_text(encoding="utf-8")
    parts = text.split("@")
    return "".join(texts.get(part, part) if i % 2 else part for i, part in enumerate(parts))


def largest_of(drawing: Drawing) -> str:
    """Text with the largest forces and torques."""
    found = {word: max([arrow.largest for arrow in drawing.arrows if arrow.turns == turns] or [0.0])
             for word, turns in (("forces", False), ("torques", True))}
    units = {"forces": "N", "torques": "N m"}
    return ", ".join(f"{word} up to {largest:.3g} {units[word]}" for word, largest in found.items() if largest)


def limits(values: np.ndarray) -> dict[str, float]:
    """The range of a plot; a constant series gets some room."""
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-9*max(abs(low), abs(high), 1e-9):
        room = 0.1*max(abs(low), abs(high)) or 1.0
        low, high = low - room, high + room
    return {"low": low, "high": high}
