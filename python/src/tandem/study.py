# SPDX-License-Identifier: MIT
"""Files of studies (`tandem study precision`): one row per run, as NumPy arrays."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .result import opened, text

#: Columns of texts.
TEXTS = ("scene", "stepper", "control", "status")


@dataclass
class Study:
    """A study: {name: column}, the attributes of its group, its settings, and its description of the errors."""

    columns: dict[str, np.ndarray]
    attributes: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    about: str = ""

    def series(self) -> Iterator[tuple[str, str, np.ndarray]]:
        """(stepper, control, indices of its rows) in the order of the table."""
        keys = list(zip(self.columns["stepper"], self.columns["control"], strict=True))
        for key in dict.fromkeys(keys):
            yield *key, np.array([i for i, other in enumerate(keys) if other == key])

    def fastest(self, error: float, stepper: str | None = None) -> int | None:
        """The row of the shortest complete run whose error in q is at most this, None if there is none. By the
        processor's time, which other work on the machine disturbs least."""
        good = (self.columns["status"] == "complete") & (self.columns["error_q"] <= error)
        if stepper:
            good &= self.columns["stepper"] == stepper
        rows = np.flatnonzero(good)
        return rows[self.columns["cpu_seconds"][rows].argmin()] if rows.size else None


def kind_of(path: str | Path) -> str:
    """The name of the study that wrote the file; empty for other files."""
    if Path(path).suffix.lower() == ".csv":
        with open(path, newline="", encoding="utf-8") as file:
            head = file.readline(10000).strip().split(",")
        return "precision" if {"stepper", "control", "value", "error_q"} <= set(head) else ""
    with opened(path) as file:
        return text(file.attrs.get("study", ""))


def read_study(path: str | Path) -> Study:
    """Read a study, its .h5 or its .csv."""
    if Path(path).suffix.lower() == ".csv":
        return read_rows(path)
    with opened(path) as file:
        try:
            group = file[text(file.attrs["study"])]
            columns = {name: column.asstr()[:].astype(str) if column.dtype == object else column[:] for name, column in group.items()}
            return Study(columns, dict(group.attrs), tomllib.loads(text(file.attrs["settings"])), text(file.attrs["about"]))
        except (AttributeError, KeyError, RuntimeError, TypeError) as error:
            raise ValueError(f"{path} is not a complete study: {error.args[0] if error.args else error}") from error


def read_rows(path: str | Path) -> Study:
    """The rows of a .csv, in which a number that is not known is left out."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = list(rows[0]) if rows else []
    try:
        columns = {name: np.array([row[name] if name in TEXTS else float(row[name] or "nan") for row in rows]) for name in names}
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a complete study: {error}") from error
    return Study(columns)
