# SPDX-License-Identifier: MIT
"""Animations for browsers, and glTF files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..plot.data import motion_of
from .draw import draw
from .drawing import Body, Drawing, Piece, Spring, Track
from .modes import Modes, draw_modes, is_modes, read_modes


class Page:
    """An animation in memory; displayed in a notebook."""

    def __init__(self, text: str, path: Path | None = None):
        self.text, self.path = text, path

    def save(self, path: str | Path) -> Page:
        """Write it to a file."""
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
    """An animation of a motion: a result, its file, or a solution; or the modes in a file of `tandem linearise`; written to `path`,
    and the motion as glTF to `glb`.

    `names` are series that can be plotted beside it. `look(result, times, values)` makes a `Drawing` of a model of your own, from a
    dictionary of the coordinates at the times of the frames. `meshes` are files of bodies, STL or OBJ,
    {"rod": "rod.stl"}, in metres, or with a scale, {"rod": ("rod.stl", 0.001)}.
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
    """The drawing of an object that can be viewed."""
    if isinstance(given, (str, Path)) and is_modes(given):
        given = read_modes(given)
    if isinstance(given, Modes):
        return draw_modes(given, look)
    return draw(motion_of(given), per_second=per_second, names=names, look=look)


__all__ = ["Body", "Drawing", "Modes", "Page", "Piece", "Spring", "Track", "draw", "read_modes", "view"]
