#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Runs everything that verifies the project, part by part, and closes with the line "N passed, N failed".

Usage: tools/verify.py [PART...]        without a name, the parts of `make test`
       tools/verify.py --all            all parts, as `make test-all`
       tools/verify.py --list           their names, with the minutes that each takes on two idle cores

Each part is a command and a reader that counts the tests in its output. Two parts run at the same time where there are two
cores: tests use one core each, and builds wait for single long files. A part that fails does not keep the later ones from
running. A part whose command fails, runs no test, or takes longer than its limit counts as a failure. Limits are many times the
expected duration, so that a busy machine does not turn them red. The output of a part is in build/verify/PART.log. The exit code
is 1 if anything failed.
"""

import concurrent.futures
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOGS = ROOT / "build" / "verify"
STRICT = ROOT / "build" / "strict"
FPM = str(ROOT / ".venv" / "bin" / "fpm")
PYTHON = str(ROOT / ".venv" / "bin" / "python")
FORTITUDE = str(ROOT / ".venv" / "bin" / "fortitude")

SOURCES = ["src", "io/src", "cli/src", "app", "test", "example"]
WARNINGS = "-std=f2018 -Wall -Wextra -pedantic -Wno-unused-dummy-argument -Wtrampolines -Werror=trampolines"
# One build serves the warnings and the checks at run time.
STRICT_FLAGS = f"{WARNINGS} -g -fPIC -fcheck=bounds -fcheck=array-temps -fbacktrace -fcoarray=single"
# Number of lines that are shown of a part that fails without a failed test.
LAST = 20
ARCH = os.environ.get("ARCH", "-march=native")


def flags(name):
    """The arguments of fpm for the fast or the optimised build, as the Makefile has them."""
    return ["--flag", f"{(ROOT / 'tools' / 'flags' / name).read_text().strip()} {ARCH}"]


@dataclass
class Count:
    """Result of a reader: the number of tests, and reports on failures."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0
    notes: list = field(default_factory=list)

    def check(self, name, problems):
        """Count one test: it passes if there are no problems."""
        if problems:
            self.failed += 1
            self.notes += [f"{name}:", *(f"  {problem}" for problem in problems)]
        else:
            self.passed += 1


# --- the readers: from the output of a command to a Count -------------------------------------------------------------


def one_test(text):
    """The command as a whole is the test: it passes if its exit code is 0."""
    return Count(passed=1)


def test_drive(text):
    """The output of test-drive: 'Starting NAME ... (1/5)', later '... NAME [PASSED]', then perhaps a message."""
    count = Count()
    begun = Counter(re.findall(r"^\s*Starting (\S+) \.\.\. \(\d+/\d+\)", text, re.M))
    parts = re.split(r"^\s*\.\.\. (\S+) \[([A-Z ]+)\]", text, flags=re.M)
    for name, verdict, after in zip(parts[1::3], parts[2::3], parts[3::3]):
        begun[name] -= 1
        if verdict in ("FAILED", "UNEXPECTED PASS"):
            count.failed += 1
            count.notes += [f"{name} [{verdict}]", *after.split("  Starting ")[0].strip().splitlines()]
        else:
            count.passed += verdict != "SKIPPED"
            count.skipped += verdict == "SKIPPED"
    for name in +begun:
        count.check(f"{name} [did not end]", text.splitlines()[-LAST:])
    return count


def test_drive_checked(text):
    """As test_drive, plus one test: the checked build reports no array temporary in shipped sources."""
    count = test_drive(text)
    told = re.findall(r"At line (\d+) of file (\S+)\n.*warning: (.*array temporary.*)", text)
    places = Counter(f"{os.path.normpath(file)}:{line}: {what}" for line, file, what in told)
    if count.passed + count.failed > 0:
        count.check("array temporaries at run time", [f"{place} ({times} times)" for place, times in sorted(places.items())
                                                      if place.startswith(("src/", "io/", "cli/", "app/"))])
    return count


def compiler(text):
    """The output of a verbose build: no warning in our own sources, and all of them were compiled."""
    compiled = {os.path.normpath(file) for file in re.findall(r"\+ \S+ .*?-c (\S+)", text)}
    told = re.findall(r"^(\S+\.[fF]90):(\d+):\d+:\n(?:(?!\S+\.[fF]90:|Warning:|Error:|Fatal Error:).*\n)*((?:Warning|(?:Fatal )?Error): .*)",
                      text, re.M)
    warnings = [f"{os.path.normpath(file)}:{line}: {what}" for file, line, what in told if is_ours(os.path.normpath(file))]
    count = Count()
    count.check("compiler warnings", [*dict.fromkeys(warnings), *re.findall(r".*\bld: warning:.*", text)])
    count.check("sources that no target of fpm.toml compiles", sorted(own_sources() - compiled))
    return count


def unittest_text(text):
    """The output of Python's unittest, of one run or several: 'FAIL: NAME' with its traceback, 'Ran N tests', 'FAILED (errors=1)'."""
    numbers = Counter()
    for listed in re.findall(r"^(?:OK|FAILED) \((.*)\)", text, re.M):
        numbers.update({key: int(value) for key, value in re.findall(r"(\w[\w ]*)=(\d+)", listed)})
    failed = numbers["failures"] + numbers["errors"] + numbers["unexpected successes"]
    ran = sum(map(int, re.findall(r"^Ran (\d+) test", text, re.M)))
    notes = text[text.index("=" * 70) :].splitlines() if "=" * 70 in text else []
    return Count(max(0, ran - failed - numbers["skipped"]), failed, numbers["skipped"], notes)


def ok_lines(text):
    """Lines 'ok NAME' and 'not ok NAME', each a test; other lines after a 'not ok' explain it."""
    count = Count()
    for block in re.split(r"^(?=ok\b|not ok\b)", text, flags=re.M):
        count.passed += block.startswith("ok")
        if block.startswith("not ok"):
            count.failed += 1
            count.notes += block.splitlines()
    return count


# --- inputs of the strict build ---------------------------------------------------------------------------------------


def is_ours(path):
    return path.startswith(tuple(folder + "/" for folder in SOURCES))


def own_sources():
    """Our Fortran sources, without those of the small projects with their own manifests."""
    manifests = ("fpm.toml", "CMakeLists.txt", "Makefile")
    found = set()
    for folder in SOURCES:
        for directory, below, files in os.walk(ROOT / folder):
            below[:] = [name for name in below if not any(Path(directory, name, file).exists() for file in manifests)]
            found.update(
                os.path.relpath(Path(directory, file), ROOT) for file in files if file.endswith((".f90", ".F90"))
            )
    return found


def copy_sources():
    """Copy the project, with what its tests read, to a new place: the compiler warns only about files that it compiles."""
    shutil.rmtree(STRICT, ignore_errors=True)
    STRICT.mkdir(parents=True)
    shutil.copy(ROOT / "fpm.toml", STRICT)
    for folder in ("src", "io", "cli", "app", "test", "example", "scenes", "doc"):
        if (ROOT / folder).exists():
            shutil.copytree(ROOT / folder, STRICT / folder, symlinks=True, ignore=shutil.ignore_patterns("build"))
    shutil.copytree(ROOT / "build" / "dependencies", STRICT / "build" / "dependencies", symlinks=True)
    # Without its cache, fpm would name paths differently in the first build and compile everything twice.
    shutil.copy(ROOT / "build" / "cache.toml", STRICT / "build")


# --- the parts, in their order ----------------------------------------------------------------------------------------


@dataclass
class Part:
    name: str
    command: list
    reader: callable
    prepare: callable = None
    folder: Path = ROOT
    # The limit of its duration.
    minutes: float = 60
    # The minutes that it takes on one of two idle cores.
    expected: float = 0.2
    # Another part that must run before, even if it was not requested.
    needs: str = ""
    # The project whose builds by fpm it runs: one part at a time may do that.
    builds: str = ""
    # Excluded from `make test`, because it takes long or needs large packages.
    long: bool = False


PARTS = [
    Part(
        "strict",
        [FPM, "build", "--tests", "--no-prune", "--verbose", "--flag", STRICT_FLAGS],
        compiler,
        copy_sources,
        STRICT,
        expected=2.4,
        builds="copy",
    ),
    Part("build", ["make", "--no-print-directory", "build"], one_test, expected=2.4, builds="project"),
    Part(
        "debug",
        [FPM, "test", "--no-prune", "--flag", STRICT_FLAGS],
        test_drive_checked,
        folder=STRICT,
        expected=6.5,
        needs="strict",
        builds="copy",
    ),
    Part("fast", [FPM, "test", *flags("fast")], test_drive, expected=5, builds="project"),
    Part("install", ["tools/check_install.sh"], ok_lines, needs="build", expected=6),
    Part("python", [PYTHON, "-m", "unittest", "discover", "-v", "-s", "test/python"], unittest_text, needs="build", expected=3.5),
    Part("package", ["tools/check_package.sh"], unittest_text, needs="build", expected=3.5),
    Part("examples", ["tools/check_examples.sh"], ok_lines, expected=3, builds="project"),
    Part(
        "fuzz",
        [FPM, "test", "tandem-fuzz", "--no-prune", "--flag", STRICT_FLAGS, "--runner", str(ROOT / "test" / "fuzz" / "fuzz.py")],
        ok_lines,
        folder=STRICT,
        expected=2,
        needs="strict",
        builds="copy",
    ),
    Part("bench", ["tools/check_bench.py", str(STRICT), STRICT_FLAGS], ok_lines, needs="strict", expected=0.2),
    Part("frozen", [PYTHON, "test/frozen/frozen.py"], ok_lines, needs="build", expected=0.2),
    Part("lint", [FORTITUDE, "check", "--output-format", "concise", *SOURCES, "bench", "mpi"], one_test),
    Part("lengths", ["tools/check_lengths.py"], ok_lines),
    Part("docs", ["python3", "tools/docs.py"], ok_lines, expected=0.3),
    Part("optimised", [FPM, "test", *flags("optimised")], test_drive, long=True, expected=8, builds="project"),
    Part("mpi", ["tools/check_mpi.sh"], unittest_text, long=True, expected=10),
    Part("page", ["tools/check_package.sh", "page"], unittest_text, needs="build", long=True, expected=5),
    Part("wheel", ["tools/check_wheel.sh"], unittest_text, long=True, expected=14),
    Part("dist", ["tools/check_dist.sh"], ok_lines, long=True, expected=2),
]


# ----------------------------------------------------------------------------------------------------------------------


def environment():
    """Environment of every part, independent of the caller's: one thread of BLAS unless the caller sets another number, messages
        that tests and readers know, and no git repository named by a hook."""
    own = {
        name: value
        for name, value in os.environ.items()
        if name != "LANGUAGE" and not (name.startswith("GIT_") and name.endswith(("DIR", "TREE", "FILE", "DIRECTORY")))
    }
    return {"OPENBLAS_NUM_THREADS": "1"} | own | {"LC_ALL": "C.UTF-8"}


def run(part, stopping=None):
    """Run one part, unless the event `stopping` ends it: its Count, after the rules that hold for all of them."""
    stopping = stopping or threading.Event()
    LOGS.mkdir(parents=True, exist_ok=True)
    log = LOGS / f"{part.name}.log"
    try:
        if part.prepare:
            part.prepare()
        with open(log, "w", encoding="utf-8") as output:
            process = subprocess.Popen(part.command, cwd=part.folder, env=environment(), stdin=subprocess.DEVNULL, stdout=output,
                                       stderr=subprocess.STDOUT, start_new_session=True)
    except OSError as error:
        return Count(failed=1, notes=[f"cannot run {part.command[0]}: {error}"])
    limit = time.monotonic() + 60 * part.minutes
    while process.poll() is None and time.monotonic() < limit and not stopping.wait(0.2):
        pass
    end = f"ended with exit code {process.returncode}" if process.returncode else ""
    if process.returncode is None:
        end = f"stopped after {part.minutes:g} minutes"
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    text = re.sub(r"\x1b\[[0-9;]*m", "", log.read_text(encoding="utf-8", errors="replace"))
    count = part.reader(text)
    if not end and count.passed + count.failed == 0:
        end = "ran no test"
    # The exit code includes failures without a counted test.
    if end and (count.failed == 0 or "stopped" in end):
        count.failed += 1
        count.passed = 0 if part.reader is one_test else count.passed
        count.notes += [f"{end}; its last lines:", *text.splitlines()[-LAST:]]
    return count


def results(parts, lanes):
    """Run parts, as many at a time as there are lanes; yields each with its Count and its seconds when it ends."""
    waiting, running, stopping = list(parts), {}, threading.Event()
    with concurrent.futures.ThreadPoolExecutor(lanes) as pool, contextlib.ExitStack() as at_end:
        # An interrupted caller leaves no process behind.
        at_end.callback(stopping.set)
        while waiting or running:
            busy = {part.builds for part, _ in running.values()}
            missing = {part.name for part in waiting} | {part.name for part, _ in running.values()}
            free = (part for part in waiting if part.needs not in missing and not (part.builds and part.builds in busy))
            part = next(free, None) if len(running) < lanes else None
            if part:
                waiting.remove(part)
                running[pool.submit(run, part, stopping)] = part, time.monotonic()
                continue
            ended, _ = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
            for future in ended:
                part, start = running.pop(future)
                yield part, future.result(), time.monotonic() - start


def main(names):
    known = [part.name for part in PARTS]
    if names == ["--list"]:
        for part in PARTS:
            print(f"{part.name:10}{part.expected:5.1f}" + ("   make test-all" if part.long else ""))
        return 0
    everything = names == ["--all"]
    names = [] if everything else names
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"verify: no part {', '.join(unknown)}; there are {', '.join(known)}", file=sys.stderr)
        return 2
    total = Count()
    chosen = {*names, *(part.needs for part in PARTS if part.name in names)}
    parts = [part for part in PARTS if (part.name in chosen if names else everything or not part.long)]
    lanes = min(2, len(os.sched_getaffinity(0)))
    print(f"{len(parts)} parts; about {sum(part.expected for part in parts) / 2:.0f} minutes on two idle cores", flush=True)
    for number, (part, count, seconds) in enumerate(results(parts, lanes), 1):
        skipped = f", {count.skipped} skipped" if count.skipped else ""
        told = f"{count.passed:5} passed, {count.failed} failed{skipped}  ({seconds:.1f} s)"
        print(f"{number:2}/{len(parts)} {part.name:10}{told}", flush=True)
        if count.failed:
            for note in count.notes[:80]:
                print(f"    {note}")
            print(f"    (all of its output: {(LOGS / part.name).relative_to(ROOT)}.log)", flush=True)
        total.passed += count.passed
        total.failed += count.failed
        total.skipped += count.skipped
    print(f"\n{total.passed} passed, {total.failed} failed" + (f", {total.skipped} skipped" if total.skipped else ""))
    return 1 if total.failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
