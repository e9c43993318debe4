# SPDX-License-Identifier: MIT
"""How results and solutions show themselves: plots, animations, and tables in a notebook. The package binds these functions as methods,
so that results are data, and the modules that draw them import them."""

from __future__ import annotations

import base64
import html
import io
from pathlib import Path
from typing import Any


def plot(given, *arguments: Any, **options: Any):
    """A plot of the motion, see `tandem.plot.overview`."""
    from .plot import overview

    return overview(given, *arguments, **options)


def view(given, path: str | Path | None = None, **options: Any):
    """An animation of the motion, see `tandem.view`."""
    from .viewer import view

    return view(given, path, **options)


def table(rows: list[tuple[str, str]]) -> str:
    cells = "".join(f"<tr><th style='text-align:left'>{html.escape(name)}</th><td style='text-align:left'>{html.escape(value)}</td></tr>"
                    for name, value in rows if value)
    return f"<table>{cells}</table>"


def picture(given) -> str:
    """An overview as an image within the page, where matplotlib is there and there is something to draw."""
    file = io.BytesIO()
    try:
        plot(given).savefig(file, format="png")
    except (ModuleNotFoundError, ValueError):
        return ""
    return f"<img alt='overview' style='max-width:100%' src='data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}'>"


def span(time) -> str:
    return f"{time[0]:g} to {time[-1]:g} s, {time.size} rows" if time.size else "none"


def result_html(result) -> str:
    report = result.report
    error = f"{report['global_error_q']:.2g} of the coordinates at the end" if "global_error_q" in report else ""
    rows = [("scene", result.name), ("", result.scene.get("scene", {}).get("description", "")),
            ("status", " ".join(part for part in (result.status, result.message) if part)), ("time", span(result.time)),
            ("coordinates", f"{len(result.names)}: {', '.join(result.names[:12])}{', ...' if len(result.names) > 12 else ''}"),
            ("sensors", ", ".join(result.sensors)), ("steps", str(report.get("steps", ""))), ("estimated error", error)]
    return table(rows) + picture(result)


def solution_html(solution) -> str:
    error = f"{solution.error.q:.2g} of the coordinates at the end" if solution.error else ""
    rows = [("status", f"{solution.status}, {solution.message}"), ("time", span(solution.t)),
            ("coordinates", f"{len(solution.names)}: {', '.join(solution.names[:12])}{', ...' if len(solution.names) > 12 else ''}"),
            ("steps", str(solution.statistics.get("steps", ""))), ("events", str(len(solution.events) or "")),
            ("warnings", "; ".join(solution.warnings)), ("estimated error", error)]
    return table(rows) + picture(solution)
