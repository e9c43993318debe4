#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the tables of a document anew from the files of studies. tools/plots.sh calls it.

Usage: tools/fill_tables.py DOCUMENT FOLDER
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from plots.tables import fill  # noqa: E402

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    print(f"{sys.argv[1]}: {fill(*sys.argv[1:])} tables")
