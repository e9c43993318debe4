#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Builds the libraries for programs that are not built with fpm, and installs them and the program `tandem`.

Usage: tools/library.py build     [--build DIR] [--flags FLAGS]
       tools/library.py install   [--build DIR] [--flags FLAGS] [--prefix DIR] [--destdir DIR] [--program FILE] [--parts PART...]
                                  [--portable]
       tools/library.py archive
       tools/library.py uninstall [--prefix DIR] [--destdir DIR] [--parts PART...]

The parts, all of them but the last unless --parts names some:
  library       the solver, static and shared. Needs gfortran, make, LAPACK and BLAS, and nothing else.
  program       build/optimised/tandem, which `make optimised` leaves there, or --program FILE, and the shipped scenes.
  command-line  the command line as a static library, for models of one's own. Needs HDF5 and toml-f (tools/setup.sh) too.
  mpi           build/tandem-mpi, which `make mpi` leaves there; its scenes are those of the program.

`build` builds the solver. Sources are compiled by make in the order of their modules, those that have changed since the last time. FC
names another gfortran, CC another C compiler.

--portable makes parts `library` and `program` that run on any Linux of this kind and from any folder: the program holds HDF5 and is
linked with the shared library; OpenBLAS, which chooses its kernels where it runs, the run-time library of gfortran, and a shared
library for newer processors stand beside them. `make wheel` ships them, and so does `archive`, with the documents: dist/tandem-VERSION-linux-x86_64.tar.xz.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FC = os.environ.get("FC", "gfortran")
CC = os.environ.get("CC", "cc")
PARTS = ["library", "program", "command-line"]
OPTIONAL = ["mpi"]
TOML_F = ROOT / "build" / "dependencies" / "toml-f"
HDF5 = ROOT / "io" / "include" / "hdf5"
# Portable files: any x86-64 processor of the last fifteen years, and a second shared library for those of the last ten, which the
# dynamic linker takes there.
PORTABLE = ROOT / "build" / "portable"
PORTABLE_FLAGS = [*(ROOT / "tools" / "flags" / "optimised").read_text().split(), "-march=x86-64-v2"]
FASTER = "x86-64-v3"
# Static libraries of Debian that they hold, and the packages with their licences.
OPENBLAS = "openblas-serial/libopenblas.a"
HELD_BY_PROGRAM = ["libhdf5_serial_hl.a", "libhdf5_serial_fortran.a", "libhdf5_serial.a", "libsz.a", "libaec.a", "libz.a"]
# Required libraries are in a separate folder, which other programs do not search: one with its own gfortran uses that.
RUN_TIME = {"libgfortran.so": "libgfortran.so.5", "libquadmath.so": "libquadmath.so.0"}
LICENCES = {"openblas": "libopenblas-dev", "hdf5": "libhdf5-dev", "libaec": "libaec-dev", "zlib": "zlib1g-dev",
            "gfortran": "libgfortran5"}
# Procedures are inlined although others could replace them in a shared library; local arrays stay off static memory, so that
# threads never meet; no pointer to an internal procedure may be made.
ALWAYS = ["-std=f2018", "-fPIC", "-fno-semantic-interposition", "-frecursive", "-Wtrampolines", "-Werror=trampolines",
          "-Werror=implicit-interface"]
MODULE = re.compile(r"^\s*module\s+(?!procedure\b|subroutine\b|function\b)(\w+)\s*$", re.M | re.I)
SUBMODULE = re.compile(r"^\s*submodule\s*\(\s*(\w+)(?:\s*:\s*(\w+))?\s*\)\s*(\w+)", re.M | re.I)
USE = re.compile(r"^\s*use\s*(?:,\s*non_intrinsic\s*)?(?:::)?\s*(\w+)", re.M | re.I)


def versions():
    """Version of tandem, and major number of the interface, which is that of the shared library."""
    tandem = re.search(r'^version = "([^"]+)"', (ROOT / "fpm.toml").read_text(), re.M)[1]
    interface = re.search(r"interface_version = (\d+)", (ROOT / "src/tandem/legacy/version.f90").read_text())[1]
    return tandem, int(interface) // 1000, int(interface) % 1000


def dependencies(sources):
    """For each source those that must be compiled before it."""
    texts = {source: source.read_text() for source in sources}
    provider = {}
    for source, text in texts.items():
        for name in MODULE.findall(text):
            provider[name.lower()] = source
        for ancestor, parent, name in SUBMODULE.findall(text):
            provider[f"{ancestor}:{name}".lower()] = source
    needs = {}
    for source, text in texts.items():
        names = [name.lower() for name in USE.findall(text)]
        for ancestor, parent, _ in SUBMODULE.findall(text):
            names.append((f"{ancestor}:{parent}" if parent else ancestor).lower())
        needs[source] = {provider[name] for name in names if name in provider} - {source}
    return needs


def compile_all(build, flags, roots, includes=()):
    """Objects and module files of all sources, by make, each after those that it needs; returns the objects. `includes` are folders of
    module files that come from elsewhere: where one of them is new, everything is compiled."""
    sources = sorted(source for root in roots for ending in ("f90", "c") for source in root.rglob(f"*.{ending}"))
    needs = dependencies([source for source in sources if source.suffix == ".f90"])
    modules = build / "modules"
    modules.mkdir(parents=True, exist_ok=True)
    # Relative paths: programs hold the options of their compilation, and make takes no blanks.
    where = [f"-I{relative(folder)}" for folder in includes]
    commands = {".f90": [FC, *ALWAYS, *flags, *where, "-J", relative(modules), "-c"], ".c": [CC, "-fPIC", *flags, *where, "-c"]}
    objects = {source: relative(build / (object_name(source, roots) + ".o")) for source in sources}
    # Other flags or sources: nothing is left of what was compiled.
    stamp, now = build / "stamp", "\n".join([*commands[".f90"], *objects.values()])
    if not stamp.exists() or stamp.read_text() != now:
        for file in [*build.glob("*.o"), *modules.glob("*")]:
            file.unlink()
        stamp.write_text(now)
    rules = ["elsewhere = " + " ".join(relative(file) for folder in includes for file in sorted(Path(folder).glob("*.mod")))]
    for source, made in objects.items():
        first = [relative(source), *sorted(objects[other] for other in needs.get(source, ()))]
        quiet = ["-w"] * (TOML_F in source.parents)
        rules.append(f"{made}: {' '.join(first)} $(elsewhere)\n\t{shlex.join([*commands[source.suffix], *quiet, first[0], '-o', made])}")
    (build / "Makefile").write_text("\n".join(rules) + "\n")
    own = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    command = ["make", "-s", f"-j{os.cpu_count()}", "-f", str(build / "Makefile"), *objects.values()]
    if subprocess.run(command, cwd=ROOT, env=own).returncode:
        raise SystemExit("library: not everything compiles")
    return [ROOT / made for made in objects.values()]


def relative(path):
    return os.path.relpath(path, ROOT)


def object_name(source, roots):
    """The path below its root, with its ending where that is not Fortran's: path.f90 and path.c may stand side by side."""
    root = next(root for root in roots if root in source.parents)
    return str(source.relative_to(root)).replace("/", "_").removesuffix(".f90")


def archive(file, objects):
    file.unlink(missing_ok=True)
    subprocess.run(["ar", "rcs", str(file), *map(str, objects)], check=True)


def found_by_linker(name):
    """The path of a library."""
    path = subprocess.run([FC, f"-print-file-name={name}"], capture_output=True, text=True).stdout.strip()
    if not os.path.isabs(path):
        raise SystemExit(f"library: there is no {name}: tools/setup.sh wheel brings it")
    return os.path.realpath(path)


def portable_link(names, *folders):
    """Arguments of the linker for static libraries with local symbols. Shared ones are searched in folders beside the file, also
        their own dependencies (an RPATH, no RUNPATH)."""
    where = ":".join(f"$ORIGIN/{folder}" for folder in folders)
    stand_ins = []
    for source in (ROOT / "tools" / "portable").glob("*.c"):
        stand_ins.append(str(PORTABLE / f"{source.stem}.stand-in"))
        subprocess.run([CC, "-O2", "-fPIC", "-fvisibility=hidden", "-c", str(source), "-o", stand_ins[-1]], check=True)
    return [*stand_ins, *map(found_by_linker, names), "-Wl,--wrap=hypot", "-Wl,--exclude-libs,ALL", "-Wl,-s",
            "-Wl,--disable-new-dtags", f"-Wl,-rpath,{where}"]


def symbols(kind, file):
    """The symbols that a library defines (T) or needs (U)."""
    told = subprocess.run(["nm", "-P", "-A", str(file)], capture_output=True, text=True).stdout
    return {words[1] for words in map(str.split, told.splitlines()) if len(words) > 2 and words[2] == kind}


def build_blas(solver, shared):
    """OpenBLAS as a shared library reduced to the routines that the solver calls."""
    called = sorted(symbols("U", solver) & symbols("T", found_by_linker(OPENBLAS)))
    script = shared.with_suffix(".map")
    script.write_text("TANDEM_1 { global: " + "; ".join(called) + "; local: *; };\n")
    subprocess.run(
        [FC, "-shared", f"-Wl,-soname,{shared.name}", "-o", str(shared), *(f"-Wl,-u,{name}" for name in called)]
        + [found_by_linker(OPENBLAS), f"-Wl,--version-script={script}", "-Wl,-s", "-Wl,-z,defs"],
        check=True,
    )
    return shared


def build_libraries(build, flags, link=("-llapack", "-lblas")):
    """libtandem.a and libtandem.so in the build folder."""
    for tool, brings in ((FC, "gfortran"), ("ar", "binutils"), ("make", "make")):
        if shutil.which(tool) is None:
            raise SystemExit(f"library: there is no {tool}; the Debian package {brings} brings it, FC names another compiler")
    build = Path(build).resolve()
    build.mkdir(parents=True, exist_ok=True)
    objects = compile_all(build, flags, [ROOT / "src"])
    archive(build / "libtandem.a", objects)
    link_shared(build, objects, flags, link)
    return build


def link_shared(build, objects, flags, link):
    """libtandem.so in the build folder, if it is older than an object."""
    shared, made = build / "libtandem.so", build / "linked.so"
    newest = max(file.stat().st_mtime for file in [*objects, Path(__file__)])
    if shared.exists() and shared.stat().st_mtime > newest:
        return
    # Undefined symbols are an error here, not in the user's program; those of a sanitizer come with the program.
    strict = [] if any("-fsanitize" in flag for flag in flags) else ["-Wl,-z,defs"]
    subprocess.run(
        [FC, "-shared", *flags, *strict, f"-Wl,-soname,libtandem.so.{versions()[1]}", "-o", str(made), *map(str, objects), *link],
        check=True,
    )
    made.rename(shared)


def build_command_line(build, flags):
    """libtandem-command-line.a in a folder below that of the solver, whose module files it uses."""
    for needed in (TOML_F / "src", HDF5):
        if not needed.is_dir():
            raise SystemExit(f"library: {needed.relative_to(ROOT)} is missing: tools/setup.sh brings it")
    below_it = build / "command_line"
    below_it.mkdir(parents=True, exist_ok=True)
    roots = [TOML_F / "src", ROOT / "io" / "src", ROOT / "cli" / "src"]
    archive(below_it / "libtandem-command-line.a", compile_all(below_it, flags, roots, [build / "modules", HDF5]))
    return below_it


def build_portable():
    """The folder with libtandem.a, libtandem.so and the program tandem, which run on any Linux of this kind, and their
    dependencies. The library for newer processors and the sources of the program are compiled without link-time optimisation, which takes
    minutes: the former is fast enough without it, the latter spends its time on input and output."""
    PORTABLE.mkdir(parents=True, exist_ok=True)
    archive(PORTABLE / "libtandem.a", compile_all(PORTABLE, PORTABLE_FLAGS, [ROOT / "src"]))
    blas = str(build_blas(PORTABLE / "libtandem.a", PORTABLE / "libtandem-blas.so.1"))
    build_libraries(PORTABLE, PORTABLE_FLAGS, [blas, *portable_link([], "tandem")])
    plain = [flag for flag in PORTABLE_FLAGS if "lto" not in flag]
    flags = [flag for flag in plain if "-march" not in flag] + [f"-march={FASTER}"]
    faster = PORTABLE / FASTER
    link_shared(faster, compile_all(faster, flags, [ROOT / "src"]), flags, [blas, *portable_link([], "../../tandem")])
    # For callers that load the library by a path, where the dynamic linker has no choice.
    subprocess.run(
        [CC, "-shared", "-nostdlib", "-o", str(PORTABLE / "libtandem-chosen.so"), "-Wl,--no-as-needed"]
        + [str(PORTABLE / "libtandem.so"), "-Wl,--allow-shlib-undefined", "-Wl,--disable-new-dtags", "-Wl,-rpath,$ORIGIN/.."],
        check=True,
    )
    commands = build_command_line(PORTABLE, plain)
    subprocess.run(
        [FC, *plain, f"-I{commands / 'modules'}", "app/main.f90", "-o", str(PORTABLE / "tandem"), f"-Wl,-rpath-link,{PORTABLE}"]
        + [str(commands / "libtandem-command-line.a"), str(PORTABLE / "libtandem.so")]
        + portable_link(HELD_BY_PROGRAM, "../lib", "../lib/tandem"),
        cwd=ROOT, check=True,
    )
    return PORTABLE


def run_path(prefix):
    """Linker flag for the run path of programs; empty for a folder that the system searches."""
    return "" if prefix == "/usr" else "-Wl,-rpath,${libdir} "


def contents(prefix):
    """The generated files of the library: path below the prefix, text."""
    tandem, major, minor = versions()
    # The static run-time library of gfortran requires libquadmath on some platforms.
    quadmath = subprocess.run([FC, "-print-file-name=libquadmath.a"], capture_output=True, text=True).stdout.strip()
    needed = "-llapack -lblas -lgfortran" + (" -lquadmath" if os.path.isabs(quadmath) else "") + " -lm"
    pkgconfig = f"""\
prefix={prefix}
libdir=${{prefix}}/lib
includedir=${{prefix}}/include
# Module files for `use tandem`; they serve the compiler that made them.
moduledir=${{includedir}}/tandem

Name: tandem
Description: Dynamics of multibody systems with holonomic and nonholonomic constraints
Version: {tandem}
Libs: -L${{libdir}} {run_path(prefix)}-ltandem
Libs.private: {needed}
Cflags: -I${{includedir}} -I${{moduledir}}
"""
    # pkg-config can add to the output for the shared library, but not change it: the static one has a separate file.
    static = f"""\
prefix={prefix}
libdir=${{prefix}}/lib
includedir=${{prefix}}/include
moduledir=${{includedir}}/tandem

Name: tandem-static
Description: Dynamics of multibody systems with holonomic and nonholonomic constraints, the static library
Version: {tandem}
Libs: ${{libdir}}/libtandem.a {needed}
Cflags: -I${{includedir}} -I${{moduledir}}
"""
    config = """\
# tandem::tandem is the shared library, tandem::tandem_static the static one. Fortran sources find the module files, C and
# C++ sources the header. The package may be moved as a whole.
get_filename_component(_tandem_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET tandem::tandem)
  add_library(tandem::tandem SHARED IMPORTED)
  set_target_properties(tandem::tandem PROPERTIES
    IMPORTED_LOCATION "${_tandem_prefix}/lib/libtandem.so.@MAJOR@"
    IMPORTED_SONAME "libtandem.so.@MAJOR@"
    INTERFACE_INCLUDE_DIRECTORIES "${_tandem_prefix}/include;${_tandem_prefix}/include/tandem")
  add_library(tandem::tandem_static STATIC IMPORTED)
  set_target_properties(tandem::tandem_static PROPERTIES
    IMPORTED_LOCATION "${_tandem_prefix}/lib/libtandem.a"
    IMPORTED_LINK_INTERFACE_LANGUAGES "Fortran"
    INTERFACE_LINK_LIBRARIES "lapack;blas;gfortran;m"
    INTERFACE_INCLUDE_DIRECTORIES "${_tandem_prefix}/include;${_tandem_prefix}/include/tandem")
endif()
unset(_tandem_prefix)
""".replace("@MAJOR@", str(major))
    version = f"""\
set(PACKAGE_VERSION "{tandem}")
# Before 1.0, the minor number of the version may break what was.
if("${{PACKAGE_FIND_VERSION}}" VERSION_GREATER PACKAGE_VERSION)
  set(PACKAGE_VERSION_COMPATIBLE FALSE)
elseif(NOT "${{PACKAGE_FIND_VERSION_MAJOR}}.${{PACKAGE_FIND_VERSION_MINOR}}" VERSION_EQUAL
       "{".".join(tandem.split(".")[:2])}" AND PACKAGE_FIND_VERSION_COUNT GREATER 1)
  set(PACKAGE_VERSION_COMPATIBLE FALSE)
else()
  set(PACKAGE_VERSION_COMPATIBLE TRUE)
  if(PACKAGE_FIND_VERSION VERSION_EQUAL PACKAGE_VERSION)
    set(PACKAGE_VERSION_EXACT TRUE)
  endif()
endif()
"""
    return {
        "lib/pkgconfig/tandem.pc": pkgconfig,
        "lib/pkgconfig/tandem-static.pc": static,
        "lib/cmake/tandem/tandem-config.cmake": config,
        "lib/cmake/tandem/tandem-config-version.cmake": version,
    }


def library_part(build, prefix):
    """Files (path below the prefix: source), generated texts and links of the solver's library."""
    _, major, minor = versions()
    real = f"libtandem.so.{major}.{minor}"
    files = {"include/tandem.h": ROOT / "include/tandem.h", "include/tandem.inc": ROOT / "include/tandem.inc"}
    files["lib/libtandem.a"] = build / "libtandem.a"
    files[f"lib/{real}"] = build / "libtandem.so"
    for module in sorted((build / "modules").glob("*.mod")):
        files[f"include/tandem/{module.name}"] = module
    return files, contents(prefix), {f"lib/libtandem.so.{major}": real, "lib/libtandem.so": f"libtandem.so.{major}"}


def program_part(program):
    """The program with its scenes, which it searches relative to its folder (io/src/tandem_io/scene/shipped.f90)."""
    if not program.exists():
        raise SystemExit(f"library: {program} is missing: make optimised")
    files = {"bin/tandem": program, "share/tandem/licences/program-toml-f.txt": TOML_F / "LICENSE-MIT"}
    return files | {f"share/tandem/scenes/{scene.name}": scene for scene in sorted((ROOT / "scenes").glob("*.toml"))}, {}, {}


def mpi_part():
    """The program that distributes sweeps over ranks of MPI."""
    program = ROOT / "build" / "tandem-mpi"
    if not program.exists():
        raise SystemExit("library: build/tandem-mpi is missing: make mpi")
    return {"bin/tandem-mpi": program, "share/tandem/licences/mpi-toml-f.txt": TOML_F / "LICENSE-MIT"}, {}, {}


def command_line_part(build, prefix):
    """The library of the command line. Of its modules only those that programs use: a module file needs no other one."""
    tandem, _, _ = versions()
    linked = re.findall(r'"(\w+)"', re.search(r"^link = (.*)", (ROOT / "io/fpm.toml").read_text(), re.M)[1])
    pkgconfig = f"""\
prefix={prefix}
libdir=${{prefix}}/lib
includedir=${{prefix}}/include

Name: tandem-command-line
Description: The command line of tandem, for models of one's own
Version: {tandem}
Requires: tandem = {tandem}
Libs: -L${{libdir}} {run_path(prefix)}-ltandem-command-line -ltandem {" ".join(f"-l{name}" for name in linked)}
Cflags: -I${{includedir}}/tandem/command_line
"""
    files = {"lib/libtandem-command-line.a": build / "libtandem-command-line.a",
             "share/tandem/licences/command-line-toml-f.txt": TOML_F / "LICENSE-MIT"}
    for name in ("tandem_command_line.mod", "tandem_io.mod"):
        files[f"include/tandem/command_line/{name}"] = build / "modules" / name
    return files, {"lib/pkgconfig/tandem-command-line.pc": pkgconfig}, {}


def held():
    """Further files of portable builds: libraries beside them, the library for newer processors, and all licences."""
    common = Path("/usr/share/common-licenses")
    files = {f"lib/tandem/{name}": Path(found_by_linker(linked)) for linked, name in RUN_TIME.items()}
    files |= {f"lib/tandem/{name}": PORTABLE / name for name in ("libtandem-blas.so.1", "libtandem-chosen.so")}
    files[f"lib/glibc-hwcaps/{FASTER}/libtandem.so.{versions()[1]}"] = PORTABLE / FASTER / "libtandem.so"
    files |= {f"share/tandem/licences/{name}.txt": Path("/usr/share/doc", package, "copyright") for name, package in LICENCES.items()}
    return files | {f"share/tandem/licences/{name}.txt": common / name for name in ("GPL-3", "LGPL-2.1")}


def package_files(shared, program, portable):
    """The files of the package for Python, as below a prefix: the shared library by the name that the program asks for, and the
    program with its scenes."""
    files = {f"lib/libtandem.so.{versions()[1]}": shared, "share/tandem/licences/tandem.txt": ROOT / "LICENSE"}
    return files | (program_part(program)[0] if program.exists() else {}) | (held() if portable else {})


def install(build, flags, prefix, destdir, parts, program, portable=False):
    """Put the parts below the prefix, and a list of each, for `uninstall`."""
    found = {}
    if portable:
        build = build_portable()
        program = build / "tandem"
    elif "library" in parts or "command-line" in parts:
        build = build_libraries(build, flags)
    if "library" in parts:
        found["library"] = library_part(build, "${pcfiledir}/../.." if portable else prefix)
        found["library"][0].update(held() if portable else {})
    if "program" in parts:
        found["program"] = program_part(program)
    if "mpi" in parts:
        found["mpi"] = mpi_part()
    if "command-line" in parts:
        found["command-line"] = command_line_part(build_command_line(build, flags), prefix)
    target = below(prefix, destdir)
    remove(prefix, destdir, parts)
    try:
        for part, (files, texts, links) in found.items():
            for name, source in files.items():
                (target / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target / name)
                (target / name).chmod(0o755 if ".so" in name or name.startswith("bin/") else 0o644)
            texts[manifest(part)] = "\n".join([*files, *texts, *links, manifest(part)]) + "\n"
            for name, text in texts.items():
                (target / name).parent.mkdir(parents=True, exist_ok=True)
                (target / name).write_text(text)
            for name, to in links.items():
                (target / name).unlink(missing_ok=True)
                (target / name).symlink_to(to)
    except OSError as error:
        raise SystemExit(f"library: {error}\nlibrary: install below another PREFIX, or as root") from error
    print(f"installed below {target}: {', '.join(found)}")


def make_archive():
    """The portable parts and the documents, as one folder in an archive that anybody may unpack."""
    name = f"tandem-{versions()[0]}-linux-x86_64"
    folder = ROOT / "build" / name
    shutil.rmtree(folder, ignore_errors=True)
    install(None, None, str(folder), "", ["library", "program"], None, portable=True)
    # The sections for link-time optimisation are larger than the static library, and work with this gfortran only.
    lto = ["-R", ".gnu.lto_*", "-R", ".gnu.debuglto_*"]
    subprocess.run(["strip", "-g", *lto, str(folder / "lib" / "libtandem.a")], check=True)
    kept = ["README.md", "CHANGELOG.md", "LICENSE", "doc", "example"]
    listed = subprocess.run(["git", "ls-files", "-z", *kept], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for file in listed.split("\0")[:-1]:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, folder / file)

    def nobody(entry):
        entry.uid = entry.gid = 0
        entry.uname = entry.gname = "root"
        return entry

    file = ROOT / "dist" / f"{name}.tar.xz"
    file.parent.mkdir(exist_ok=True)
    with tarfile.open(file, "w:xz") as packed:
        packed.add(folder, name, filter=nobody)
    print(file.relative_to(ROOT))


def manifest(part):
    return f"share/tandem/installed/{part}.txt"


def below(prefix, destdir):
    return Path(destdir + prefix) if destdir else Path(prefix)


def remove(prefix, destdir, parts):
    """Remove the files in the lists of the parts, and empty folders; returns the number of files."""
    target = below(prefix, destdir)
    lists = [target / manifest(part) for part in parts]
    names = [name for file in lists if file.exists() for name in file.read_text().split("\n")[:-1]]
    folders = set()
    for name in names:
        (target / name).unlink(missing_ok=True)
        folders.update(folder for folder in Path(name).parents if folder != Path("."))
    for folder in sorted(folders, key=lambda folder: -len(folder.parts)):
        if (target / folder).is_dir() and not any((target / folder).iterdir()):
            (target / folder).rmdir()
    return len(names)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["build", "install", "uninstall", "archive"])
    parser.add_argument("--build", default=str(ROOT / "build" / "library"))
    parser.add_argument("--flags", default="-O3 -funroll-loops -fno-loop-unroll-and-jam " + os.environ.get("ARCH", ""))
    parser.add_argument("--prefix", default="/usr/local")
    parser.add_argument("--destdir", default="")
    parser.add_argument("--program", type=Path, default=ROOT / "build" / "optimised" / "tandem")
    parser.add_argument("--portable", action="store_true")
    parser.add_argument("--parts", nargs="+", choices=PARTS + OPTIONAL)
    given = parser.parse_args()
    prefix = os.path.abspath(given.prefix)
    if given.parts is None:
        given.parts = ["library", "program"] if given.portable else PARTS + OPTIONAL * (given.action == "uninstall")
    if given.action == "build":
        build_libraries(given.build, given.flags.split())
    elif given.action == "archive":
        make_archive()
    elif given.action == "install":
        install(given.build, given.flags.split(), prefix, given.destdir, given.parts, given.program, given.portable)
    elif not remove(prefix, given.destdir, given.parts):
        raise SystemExit(f"library: no installation below {below(prefix, given.destdir)}")


if __name__ == "__main__":
    main()
