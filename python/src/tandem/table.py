# SPDX-License-Identifier: MIT
"""Tables of sweeps (`tandem sweep`): one row per case, as NumPy arrays with units, and as a dataset of xarray."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .result import opened, plain, text


@dataclass
class Column:
    """A column of a table: values (cases), or (cases, times) with the times."""

    values: np.ndarray
    unit: str = ""
    times: np.ndarray | None = None
    #: The texts that the values stand for, from 1.
    labels: list[str] = field(default_factory=list)
    #: The key of an input, or the quantity of an output and what was taken of it.
    key: str = ""
    take: str = ""

    @property
    def data(self) -> np.ndarray:
        """The given values: texts if numbers represent texts, otherwise numbers."""
        if not self.labels:
            return self.values
        return np.array(self.labels, dtype=object)[self.values.astype(int) - 1]


@dataclass
class Indices:
    """Sobol' indices of an output, a row an input: of first order and total, each with half of the interval that holds 95 % of a
    bootstrap; and of how many blocks of cases they are made."""

    inputs: list[str]
    first: np.ndarray
    first_error: np.ndarray
    total: np.ndarray
    total_error: np.ndarray
    blocks: int = 0


@dataclass
class Table:
    """A table of cases.

    `table["rz_min"]` is a column by its name, `table.unit("rz_min")` its unit; `inputs` and `outputs` hold them with their
    attributes. Values of failed cases are NaN: `status` is 0 for finished cases, `messages` maps the number of each other case to
    its status and its message.
    """

    name: str
    inputs: dict[str, Column]
    outputs: dict[str, Column]
    #: 0 for a finished case, otherwise the code of a status (doc/statuses.md).
    status: np.ndarray
    #: The numbers of the cases, from 1, and the wall time of each (s).
    case: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    seconds: np.ndarray = field(default_factory=lambda: np.zeros(0))
    #: Of cases that failed: the name of the status and the message.
    messages: dict[int, tuple[str, str]] = field(default_factory=dict)
    indices: dict[str, Indices] = field(default_factory=dict)
    #: Seed, draws, design, versions.
    attributes: dict[str, Any] = field(default_factory=dict)
    #: The sweep's file, and the scene with every default.
    sweep_text: str = ""
    scene_text: str = ""

    def column(self, name: str) -> Column:
        """An input or an output by its name."""
        for columns in (self.outputs, self.inputs):
            if name in columns:
                return columns[name]
        raise KeyError(f"there is no column {name!r}; there are {', '.join([*self.inputs, *self.outputs])}")

    def __getitem__(self, name: str) -> np.ndarray:
        """The values of an input or an output (cases), or (cases, times)."""
        return self.column(name).data

    def __len__(self) -> int:
        return len(self.status)

    def unit(self, name: str) -> str:
        return self.column(name).unit

    @property
    def names(self) -> list[str]:
        """The columns: inputs, then outputs."""
        return [*self.inputs, *self.outputs]

    @property
    def done(self) -> np.ndarray:
        """True for each finished case: `table["rz_min"][table.done]` has no rows of cases that failed."""
        return self.status == 0

    def to_xarray(self):
        """An xarray dataset over `case`: inputs are coordinates, outputs and the status variables; an output at times has a dimension
        NAME_time of its own. Units stand in the attribute `units`."""
        try:
            import xarray
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError("there is no package xarray: pip install xarray") from error
        coordinates = {"case": ("case", self.case)}
        for name, one in self.inputs.items():
            coordinates[name] = ("case", one.data, {"units": one.unit, "key": one.key})
        made = {}
        for name, one in self.outputs.items():
            dimensions = ("case",)
            if one.times is not None:
                dimensions = ("case", f"{name}_time")
                coordinates[f"{name}_time"] = (f"{name}_time", one.times, {"units": "s"})
            # A quantity may have the name of an input, and xarray takes each name once.
            own = f"{name}_kept" if name in coordinates else name
            made[own] = (dimensions, one.values, {"units": one.unit, "quantity": one.key, "take": one.take})
        made["status" if "status" not in coordinates and "status" not in made else "status_of_case"] = ("case", self.status)
        return xarray.Dataset(made, coords=coordinates, attrs={**self.attributes, "sweep": self.sweep_text, "scene": self.scene_text})

    def __repr__(self) -> str:
        return (f"<tandem.Table {self.name}: {np.count_nonzero(self.done)} of {len(self)} cases done, inputs {', '.join(self.inputs)}, "
                f"outputs {', '.join(self.outputs)}>")


def is_table(path: str | Path) -> bool:
    """True if a file is the table of a sweep."""
    with opened(path) as file:
        return "inputs" in file and "outputs" in file and "status" in file


def read_table(path: str | Path | Table) -> Table:
    """Read the table of a sweep, the file TABLE.h5 that `tandem sweep` writes."""
    if isinstance(path, Table):
        return path
    with opened(path) as file:
        if not ("inputs" in file and "outputs" in file and "status" in file):
            raise ValueError(f"{path} is no table of tandem sweep: it has no /inputs, /outputs and /status")
        try:
            return read_groups(path, file)
        except (AttributeError, IndexError, KeyError, RuntimeError, TypeError) as error:
            raise ValueError(f"{path} is no whole table of tandem sweep: {error.args[0] if error.args else error}") from error


def read_groups(path: str | Path, file) -> Table:
    """All of a table."""

    def attribute(item, name):
        return text(item.attrs.get(name, ""))

    def whole_text(name):
        return text(file[name][0]) if name in file and len(file[name]) else ""

    inputs = {name: Column(item[()].astype(float), attribute(item, "unit"), None, [text(one) for one in item.attrs.get("labels", [])],
                           attribute(item, "key"), attribute(item, "values")) for name, item in file["inputs"].items()}
    outputs = {}
    for name, item in file["outputs"].items():
        # The times of NAME stand beside it as NAME.times.
        if name.endswith(".times") and name.removesuffix(".times") in file["outputs"]:
            continue
        times = file["outputs"].get(f"{name}.times")
        outputs[name] = Column(item[()], attribute(item, "unit"), times[()] if times is not None else None, [],
                               attribute(item, "quantity"), attribute(item, "take"))
    status = file["status"][()]
    made = Table(Path(path).stem, inputs, outputs, status, sweep_text=whole_text("sweep"), scene_text=whole_text("scene"),
                 attributes={name: plain(value) for name, value in file.attrs.items()})
    made.case = file["case"][()] if "case" in file else np.arange(1, len(status) + 1)
    made.seconds = file["seconds"][()] if "seconds" in file else np.full(len(status), np.nan)
    if "failures" in file:
        group = file["failures"]
        made.messages = {int(case): (text(kind), text(said)) for case, kind, said in
                         zip(group["case"][()], group["status"][()], group["message"][()], strict=True)}
    if "indices" in file:
        group = file["indices"]
        names = [text(name) for name in group["inputs"][()]]
        made.indices = {name: Indices(names, *item[()].T, blocks=int(item.attrs["blocks"])) for name, item in group.items()
                        if name != "inputs"}
    return made
