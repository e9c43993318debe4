#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Finds invalid use of memory and undefined behaviour with the compiler's sanitizers and by valgrind.

Usage: tools/sanitize.py [sanitizers] [valgrind] [suites [SUITE...]]        all without a name; `make sanitize` calls it

sanitizers: the Fortran tests, a choice of command lines, and fuzzed scenes, built with -fsanitize=address,undefined and all
            run-time checks of gfortran, leaks included.
valgrind:   memcheck over the same command lines, which take every stepper, both kinds of steps, events, assembly and the result
            file, and over the tests of the interfaces of C and Fortran 77; built with little optimization.
suites:     memcheck over the Fortran tests, suite by suite, or over those that are named, without the longest tests (LONG), which
            the sanitizers run.

`tools/check_install.sh`, a part of `make test`, does the former for those interfaces and their examples.

Prints "ok NAME" or "not ok NAME" for each check, and after a failure what was found; all of it is in build/sanitize. The exit code
is 1 if anything was found.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "build" / "sanitize"
FPM = str(ROOT / ".venv" / "bin" / "fpm")
SANITIZE = "-O1 -g -fsanitize=address,undefined -fno-omit-frame-pointer"
# Array temporaries are not errors here; `tools/verify.py debug` detects them.
CHECKED = f"{SANITIZE} -fcheck=all,no-array-temps"
PLAIN = "-O1 -g"
VALGRIND = ["valgrind", "-q", "--error-exitcode=99", "--num-callers=20", "--leak-check=full", "--show-leak-kinds=definite"]
VALGRIND += ["--errors-for-leak-kinds=definite", f"--suppressions={ROOT}/config/valgrind.txt"]
# Leaks in the code of others, by the first procedure that is not the sanitizer's: toml-f makes the labels of its messages, and
# test-drive its lists of tests (in main.f90 too), by functions whose results hold allocatable texts, which gfortran 12 leaks.
KNOWN_LEAKS = re.compile(r"__tomlf_diagnostic_MOD_new_label |__testdrive_MOD_new_|MAIN__ \S*test/main.f90:")
LEAK = re.compile(r"^(?:Direct|Indirect) leak of .*?(?=\n\n|\Z)", re.M | re.S)
TROUBLE = re.compile(r"ERROR: (?!LeakSanitizer)\w+Sanitizer|runtime error:|Fortran runtime error|Backtrace for|^==\d+== ", re.M)
FUZZED = "2000"
# Programs of test/linking.
INTERFACE_TESTS = ("interface_c", "interface_f77", "mechanism_f77", "orders_c", "orders_f77")
# Tests that memcheck takes about a minute or more for, by suite; shorter ones go the same ways through the code.
LONG = {
    "accuracy": [
        "disk-with-the-trapezoid-agrees-with-its-reference",
        "stiff-pendulum-with-implicit-steps-agrees-with-its-reference",
        "motorcycle-with-all-steppers-agrees-with-an-independent-solution",
        "chopper-with-all-steppers-agrees-with-an-independent-solution",
    ],
    "order": ["test-models-with-implicit-steps-have-their-order"],
    "constraints": ["implicit-steps-hold-all-levels", "implicit-steps-hold-all-levels-with-all-options"],
    "charts": [
        "disk-takes-127-charts-with-refinement-too",
        "disk-takes-127-charts-with-sdirk54-too",
        "motorcycles-take-8-charts-with-the-papers-limit",
        "disk-takes-80-adaptive-charts-in-40-s",
        "all-policies-and-modes-give-the-same-solution",
        "implicit-steps-give-the-same-solution-with-all-options",
    ],
    "control": ["every-tolerance-ends-on-the-disk-with-constraints-held"],
    "checkpoint": ["fixed_steps", "controlled_steps"],
    "mechanisms": ["bricard-lacks-one-rank-all-along-its-path"],
}

DISK = ["rolling_disk", "--set", "time.end=0.02", "--quiet"]
ADAPTIVE = ["--set", "solver.rtol=1e-8", "--set", "time.end=0.3"]
STEPPERS = ["rk4", "dopri5", "dop853", "trapezoid", "sdirk54", "radau5"]
# Those that take a tolerance: `radau` and `auto` take no fixed steps.
ADAPTIVE_STEPPERS = [*STEPPERS[1:], "radau", "auto"]


def stepper(name):
    return ["--set", f"solver.stepper={name}"]


# Command lines of tandem: a name, an exit code, the words.
COMMANDS = [
    ("help", 0, ["help"]),
    ("list", 0, ["list"]),
    *((f"show {scene}", 0, ["show", scene]) for scene in ("articulated_vehicle", "motorcycle")),
    *((f"check {scene}", 0, ["check", scene]) for scene in ("rolling_disk", "articulated_vehicle", "motorcycle_chopper")),
    *((f"run by {name}", 0, ["run", *DISK, *stepper(name), "--no-error"]) for name in STEPPERS),
    *((f"run by {name} with a tolerance", 0, ["run", *DISK, *ADAPTIVE, *stepper(name)]) for name in ADAPTIVE_STEPPERS),
    ("run with the paper's charts", 0, ["run", *DISK, "--set", "solver.chart=paper", "--set", "solver.v_limit=0.01"]
     + ["--set", "solver.refresh=refine", "--set", "solver.basis=svd"]),
    ("run with a profile", 0, ["run", *DISK, *stepper("sdirk54"), "--profile", "--no-error", "--output", "profile.h5"]),
    ("run of an implicit vehicle", 0, ["run", "articulated_vehicle", "--set", "time.end=0.01", "--quiet", *stepper("sdirk54")]),
    ("run with events", 0, ["run", "events.toml", "--quiet"]),
    ("run of an assembled start", 0, ["run", "assembled.toml", "--set", "time.end=0.05", "--quiet"]),
    ("run that fails", 1, ["run", *DISK, "--set", "solver.max_steps=3", "--output", "cut.h5"]),
    ("run that is resumed", 0, ["resume", "cut.h5", "--set", "solver.max_steps=100", "--quiet"]),
    ("a start that is refused", 2, ["run", *DISK, "--set", "initial.q=[0,0,2,1,0,0,0,0,-1]"]
     + ["--set", "initial.qd=[0,0,0,0,0,0,0,0,0]"]),
    ("a scene that is refused", 2, ["run", "broken.toml"]),
    ("a setting that is refused", 2, ["show", "rolling_disk", "--set", "solver.stepper=rk5"]),
    ("study precision", 0, ["study", "precision", "rolling_disk", "--set", "time.end=0.02", "--steppers", "rk4,sdirk54"]
     + ["--samples", "2", "--repeats", "1", "--budget", "0.02"]),
]


def unknown_leak(text):
    """First reported leak that is not a known one."""
    for leak in LEAK.finditer(text):
        place = re.search(r"#\d+ 0x\w+ in (?!__interceptor)(.*)", leak[0])
        if not (place and KNOWN_LEAKS.match(place[1])):
            return leak
    return None


class Checks:
    """Runs commands, checks their results, and counts failures."""

    def __init__(self, folder):
        self.folder = folder
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self.failures = 0

    def run(self, name, command, code=0, cwd=None, seconds=1200, **environment):
        """One check: the command ends with the code, and reports no error."""
        log = self.folder / (re.sub(r"\W+", "_", name) + ".log")
        try:
            done = subprocess.run(
                command,
                cwd=cwd or ROOT,
                env=os.environ | environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=seconds,
            )
            text, ended = done.stdout.decode(errors="replace"), done.returncode
        except subprocess.TimeoutExpired as late:
            text, ended = (late.stdout or b"").decode(errors="replace"), f"none after {seconds} s"
        log.write_text(text)
        found = TROUBLE.search(text) or unknown_leak(text)
        if ended == code and not found:
            print(f"ok {name}", flush=True)
            return True
        self.failures += 1
        lines = (text[found.start() :].splitlines() if found else text.splitlines()[-12:])[:12]
        print(f"not ok {name}: exit code {ended}, all of it in {log.relative_to(ROOT)}")
        print("\n".join(f"    {line}" for line in lines), flush=True)
        return False


def scenes(folder):
    """Scenes with features that the shipped ones do not use, from the fuzzing."""
    sys.path.insert(0, str(ROOT / "test" / "fuzz"))
    from scenes import ASSEMBLED, EVENTS

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "events.toml").write_text(EVENTS)
    (folder / "assembled.toml").write_text(ASSEMBLED)
    (folder / "broken.toml").write_text('[scene]\nmodel = "rolling_disk\n')
    return folder


def program(flags, target, *words):
    """The path of a program that fpm has built with some flags."""
    command = [FPM, *words, "--flag", flags, "--c-flag", flags.split(" -fcheck")[0], "--runner", "echo"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return str(ROOT / [line for line in done.stdout.splitlines() if line.strip().endswith(f"/{target}")][-1].strip())


def command_lines(checks, tool, binary, **environment):
    """All command lines, under a tool or by themselves."""
    folder = scenes(checks.folder / "work")
    for name, code, words in COMMANDS:
        more = ["--force"] if words[0] == "run" else []
        more += ["--output", str(folder / "study")] if words[0] == "study" else []
        checks.run(name, [*tool, binary, *words, *more], code, folder, TANDEM_SCENES=str(ROOT / "scenes"), **environment)


def sanitizers():
    """Checks with the sanitizers."""
    checks = Checks(OUT / "sanitizers")
    # Leaks are checked by `unknown_leak`. Results of toml-f for too long integers are never used (`has_overflown`).
    os.environ["LSAN_OPTIONS"] = "exitcode=0"
    os.environ["ASAN_OPTIONS"] = "detect_leaks=1"
    os.environ["UBSAN_OPTIONS"] = f"print_stacktrace=1:halt_on_error=1:suppressions={ROOT}/config/undefined.txt"
    c_flags = ["--c-flag", SANITIZE]
    checks.run("the Fortran tests", [FPM, "test", "tandem-test", "--flag", CHECKED, *c_flags], seconds=3000)
    binary = program(CHECKED, "tandem", "run", "tandem")
    command_lines(checks, [], binary)
    fuzz = program(CHECKED, "tandem-fuzz", "test", "tandem-fuzz")
    checks.run(f"{FUZZED} fuzzed scenes", ["test/fuzz/fuzz.py", fuzz, "--seed", "7", "--count", FUZZED])
    return checks.failures


def valgrind():
    """Checks with valgrind."""
    checks = Checks(OUT / "valgrind")
    command_lines(checks, VALGRIND, program(PLAIN, "tandem", "run", "tandem"))
    installed, linking = checks.folder / "installed", checks.folder / "linking"
    shutil.copytree(ROOT / "test" / "linking", linking)
    build = ["--prefix", str(installed), "--parts", "library", "--build", str(ROOT / "build" / "library-plain"), "--flags", PLAIN]
    if checks.run("the library is built", ["tools/library.py", "install", *build]) and checks.run(
        "the tests of the interfaces are built", ["make", "-C", str(linking), f"PREFIX={installed}", *INTERFACE_TESTS]
    ):
        for name in INTERFACE_TESTS:
            checks.run(name, [*VALGRIND, str(linking / name)], cwd=linking)
    return checks.failures


def fortran_tests():
    """The suites of the Fortran tests and the names of their tests."""
    for suite, name in re.findall(r"new_testsuite\('(\w+)', collect_(\w+)\)", (ROOT / "test" / "main.f90").read_text()):
        (path,) = (ROOT / "test" / "src").glob(f"*/test_{name}.f90")
        yield suite, re.findall(r"new_unittest\('([^']+)'", path.read_text())


def suites(only=()):
    """Fortran tests under valgrind."""
    checks = Checks(OUT / "suites")
    known = dict(fortran_tests())
    unknown = [f"{suite}/{test}" for suite, tests in LONG.items() for test in tests if test not in known.get(suite, ())]
    if unknown:
        sys.exit(f"sanitize: LONG names tests that do not exist: {', '.join(unknown)}")
    binary = program(PLAIN, "tandem-test", "test", "tandem-test")
    for suite, tests in known.items():
        if only and suite not in only:
            continue
        short = [test for test in tests if test not in LONG.get(suite, ())]
        if len(short) == len(tests):
            checks.run(suite, [*VALGRIND, binary, suite])
        else:
            for test in short:
                checks.run(f"{suite} {test}", [*VALGRIND, binary, suite, test])
            print(f"# {suite}: left out {', '.join(test for test in tests if test not in short)}", flush=True)
    return checks.failures


PARTS = {"sanitizers": sanitizers, "valgrind": valgrind, "suites": suites}


def main(names):
    only = []
    if names[:1] == ["suites"]:
        names, only = names[:1], names[1:]
    for what, those, there in (("part", names, PARTS), ("suite", only, dict(fortran_tests()))):
        unknown = [name for name in those if name not in there]
        if unknown:
            sys.exit(f"sanitize: no {what} {', '.join(unknown)}; there are {', '.join(there)}")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    failures = sum(suites(only) if name == "suites" else part() for name, part in PARTS.items() if name in (names or PARTS))
    print("nothing was found" if failures == 0 else f"{failures} checks failed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
