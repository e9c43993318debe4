# SPDX-License-Identifier: MIT
"""Mode shapes of a linearised system (`tandem linearise SCENE --output modes.h5`) as motions. Each mode oscillates about the point of
linearisation with a well visible amplitude and a period of two seconds. Bodies move according to the motions in the file. If the file
contains none, as for user-defined models, the coordinates move."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..result import Result, drawing_in, opened, text
from .drawing import Body, Drawing
from .rotations import from_vectors, product

#: Duration of a period (s), and its number of frames.
PERIOD, FRAMES = 2.0, 120
TIMES = np.linspace(0.0, PERIOD, FRAMES + 1)
#: Largest displacement in a mode, relative to the size of the mechanism, and largest rotation (rad).
LARGEST_PART, LARGEST_ANGLE = 0.12, 0.4
#: Real parts below this fraction of the largest eigenvalue are set to zero.
ROUNDING = 1e-10
#: Largest number of modes shown; modes with the least damping come first.
MOST_MODES = 40


def swing() -> np.ndarray:
    """Complex phase factors of one period at the frames (nf)."""
    return np.exp(2j*np.pi*TIMES/PERIOD)


@dataclass
class Modes:
    """Contents of the file of a linearised system: the coordinates with their names; for each mode its eigenvalue (1/s) with its cause,
    its frequency (Hz), its damping ratio, and its complex shape (n_modes, n). For mechanisms also the names of the bodies, and their
    complex motions in each mode (n_modes, n_bodies, 6): displacement of the centre of mass (m) and rotation vector (rad)."""

    names: list[str]
    q: np.ndarray
    eigenvalues: np.ndarray
    causes: list[str]
    frequency: np.ndarray
    damping_ratio: np.ndarray
    shapes: np.ndarray
    scene: dict[str, Any]
    path: str = ""
    #: The geometry of a mechanism, as in `Result`.
    drawing: dict[str, Any] = field(default_factory=dict)
    bodies: list[str] = field(default_factory=list)
    motions: np.ndarray | None = None

    def shown(self) -> list[int]:
        """Indices of the modes that are motions, one per complex pair, in order of increasing damping."""
        found = [i for i, value in enumerate(self.eigenvalues) if value.imag >= 0 and np.abs(self.shapes[i]).max(initial=0) > 0
                 and np.isfinite(self.shapes[i]).all()]
        return sorted(found, key=lambda i: -self.eigenvalues[i].real)[:MOST_MODES]

    def label(self, i: int) -> str:
        """Label of a mode: frequency and damping, or the rate if the mode does not oscillate."""
        value = self.eigenvalues[i]
        # Real parts within rounding are neither damping nor growth.
        real = value.real if abs(value.real) > ROUNDING*np.abs(self.eigenvalues).max() else 0.0
        grows = ", unstable" if real > 0 else ""
        if value.imag > 0:
            return f"{value.imag/(2*np.pi):.4g} Hz, damping {100*self.damping_ratio[i] if real else 0:.3g} %{grows}"
        return f"does not swing, {value.real:.4g} 1/s{grows}"

    def swings(self, i: int, size: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """For each body, the displacement of its centre of mass and its rotation vector at the frames (nf, 3)."""
        shape = self.motions[i]/np.repeat([LARGEST_PART*size, LARGEST_ANGLE], 3)
        most = shape.flat[np.argmax(np.abs(shape))] or 1.0
        # The phase and the scale are chosen such that the largest component has the wanted amplitude at the first frame.
        moved = np.real(swing()[:, None, None]*self.motions[i]/most)
        return {name: (moved[:, j, :3], moved[:, j, 3:]) for j, name in enumerate(self.bodies)}

    def motion(self, i: int, size: float) -> Result:
        """Motion of the coordinates in a mode; `size` is the size of the model (m)."""
        shape = self.shapes[i]
        shape = shape*np.exp(-1j*np.angle(shape[np.argmax(np.abs(shape))]))
        lengths = np.array([re.search(r"(^|\.|^r)[xyz]\d*$", name) is not None for name in self.names])
        # An Euler parameter changes by half of the rotation.
        weights = np.array([2.0 if re.search(r"(^|\.)e[0-3]$", name) else 1.0 for name in self.names])
        far = np.abs(shape[lengths]).max(initial=0)/(LARGEST_PART*size)
        rotation = np.abs(shape*weights)[~lengths].max(initial=0)/LARGEST_ANGLE
        q = self.q + np.real(swing()[:, None]*shape)/(max(far, rotation) or 1.0)
        return Result(TIMES, self.names, [""]*len(self.names), q, scene=self.scene, path=self.path, drawing=self.drawing)


def is_modes(path: str | Path) -> bool:
    """True if a file is a linearised system."""
    with opened(path) as file:
        return "linearisation" in file


def read_modes(path: str | Path) -> Modes:
    """Read a file of `tandem linearise`."""
    with opened(path) as file:
        try:
            group = file["linearisation"]
            values = group["eigenvalues"][:]
            # The file may be stored by columns or by rows; real and imaginary part are the dimension of length two.
            values = values if values.shape[-1] == 2 and values.shape[0] == len(group["frequency"]) else values.T
            causes = [text(cause).strip() for cause in group["cause"][:]] if "cause" in group else [""]*len(values)
            found = Modes([text(name).strip() for name in group["coordinates"][:]], group["q"][:], values[:, 0] + 1j*values[:, 1], causes,
                          group["frequency"][:], group["damping_ratio"][:], group["shapes_re"][:] + 1j*group["shapes_im"][:],
                          tomllib.loads(text(file.attrs.get("scene", ""))), str(path), drawing_in(file))
            if "motions_re" in group:
                found.bodies = [text(name).strip() for name in group["bodies"][:]]
                motions = group["motions_re"][:] + 1j*group["motions_im"][:]
                found.motions = motions.reshape(len(found.eigenvalues), len(found.bodies), 6)
            return found
        except (AttributeError, IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is not a complete linearised system: {error.args[0] if error.args else error}") from error


def draw_modes(modes: Modes, look=None) -> Drawing:
    """Create the drawing of a linearised system; each mode is a take."""
    from .draw import draw_model

    shown = modes.shown()
    if not shown:
        raise ValueError(f"{modes.path}: there is no mode to show: symmetries and families explain all eigenvalues")
    rest = Result(np.zeros(1), modes.names, [""]*len(modes.names), modes.q[None], scene=modes.scene, path=modes.path,
                  drawing=modes.drawing)
    still = draw_model(rest, rest.time, {name: rest.q[:, j] for j, name in enumerate(modes.names)}, look)
    low, high = still.bounds()
    size = max(still.extent, 0.3*float(np.max(high - low)))
    if look is None and modes.motions is not None:
        made = still
        for i in shown:
            made.takes.append((modes.label(i), bodies_swinging(still.bodies, modes.swings(i, size))))
        made.bodies = made.takes[0][1]
    else:
        made = None
        for i in shown:
            one = modes.motion(i, size)
            drawing = draw_model(one, one.time, {name: one.q[:, j] for j, name in enumerate(one.names)}, look)
            made = made or drawing
            made.takes.append((modes.label(i), drawing.bodies))
    made.times, made.tracks, made.arrows = TIMES, [], []
    made.about = f"{len(shown)} modes, not to scale, a period in {PERIOD:g} s"
    return made


def bodies_swinging(bodies: list[Body], swings: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[Body]:
    """Bodies moving in a mode; bodies without motion in the mode stay at rest."""
    still = np.zeros((len(TIMES), 3)), np.zeros((len(TIMES), 3))
    made = []
    for body in bodies:
        away, rotation = swings.get(body.name, still)
        made.append(Body(body.name, body.position[0] + away, product(from_vectors(rotation), body.rotation[0]), body.pieces))
    return made
