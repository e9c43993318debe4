# SPDX-License-Identifier: MIT
"""Mechanisms from bodies and joints, in the words of scene files."""

from __future__ import annotations

import json
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .program import equilibrium, linearise, run_program, run_scene, settings_words, toml_key, toml_value


class Mechanism:
    """A scene of bodies and joints, run by the program `tandem`.

        arm = tandem.Mechanism.from_toml("arm.toml")        # a file, or the text of one
        arm = tandem.Mechanism({"scene.planar": True, "gravity.vector": [0, -9.81]})
        arm.add("body.rod", mass=1.0, inertia=1/12, position=[0.5, 0])
        arm.add("joint.pivot", type="revolute", bodies=["ground", "rod"], at=[0, 0])
        arm["time.end"] = 10
        result = arm.run({"body.rod.mass": 2})

    doc/mechanism.md lists all words. A name with a dot or a brace is one part of a key in quotes: `'repeat.bay.body."rod{i}"'`.
    """

    def __init__(self, keys: Mapping[str, Any] | None = None):
        self.tables: dict[str, Any] = {"scene": {"model": "mechanism"}}
        for key, value in (keys or {}).items():
            self[key] = value

    @classmethod
    def from_toml(cls, source: str | Path) -> Mechanism:
        """From a scene file, or from its text."""
        made = cls()
        text = str(source)
        if isinstance(source, Path) or ("\n" not in text and "=" not in text):
            text = Path(source).read_text(encoding="utf-8")
        made.tables = tomllib.loads(text)
        made.tables.setdefault("scene", {}).setdefault("model", "mechanism")
        return made

    def __setitem__(self, key: str, value: Any) -> None:
        *tables, last = parts_of(key)
        place = self.tables
        for name in tables:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise KeyError(f"{name!r} in {key!r} has a value and is no table")
        place[last] = value

    def __getitem__(self, key: str) -> Any:
        place: Any = self.tables
        for name in parts_of(key):
            place = place[name]
        return place

    def add(self, element: str, **keys: Any) -> Mechanism:
        """An element with its keys: `add("body.rod", mass=1.0, ...)`."""
        self[element] = {**keys}
        return self

    def to_toml(self) -> str:
        """The scene as a file."""
        return "\n".join(lines_of(self.tables)) + "\n"

    def _with_file(self, act):
        """Call `act` with the scene as a file."""
        with tempfile.TemporaryDirectory(prefix="tandem-") as folder:
            name = str(self.tables.get("scene", {}).get("name", ""))
            # The program refuses a name that is none; it must not name a file elsewhere before.
            file = Path(folder) / f"{name if name.replace('_', '').replace('-', '').isalnum() and len(name) < 100 else 'mechanism'}.toml"
            file.write_text(self.to_toml(), encoding="utf-8")
            return act(file)

    def run(self, settings: Mapping[str, Any] | None = None, output: str | Path | None = None, *, error: bool | None = None):
        """Run it, and read the result; see `run_scene`."""
        return self._with_file(lambda file: run_scene(file, settings, output, error=error))

    def check(self, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Rows, degrees of freedom, and every derivative against differences; `ProgramError` where something is wrong."""
        return self._with_file(lambda file: json.loads(run_program("check", file, *settings_words(settings), "--json")))

    def show(self, settings: Mapping[str, Any] | None = None) -> str:
        """The complete scene, every default filled in."""
        return self._with_file(lambda file: run_program("show", file, *settings_words(settings)))

    def equilibrium(self, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Where it rests; see `tandem.equilibrium`."""
        return self._with_file(lambda file: equilibrium(file, settings))

    def linearise(self, settings: Mapping[str, Any] | None = None, *words: Any) -> dict[str, Any]:
        """Its eigenvalues and modes; see `tandem.linearise`."""
        return self._with_file(lambda file: linearise(file, settings, *words))

    def __repr__(self) -> str:
        counts = [f"{len(self.tables[kind])} {kind}" for kind in ("body", "joint", "constraint", "wheel", "force", "sensor")
                  if kind in self.tables]
        return f"<tandem.Mechanism: {', '.join(counts) or 'empty'}>"


def parts_of(key: str) -> list[str]:
    """The parts of a dotted key; those in quotes may have dots."""
    parts, part, quoted = [], "", False
    for letter in key:
        if letter == '"':
            quoted = not quoted
        elif letter == "." and not quoted:
            parts.append(part)
            part = ""
        else:
            part += letter
    parts.append(part)
    if quoted or not all(parts):
        raise KeyError(f"{key!r} is no dotted key")
    return parts


def lines_of(table: Mapping[str, Any], heading: str = "") -> list[str]:
    """A table as lines of TOML: its values first, then the tables in it; lists of tables are events."""
    lines = [f"{toml_key(key)} = {toml_value(value)}" for key, value in table.items() if not holds_tables(value)]
    if heading and (lines or not table):
        lines = ["", f"[{heading}]", *lines]
    for key, value in table.items():
        below = f"{heading}.{toml_key(key)}" if heading else toml_key(key)
        if isinstance(value, Mapping):
            lines += lines_of(value, below)
        elif holds_tables(value):
            for item in value:
                lines += ["", f"[[{below}]]", *(f"{toml_key(name)} = {toml_value(entry)}" for name, entry in item.items())]
    return lines


def holds_tables(value: Any) -> bool:
    return isinstance(value, Mapping) or (isinstance(value, (list, tuple)) and len(value) > 0 and isinstance(value[0], Mapping))
