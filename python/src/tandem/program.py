# SPDX-License-Identifier: MIT
"""The program `tandem`: its path, and runs of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .errors import ProgramError

HOW = ("`make python` in a checkout installs it with the package, `make install` below a prefix; put it on the PATH, "
       "or let TANDEM_PROGRAM name it")


def program_path() -> str:
    """The program: TANDEM_PROGRAM, the one in this package, or the one on the PATH."""
    named = os.environ.get("TANDEM_PROGRAM")
    own = Path(__file__).parent / "program" / "bin" / "tandem"
    found = named or (str(own) if own.exists() else shutil.which("tandem"))
    if not found or not Path(found).exists():
        raise ProgramError(f"the program tandem was not found{f' at {named}' if named else ''}: {HOW}", 2, "missing")
    return found


def run_program(*words: Any, cwd: str | Path | None = None) -> str:
    """Run `tandem WORDS...` and return its output; `ProgramError` with its message if it fails.

    Ctrl-C reaches the program too, which then ends its run with a whole file."""
    environment = {"OPENBLAS_NUM_THREADS": "1"} | dict(os.environ)
    done = subprocess.run([program_path(), *map(str, words)], cwd=cwd, env=environment, capture_output=True, encoding="utf-8",
                          errors="replace", stdin=subprocess.DEVNULL)
    if done.returncode:
        message = done.stderr.strip() or done.stdout.strip() or f"tandem ended with exit code {done.returncode}"
        status = "interrupted" if done.returncode > 128 else "refused" if done.returncode == 2 else "failed"
        raise ProgramError(message.removeprefix("tandem: "), done.returncode, status)
    return done.stdout


def toml_value(value: Any) -> str:
    """A value in TOML notation."""
    import numpy as np

    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        text = repr(float(value))
        return text if any(mark in text for mark in ".en") else text + ".0"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"{value!r} cannot be written to a scene: numbers, texts, lists and dictionaries can")


def toml_key(key: str) -> str:
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if plain else json.dumps(key)


def settings_words(settings: Mapping[str, Any] | None) -> list[str]:
    """Settings as `--set KEY=VALUE`."""
    return [word for key, value in (settings or {}).items() for word in ("--set", f"{key}={toml_value(value)}")]


def run_scene(scene: str | Path, settings: Mapping[str, Any] | None = None, output: str | Path | None = None, *,
              error: bool | None = None, force: bool = True):
    """Run a shipped scene by its name, or a scene file, and read its result.

    `settings` are keys of the scene, `{"time.end": 5}`; `output` keeps the result file; `error` estimates the error at the end (True),
    or never does (False). A run that fails raises `ProgramError`; its `solution` is the result up to there.
    """
    from .result import read

    with tempfile.TemporaryDirectory(prefix="tandem-") as folder:
        file = Path(output) if output is not None else Path(folder) / "result.h5"
        words = ["run", scene, *settings_words(settings), "--output", file, "--quiet"]
        words += ["--force"] * force + {None: [], True: ["--error"], False: ["--no-error"]}[error]
        try:
            run_program(*words)
        except ProgramError as failure:
            if failure.code != 2 and file.exists():
                failure.solution = read(file)
            raise
        return read(file)


def as_arrays(told: dict[str, Any]) -> dict[str, Any]:
    """The object printed by the program, with lists of numbers as arrays and eigenvalues as complex arrays."""
    import numpy as np

    found = dict(told)
    for name, value in told.items():
        if name == "eigenvalues":
            found[name] = np.array([complex(*pair) for pair in value], dtype=complex)
        elif isinstance(value, list) and value:
            try:
                found[name] = np.array(value, dtype=float)
            except (TypeError, ValueError):
                continue
    return found


def equilibrium(scene: str | Path, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The equilibrium of a scene, as `tandem equilibrium` returns it: `q`, `stability`, complex `eigenvalues`, ..."""
    return as_arrays(json.loads(run_program("equilibrium", scene, *settings_words(settings), "--json")))


def linearise(scene: str | Path, settings: Mapping[str, Any] | None = None, *words: Any) -> dict[str, Any]:
    """A scene linearised about its start, as `tandem linearise` returns it: complex `eigenvalues`, `modes`, ...; `words` are options
    of the program, such as "--equilibrium"."""
    return as_arrays(json.loads(run_program("linearise", scene, *settings_words(settings), *words, "--json")))
