# SPDX-License-Identifier: MIT
"""Result files of the program: all contents listed in doc/output.md, as arrays."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np


@dataclass(frozen=True)
class Series:
    """A dataset with its unit and its meaning; (nt) or (nt, k), then with the names of its columns."""

    values: np.ndarray
    unit: str = ""
    meaning: str = ""
    names: tuple[str, ...] = ()

    def __array__(self, dtype=None, copy=None):
        return self.values.astype(dtype) if dtype else self.values


#: Pictures and pages read no more than about this of a file.
MOST_BYTES = 2_000_000_000
#: The groups that hold one for each element.
KINDS = ("bodies", "joints", "wheels", "constraints", "forces")


def text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


@dataclass
class Result:
    """A run of the program `tandem`.

    `time` (nt), `q`, `qd`, `qdd` (nt, n) and `multipliers`, as far as the scene requested them; `names` and `units` of the
    coordinates; `result["rod.x"]` is the series of that name. `sensors["tip"]["position"]`, `diagnostics["step"]` and
    `groups["joints"]["pin"]["force"]` (the content of /bodies, /joints, /wheels, /constraints, /forces and /balance) are `Series`;
    `events`; `singular` configurations that were passed, their `time` and `error`; `report`, `scene` and `scene_text`, `status`,
    `message`; `path` of its file; of a mechanism, `drawing`: the datasets of /drawing.
    `plot()` and `view()` draw the motion.
    """

    time: np.ndarray
    names: list[str]
    units: list[str]
    q: np.ndarray
    qd: np.ndarray | None = None
    qdd: np.ndarray | None = None
    multipliers: np.ndarray | None = None
    constraints: list[str] = field(default_factory=list)
    diagnostics: dict[str, Series] = field(default_factory=dict)
    sensors: dict[str, dict[str, Series]] = field(default_factory=dict)
    groups: dict[str, dict[str, dict[str, Series]]] = field(default_factory=dict)
    events: dict[str, np.ndarray] = field(default_factory=dict)
    singular: dict[str, np.ndarray] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    scene: dict[str, Any] = field(default_factory=dict)
    scene_text: str = ""
    status: str = ""
    message: str = ""
    path: str = ""
    drawing: dict[str, Any] = field(default_factory=dict)
    #: A plot and an animation of the motion: `tandem.plot.overview` and `tandem.view`, bound by `tandem.show`.
    plot: ClassVar[Callable[..., Any]]
    view: ClassVar[Callable[..., Any]]

    @property
    def t(self) -> np.ndarray:
        return self.time

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.get("scene", {}).get("name") or Path(self.path or "result").stem

    @property
    def model(self) -> str:
        return self.scene.get("scene", {}).get("model", "")

    def __getitem__(self, name: str) -> np.ndarray:
        """The series of a coordinate by its name."""
        try:
            return self.q[:, self.names.index(name)]
        except ValueError:
            raise KeyError(f"there is no coordinate {name!r}; there are {', '.join(self.names)}") from None

    def unit(self, name: str) -> str:
        return self.units[self.names.index(name)]

    def columns(self, *names: str) -> np.ndarray:
        return np.stack([self[name] for name in names], axis=1)

    def to_xarray(self, group: str = "trajectory"):
        """An xarray dataset: "trajectory" (q, qd, qdd over time and coordinate), "sensors", "diagnostics", or one of `groups`."""
        from .xarrays import motion_dataset

        if group == "trajectory":
            values = {name: array for name, array in (("q", self.q), ("qd", self.qd), ("qdd", self.qdd)) if array is not None}
            return motion_dataset(self.time, values, self.names, self.units, {"status": self.status, "scene": self.scene_text})
        import xarray

        known = {"sensors": self.sensors, **self.groups}
        if group != "diagnostics" and group not in known:
            raise KeyError(f"there is no group {group!r}; there are trajectory, diagnostics, {', '.join(known)}")
        series = self.diagnostics if group == "diagnostics" else {
            f"{name}_{what}": one for name, all_ in known[group].items() for what, one in all_.items()}
        made = {}
        for name, one in series.items():
            dimensions = ("time", *([f"axis{one.values.shape[1]}"] if one.values.ndim > 1 else []))
            made[name] = (dimensions, one.values, {"units": one.unit, "meaning": one.meaning})
        return xarray.Dataset(made, coords={"time": ("time", self.time, {"units": "s"})}, attrs={"status": self.status})

    def __repr__(self) -> str:
        until = f"t = {self.time[0]:g} to {self.time[-1]:g} s" if self.time.size else "no rows"
        return f"<tandem.Result {self.name}: {self.status}, {until}, {self.time.size} rows of {len(self.names)} coordinates>"


def read(path: str | Path, every: int = 1) -> Result:
    """Read a result file of `tandem run`, also of a run in progress or a killed one: all complete rows; or, for large files, only one
    row in `every`."""
    if every < 1:
        raise ValueError(f"every is {every}: it must be 1 or more")
    with opened(path) as file:
        if "study" in file.attrs or not hasattr(file.get("trajectory"), "items"):
            raise ValueError(f"{path} is no result of tandem run: it has no /trajectory")
        try:
            return read_groups(path, file, every)
        except (AttributeError, IndexError, KeyError, RuntimeError, TypeError) as error:
            raise ValueError(f"{path} is no whole result of tandem run: {error.args[0] if error.args else error}") from error


@contextlib.contextmanager
def opened(path: str | Path):
    """An HDF5 file, opened to read; `OSError` with its name for other files."""
    import h5py

    if not Path(path).exists():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        file = h5py.File(path)
    except OSError as error:
        why = "it is a folder" if Path(path).is_dir() else str(error).partition("(")[2].partition(",")[0].rstrip(")") or error
        raise OSError(f"{path} cannot be read as a file of HDF5: {why}") from error
    with file:
        yield file


def rows_for_pictures(path: str | Path) -> int:
    """Stride of the rows read for a plot or an animation: 1, except for files that are too large for the memory."""
    sizes = []

    def look(_, item):
        if is_series(item):
            sizes.append(item.size*item.dtype.itemsize)

    with opened(path) as file:
        file.visititems(look)
    return max(1, -(-sum(sizes)//MOST_BYTES))


def read_groups(path: str | Path, file, every: int = 1) -> Result:
    """All of a result file."""
    trajectory = file["trajectory"]
    if "q" not in trajectory:
        raise ValueError(f"{path} holds no coordinates: the scene's [output] fields must have \"q\"")
    attributes = trajectory["q"].attrs
    # Series written together may end at different rows in the file of a run that was killed.
    beside = [file[kind] for kind in ("diagnostics", "balance") if kind in file]
    beside += [one for kind in (*KINDS, "sensors") for one in file.get(kind, {}).values()]
    nt = min(len(data) for one in (trajectory, *beside) for data in one.values() if is_series(data))

    def rows(name):
        return trajectory[name][:nt:every] if name in trajectory else None

    def group(path):
        return {name: series(data, nt, every) for name, data in file[path].items()
                if is_series(data) and name != "time"} if path in file else {}

    scene_text = text(file.attrs.get("scene", ""))
    found = Result(
        time=trajectory["time"][:nt:every], names=[text(name) for name in attributes["names"]],
        units=[text(unit) for unit in attributes["units"]], q=rows("q"), qd=rows("qd"), qdd=rows("qdd"), multipliers=rows("lambda"),
        diagnostics=group("diagnostics"), scene_text=scene_text, scene=tomllib.loads(scene_text) if scene_text else {},
        status=text(file.attrs.get("status", "")), message=text(file.attrs.get("status_message", "")), path=str(path))
    if "lambda" in trajectory:
        found.constraints = [text(name) for name in trajectory["lambda"].attrs.get("names", ())]
    found.drawing = drawing_in(file)
    found.sensors = {name: group(f"sensors/{name}") for name in file.get("sensors", {})}
    for kind in KINDS:
        if kind in file:
            found.groups[kind] = {name: group(f"{kind}/{name}") for name in file[kind]}
    if "balance" in file:
        found.groups["balance"] = {"balance": group("balance")}
    if "report" in file:
        found.report = {name: plain(value) for name, value in file["report"].attrs.items()}
    if "events" in file:
        found.events = {name: data.asstr()[:] if data.dtype.kind == "O" else data[:] for name, data in file["events"].items()
                        if name not in ("coordinate", "singular")}
        found.singular = {name: data[:] for name, data in file["events"].get("singular", {}).items()}
        if "name" in found.events:
            found.events["name"] = np.array([text(name) for name in found.events["name"]])
    return found


def drawing_in(file) -> dict[str, Any]:
    """The group /drawing of a file: arrays of numbers, and lists of texts."""
    return {name: data[:] if data.dtype.kind == "f" else [text(one) for one in data[:]] for name, data in file.get("drawing", {}).items()}


def is_series(data) -> bool:
    """True if a dataset has a row for each time."""
    return hasattr(data, "shape") and data.dtype.kind in "fi" and data.ndim > 0


def series(data, nt: int, every: int = 1) -> Series:
    attributes = data.attrs
    return Series(data[:nt:every], text(attributes.get("unit", "")), text(attributes.get("meaning", "")),
                  tuple(text(name) for name in attributes.get("names", ())))


def plain(value: Any) -> Any:
    """A number, text or list of Python."""
    if isinstance(value, np.ndarray):
        return [text(item) if isinstance(item, bytes) else item for item in value.tolist()]
    return value.item() if hasattr(value, "item") else text(value)
