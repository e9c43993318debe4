# SPDX-License-Identifier: MIT
"""`tandem resume`: runs that are killed at random moments and taken up end bitwise as runs that are not; other files are refused.

Runs build/tandem, or the program given by the environment variable TANDEM. TANDEM_KILLS is the number of kills of each run
(default 3), and TANDEM_SEED chooses the moments. The full check is TANDEM_KILLS=20 python3 test/python/test_resume.py Killed
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
import unittest

import h5py
import numpy as np
from test_output import STRICT, TANDEM, Case, run

KILLS = int(os.environ.get("TANDEM_KILLS", "3"))
SEED = int(os.environ.get("TANDEM_SEED", "1"))

# Of each scene: the end of a run of about 20 000 explicit steps, and the step.
SCENES = {
    "rolling_disk": (10.0, 5e-4),
    "articulated_vehicle": (6.0, 3e-4),
    "motorcycle": (8.0, 5e-4),
    "motorcycle_chopper": (8.0, 5e-4),
}
# Implicit steps cost more, and a controlled step of high order gets further.
STEPPERS = {"rk4": 1.0, "dopri5": 1.0, "dop853": 2.0, "trapezoid": 3.0, "sdirk54": 12.0, "radau5": 12.0}
POLICIES = [
    "solver.chart=every_step",
    "solver.chart=adaptive",
    "solver.chart=paper solver.v_limit=0.05 solver.w_limit=0.2",
    "solver.chart=paper solver.condition_limit=1e6 solver.iteration_limit=3",
]
VARIANTS = [
    "solver.refresh=factor",
    "solver.refresh=refine",
    "solver.basis=svd",
    "output.interval=0.0137",
    "output.rows=700",
    'output.fields=["q","qd","lambda","kinetic_energy","step","chart"]',
]
COMPILER = shutil.which("cc") or shutil.which("gcc")
# Kills the program instead of its KILL_AT-th change of an HDF5 file, and says how many there were.
KILLER = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
static long changes;
static void count(int file)
{
    char link[32], path[4096];
    const char *at = getenv("KILL_AT");
    long length;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    length = readlink(link, path, sizeof path);
    if (length > 3 && memcmp(path + length - 3, ".h5", 3) == 0 && ++changes == (at ? atol(at) : 0))
        kill(getpid(), SIGKILL);
}
#define REAL(name) ((__typeof__(name) *)dlsym(RTLD_NEXT, #name))
ssize_t pwrite(int file, const void *from, size_t size, off_t at) { count(file); return REAL(pwrite)(file, from, size, at); }
ssize_t pwrite64(int file, const void *from, size_t size, off64_t at) { count(file); return REAL(pwrite64)(file, from, size, at); }
int ftruncate(int file, off_t size) { count(file); return REAL(ftruncate)(file, size); }
int ftruncate64(int file, off64_t size) { count(file); return REAL(ftruncate64)(file, size); }
__attribute__((destructor)) static void report(void) { fprintf(stderr, "changes: %ld\n", changes); }
"""
# Attributes that depend on the clock, and attributes that record a resumed run.
CLOCK = {"wall_seconds", "cpu_seconds", "global_error_seconds"}
HISTORY = {"created", "command", "resumed", "scene", "status_message"}


def settings(words):
    return [part for word in words for part in ("--set", word)]


def contents(path):
    """Every dataset of a result, bit by bit, and every attribute that the clock does not make."""
    found = {}
    with h5py.File(path) as file:

        def take(name, item):
            found.update({f"{name}@{key}": np.asarray(value).tolist() for key, value in item.attrs.items()
                          if key not in CLOCK | HISTORY | {"DIMENSION_LIST", "REFERENCE_LIST"}})
            if isinstance(item, h5py.Dataset):
                values = item[()]
                found[name] = values.shape, values.tobytes() if values.dtype.kind != "O" else values.tolist()

        take("/", file)
        for name in ("trajectory", "diagnostics", "events", "report"):
            if name in file:
                take(name, file[name])
                file[name].visititems(lambda part, item, name=name: take(f"{name}/{part}", item))
    return found


def has_checkpoint(path):
    """True if the run that was to write the file reached its first row."""
    try:
        with h5py.File(path) as file:
            return any(len(place) for place in file["checkpoint"].values())
    except (OSError, KeyError):
        return False


def checksum(words):
    """Fletcher's checksum of the halves of words, as pack.f90 has it."""
    first, second = 1, 0
    for word in words:
        for half in int(word) & 0xFFFFFFFF, int(word) >> 32 & 0xFFFFFFFF:
            first = (first + half) % 0xFFFFFFFF
            second = (second + first) % 0xFFFFFFFF
    return np.array(second << 32 | first, "u8").astype("i8")


class Resume(Case):
    """A run that is ended by signals again and again, each time a little later."""

    def assert_same(self, one, other):
        first, second = contents(self.folder / one), contents(self.folder / other)
        self.assertEqual(first.keys(), second.keys())
        for name in first:
            if first[name] != second[name]:
                self.fail(f"{name} is not the same: {str(first[name])[:200]}, {str(second[name])[:200]}")

    def interrupt(self, number, shortest, longest, *arguments):
        """Run until a random moment; whether the run was done before it."""
        environment = os.environ | STRICT
        process = subprocess.Popen([TANDEM, *arguments, "--quiet", "--no-error"], cwd=self.folder, env=environment,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            process.wait(self.random.uniform(shortest, longest))
        except subprocess.TimeoutExpired:
            process.send_signal(number)
        message = process.communicate()[1]
        # It was killed when all was done, but before another HDF5 could see that.
        if process.returncode == 2 and "is complete" in message:
            return True
        if number == signal.SIGKILL:
            self.assertIn(process.returncode, (0, -number), message)
        else:
            # It may come before the program catches it.
            self.assertIn(process.returncode, (0, 128 + number, -number), message)
        return process.returncode == 0

    def chain(self, scene, words, number, kills=KILLS):
        """The run, and the same run ended so many times; their results."""
        for path in self.folder.glob("*.h5"):
            path.unlink()
        start = time.monotonic()
        self.tandem("run", scene, *settings(words), "--no-error", "--output", "whole.h5", "--quiet")
        seconds = time.monotonic() - start
        # The first ones come early; where nothing is there yet to go on from, the run is begun anew and ended later: most of a
        # short run may be its set-up, so that the loop would not end otherwise.
        ended, done, longest = 0, False, 2*seconds/(kills + 1)
        while ended < kills and not done:
            if ended == 0:
                done = self.interrupt(number, 0.1*longest, longest, "run", scene, *settings(words), "--output", "parts.h5",
                                      "--force")
                if not done and not has_checkpoint(self.folder / "parts.h5"):
                    longest *= 1.3
                    continue
            else:
                done = self.interrupt(number, 0.0, 2.5*seconds/(kills + 1), "resume", "parts.h5")
            ended += 1
        if not done:
            last = run("resume", "parts.h5", "--quiet", "--no-error", cwd=self.folder)
            self.assertTrue(last.returncode == 0 or "is complete" in last.stderr, last.stderr)
        self.assert_same("whole.h5", "parts.h5")
        return ended - done


class Killed(Resume):
    def test_all_scenes_and_steppers(self):
        total = 0
        for scene, (end, step) in SCENES.items():
            for stepper, larger in STEPPERS.items():
                self.random = random.Random(f"{SEED} {scene} {stepper}")
                control = f"solver.step={step*larger}"
                if stepper != "rk4" and self.random.random() < 0.5:
                    control = "solver.rtol=1e-11" if larger < 3 else "solver.rtol=1e-8"
                words = [f"time.end={end}", f"solver.stepper={stepper}", control, "output.every=7",
                         f"output.flush={self.random.choice([0.0, 0.003, 0.05])}",
                         *self.random.choice(POLICIES).split(), self.random.choice(VARIANTS)]
                if words[-1].startswith(("output.interval", "output.rows")):
                    words.remove("output.every=7")
                with self.subTest(" ".join(["run", scene, *settings(words)])):
                    total += self.chain(scene, words, signal.SIGKILL)
        self.assertGreater(total, 0)

    def test_a_tiny_run(self):
        """Runs of some milliseconds, so that many are killed while the file is made, taken up, or closed."""
        self.random = random.Random(SEED)
        words = ["time.end=0.05", "output.every=3", "output.flush=0"]
        for _ in range(KILLS):
            self.chain("rolling_disk", words, signal.SIGKILL, 3)


@unittest.skipUnless(COMPILER and sys.platform == "linux", "wants a C compiler and Linux")
class KilledBetweenWrites(Resume):
    """A run that is killed before it changes its file for the n-th time, for every n of its end and of a new beginning."""

    RUN = ["rolling_disk", *settings(["time.end=0.2", "solver.stepper=rk4", "solver.step=1e-3", "output.flush=0"]), "--quiet"]

    def setUp(self):
        super().setUp()
        (self.folder / "killer.c").write_text(KILLER, encoding="utf-8")
        subprocess.run([COMPILER, "-shared", "-fPIC", "-o", "killer.so", "killer.c", "-ldl"], cwd=self.folder, check=True)

    def call(self, *arguments, at=0):
        return subprocess.run([TANDEM, *arguments], cwd=self.folder, capture_output=True, text=True, timeout=60,
                              env=os.environ | STRICT | {"LD_PRELOAD": str(self.folder / "killer.so"), "KILL_AT": str(at)})

    def check(self, begin, *arguments, first, last):
        """Kill at the first and at the last changes of the file; the remaining file can be resumed to the same end."""
        begin()
        changes = self.changes(self.call(*arguments))
        self.assertGreater(changes, first + last)
        for at in (*range(1, first + 1), *range(changes - last + 1, changes + 1)):
            with self.subTest(at=at, of=changes):
                begin()
                self.assertEqual(self.call(*arguments, at=at).returncode, -signal.SIGKILL)
                on = run("resume", "parts.h5", "--quiet", "--no-error", *settings(["solver.max_steps=100000"]), cwd=self.folder)
                self.assertTrue(on.returncode == 0 or "is complete" in on.stderr, on.stderr)
                self.assert_same("whole.h5", "parts.h5")
                with h5py.File(self.folder / "parts.h5") as file:
                    self.assertEqual(file.attrs["status"], "complete")

    def changes(self, done):
        """How often a run has changed its file."""
        self.assertEqual(done.returncode, 0, done.stderr)
        found = [int(line.split()[1]) for line in done.stderr.splitlines() if line.startswith("changes:")]
        if not found:
            self.skipTest("programs cannot be preloaded here")
        return found[-1]

    def test_the_file_opens_as_any_other(self):
        """From its first row on, at every moment, without `tandem resume`; the status alone takes two writes, at the end."""
        arguments = ["run", *self.RUN, *settings(["time.end=0.01", "output.every=1"]), "--no-error", "--force", "--output"]
        count = self.changes(self.call(*arguments, "whole.h5"))
        with h5py.File(self.folder / "whole.h5") as file:
            whole = file["trajectory/q"][:]
            objects = []
            file.visit(objects.append)
        opens, speaks = {}, {}
        for at in range(1, count + 1):
            self.assertEqual(self.call(*arguments, "parts.h5", at=at).returncode, -signal.SIGKILL)
            try:
                with h5py.File(self.folder / "parts.h5") as file:
                    q = file["trajectory/q"][:]
                    np.testing.assert_array_equal(q, whole[:len(q)])
                    opens[at] = len(q)
                    speaks[at] = file.attrs["status"], file.attrs["status_message"]
            except OSError as error:
                speaks[at] = str(error)
        first = min(opens)
        # Until then it is made, object by object: each has a header and may have an index, in a place and a write of its own.
        self.assertLess(first, 2*len(objects))
        self.assertEqual([at for at in range(first, count + 1) if at not in opens], [])
        rows = [opens[at] for at in range(first, count + 1)]
        self.assertEqual(rows, sorted(rows))
        self.assertEqual(rows[-1], len(whole))
        told = [speaks[at] for at in range(first, count + 1)]
        self.assertLessEqual(sum(isinstance(words, str) for words in told), 2, "texts cannot be read")
        words = [words for words in told if not isinstance(words, str)]
        n = words.count(("running", ""))
        self.assertEqual(words, n*[("running", "")] + (len(words) - n)*[("complete", "")])
        self.assertTrue(0 < n < len(words))

    def test_the_end_of_a_run(self):
        self.tandem("run", *self.RUN, "--no-error", "--output", "whole.h5")
        self.check(lambda: None, "run", *self.RUN, "--no-error", "--output", "parts.h5", "--force", first=0, last=20)

    def test_a_run_that_goes_on(self):
        self.tandem("run", *self.RUN, "--no-error", "--output", "whole.h5")
        # It leaves a profile, which does not hold for the whole run.
        self.tandem("run", *self.RUN, "--no-error", "--profile", "--output", "part.h5", *settings(["solver.max_steps=100"]), code=1)
        self.check(lambda: shutil.copy(self.folder / "part.h5", self.folder / "parts.h5"), "resume", "parts.h5", "--quiet",
                   "--no-error", *settings(["solver.max_steps=100000"]), first=20, last=20)


class Signalled(Resume):
    def test_signals(self):
        self.random = random.Random(SEED)
        for number in (signal.SIGINT, signal.SIGTERM):
            for stepper in ("dop853", "sdirk54"):
                with self.subTest(f"{number.name} {stepper}"):
                    # Rows at every seventh step: the row of the last state before a signal is none of the whole run.
                    words = ["time.end=4", f"solver.stepper={stepper}", "solver.rtol=1e-10", "output.every=7"]
                    self.chain("motorcycle", words, number)

    def test_what_is_left_says_so(self):
        self.random = random.Random(SEED)
        words = ["time.end=20000", "output.flush=0.01"]
        # A second is enough for thousands of rows, but not where the machine is busy.
        wait, times = 0.5, []
        while len(times) <= 10 and wait < 60:
            wait *= 2
            self.interrupt(signal.SIGTERM, wait, 1.5*wait, "run", "rolling_disk", *settings(words), "--output", "parts.h5", "--force")
            if has_checkpoint(self.folder / "parts.h5"):
                with h5py.File(self.folder / "parts.h5") as file:
                    self.assertEqual(file.attrs["status"], "interrupted")
                    times = file["trajectory/time"][:]
        self.assertGreater(len(times), 10)
        # A shorter end than planned is one too; the file may have moved.
        (self.folder / "parts.h5").rename(self.folder / "moved.h5")
        end = float(np.ceil(times[-1])) + 0.5
        done = self.tandem("resume", "moved.h5", "--set", f"time.end={end}", "--no-error")
        self.assertIn(f"0.0 to {end} s", done.stdout)
        with h5py.File(self.folder / "moved.h5") as file:
            self.assertEqual(file.attrs["status"], "complete")
            self.assertEqual(file.attrs["resumed"], 1)
            self.assertIn(f"end = {end}", file.attrs["scene"])
            self.assertTrue(np.all(np.diff(file["trajectory/time"][:]) > 0))
        self.tandem("run", "rolling_disk", "--set", f"time.end={end}", "--quiet", "--output", "whole.h5", "--no-error")
        self.assert_same("whole.h5", "moved.h5")


class Complete(Resume):
    def test_a_later_end(self):
        # The end lies on the grid, and 100 rows are due in either case.
        self.tandem("run", "articulated_vehicle", "--set", "time.end=1", "--set", "output.every=10", "--output", "one.h5",
                    "--error")
        before = (self.folder / "one.h5").read_bytes()
        done = self.tandem("resume", "one.h5", code=2)
        self.assertIn("is complete: t = 1.0", done.stderr)
        self.assertIn("--set time.end=", done.stderr)
        self.assertEqual(before, (self.folder / "one.h5").read_bytes())
        self.tandem("resume", "one.h5", "--set", "time.end=2", "--error")
        self.tandem("resume", "one.h5", "--set", "time.end=3", "--error")
        self.tandem("run", "articulated_vehicle", "--set", "time.end=3", "--set", "output.every=10", "--output", "whole.h5", "--error")
        one, whole = contents(self.folder / "one.h5"), contents(self.folder / "whole.h5")
        # The ends of the parts are compared too.
        differing = {name for name in whole if one[name] != whole[name]}
        self.assertLessEqual(differing, {"report@global_error_time", "report@global_error_largest"})
        self.assertEqual(one.keys(), whole.keys())

    def test_the_error_of_a_complete_run(self):
        # No step is taken: the rows stay unchanged, and the error is that which the run would have estimated itself. In a
        # run resumed from its own end the observer sees no step.
        for end in ("1", "2"):
            self.tandem("run", "articulated_vehicle", "--set", f"time.end={end}", "--output", f"whole{end}.h5", "--error")
        self.tandem("run", "articulated_vehicle", "--set", "time.end=1", "--output", "one.h5", "--no-error")
        before = contents(self.folder / "one.h5")
        self.assertNotIn("report@global_error_largest", before)
        done = self.tandem("resume", "one.h5", code=2)
        self.assertIn("--error estimates its error", done.stderr)
        self.tandem("resume", "one.h5", "--error")
        after = contents(self.folder / "one.h5")
        self.assertEqual([], [name for name in before if name.startswith("trajectory") and before[name] != after[name]])
        self.error_at_end_is_that_of("whole1.h5", 0)
        self.tandem("resume", "one.h5", "--set", "time.end=2", "--no-error")
        self.tandem("resume", "one.h5", "--error")
        # The error of the second run is estimated from the differences at all times of comparison, which depend on the first end.
        self.error_at_end_is_that_of("whole2.h5", 0.02)

    def error_at_end_is_that_of(self, path, part):
        with h5py.File(self.folder / "one.h5") as one, h5py.File(self.folder / path) as whole:
            self.assertEqual("complete", one.attrs["status"])
            for name in ("global_error", "global_error_q", "global_error_qd"):
                error = whole["report"].attrs[name]
                self.assertAlmostEqual(one["report"].attrs[name], error, delta=part*error, msg=name)

    def test_limits(self):
        self.tandem("run", "rolling_disk", "--set", "solver.max_steps=200", "--set", "time.end=1", "--output", "one.h5", code=1)
        done = self.tandem("resume", "one.h5", code=1)
        self.assertIn("step_limit", done.stderr)
        self.tandem("resume", "one.h5", "--set", "solver.max_steps=100000", "--no-error")
        self.tandem("run", "rolling_disk", "--set", "time.end=1", "--output", "whole.h5", "--no-error")
        self.assert_same("whole.h5", "one.h5")

    def test_rows_between_steps(self):
        """A run of some ten steps, taken up at each of several places, has the rows of one in one piece."""
        words = settings(["solver.stepper=dop853", "solver.rtol=1e-6"])
        self.tandem("run", "motorcycle", *words, "--output", "whole.h5", "--no-error")
        with h5py.File(self.folder / "whole.h5") as file:
            self.assertGreater(len(file["trajectory/time"]), 300)
        for limit in (1, 5, 12):
            self.tandem("run", "motorcycle", *words, "--set", f"solver.max_steps={limit}", "--output", "one.h5", "--force", code=1)
            self.tandem("resume", "one.h5", "--set", "solver.max_steps=100000", "--no-error")
            self.assert_same("whole.h5", "one.h5")

    def test_events(self):
        events = """
[[event]]
name = "dips"
watch = "rz"
value = 0.999
[[event]]
name = "pressed"
watch = "lambda:contact height"
value = 97.0
"""
        self.random = random.Random(SEED)
        path = self.disk(solver='stepper = "dop853"\nrtol = 1e-9\n', time="end = 30.0", output="flush = 0\n" + events)
        self.chain(path, [], signal.SIGKILL, 2*KILLS)
        with h5py.File(self.folder / "whole.h5") as file:
            self.assertGreater(len(file["events/time"]), 5)
        path = self.disk(time="end = 30.0", output=events.replace('0.999', '0.999\naction = "stop"'))
        self.tandem("run", path, "--output", "stopped.h5")
        done = self.tandem("resume", "stopped.h5", "--set", "time.end=40", code=2)
        self.assertIn('"dips" stopped it', done.stderr)

    def test_an_assembled_start(self):
        self.random = random.Random(SEED)
        words = ["initial.assemble=true", "time.end=2", "output.flush=0", "initial.q=[6.0, 0.1, 0, 0, 0, 0]",
                 "initial.qd=[15.0, 0, 0, 15.0, 0, 0]"]
        self.chain("articulated_vehicle", words, signal.SIGKILL, 2)


class Refused(Resume):
    def check(self, says, *arguments):
        """Refused with a reason, and no bit of the file is changed."""
        before = (self.folder / "run.h5").read_bytes() if (self.folder / "run.h5").exists() else None
        done = self.tandem("resume", *(arguments or ["run.h5"]), code=2)
        self.assertIn(says, done.stderr)
        self.assertEqual(done.stdout, "")
        if before is not None:
            self.assertEqual(before, (self.folder / "run.h5").read_bytes())

    def test_files_that_cannot_be_taken_up(self):
        done = self.tandem("resume", code=2)
        self.assertIn("needs a FILE", done.stderr)
        self.check("there is no such file", "none.h5")
        os.mkfifo(self.folder / "pipe.h5")
        for path in ("pipe.h5", "/dev/null", str(self.folder)):
            self.check("not a regular file", path)
        (self.folder / "run.h5").write_text("[scene]")
        self.check("it is not a result of tandem (HDF5)")
        with h5py.File(self.folder / "run.h5", "w") as file:
            file["x"] = 1
        self.check("it is not a result of tandem")
        self.tandem("run", "rolling_disk", "--set", "time.end=0.2", "--set", "solver.max_steps=150", "--output", "run.h5", "--force",
                    code=1)
        whole = (self.folder / "run.h5").read_bytes()
        for setting in ("solver.step=1e-4", "model.mass=2", "time.start=1", "output.every=1"):
            self.check("resume cannot set " + setting.split("=")[0], "run.h5", "--set", setting)
        self.check("time.end", "run.h5", "--set", "time.end=-1")
        for length in (0, 40, 100, 1000, len(whole)//2, len(whole) - 1):
            (self.folder / "run.h5").write_bytes(whole[:length])
            self.check("cannot resume from run.h5")

        def change(action):
            (self.folder / "run.h5").write_bytes(whole)
            with h5py.File(self.folder / "run.h5", "r+") as file:
                action(file)

        change(lambda file: file.attrs.__setitem__("format_version", 2))
        self.check("it was written by a newer version of tandem")
        change(lambda file: file.__delitem__("checkpoint"))
        self.check("it has no checkpoint")
        change(lambda file: [file[f"trajectory/{name}"].resize(3, axis=0) for name in ("time", "q")])
        self.check("rows of /trajectory/time are missing")

        def write(index, value):
            def action(file):
                for place in file["checkpoint"].values():
                    if len(place):
                        place[index] = value
            return action

        change(write(2, 1000))
        self.check("it was written by a newer version of tandem")
        change(write(0, 0))
        self.check("it is not a checkpoint")
        change(write(7, 12345))
        self.check("wrong checksum")
        change(lambda file: [place.resize(20, axis=0) for place in file["checkpoint"].values() if len(place)])
        self.check("it is truncated")
        change(lambda file: [place.resize(0, axis=0) for place in file["checkpoint"].values()])
        self.check("it is empty or truncated")

    def test_an_end_before_the_state(self):
        """A run that has failed or was interrupted, whose rows already go further."""
        self.tandem("run", "rolling_disk", *settings(["solver.step=0.02", "solver.max_steps=300", "output.every=1"]), "--no-error",
                    "--output", "run.h5", code=1)
        for end in ("3", "6", "5.9999"):
            self.check("is already at t = 6.0", "run.h5", "--set", f"time.end={end}")
            self.check("--set time.end=TIME", "run.h5", "--set", f"time.end={end}", "--error")
        with h5py.File(self.folder / "run.h5", "r+") as file:
            file.attrs["status"] = "running"
        self.check("its end was 40.0", "run.h5", "--set", "time.end=3")
        self.tandem("resume", "run.h5", *settings(["time.end=6.5", "solver.max_steps=1000"]), "--no-error")
        # A run killed between its end and its report is at its own end, and continues with the report.
        with h5py.File(self.folder / "run.h5", "r+") as file:
            file.attrs["status"] = "running"
        self.check("is already at t = 6.5", "run.h5", "--set", "time.end=6")
        self.tandem("resume", "run.h5", "--no-error")
        with h5py.File(self.folder / "run.h5") as file:
            self.assertEqual((file.attrs["status"], file["trajectory/time"][-1]), ("complete", 6.5))

    def test_what_another_version_has_saved(self):
        """Only the same version can read the state of a run; the rows remain readable for every version."""
        self.tandem("run", "rolling_disk", "--set", "time.end=0.2", "--set", "solver.max_steps=150", "--output", "run.h5", code=1)
        whole = (self.folder / "run.h5").read_bytes()
        with h5py.File(self.folder / "run.h5") as file:
            own = file.attrs["tandem_version"]
        self.assertLessEqual(len(own), 8)
        for other in ("0.0.9", "0.9.0", own):
            (self.folder / "run.h5").write_bytes(whole)
            with h5py.File(self.folder / "run.h5", "r+") as file:
                file.attrs["tandem_version"] = other
                for place in file["checkpoint"].values():
                    words = place[:]
                    used = words[3]
                    self.assertEqual(words[4], checksum(words[5:used]))
                    # A text: that it is there, its length, its letters.
                    self.assertEqual((words[5], words[6], words[7:8].tobytes().decode().strip()), (1, len(own), own))
                    words[6:8] = len(other), np.frombuffer(other.ljust(8).encode(), "i8")[0]
                    words[4] = checksum(words[5:used])
                    place[:] = words
            if other != own:
                self.check(f"cannot resume from run.h5: tandem {other} wrote it, and this is {own}")
        # Writing the same version back changes nothing.
        self.tandem("resume", "run.h5", "--set", "solver.max_steps=100000", "--no-error")

    def test_one_damaged_place_is_no_harm(self):
        words = ["time.end=0.2", "output.flush=0"]
        self.tandem("run", "rolling_disk", *settings(words), "--output", "whole.h5", "--no-error")
        for number in (0, 1):
            self.tandem("run", "rolling_disk", *settings(words), "--set", "solver.max_steps=150", "--output", "run.h5", "--force",
                        code=1)
            with h5py.File(self.folder / "run.h5", "r+") as file:
                list(file["checkpoint"].values())[number][100] += 1
            self.tandem("resume", "run.h5", "--set", "solver.max_steps=100000", "--no-error")
            self.assert_same("whole.h5", "run.h5")

    def test_a_file_in_use(self):
        process = subprocess.Popen([TANDEM, "run", "rolling_disk", "--set", "time.end=100000", "--quiet", "--output", "run.h5"],
                                   cwd=self.folder)
        try:
            deadline = time.monotonic() + 20
            while not has_checkpoint(self.folder / "run.h5") and time.monotonic() < deadline:
                time.sleep(0.05)
            done = self.tandem("resume", "run.h5", code=2)
            self.assertIn("in use", done.stderr)
        finally:
            process.kill()
            process.wait()


class Again(Resume):
    """Runs that can be resumed: complete ones, ones killed before their first state, and by one process at a time."""

    SWITCHED = """[scene]
model = "mechanism"
planar = true
[body.block]
mass = 1.0
inertia = 1.0
position = [0.0, 0.0]
velocity = [0.0, 0.0]
[joint.guide]
type = "prismatic"
bodies = ["ground", "block"]
at = [0.0, 0.0]
axis = [1.0, 0.0]
[force.push]
type = "load"
on = "block"
force = ["2*step(t - 0.7) - step(t - 1.3)", 0.0]
[time]
end = 1.0
[solver]
rtol = 1e-10
[output]
interval = 0.1
"""

    def test_a_later_end_with_later_kinks(self):
        """A force that switches at 0.7 and 1.3 s: x(2) = 2*1.3^2/2 - 0.7^2/2 = 1.445 m."""
        self.scene(self.SWITCHED)
        self.tandem("run", "scene.toml", "--output", "run.h5", "--quiet", "--no-error")
        self.tandem("resume", "run.h5", "--set", "time.end=2.0", "--quiet", "--no-error")
        with h5py.File(self.folder / "run.h5") as file:
            self.assertEqual(file.attrs["status"], "complete")
            self.assertAlmostEqual(file["trajectory/time"][-1], 2.0)
            self.assertAlmostEqual(file["trajectory/q"][-1, 0], 1.445, delta=1e-9)
        self.tandem("verify", "run.h5")
        # An end at a kink, and one before it.
        for first, last in ((0.7, 1.3), (0.5, 2.0), (1.3, 2.0)):
            self.tandem("run", "scene.toml", "--set", f"time.end={first}", "--output", "run.h5", "--force", "--quiet", "--no-error")
            self.tandem("resume", "run.h5", "--set", f"time.end={last}", "--quiet", "--no-error")
            with h5py.File(self.folder / "run.h5") as file:
                true = 0.6**2 if last < 2 else 1.445
                self.assertAlmostEqual(file["trajectory/q"][-1, 0], true, delta=1e-9)

    def test_a_run_that_was_killed_before_its_first_state(self):
        """Its file holds the scene alone: the run begins again, and ends as one that was not killed."""
        words = ["rolling_disk", *settings(["time.end=0.2", "output.flush=0"]), "--quiet", "--no-error"]
        self.tandem("run", *words, "--output", "whole.h5")
        self.tandem("run", *words, "--output", "part.h5")
        with h5py.File(self.folder / "part.h5", "r+") as file:
            for place in file["checkpoint"].values():
                place.resize((0,))
            file.attrs.modify("status", "running")
        self.tandem("resume", "part.h5", "--quiet", "--no-error")
        self.assertEqual(contents(self.folder / "whole.h5"), contents(self.folder / "part.h5"))
        self.tandem("verify", "part.h5")

    def test_one_process_at_a_time(self):
        """Of two that go on with a run at the same time, one is refused, and the file is whole."""
        words = ["rolling_disk", *settings(["time.end=3", "solver.max_steps=100"]), "--quiet", "--no-error"]
        on = settings(["solver.max_steps=100000"])
        for _ in range(12):
            run("run", *words, "--output", "run.h5", "--force", cwd=self.folder)
            both = [subprocess.Popen([TANDEM, "resume", "run.h5", *on, "--quiet", "--no-error"], cwd=self.folder,
                                     stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for _ in range(2)]
            says = [process.communicate(timeout=60)[1] for process in both]
            codes = sorted(process.returncode for process in both)
            # One that comes when the other has ended finds a complete run.
            self.assertEqual(codes, [0, 2], says)
            self.assertTrue(any("in use" in text or "complete" in text for text in says), says)
            with h5py.File(self.folder / "run.h5") as file:
                self.assertEqual(file.attrs["status"], "complete")
                self.assertAlmostEqual(file["trajectory/time"][-1], 3.0)
            self.tandem("verify", "run.h5")


if __name__ == "__main__":
    unittest.main(verbosity=2)
