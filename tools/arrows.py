#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Dependencies between folders: the `use` statements of all modules of src, io, cli and app as arrows between their folders.

Usage: tools/arrows.py          print each arrow, the number of `use` statements, and their files
       tools/arrows.py write    update them in CONTRIBUTING.md

Files directly below src/tandem form a folder, the base; those that only re-export names are the face of a
package. tools/docs.py checks that there is no circle, and that the diagram agrees with the sources.
"""

import re
import sys
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = "CONTRIBUTING.md"
BEGIN, END = "<!-- tools/arrows.py write -->\n", "<!-- end -->\n"
MODULE = re.compile(r"^\s*(?:module|submodule\s*\(\s*\w+(?:\s*:\s*\w+)?\s*\))\s+(?!procedure\b)(\w+)\s*(?:!.*)?$", re.I | re.M)
USE = re.compile(r"^\s*(?:use\b(?:\s*,\s*(?:non_)?intrinsic)?\s*(?:::)?|submodule\s*\()\s*(\w+)", re.I | re.M)


def folder(root, path):
    """The node that a source belongs to."""
    parts = path.parts
    if parts[0] == "app":
        return "app"
    package = "" if parts[0] == "src" else parts[0] + "/"
    inner = parts[parts.index("src") + 1 :]
    if len(inner) == 1:
        return parts[0] if package else "tandem.f90"
    # A file beside a folder of its name belongs to this folder.
    below = len(inner) > 2 or (root / path).with_suffix("").is_dir()
    return package + (Path(inner[1]).stem if below else "base")


def find_arrows(root):
    """From each folder to those that it uses: number of uses, and their files."""
    sources = {}
    for package in ("src", "io/src", "cli/src", "app"):
        for path in sorted((root / package).rglob("*.[fF]90")):
            sources[path.relative_to(root)] = path.read_text()
    home = {name.lower(): folder(root, path) for path, text in sources.items() for name in MODULE.findall(text)}
    arrows = defaultdict(lambda: defaultdict(list))
    for path, text in sources.items():
        here = arrows[folder(root, path)]
        for name in USE.findall(text):
            there = home.get(name.lower())
            if there and there != folder(root, path):
                here[there].append(str(path))
    return arrows


def in_order(arrows):
    """The folders, each after those it uses; a ValueError names a circle."""
    try:
        return list(TopologicalSorter({here: sorted(arrows[here]) for here in sorted(arrows)}).static_order())
    except CycleError as error:
        circle = error.args[1][::-1]
        files = [f"{one} uses {other} in {', '.join(sorted(set(arrows[one][other])))}" for one, other in zip(circle, circle[1:])]
        raise ValueError("; ".join(files)) from None


def draw(arrows):
    """The arrows without those that follow from others, for Mermaid."""
    reach = {}
    lines = ["```mermaid", "graph BT"]
    for here in in_order(arrows):
        beyond = set().union(*(reach[there] for there in arrows[here]))
        reach[here] = beyond | set(arrows[here])
        lines += [f"    {here} --> {there}" for there in sorted(set(arrows[here]) - beyond)]
    return "\n".join([*lines, "```", ""])


def problems(root=ROOT):
    """Problems: a circle, or a diagram that differs from the sources."""
    try:
        drawing = draw(find_arrows(root))
    except ValueError as error:
        return [f"folders use each other: {error}"]
    if BEGIN + drawing + END not in (root / PAGE).read_text():
        return [f"{PAGE} shows other arrows than the sources have: tools/arrows.py write"]
    return []


def write(root=ROOT):
    page = root / PAGE
    before, rest = page.read_text().split(BEGIN)
    page.write_text(before + BEGIN + draw(find_arrows(root)) + END + rest.split(END, 1)[1])


if __name__ == "__main__":
    if sys.argv[1:] == ["write"]:
        write()
    elif sys.argv[1:]:
        sys.exit(__doc__)
    else:
        table = find_arrows(ROOT)
        for one in sorted(table):
            for other, files in sorted(table[one].items()):
                print(f"{one} -> {other}: {len(files)} ({', '.join(sorted(set(files)))})")
        print(*problems(), sep="\n", end="")
