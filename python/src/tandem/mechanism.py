# SPDX-License-Identifier: MIT
"""Mechanisms from bodies and joints, with the keys of scene files."""

from __future__ import annotations

import copy
import difflib
import json
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .model import DrawnModel
from .problem import Event
from .program import equilibrium, linearise, run_program, run_scene, settings_words, toml_key, toml_value
from .result import drawing_in, opened
from .simulation import Simulation
from .solve import Solution, solve


class Mechanism:
    """A scene of bodies and joints, run by the program `tandem`, or by the library in this process (`simulation`, `solve`).

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
        # A copy: what is changed here later is not the caller's.
        place[last] = copy.deepcopy(value)

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

    def model(self, settings: Mapping[str, Any] | None = None, t_span: tuple[float, float] | None = None) -> DrawnModel:
        """The mechanism as a model for `tandem.Simulation` and `tandem.solve`, without the program."""
        made = Mechanism()
        made.tables = copy.deepcopy(self.tables)
        for key, value in (settings or {}).items():
            made[key] = value
        tables = made.tables
        given = {key.removeprefix("solver."): value for key, value in (settings or {}).items() if key.startswith("solver.")}
        if "solver" in tables:
            replace_steps(tables["solver"], given)
        refuse_unknown(tables)
        scene, initial, time = (tables.get(name, {}) for name in ("scene", "initial", "time"))
        if scene.get("model", "mechanism") != "mechanism":
            raise ValueError(f"the model {scene['model']} is none of bodies and joints: `run()` lets the program run it")
        if t_span is None and "end" not in time:
            raise ValueError("the end of the run is not known: give t_span, or the key time.end")
        span = tuple(map(float, t_span if t_span is not None else (time.get("start", 0.0), time["end"])))
        keys = [(key, toml_value(value)) for kind, table in tables.items() if kind in KINDS for key, value in flat(table, toml_key(kind))]
        return DrawnModel(keys, planar=bool(scene.get("planar", False)), is_open=bool(initial.get("assemble", False)), times=span,
                          initial=dict(initial), scene=tables)

    def simulation(self, settings: Mapping[str, Any] | None = None, *, t_span: tuple[float, float] | None = None, q: Any = None,
                   qd: Any = None, events: Any = None, **options: Any) -> Simulation:
        """A run in this process, step by step: see `tandem.Simulation`. It starts from the initial state of the scene, or from q and qd; its events are
        those of the scene and `events`; options of the scene's [solver] count where they are not given here."""
        model = self.model(settings, t_span)
        return Simulation(model, q, qd, model.times[0], events=[*scene_events(model.scene), *listed(events)],
                          **solver_options(model.scene, options))

    def solve(self, t_span: tuple[float, float] | None = None, *, settings: Mapping[str, Any] | None = None, q: Any = None, qd: Any = None,
              events: Any = None, **options: Any) -> Solution:
        """A whole run in this process, its rows in memory: see `tandem.solve`. Only `run` returns sensors and `[results]`."""
        model = self.model(settings, t_span)
        return solve(model, model.times, q, qd, events=[*scene_events(model.scene), *listed(events)],
                     **solver_options(model.scene, options))

    def check(self, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Rows, degrees of freedom, and a comparison of all derivatives with differences; `ProgramError` on a wrong result."""
        return self._with_file(lambda file: json.loads(run_program("check", file, *settings_words(settings), "--json")))

    def show(self, settings: Mapping[str, Any] | None = None) -> str:
        """The complete scene, with all defaults."""
        return self._with_file(lambda file: run_program("show", file, *settings_words(settings)))

    def drawing(self) -> dict[str, Any]:
        """The geometry for viewers: the group /drawing of a result file (doc/output.md)."""
        def derive(file: Path) -> dict[str, Any]:
            path = file.with_suffix(".h5")
            run_program("show", file, "--drawing", path)
            with opened(path) as found:
                return drawing_in(found)

        return self._with_file(derive)

    def equilibrium(self, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The equilibrium; see `tandem.equilibrium`."""
        return self._with_file(lambda file: equilibrium(file, settings))

    def linearise(self, settings: Mapping[str, Any] | None = None, *words: Any) -> dict[str, Any]:
        """Its eigenvalues and modes; see `tandem.linearise`."""
        return self._with_file(lambda file: linearise(file, settings, *words))

    def __repr__(self) -> str:
        counts = [f"{len(self.tables[kind])} {kind}" for kind in ("body", "joint", "constraint", "wheel", "force", "sensor")
                  if kind in self.tables]
        return f"<tandem.Mechanism: {', '.join(counts) or 'empty'}>"


#: The tables of a run, with their keys where the program alone would look at them.
RUN = {"scene": ("name", "description", "model", "group", "planar"), "time": ("start", "end"),
       "initial": ("assemble", "fixed", "fixed_velocities", "weights", "velocity_weights", "velocity_metric", "largest_move",
                   "largest_velocity_move", "equilibrium", "steady", "q", "qd"), "solver": (), "output": (), "event": ()}
#: The tables of a mechanism; their keys are defined in the library.
KINDS = ("parameters", "gravity", "ground", "results", "function", "body", "joint", "constraint", "wheel", "force", "sensor", "repeat")


def refuse_unknown(tables: Mapping[str, Any]) -> None:
    """Unknown tables, and keys of the run without effect."""
    for kind, table in tables.items():
        if kind not in KINDS and kind not in RUN:
            raise ValueError(f'there is no table "{kind}" in a scene{question(kind, (*KINDS, *RUN))}')
        for key in table if RUN.get(kind) else ():
            if key not in RUN[kind]:
                raise ValueError(f'unknown key "{key}" of [{kind}]{question(key, RUN[kind])}; its keys are {", ".join(RUN[kind])}')


def question(word: str, names: Any) -> str:
    """The most similar name, if there is one."""
    near = difflib.get_close_matches(word, names, 1)
    return f' (did you mean "{near[0]}"?)' if near else ""


def flat(table: Mapping[str, Any], before: str) -> Iterator[tuple[str, Any]]:
    """A table as dotted keys with values."""
    for name, value in table.items():
        # The library's keys are parts joined by dots, without quotes.
        key = f"{before}.{name}"
        if isinstance(value, Mapping):
            yield from flat(value, key)
        else:
            yield key, value


def listed(events: Any) -> list[Any]:
    return [] if events is None else [events] if callable(events) or isinstance(events, (Event, Mapping)) else list(events)


def scene_events(scene: Mapping[str, Any]) -> list[Event]:
    """The events of a scene that watch coordinates, velocities or multipliers."""
    found = []
    for number, table in enumerate(scene.get("event", [])):
        watch, name = str(table.get("watch", "")), table.get("name", f"event {number + 1}")
        unknown = set(table) - {"name", "watch", "value", "direction", "action"}
        if watch.startswith("/") or unknown:
            raise ValueError(f"the event {name!r} {'watches ' + watch if watch.startswith('/') else 'has ' + ', '.join(unknown)}: `run()` lets "
                             "the program do that; here, a function of (t, q, qd) will")
        quantity, _, entry = watch.rpartition(":")
        direction = {"rising": 1, "falling": -1, "both": 0}.get(table.get("direction", "both"))
        if direction is None or table.get("action", "record") not in ("record", "stop"):
            raise ValueError(f"the event {name!r}: direction is rising, falling or both, and action record or stop")
        found.append(Event(name=name, quantity=quantity or "q", index=entry, value=float(table.get("value", 0.0)), direction=direction,
                           stops=table.get("action") == "stop"))
    return found


def replace_steps(solver: dict[str, Any], given: Mapping[str, Any]) -> None:
    """Remove what given options replace: a step replaces tolerances, and a tolerance a step, unless both are given."""
    if given.get("step"):
        for key in {"rtol", "rtol_qd", "atol", "atol_qd", "first_step", "max_step"} - {*given}:
            solver.pop(key, None)
    if (given.get("rtol") or given.get("rtol_qd")) and "step" not in given:
        solver.pop("step", None)


def solver_options(scene: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a scene and those given, which come first: a step replaces the tolerances of the scene, a tolerance its step."""
    solver = dict(scene.get("solver", {}))
    replace_steps(solver, given)
    return {**solver, **{key: value for key, value in given.items() if value is not None}}


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
