# SPDX-License-Identifier: MIT
"""The shared library by ctypes: its path, and the types of its functions. ctypes releases the interpreter's lock while a
function of the library runs."""

from __future__ import annotations

import ctypes
import functools
import os
from ctypes import c_char_p, c_double, c_int, c_void_p
from pathlib import Path

#: The interface that this package was written for: the same major number, and at least this minor one.
INTERFACE = 1012

#: The types of a model's functions, see include/tandem.h. Addresses come as numbers, which costs least.
POSITION = ctypes.CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p)
MOTION = ctypes.CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p, c_void_p)
EVALUATE = ctypes.CFUNCTYPE(c_int, c_int, c_double, *[c_void_p] * 9)

# Arguments after the problem; all of these return a status.
FUNCTIONS = {
    "set_key": (c_char_p, c_char_p),
    "define": (c_int, c_int, c_double, c_double),
    "get_sizes": (c_void_p, c_void_p, c_void_p),
    "get_drawing": (c_void_p, c_void_p),
    "get_name": (c_char_p, c_int, c_int, c_char_p),
    "linearise": (c_double, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p),
    "find_equilibrium": (c_double, c_void_p),
    "find_steady_motion": (c_double, c_void_p, c_void_p, c_char_p),
    "set_position_function": (c_char_p, c_void_p),
    "set_motion_function": (c_char_p, c_void_p),
    "set_direction_function": (c_char_p, c_void_p),
    "set_evaluate": (c_void_p, c_int),
    "set_row_name": (c_int, c_char_p),
    "check": (c_double, c_void_p, c_void_p),
    "set_real": (c_char_p, c_double),
    "set_integer": (c_char_p, c_int),
    "set_text": (c_char_p, c_char_p),
    "set_vector": (c_char_p, c_int, c_void_p),
    "add_event": (c_char_p, c_char_p, c_int, c_double, c_int, c_int),
    "add_event_function": (c_char_p, c_void_p, c_int, c_int),
    "clear_events": (),
    "start": (c_double, c_void_p, c_void_p),
    "integrate": (c_double,),
    "step": (c_double,),
    "advance": (c_double, c_int, c_int, c_int, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p),
    "count_events": (c_void_p,),
    "get_event": (c_int, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p),
    "get_stop": (c_void_p,),
    "watch_error": (c_double,),
    "estimate_error": (),
    "assemble": (c_double, c_void_p, c_void_p),
    "get_state": (c_void_p, c_void_p, c_void_p, c_void_p),
    "get_state_at": (c_double, c_void_p, c_void_p, c_void_p),
    "get_multipliers": (c_double, c_void_p),
    "get_energies": (c_void_p, c_void_p),
    "get_statistic": (c_char_p, c_void_p),
    "count_warnings": (c_void_p,),
    "get_warning": (c_int, c_int, c_char_p),
    "save_state": (c_int, c_void_p, c_void_p),
    "restore_state": (c_int, c_void_p),
    "get_segment": (),
}


def library_path() -> str:
    """Path of the library: TANDEM_LIBRARY, the one in this package, or the one found by the dynamic linker. A wheel holds one for newer
    processors too, and a file that makes the dynamic linker choose."""
    named = os.environ.get("TANDEM_LIBRARY")
    if named:
        return named
    name = f"libtandem.so.{INTERFACE // 1000}"
    folder = Path(__file__).parent / "program" / "lib"
    return next((str(file) for file in (folder / "tandem" / "libtandem-chosen.so", folder / name) if file.exists()), name)


@functools.cache
def library() -> ctypes.CDLL:
    """The library, loaded once."""
    path = library_path()
    try:
        loaded = ctypes.CDLL(path)
    except OSError as error:
        raise ImportError(
            f"the library of tandem cannot be loaded: {error}. `make python` in a checkout installs a package that holds it "
            "(it needs LAPACK and the run-time library of gfortran: apt-get install liblapack3 libgfortran5); "
            "TANDEM_LIBRARY names another file") from error
    version = loaded.tandem_interface_version()
    if version // 1000 != INTERFACE // 1000 or version < INTERFACE:
        raise ImportError(f"{path} has the version {version} of the interface, and this package needs {INTERFACE}: "
                          "install library and package from the same checkout")
    loaded.tandem_new.restype = c_void_p
    loaded.tandem_new.argtypes = [c_int, c_int, c_int, c_void_p]
    loaded.tandem_new_mechanism.restype = c_void_p
    loaded.tandem_new_mechanism.argtypes = [c_void_p]
    loaded.tandem_free.restype = None
    loaded.tandem_free.argtypes = [c_void_p]
    loaded.tandem_message.restype = c_char_p
    loaded.tandem_message.argtypes = [c_void_p]
    for name, arguments in FUNCTIONS.items():
        function = getattr(loaded, f"tandem_{name}")
        function.restype = c_int
        function.argtypes = [c_void_p, *arguments]
    return loaded
