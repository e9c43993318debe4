# SPDX-License-Identifier: MIT
"""The pictures of tools/plot.py, one module a kind. Those of single runs are drawn by the package for Python, as `tandem plot` does."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "src"))
