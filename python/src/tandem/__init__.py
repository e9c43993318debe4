# SPDX-License-Identifier: MIT
"""tandem: dynamics of multibody systems with holonomic and nonholonomic constraints.

    import tandem
    solution = tandem.solve(model, (0, 10), q, qd)      # equations of one's own, as functions of NumPy arrays
    result = tandem.Mechanism.from_toml("four_bar.toml").run()      # bodies and joints
    tandem.plot.overview(result).savefig("four_bar.pdf")
    tandem.view(result, "four_bar.html")                # a page that plays the motion
"""

from importlib import metadata as _metadata

from tandem_command import CLASH as _CLASH
from tandem_command import other_package as _other_package

if _other_package():
    raise ImportError(_CLASH)

from .errors import InvalidInput, NotEvaluable, ProgramError, RunFailed, TandemError
from .mechanism import Mechanism
from .model import FORCE, GAMMA, JACOBIAN, MASS, NU, PHI, Model, numba_signature
from .problem import Event, assemble, check
from .program import equilibrium, linearise, program_path, run_program, run_scene
from .result import Result, read
from .simulation import Occurrence, RunError, Simulation, State
from .solve import Solution, solve
from .show import plot as _plot
from .show import result_html as _result_html
from .show import solution_html as _solution_html
from .show import view as _view
from .table import Table, read_table

for _shown, _html in ((Result, _result_html), (Solution, _solution_html)):
    _shown.plot, _shown.view, _shown._repr_html_ = _plot, _view, _html

try:
    __version__ = _metadata.version("tandem-multibody")
except _metadata.PackageNotFoundError:
    __version__ = "unknown"

__all__ = [
    "FORCE", "GAMMA", "JACOBIAN", "MASS", "NU", "PHI", "Event", "InvalidInput", "Mechanism", "Model", "NotEvaluable", "Occurrence",
    "ProgramError", "Result", "RunError", "RunFailed", "Simulation", "Solution", "State", "Table", "TandemError", "assemble", "check",
    "equilibrium", "linearise", "numba_signature", "plot", "program_path", "read", "read_table", "run_program", "run_scene", "solve", "view",
]


def __getattr__(name):
    # Pictures and pages need packages that a run does not: they are loaded on first use.
    import importlib

    if name == "plot":
        return importlib.import_module(".plot", __name__)
    if name == "view":
        return importlib.import_module(".viewer", __name__).view
    raise AttributeError(f"module 'tandem' has no attribute {name!r}")
