# SPDX-License-Identifier: MIT
"""Reads results of runs and of studies, as the package does."""

from tandem.result import read as read_result
from tandem.result import text
from tandem.study import Study, read_study
from tandem.study import kind_of as study_of

__all__ = ["Study", "kind_of", "read_result", "read_study", "text"]


def kind_of(path):
    """Name of the study of the file, or 'result'."""
    return study_of(path) or "result"
