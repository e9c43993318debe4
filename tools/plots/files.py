# SPDX-License-Identifier: MIT
"""Reads what studies write; results of runs are read by the package."""

import tomllib
from dataclasses import dataclass

import h5py
import numpy as np
from tandem.result import read as read_result

__all__ = ["Study", "kind_of", "read_result", "read_study", "text"]


def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def kind_of(path):
    """The name of the study whose file this is, or 'result'."""
    with h5py.File(path) as file:
        return text(file.attrs["study"]) if "study" in file.attrs else "result"


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
