# SPDX-License-Identifier: MIT
"""The picture of a motion: bodies with their pieces, points, springs, tracks, arrows, the ground."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .rotations import IDENTITY, normalised, turned

#: The shapes of pieces, of unit size: a box with edges 1, a cylinder of radius 1 and length 1 along z, a sphere of radius 1, a rim
#: (a torus of radius 1 about z).
SHAPES = ("box", "cylinder", "sphere", "rim")

#: Colours that colour-blind eyes can distinguish (Okabe, Ito 2008).
BLUE, ORANGE, GREEN, RED, SKY, PINK, YELLOW, GREY, DARK = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442", "#9AA0A6", "#3C4043")
COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY, RED, YELLOW)
#: Of arrows, darker than bodies; the first is that of a single one.
ARROWS = (RED, "#862E9C", "#1864AB", "#2B8A3E", "#7A4100", "#C2255C", "#3C4043")

#: The largest force is as long as this part of all that is seen, and the arc of the largest torque has such a radius.
LONGEST, LARGEST_ARC = 0.5, 0.12


@dataclass
class Piece:
    """A unit shape, or a mesh of the drawing by its name, with its place, turn and size in the axes of its body."""

    shape: str
    size: tuple[float, float, float]
    colour: str
    at: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn: np.ndarray = field(default_factory=lambda: IDENTITY.copy())
    #: How far a mesh of a file reaches; 0 for unit shapes.
    reach: float = 0.0


@dataclass
class Body:
    """A body with its poses at the frames: places (nf, 3), rotations (nf, 4)."""

    name: str
    place: np.ndarray
    turn: np.ndarray
    pieces: list[Piece] = field(default_factory=list)

    def point(self, local) -> np.ndarray:
        """Positions of a point of the body at the frames (nf, 3)."""
        return self.place + turned(self.turn, np.broadcast_to(np.asarray(local, dtype=float), self.place.shape))


@dataclass
class Spring:
    """A coil between two points of bodies, "" for the ground; a line where its radius is 0."""

    name: str
    bodies: tuple[str, str]
    places: tuple[np.ndarray, np.ndarray]
    radius: float


@dataclass
class Track:
    """A line that grows during the motion: positions at the frames (nf, 3); NaN if there is none."""

    name: str
    places: np.ndarray
    colour: str
    is_contact: bool = False


@dataclass
class Arrow:
    """A force (N) or a torque (N m) at a place, both at the frames; each kind is scaled so that its largest can be seen."""

    name: str
    places: np.ndarray
    vectors: np.ndarray
    colour: str
    unit: str
    #: The body that it acts on, as the legend says it.
    on: str = ""

    @property
    def turns(self) -> bool:
        """True for a torque, which is drawn as an arc about its axis."""
        return self.unit == "N m"

    @property
    def largest(self) -> float:
        """Its largest size at any frame."""
        return float(np.linalg.norm(np.nan_to_num(self.vectors), axis=1).max(initial=0))


@dataclass
class Curve:
    """A series that can be plotted beside the motion."""

    name: str
    unit: str
    values: np.ndarray


@dataclass
class Drawing:
    """The complete drawing."""

    name: str
    times: np.ndarray
    bodies: list[Body] = field(default_factory=list)
    springs: list[Spring] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
    arrows: list[Arrow] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    #: Named motions of the same bodies, of which one is shown at a time: modes.
    takes: list[tuple[str, list[Body]]] = field(default_factory=list)
    #: Named meshes of files: triangles (nt, 3, 3).
    meshes: dict[str, np.ndarray] = field(default_factory=dict)
    #: Upward direction, and a point on the ground; None for no ground.
    up: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    ground: np.ndarray | None = None
    #: True if everything moves in the plane x, y.
    planar: bool = False
    #: The size of the drawing together with the ground to which it is joined; 0 if that is the size of the bodies.
    extent: float = 0.0
    #: Words about the run, below its name.
    about: str = ""

    def scale(self, turns: bool, size: float) -> float:
        """Length of the arrow of one newton for a picture of that size, or size of the arc of one newton metre."""
        largest = max([arrow.largest for arrow in self.arrows if arrow.turns == turns] or [0.0])
        return (LARGEST_ARC if turns else LONGEST)*size/largest if largest else 0.0

    def body(self, name: str) -> Body:
        return next(body for body in self.bodies if body.name == name)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and highest corner of all that is seen of the bodies at any frame."""
        lows, highs = [], []
        for body in [*self.bodies, *(body for _, bodies in self.takes[1:] for body in bodies)]:
            reach = max([float(np.linalg.norm(piece.at)) + radius_of(piece) for piece in body.pieces] or [0.0])
            finite = body.place[np.isfinite(body.place).all(axis=1)]
            if finite.size:
                lows.append(finite.min(axis=0) - reach)
                highs.append(finite.max(axis=0) + reach)
        if not lows:
            return -np.ones(3), np.ones(3)
        return np.min(lows, axis=0), np.max(highs, axis=0)


def radius_of(piece: Piece) -> float:
    if piece.reach > 0:
        return piece.reach
    x, y, z = piece.size
    if piece.shape == "box":
        return float(np.linalg.norm(piece.size))/2
    return float(np.hypot(max(x, y), z/2)) if piece.shape == "cylinder" else float(max(piece.size))


def bar(start, end, radius: float, colour: str) -> Piece:
    """A round bar between two places of a body."""
    from .rotations import carrying

    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    return Piece("cylinder", (radius, radius, float(np.linalg.norm(end - start))), colour, (start + end)/2, carrying(end - start))


def wheel(radius: float, colour: str, axis=(0.0, 0.0, 1.0), at=(0.0, 0.0, 0.0), width: float = 0.0) -> list[Piece]:
    """A rim with spokes, which make rotation visible."""
    from .rotations import carrying, product

    turn, at = carrying(axis), np.asarray(at, dtype=float)
    pieces = [Piece("rim", (radius, radius, radius), DARK, at, turn)]
    pieces.append(Piece("cylinder", (0.12*radius, 0.12*radius, max(width, 0.2*radius)), colour, at, turn))
    for k in range(3):
        spoke = product(turn, normalised([np.cos(k*np.pi/6), 0, 0, np.sin(k*np.pi/6)]))
        pieces.append(Piece("box", (1.9*radius, 0.07*radius, 0.05*radius), ORANGE if k == 0 else colour, at, spoke))
    return pieces
