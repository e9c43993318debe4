# SPDX-License-Identifier: MIT
"""The drawing of a motion: bodies with their pieces, springs, tracks, arrows, curves and the ground."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .rotations import IDENTITY, normalised, rotated

#: Unit shapes of pieces: a box with edges of length 1, a cylinder of radius 1 and length 1 along z, a sphere of radius 1, and a rim
#: (torus of radius 1 about z).
SHAPES = ("box", "cylinder", "sphere", "rim")

#: Colours that colour-blind people can distinguish (Okabe, Ito 2008).
BLUE, ORANGE, GREEN, RED, SKY, PINK, YELLOW, GREY, DARK = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442", "#9AA0A6", "#3C4043")
COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY, RED, YELLOW)
#: Colours of arrows, which are darker than bodies.
ARROWS = (RED, "#862E9C", "#1864AB", "#2B8A3E", "#7A4100", "#C2255C", "#3C4043")

#: Length of the largest force, and radius of the arc of the largest torque, relative to the size of the drawing.
LONGEST, LARGEST_ARC = 0.5, 0.12


@dataclass
class Piece:
    """A piece of a body: a unit shape, or the name of a mesh of the drawing, with its position, rotation and size in the axes of the body."""

    shape: str
    size: tuple[float, float, float]
    colour: str
    at: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = field(default_factory=lambda: IDENTITY.copy())
    #: Largest distance of a point of the mesh from its origin; 0 for unit shapes.
    reach: float = 0.0


@dataclass
class Body:
    """A body with its positions (nf, 3) and rotations (nf, 4) at the frames, and the pieces that represent it."""

    name: str
    position: np.ndarray
    rotation: np.ndarray
    pieces: list[Piece] = field(default_factory=list)

    def point(self, local) -> np.ndarray:
        """Positions of a point of the body at the frames (nf, 3)."""
        return self.position + rotated(self.rotation, np.broadcast_to(np.asarray(local, dtype=float), self.position.shape))


@dataclass
class Spring:
    """A coil between two points of bodies; a line if the radius is 0. The name of the ground is "". Positions are in the axes of the
    bodies."""

    name: str
    bodies: tuple[str, str]
    positions: tuple[np.ndarray, np.ndarray]
    radius: float


@dataclass
class Track:
    """A line that grows during the motion. Positions at the frames (nf, 3) are NaN while there is no point."""

    name: str
    positions: np.ndarray
    colour: str
    is_contact: bool = False


@dataclass
class Arrow:
    """A force (N) or a torque (N m): points of action and vectors at the frames (nf, 3). Forces and torques have separate scales."""

    name: str
    positions: np.ndarray
    vectors: np.ndarray
    colour: str
    unit: str
    #: Name of the body on which it acts, for the legend.
    on: str = ""

    @property
    def is_torque(self) -> bool:
        """True for a torque, which is shown as an arc about its axis."""
        return self.unit == "N m"

    @property
    def largest(self) -> float:
        """Largest magnitude over all frames."""
        return float(np.linalg.norm(np.nan_to_num(self.vectors), axis=1).max(initial=0))


@dataclass
class Curve:
    """A series that can be plotted beside the motion."""

    name: str
    unit: str
    values: np.ndarray


@dataclass
class Drawing:
    """A complete drawing; the class that a `look` function returns."""

    name: str
    times: np.ndarray
    bodies: list[Body] = field(default_factory=list)
    springs: list[Spring] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
    arrows: list[Arrow] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    #: Named alternative motions of the same bodies, such as modes; one of them is shown at a time.
    takes: list[tuple[str, list[Body]]] = field(default_factory=list)
    #: Meshes by name: triangles (nt, 3, 3).
    meshes: dict[str, np.ndarray] = field(default_factory=dict)
    #: Upward direction, and a point on the ground; None for no ground.
    up: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    ground: np.ndarray | None = None
    #: True if the motion is in the plane x, y.
    planar: bool = False
    #: Size of the drawing including its joints on the ground; 0 to use the size of the bodies.
    extent: float = 0.0
    #: Text about the run, shown below its name.
    about: str = ""

    def scale(self, is_torque: bool, size: float) -> float:
        """Length of the arrow for 1 N, or radius of the arc for 1 N m, in a drawing of the given size."""
        largest = max([arrow.largest for arrow in self.arrows if arrow.is_torque == is_torque] or [0.0])
        return (LARGEST_ARC if is_torque else LONGEST)*size/largest if largest else 0.0

    def body(self, name: str) -> Body:
        return next(body for body in self.bodies if body.name == name)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of a box that contains the bodies at all frames."""
        lows, highs = [], []
        for body in [*self.bodies, *(body for _, bodies in self.takes[1:] for body in bodies)]:
            reach = max([float(np.linalg.norm(piece.at)) + radius_of(piece) for piece in body.pieces] or [0.0])
            finite = body.position[np.isfinite(body.position).all(axis=1)]
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
    """A round bar between two points of a body."""
    from .rotations import rotation_onto

    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    return Piece("cylinder", (radius, radius, float(np.linalg.norm(end - start))), colour, (start + end)/2, rotation_onto(end - start))


def wheel(radius: float, colour: str, axis=(0.0, 0.0, 1.0), at=(0.0, 0.0, 0.0), width: float = 0.0) -> list[Piece]:
    """The pieces of a wheel: a rim with spokes, which make its rotation visible."""
    from .rotations import rotation_onto, product

    rotation, at = rotation_onto(axis), np.asarray(at, dtype=float)
    pieces = [Piece("rim", (radius, radius, radius), DARK, at, rotation)]
    pieces.append(Piece("cylinder", (0.12*radius, 0.12*radius, max(width, 0.2*radius)), colour, at, rotation))
    for k in range(3):
        spoke = product(rotation, normalised([np.cos(k*np.pi/6), 0, 0, np.sin(k*np.pi/6)]))
        pieces.append(Piece("box", (1.9*radius, 0.07*radius, 0.05*radius), ORANGE if k == 0 else colour, at, spoke))
    return pieces
