# SPDX-License-Identifier: MIT
"""The pictures of tools/plot.py, one module per kind. The package for Python draws those of single runs."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "src"))
