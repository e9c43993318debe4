# SPDX-License-Identifier: MIT
"""Motions as datasets of xarray."""

from __future__ import annotations

import numpy as np


def motion_dataset(time: np.ndarray, values: dict[str, np.ndarray], names: list[str], units: list[str], attributes: dict):
    """q, qd, qdd (nt, n) over time and coordinate; units are a coordinate of their own."""
    try:
        import xarray
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("there is no package xarray: pip install xarray") from error
    return xarray.Dataset(
        {name: (("time", "coordinate"), array) for name, array in values.items()},
        coords={"time": ("time", time, {"units": "s"}), "coordinate": ("coordinate", np.array(names, dtype=object)),
                "unit": ("coordinate", np.array(units, dtype=object))},
        attrs=attributes)
