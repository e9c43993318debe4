# SPDX-License-Identifier: MIT
"""Reads what tandem writes: results of runs and of studies."""

import tomllib
from dataclasses import dataclass, field

import h5py
import numpy as np


def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def kind_of(path):
    """The name of the study whose file this is, or 'result'."""
    with h5py.File(path) as file:
        return text(file.attrs["study"]) if "study" in file.attrs else "result"


@dataclass
class Result:
    """A run: times, {name: (series, unit)} of the coordinates, {name: (series, unit)} of the diagnostics, the scene."""

    time: np.ndarray
    coordinates: dict
    diagnostics: dict = field(default_factory=dict)
    scene: dict = field(default_factory=dict)
    report: dict = field(default_factory=dict)

    def __getitem__(self, name):
        return self.coordinates[name][0]

    def columns(self, *names):
        return np.stack([self[name] for name in names], axis=1)

    def unit(self, name):
        return self.coordinates[name][1]


def read_result(path):
    with h5py.File(path) as file:
        trajectory = file["trajectory"]
        q = trajectory["q"]
        names = [text(name) for name in q.attrs["names"]]
        units = [text(unit) for unit in q.attrs["units"]]
        values = q[:]
        diagnostics = {}
        for name, series in file.get("diagnostics", {}).items():
            diagnostics[name] = (series[:], text(series.attrs["unit"]))
        scene = tomllib.loads(text(file.attrs["scene"])) if "scene" in file.attrs else {}
        coordinates = {name: (values[:, j], units[j]) for j, name in enumerate(names)}
        return Result(trajectory["time"][:], coordinates, diagnostics, scene, dict(file["report"].attrs))


@dataclass
class Study:
    """A study: {name: column}, the attributes of its group, its settings and what it says about itself."""

    columns: dict
    attributes: dict
    settings: dict
    about: str

    def series(self):
        """(stepper, control, indices of its rows) in the order of the table."""
        keys = list(zip(self.columns["stepper"], self.columns["control"], strict=True))
        for key in dict.fromkeys(keys):
            yield *key, np.array([i for i, other in enumerate(keys) if other == key])

    def fastest(self, error, stepper=None):
        """The row of the shortest complete run whose error in q is at most this, None where there is none. By the
        processor's time, which other work on the machine disturbs least."""
        good = (self.columns["status"] == "complete") & (self.columns["error_q"] <= error)
        if stepper:
            good &= self.columns["stepper"] == stepper
        rows = np.flatnonzero(good)
        return rows[self.columns["cpu_seconds"][rows].argmin()] if rows.size else None


def read_study(path):
    with h5py.File(path) as file:
        group = file[text(file.attrs["study"])]
        columns = {name: column.asstr()[:].astype(str) if column.dtype == object else column[:]
                   for name, column in group.items()}
        return Study(columns, dict(group.attrs), tomllib.loads(text(file.attrs["settings"])), text(file.attrs["about"]))
