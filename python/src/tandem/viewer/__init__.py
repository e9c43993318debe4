# SPDX-License-Identifier: MIT
"""Animations of motions and modes for browsers, and glTF files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..mechanism import Mechanism
from ..plot.data import motion_of
from ..result import Result
from .draw import draw
from .drawing import Body, Drawing, Piece, Spring, Track
from .modes import Modes, draw_modes, is_modes, read_modes


class Page:
    """An HTML animation in memory, which notebooks display."""

    def __init__(self, text: str, path: Path | None = None):
        self.text, self.path = text, path

    def save(self, path: str | Path) -> Page:
        """Write the animation to a file."""
        self.path = Path(path)
        self.path.write_text(self.text, encoding="utf-8")
        return self

    def _repr_html_(self) -> str:
        import html

        return f'<iframe srcdoc="{html.escape(self.text)}" style="width:100%;height:520px;border:0"></iframe>'

    def __repr__(self) -> str:
        return f"<tandem page, {len(self.text)/1e6:.2f} MB{f', {self.path}' if self.path else ''}>"


def view(given: Any, path: str | Path | None = None, *, glb: str | Path | None = None, per_second: float = 60.0,
         names: list[str] | None = None, look: Callable | None = None, meshes: dict[str, Any] | None = None) -> Page:
    """Animate a motion (a result, its file, or a solution), or the modes in a file of `tandem linearise`. The animation is written to
    `path`, and as glTF to `glb`, if these are given.

    `per_second` is the number of frames per second. `names` are series that can be plotted beside the motion.
    `look(result, times, values)` returns a `Drawing` of a user-defined model; `values` is a dictionary of the coordinates at the times
    of the frames. `meshes` are STL or OBJ files of bodies, {"rod": "rod.stl"} in metres, or {"rod": ("rod.stl", 0.001)} with a scale.
    """
    from .gltf import write_glb
    from .html import page
    from .meshes import put_meshes

    drawing = drawing_of(given, per_second=per_second, names=names, look=look)
    put_meshes(drawing, meshes or {})
    made = Page(page(drawing))
    if path is not None:
        made.save(path)
    if glb is not None:
        write_glb(drawing, glb)
    return made


def drawing_of(given: Any, *, per_second: float = 60.0, names: list[str] | None = None, look: Callable | None = None) -> Drawing:
    """Create the drawing of a result, its file, a solution, or modes."""
    if isinstance(given, (str, Path)) and is_modes(given):
        given = read_modes(given)
    if isinstance(given, Modes):
        return draw_modes(given, look)
    result = motion_of(given)
    if look is None and result.model == "mechanism" and result.time.size and not isinstance(given, (Result, str, Path)):
        # A solution has no file: the program derives the geometry from the scene.
        made = Mechanism()
        made.tables = {**result.scene, "time": {"start": float(result.time[0]), "end": float(result.time[-1])}}
        result = replace(result, drawing=made.drawing())
    return draw(result, per_second=per_second, names=names, look=look)


__all__ = ["Body", "Drawing", "Modes", "Page", "Piece", "Spring", "Track", "draw", "read_modes", "view"]
