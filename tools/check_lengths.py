#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""No procedure of our libraries and programs is longer than 100 lines, procedures that it contains included.

Usage: tools/check_lengths.py

Prints "ok lengths of procedures", or "not ok" with those that are longer; tools/verify.py counts them. Exit code 1 if anything is.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("src", "io/src", "cli/src", "mpi/src", "app")
MOST = 100
PREFIX = r"(?:(?:pure|elemental|impure|recursive|module|logical|integer|real|complex|character|type)(?:\([^)]*\))?\s+)*"
BEGIN = re.compile(rf"\s*(?:{PREFIX}(?:subroutine|function)\s+(\w+)|module procedure (\w+)$)", re.I)
END = re.compile(r"\s*end (?:subroutine|function|procedure)\b", re.I)
INTERFACE = re.compile(r"\s*(end )?(?:abstract )?interface\b", re.I)


def procedures(lines):
    """(name, length) of each that is more than an interface."""
    # An interface may hold a procedure whose argument has one.
    begun, interfaces = [], 0
    for number, line in enumerate(lines):
        if border := INTERFACE.match(line):
            interfaces += -1 if border[1] else 1
        elif interfaces:
            continue
        elif END.match(line):
            name, first = begun.pop()
            yield name, number - first + 1
        elif begin := BEGIN.match(line):
            begun.append((begin[1] or begin[2], number))


def main():
    found = [f"{path.relative_to(ROOT)}: {name} has {length} lines" for folder in FOLDERS
             for path in sorted((ROOT / folder).rglob("*.f90"))
             for name, length in procedures(path.read_text().splitlines()) if length > MOST]
    print("\n".join([f"{'not ' * bool(found)}ok lengths of procedures", *found]))
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
