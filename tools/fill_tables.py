#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Updates the tables of a document from the files of studies, or of `make bench`. tools/plots.sh and tools/bench.sh call it.

Usage: tools/fill_tables.py DOCUMENT FOLDER
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from plots import performance, tables  # noqa: E402

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    document, folder = sys.argv[1:]
    kind = performance if document.endswith("performance.md") else tables
    print(f"{document}: {tables.fill(document, kind.Tables(folder))} tables")
