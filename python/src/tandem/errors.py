# SPDX-License-Identifier: MIT
"""Exceptions for the statuses of the library."""

from __future__ import annotations

#: Names of the statuses by their codes, as doc/statuses.md lists them.
STATUSES = {
    0: "ok", -1: "invalid_option", -2: "invalid_model", -3: "inconsistent_start", -4: "rank_deficient", -5: "singular_mass",
    -6: "callback_failed", -7: "not_evaluable", -8: "not_finite", -9: "position_diverged", -10: "chart_left",
    -11: "constraints_not_held", -12: "step_underflow", -13: "step_limit", -14: "output_failed", -15: "newton_failed",
    -16: "inconsistent_rows", -17: "event_limit", -18: "work_limit", -19: "invalid_checkpoint", -20: "interrupted",
    -21: "no_equilibrium",
}


class TandemError(RuntimeError):
    """A call that failed.

    `status` is the name of the failure, `code` its number, `str(error)` names the problem and the remedy. After a run of `solve`
    that failed midway, `solution` holds the part before the failure.
    """

    def __init__(self, message: str, code: int = 0, status: str | None = None):
        super().__init__(message)
        self.code = code
        self.status = status or STATUSES.get(code, str(code))
        self.solution = None


class InvalidInput(TandemError, ValueError):
    """Invalid options, model, start or checkpoint."""


class RunFailed(TandemError):
    """A run that cannot continue. The state is that of the last accepted step."""


class ProgramError(TandemError):
    """The program `tandem` is missing or failed; `code` is its exit code."""


class NotEvaluable(Exception):
    """Raised by a function of a model that is undefined at this point; requests a smaller step."""


def error_of(code: int, message: str) -> TandemError:
    """The exception for a status of the library."""
    kind = InvalidInput if code in (-1, -2, -3, -16, -19) else RunFailed
    return kind(message, code)
