#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Updates the tables of doc/scene_reference.md: every key of a scene, as shown by the program.

Usage: tools/scene_reference.py           write them; the program is build/tandem, or what TANDEM names
       tools/scene_reference.py --check   exit code 1 if the page differs from the program

A table stands between `<!-- keys: TABLE -->`, or `<!-- keys: TABLE MODEL -->` for one that belongs to a model, and `<!-- end -->`.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "doc" / "scene_reference.md"
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
MODELS = ["rolling_disk", "articulated_vehicle", "motorcycle"]
# Smallest scenes, and settings that show keys that appear on demand.
LEAST = '[scene]\nmodel = "{}"\n[time]\nend = 1.0\n[[event]]\nname = "event"\nwatch = "qd:{}"\n'
WATCHED = {"rolling_disk": "rx", "articulated_vehicle": "x1", "motorcycle": "rx"}
MORE = ["initial.assemble=true", "solver.rtol_qd=1e-8", "solver.atol_qd=1e-8"]
REQUIRED = {("scene", "model"), ("time", "end"), ("event", "name"), ("event", "watch")}
# Value derived from the name of the file.
NAMED = {("scene", "name"): "that of the file", ("output", "file"): "`NAME.h5`"}
ENTRY = re.compile(r"""([A-Za-z]\w*) = ((?:"[^"]*"|\[.*?\]|[^ #]+))(?: +# (.*))?$""")


def entries(text):
    """(table, key): (value, comment) of a scene as `tandem show` prints it."""
    found, table = {}, ""
    for line in text.splitlines():
        heading = re.match(r"\[+(\w+)\]+$", line)
        entry = ENTRY.match(line)
        if heading:
            table = heading[1]
        elif entry:
            found[table, entry[1]] = entry[2], entry[3] or ""
        elif line and not line.startswith("#"):
            raise SystemExit(f"scene_reference: cannot read {line!r}")
    return found


def shown(model, *settings):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.toml").write_text(LEAST.format(model, WATCHED[model]))
        arguments = [TANDEM, "show", "scene.toml", *(word for setting in settings for word in ("--set", setting))]
        return entries(subprocess.run(arguments, cwd=folder, check=True, capture_output=True, text=True).stdout)


def table(name, model):
    """Key, default and meaning of each key of a table. A model's [initial] holds its own keys, up to `assemble`."""
    plain, whole = shown(model or MODELS[0]), shown(model or MODELS[0], *MORE)
    keys = [key for there, key in whole if there == name]
    if name == "initial":
        first = keys.index("assemble")
        keys = keys[:first] if model else keys[first:]
    lines = ["| key | default | meaning |", "|---|---|---|"]
    for key in keys:
        place, (value, comment) = (name, key), whole[name, key]
        # Details of the assembly have defaults if it takes place; other keys that are not shown have none.
        value = plain.get(place, (value if name == "initial" else "", ""))[0]
        default = "required" if place in REQUIRED else NAMED.get(place, f"`{value}`" if value else "none")
        if key.endswith("weights"):
            default = "1/scale²"
        lines.append(f"| `{key}` | {default} | {meaning(comment)} |")
    return "\n".join(lines)


def meaning(comment):
    return re.sub(r"(?<!\\)\|", r"\\|", comment)


def filled(text):
    return re.sub(
        r"(<!-- keys: (\w+)(?: (\w+))? -->\n).*?(?=<!-- end -->)",
        lambda match: f"{match[1]}{table(match[2], match[3])}\n",
        text,
        flags=re.S,
    )


def main(arguments):
    if arguments not in ([], ["--check"]):
        sys.exit(__doc__)
    old = PAGE.read_text()
    new = filled(old)
    if arguments:
        sys.exit("doc/scene_reference.md: run tools/scene_reference.py" if new != old else 0)
    PAGE.write_text(new)


if __name__ == "__main__":
    main(sys.argv[1:])
