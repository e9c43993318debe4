#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Compares the interfaces for C and Fortran 77 with the contents of their version in include/interface.txt.

Usage: tools/interface.py check [--library FILE] [--modules DIR] [--root DIR]
       tools/interface.py record [--root DIR]

`check` fails if a symbol, a signature, a constant or a name that callers use has changed and the version has not; and if
the header, the include file and the Fortran sources disagree. With --modules, where the module files of the library are, gfortran
writes the prototypes of the Fortran functions, and they must be those of the header. With --library, the symbols that the
shared library exports must be those of the interfaces.

`record` writes include/interface.txt after a change. It requires a new minor number (the last three digits) where something was
added, and a new major one where something was removed or changed: src/tandem/legacy/version.f90, TANDEM_INTERFACE_VERSION
in include/tandem.h, TDIVER in include/tandem.inc.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

RECORD = "include/interface.txt"


def squeeze(text):
    return re.sub(r"\s+", " ", text).strip()


# --- contents of the sources -------------------------------------------------------------------------------------------


def read_header(root):
    """Version, constants, and declarations of include/tandem.h, one each, without comments."""
    text = re.sub(r"/\*.*?\*/", " ", (root / "include/tandem.h").read_text(), flags=re.S)
    version = int(re.search(r"#define TANDEM_INTERFACE_VERSION (\d+)", text)[1])
    text = re.sub(r'^\s*#.*$|extern "C" \{|^\}\s*$', " ", text, flags=re.M)
    constants = {}
    for body in re.findall(r"enum \{(.*?)\}", text, re.S):
        constants.update((name, int(value)) for name, value in re.findall(r"(\w+) = (-?\d+)", body))
    text = re.sub(r"enum \{.*?\};", " ", text, flags=re.S)
    return version, constants, [squeeze(part) for part in text.split(";") if part.strip()]


def read_include(root):
    """Version and constants of include/tandem.inc."""
    text = (root / "include/tandem.inc").read_text()
    constants = {name: int(value) for name, value in re.findall(r"(TD\w+) = (-?\d+)", text)}
    return constants.pop("TDIVER"), constants


def read_subroutines(text):
    """Subroutines with the declarations of their arguments, in the order of the arguments."""
    found = []
    text = re.sub(r"&\s*\n\s*", "", text)
    for name, arguments, body in re.findall(
        r"^ *subroutine (\w+)\(([^)]*)\)(?: bind\(C\))?\s*\n(.*?)^ *end subroutine \1\s*$", text, re.M | re.S | re.I
    ):
        declared = {}
        for line in re.findall(r"^ *((?:integer|real|character|procedure)\b.*?)\s*::\s*(.*?)\s*(?:!.*)?$", body, re.M):
            for variable, shape in re.findall(r"(\w+)(\([^()]*\))?", line[1]):
                declared.setdefault(variable, f"{squeeze(line[0])} {shape}".strip())
        wanted = [argument.strip() for argument in arguments.split(",") if argument.strip()]
        found.append(f"{name}({', '.join(declared[argument] for argument in wanted)})")
    return found


def read_joined(path):
    """A Fortran source with its continued lines joined."""
    return re.sub(r"&\s*\n\s*", "", path.read_text())


def read_options(root):
    """Settings by name, with their kinds: the rows of the table, and settings of the model or of an assembly."""
    kinds = {"number": "real option", "whole": "integer option", "word": "text option", "list": "list"}
    table = read_joined(root / "src/tandem/options.f90")
    rows = re.findall(r"%take\(option_row_type\('(\w+)', .*?\), (number|whole|word|list)=self%", table)
    names = [f"{kinds[kind]} {name}" for name, kind in rows]
    others = re.findall(r"others = ', ([^']*)'", (root / "src/tandem/legacy/settings.f90").read_text())
    for kind, listed in zip(kinds.values(), others, strict=True):
        names += [f"{kind} {name}" for name in listed.split(", ")]
    return names


def read_figures(root):
    """Figures by name, in lower case: those of reports, and further ones of the interfaces."""
    source = root / "src/tandem"
    texts = "".join(read_joined(source / file) for file in ("simulate/statistics.f90", "model/terms.f90", "model/derivatives.f90"))
    names = []
    for name, array in re.findall(r"reader%\w+\('(\w+)'(?://[\w(]*\((\w+_name)\()?", read_joined(source / "simulate/figures.f90")):
        parts = [""]
        if array:
            parts = re.findall(r"'([^']*)'", re.search(rf":: {array}\(\w+\) = \[(.*?)\]", texts)[1])
        names += [(name + part.replace(" ", "_").replace("|", "")).lower() for part in parts]
    others = (source / "legacy/figures.f90").read_text()
    for words in re.findall(r"case \(('\w+'(?:, '\w+')*)\)", others):
        names += re.findall(r"\w+", words)
    names += re.findall(r"reader%\w+\('(\w+)'", others)
    return names


def read_names(root):
    """Names that callers pass as texts: of options, statistics, and procedures of a model."""
    legacy = root / "src/tandem/legacy"
    names = read_options(root) + [f"statistic {name}" for name in read_figures(root)]
    names += [
        f"procedure {name} {kind}"
        for name, kind in re.findall(r"term_row_type\('(\w+)', (of_\w+)\)", (legacy / "terms.f90").read_text())
    ]
    return names


def read_statistics(root):
    """Numbers in the types of the figures of a run."""
    names = set()
    for file, type_ in (("simulate/statistics.f90", "statistics_type"), ("model/counts.f90", "counts_type")):
        text = (root / "src/tandem" / file).read_text()
        body = re.search(rf"^ *type\b[^\n]*:: {type_}\n(.*?)^ *contains", text, re.M | re.S)[1]
        for components in re.findall(r"^ *(?:integer|real|logical)\S* :: (.*)$", body, re.M):
            names.update(re.findall(r"(\w+)(?:\(\w+\))? = ", components))
    return names


def read_all(root):
    """The version and all entries of the interfaces."""
    version = int(re.search(r"interface_version = (\d+)", (root / "src/tandem/legacy/version.f90").read_text())[1])
    _, c_constants, declarations = read_header(root)
    _, f77_constants = read_include(root)
    legacy = root / "src/tandem/legacy"
    entries = [f"c {name} = {value}" for name, value in c_constants.items()]
    entries += [f"c {declaration}" for declaration in declarations]
    entries += [f"f77 {name} = {value}" for name, value in f77_constants.items()]
    for file in ("f77.f90", "f77_analysis.f90", "f77_mechanism.f90", "f77_none.f90"):
        entries += [f"f77 {subroutine}" for subroutine in read_subroutines((legacy / file).read_text())]
    callbacks = (legacy / "f77_model.f90").read_text().split("end interface")[0]
    entries += [f"f77 callback {subroutine}" for subroutine in read_subroutines(callbacks)]
    return version, sorted(set(entries + read_names(root)))


# --- do they agree? ---------------------------------------------------------------------------------------------------


def disagreements(root, modules):
    """Differences between the header, the include file and the Fortran sources."""
    version, _ = read_all(root)
    header_version, c_constants, declarations = read_header(root)
    include_version, f77_constants = read_include(root)
    problems = []
    if not version == header_version == include_version:
        problems.append(f"the version is {version} in version.f90, {header_version} in tandem.h, {include_version} in tandem.inc")
    table = dict(re.findall(r"parameter :: status_(\w+) = (-?\d+)", (root / "src/tandem/status.f90").read_text()))
    terms = dict(re.findall(r"parameter :: need_(\w+) = (\d+)", (root / "src/tandem/model/terms.f90").read_text()))
    expected = {f"TANDEM_{name.upper()}": int(value) for name, value in {**table, **terms}.items()}
    for name in sorted(expected.keys() | c_constants.keys()):
        if expected.get(name) != c_constants.get(name):
            problems.append(f"{name} is {c_constants.get(name)} in tandem.h, {expected.get(name)} in the Fortran sources")
    lengths = {name: f77_constants.pop(name, None) for name in ("TDHLEN", "TDTLEN")}
    for name, file, constant in (("TDHLEN", "handle", "handle_length"), ("TDTLEN", "description", "message_length")):
        source = (root / f"src/tandem/legacy/{file}.f90").read_text()
        length = int(re.search(rf"parameter :: {constant} = (\d+)", source)[1])
        if lengths[name] != length:
            problems.append(f"{name} is {lengths[name]} in tandem.inc, {length} in {file}.f90")
    if sorted(f77_constants.values()) != sorted(expected.values()):
        problems.append("tandem.inc has other statuses or terms than the Fortran sources")
    # Their names depend on the kind of model, which is not a figure itself.
    told = {"has_ready_made_model"} | set(re.findall(r"\bs%(\w+)", (root / "src/tandem/simulate/figures.f90").read_text()))
    problems += [f"figures.f90 lacks the statistic {name}" for name in sorted(read_statistics(root) - told)]
    if modules:
        written = "".join(subprocess.run(
            ["gfortran", "-fc-prototypes", "-fsyntax-only", f"-I{modules}", str(root / "src/tandem/legacy" / file)],
            capture_output=True, text=True, check=True,
        ).stdout for file in ("c.f90", "c_analysis.f90", "c_mechanism.f90"))  # fmt: skip
        ours = {plain(line) for line in declarations if "(" in line and "typedef" not in line}
        theirs = {plain(line) for line in re.findall(r"^\w[^\n]*\btandem_\w+ \(.*\)(?=;)", written, re.M)}
        problems += [f"only tandem.h has: {line}" for line in sorted(ours - theirs)]
        problems += [f"only c.f90 has: {line}" for line in sorted(theirs - ours)]
    return problems


def plain(prototype):
    """Types only, with pointers to types unknown to Fortran as void pointers."""
    before, arguments = re.match(r"(.*?)\s*\((.*)\)$", squeeze(prototype)).groups()
    before = re.sub(r"\b(const )?(tandem_problem|char) \*", "void *", before)
    types = []
    for argument in [part.strip() for part in arguments.split(",")]:
        if argument in ("", "void"):
            continue
        if "(*" in argument or re.match(r"tandem_\w+_function ", argument):
            types.append("function")
            continue
        name = re.sub(r"\bconst ", "", re.sub(r"\w+$", "", argument)).replace(" ", "")
        types.append("void*" if name in ("tandem_problem*", "char*") else name)
    # gfortran writes its 64-bit kind as `long`, which is equivalent on this platform.
    types = ["int64_t*" if type_ == "long*" else type_ for type_ in types]
    # Fortran takes the list of numbers as an address, because it may be NULL.
    types = ["void*" if type_ == "double*" and "tandem_set_vector" in before else type_ for type_ in types]
    return f"{before.replace(' *', '* ')}({', '.join(types)})".replace("  ", " ")


def exported(library, entries):
    """Symbols of the shared library that differ from those of the interfaces."""
    lines = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    symbols = {line.split()[-1] for line in lines.splitlines()}
    symbols = {name for name in symbols if not name.startswith("_")}
    wanted = {match[1] for match in (re.match(r"c (?!typedef).*?\b(tandem_\w+)\(", entry) for entry in entries) if match}
    wanted |= {f"{match[1]}_" for match in (re.match(r"f77 (td\w+)\(", entry) for entry in entries) if match}
    problems = [f"the library lacks {name}" for name in sorted(wanted - symbols)]
    return problems + [f"the library exports {name}, which no interface declares" for name in sorted(symbols - wanted)]


# --- the record -------------------------------------------------------------------------------------------------------


def read_record(root):
    lines = (root / RECORD).read_text().splitlines()
    return int(re.match(r"version (\d+)$", lines[0])[1]), lines[1:]


def check(root, library, modules):
    version, entries = read_all(root)
    problems = disagreements(root, modules)
    recorded_version, recorded = read_record(root)
    gone = sorted(set(recorded) - set(entries))
    new = sorted(set(entries) - set(recorded))
    if gone or new:
        problems += [f"no longer there: {entry}" for entry in gone] + [f"new: {entry}" for entry in new]
        if version == recorded_version:
            problems.append("the interface has changed, its version has not: raise it, then tools/interface.py record")
    if version != recorded_version:
        problems.append(f"version {version} is not recorded ({RECORD} holds {recorded_version}): tools/interface.py record")
    if library:
        problems += exported(library, entries)
    return problems


def record(root):
    version, entries = read_all(root)
    if (root / RECORD).exists():
        recorded_version, recorded = read_record(root)
        if set(recorded) - set(entries) and version // 1000 <= recorded_version // 1000:
            return ["something was taken away or changed: raise the major number of the version first"]
        if set(entries) - set(recorded) and version <= recorded_version:
            return ["something was added: raise the minor number of the version first"]
    (root / RECORD).write_text("\n".join([f"version {version}", *entries]) + "\n")
    return []


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["check", "record"])
    parser.add_argument("--library")
    parser.add_argument("--modules")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent)
    given = parser.parse_args()
    if given.action == "record":
        problems = record(given.root)
    else:
        problems = check(given.root, given.library, given.modules)
    for problem in problems:
        print(f"interface: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
