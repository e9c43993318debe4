#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Gives thousands of wrong, odd and right scenes to `tandem-fuzz` (reader.f90 beside this file) and checks its answers.

Usage: .venv/bin/fpm test tandem-fuzz --profile debug --runner test/fuzz/fuzz.py [-- --seed N --count N]
       test/fuzz/fuzz.py PROGRAM [--seed N] [--count N]       with the program of any build
       test/fuzz/fuzz.py PROGRAM --again build/fuzz           repeat the stored failures

The inputs are mutations of the shipped scenes and of some that use all tables (scenes.py), texts of TOML and mechanisms from
grammars (mutations.py, mechanisms.py), made from a seed. The
requirements (judge.py): an answer within the time limit, no crash, no complaint of run-time checks, bounded memory; a
message that names the line, or the setting, if it is refused; agreement with Python's tomllib if it is accepted: the text
is TOML, the complete scene has the same values, all numbers are in their ranges, and the complete scene reads back as
itself. Failed inputs are stored in build/fuzz, with the command that repeats the failure.

It prints a line `ok KIND` or `not ok KIND` for each kind of input, and the failures.
"""

import argparse
import collections
import contextlib
import os
import random
import resource
import select
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import judge
import mutations
import scenes

ROOT = Path(__file__).resolve().parent.parent.parent
SECONDS = 60.0
MEMORY = 1 << 30


class Hang(Exception):
    pass


class Crash(Exception):
    pass


class Reader:
    """The program that reads scenes: one process for many, a new one after a crash."""

    def __init__(self, program, folder):
        self.program, self.folder = program, folder
        self.process = None
        self.largest = 0

    def start(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            # Programs with a sanitizer reserve terabytes and use little of them.
            if "ASAN_OPTIONS" not in os.environ:
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))

        self.errors = open(self.folder / "stderr", "a+b")
        self.process = subprocess.Popen(
            self.program,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            bufsize=0,
            cwd=self.folder,
            preexec_fn=limit,
        )
        self.rest = b""

    def stop(self):
        if self.process:
            with contextlib.suppress(OSError):
                self.process.stdin.close()
            try:
                self.process.wait(5)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
            self.process.stdout.close()
            self.errors.close()
            self.process = None

    def kill(self):
        self.process.kill()
        self.stop()

    def complaints(self):
        """Output of the program on stderr: run-time checks, sanitizers, the Fortran library."""
        if os.fstat(self.errors.fileno()).st_size == 0:
            return ""
        self.errors.seek(0)
        text = self.errors.read().decode(errors="replace")
        self.errors.truncate(0)
        return text

    def need(self, n, end):
        """At least n bytes of the answer, or a whole line for n = 0."""
        while len(self.rest) < n or (n == 0 and b"\n" not in self.rest):
            if not select.select([self.process.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
                self.kill()
                raise Hang(f"no answer after {SECONDS:g} s")
            block = os.read(self.process.stdout.fileno(), 1 << 20)
            if not block:
                code = self.process.wait()
                said = self.complaints()
                self.stop()
                raise Crash(f"ended with {code}: {said[:2000]}")
            self.rest += block

    def ask(self, path, settings):
        """The verdict on a scene: (verdict, status, text), the text as bytes."""
        if self.process is None:
            self.start()
        longest = max([len(os.fsencode(word)) for word in settings], default=0)
        lines = [str(path), str(self.folder / "copy.toml"), f"{len(settings)} {longest}", *settings]
        end = time.monotonic() + SECONDS
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(b"".join(os.fsencode(line) + b"\n" for line in lines))
        self.need(0, end)
        head, self.rest = self.rest.split(b"\n", 1)
        verdict, status, length = head.decode().split()
        self.need(int(length) + 1, end)
        text, self.rest = self.rest[: int(length)], self.rest[int(length) + 1 :]
        return verdict, int(status), text


def keep(folder, number, case, problem):
    """Store an input that failed."""
    place = folder / f"{number}"
    place.mkdir(parents=True, exist_ok=True)
    (place / "input.toml").write_bytes(case.text)
    (place / "settings").write_bytes(b"".join(os.fsencode(word) + b"\n" for word in case.settings))
    (place / "kind").write_text(case.kind)
    sets = " ".join("--set " + shlex.quote(os.fsdecode(os.fsencode(word))) for word in case.settings)
    (place / "problem.txt").write_text(
        f"{problem}\n\nbuild/tandem show {place / 'input.toml'} {sets}\n", errors="backslashreplace"
    )


def kept(folder):
    """The stored inputs."""
    for place in sorted(folder.iterdir(), key=lambda path: path.name):
        if (place / "input.toml").exists():
            words = [os.fsdecode(line) for line in (place / "settings").read_bytes().split(b"\n") if line]
            yield place.name, mutations.Case((place / "kind").read_text(), (place / "input.toml").read_bytes(), words)


def run(program, cases, folder):
    """Try all cases: {kind: [number, [problems]]}, counts of verdicts, and the slowest."""
    scratch = folder / "scratch"
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    reader = Reader(program, scratch)
    found = collections.defaultdict(lambda: [0, []])
    verdicts = collections.Counter()
    slowest = (0.0, "")
    path = scratch / "input.toml"
    file = open(path, "wb", buffering=0)
    try:
        for number, case in cases:
            file.seek(0)
            file.write(case.text)
            file.truncate()
            found[case.kind][0] += 1
            start = time.monotonic()
            try:
                verdict, status, text = reader.ask(path, case.settings)
                problem = judge.problem(case, path, verdict, status, text)
                said = reader.complaints()
                if said and not problem:
                    problem = "the program complains: " + said[:2000]
                verdicts[verdict if verdict == "refused" else f"{verdict}, status {status}"] += 1
            except (Hang, Crash) as end:
                problem = f"{type(end).__name__.lower()}: {end}"
                verdicts[type(end).__name__.lower()] += 1
            slowest = max(slowest, (time.monotonic() - start, f"{case.kind} {number}"))
            if problem:
                found[case.kind][1].append((number, problem))
                keep(folder, number, case, problem)
    finally:
        reader.stop()
        file.close()
    return found, verdicts, slowest


def main():
    parser = argparse.ArgumentParser(description="Fuzz the reader of scenes.")
    parser.add_argument("program", nargs="+", help="tandem-fuzz")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=12000)
    parser.add_argument("--kind", help="inputs of this kind alone")
    parser.add_argument("--again", type=Path, help="a folder of inputs that were kept")
    options = parser.parse_args()

    program = [str(Path(word).resolve()) if Path(word).exists() else word for word in options.program]
    if options.again:
        folder = ROOT / "build" / "fuzz_again"
        cases = list(kept(options.again.resolve()))
    else:
        folder = ROOT / "build" / "fuzz"
        shutil.rmtree(folder, ignore_errors=True)
        cases = mutations.cases(scenes.all_scenes(ROOT / "scenes"), random.Random(options.seed), options.count, options.kind)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    found, verdicts, slowest = run(program, cases, folder)
    for kind in sorted(found):
        number, problems = found[kind]
        print(f"{'not ' if problems else ''}ok {kind} ({number} inputs)")
        for name, problem in problems[:3]:
            print(f"  {os.path.relpath(folder / str(name), ROOT)}: {problem[:1000]}")
        if len(problems) > 3:
            print(f"  and {len(problems) - 3} more")
    total = sum(number for number, _ in found.values())
    print(f"# {total} inputs, seed {options.seed}: " + ", ".join(f"{n} {what}" for what, n in verdicts.most_common()))
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"# slowest {slowest[0]:.2f} s ({slowest[1]}), largest memory {memory:.0f} MB")
    return 1 if any(problems for _, problems in found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
