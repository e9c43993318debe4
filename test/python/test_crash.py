# SPDX-License-Identifier: MIT
"""Runs that end before their end: killed, interrupted, without a disk. Nothing that was written may be lost, and no file may lie.

Runs build/tandem, or what the environment variable TANDEM names. TANDEM_MOMENTS is at how many moments a disk is full, or a file too
large, for each kind of output (default 2); what issue 31 asks for is
TANDEM_MOMENTS=20 python3 test/python/test_crash.py Disk.test_no_room_at_random_moments
"""

import contextlib
import fcntl
import os
import random
import resource
import shutil
import signal
import subprocess
import time
import tomllib
import unittest
from pathlib import Path

import h5py
import numpy as np
from test_output import TANDEM, Case

REPORTED = ["--set", "time.end=20000", "--no-error"]
LONG = [*REPORTED, "--quiet"]
MOMENTS = 20
# Number of times that the room for a file ends, for each kind of run and each cause.
ROOMS = int(os.environ.get("TANDEM_MOMENTS", "2"))
# Settings of the steps and the output.
KINDS = {
    "fixed steps": ["--set", "output.every=1"],
    "error control": ["--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-6", "--set", "output.every=1"],
    "interval": ["--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-6", "--set", "output.interval=0.01"],
    "short interval": ["--set", "solver.stepper=dop853", "--set", "solver.rtol=1e-6", "--set", "output.interval=1e-5"],
}


class Running(Case):
    """Cases with a run in the background."""

    def start(self, *arguments, limit=None):
        def prepare():
            # Who calls the tests in the background or from `nohup` has these ignored.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            signal.signal(signal.SIGHUP, signal.SIG_DFL)
            if limit:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        process = subprocess.Popen([TANDEM, "run", *arguments], cwd=self.folder, stdout=subprocess.PIPE,
                                   env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "TMPDIR": str(self.folder / "temporary")},
                                   stderr=subprocess.PIPE, text=True, preexec_fn=prepare)
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)
        return process

    def wait_for(self, condition, process, seconds=120):
        """Until the condition holds; the process must not end before."""
        end = time.monotonic() + seconds
        while not condition():
            self.assertIsNone(process.poll(), "the run has ended too early")
            self.assertLess(time.monotonic(), end, "waited in vain")
            time.sleep(0.002)

    def end(self, process, code):
        out, err = process.communicate(timeout=120)
        self.assertEqual(process.returncode, code, out + err)
        self.assertNotIn("Backtrace", err)
        return out, err

    def rows(self, name, swmr=False):
        """Number of rows in a file, possibly one being written; None while it cannot be opened yet."""
        try:
            with h5py.File(self.folder / name, swmr=swmr) as file:
                return len(file["trajectory/time"])
        # The last where a header is not on the disk yet.
        except (OSError, KeyError, RuntimeError):
            return None

    def has_rows(self, name, least=1):
        return lambda: (self.rows(name, swmr=True) or 0) >= least


class Killed(Running):
    def test_at_twenty_random_moments(self):
        # About as long as the others get before they are killed.
        self.tandem("run", "rolling_disk", "--set", "time.end=100", "--set", "output.every=1", "--no-error", "--output",
                    "whole.h5", "--quiet")
        with h5py.File(self.folder / "whole.h5") as file:
            whole = {path: file[path][:] for path in ("trajectory/time", "trajectory/q", "trajectory/qd", "diagnostics/chart")}
        chance = random.Random(1)
        seen = []
        for moment in range(MOMENTS):
            name = f"{moment}.h5"
            process = self.start("rolling_disk", *LONG, "--set", "output.every=1", "--output", name)
            self.wait_for(lambda name=name: self.rows(name) is not None, process)
            time.sleep(chance.uniform(0, 0.6))
            if moment == MOMENTS - 1:
                # Once behind a full block of rows, however slow the machine is.
                self.wait_for(self.has_rows(name, 513), process)
            process.kill()
            process.wait()
            # Plainly, as if nothing had happened.
            with h5py.File(self.folder / name) as file:
                self.assertEqual(file.attrs["status"], "running")
                self.assertIn("[model]", file.attrs["scene"])
                seen.append(min(len(file[path]) for path in whole))
                # The machine decides how far the run has gone: perhaps further than the undisturbed one.
                n = min(seen[-1], len(whole["trajectory/time"]))
                for path, values in whole.items():
                    np.testing.assert_array_equal(file[path][:n], values[:n])
            (self.folder / name).unlink()
        self.assertGreater(max(seen), 512)
        self.assertGreater(len(set(seen)), 2)

    def test_a_killed_result_is_kept_like_any_other(self):
        process = self.start("rolling_disk", *LONG, "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        process.kill()
        process.wait()
        self.refused("run", "rolling_disk", "--output", "a.h5", says="a.h5 exists")
        self.tandem("run", "rolling_disk", "--set", "time.end=0.1", "--output", "a.h5", "--force")

    def test_rows_come_every_second(self):
        # Some ten rows a second: they come long before a block of 512 is full.
        process = self.start("rolling_disk", *LONG, "--set", "output.every=30000", "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        count = self.rows("a.h5", swmr=True)
        self.wait_for(self.has_rows("a.h5", count + 1), process)
        self.assertLess(self.rows("a.h5", swmr=True), 512)


class Readers(Running):
    def test_may_come_and_stay(self):
        process = self.start("rolling_disk", *LONG, "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        with h5py.File(self.folder / "a.h5", swmr=True) as follower, h5py.File(self.folder / "a.h5") as plain:
            first = len(plain["trajectory/time"])

            def rows():
                follower["trajectory/time"].refresh()
                return len(follower["trajectory/time"])

            self.wait_for(lambda: rows() > first, process)
            process.send_signal(signal.SIGTERM)
            self.end(process, 128 + signal.SIGTERM)
            last = rows()
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file.attrs["status"], "interrupted")
            self.assertEqual(len(file["trajectory/time"]), last)


class Signals(Running):
    def test_the_run_ends_with_a_complete_file(self):
        for number in signal.SIGINT, signal.SIGTERM, signal.SIGHUP:
            with self.subTest(number.name):
                name = f"{number.name}.h5"
                process = self.start("rolling_disk", *REPORTED, "--output", name)
                self.wait_for(self.has_rows(name), process)
                process.send_signal(number)
                out, err = self.end(process, 128 + number)
                self.assertIn("INTERRUPTED after", out)
                self.assertRegex(err, rf"(?m)^tandem: interrupted: {number.name} came at t = ")
                with h5py.File(self.folder / name) as file:
                    self.assertEqual(file.attrs["status"], "interrupted")
                    self.assertIn(number.name, file.attrs["status_message"])
                    report = file["report"].attrs
                    self.assertEqual(report["status_code"], -20)
                    self.assertAlmostEqual(file["trajectory/time"][-1], 1e-3 * report["steps"], delta=1e-9)
                    self.assertEqual({len(file[path]) for path in ("trajectory/q", "diagnostics/step")},
                                     {len(file["trajectory/time"])})

    def test_a_second_one_ends_it_at_once(self):
        process = self.start("rolling_disk", *LONG, "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        process.send_signal(signal.SIGSTOP)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)
        process.wait(30)
        self.assertIn(process.returncode, (-signal.SIGINT, -signal.SIGTERM))
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file.attrs["status"], "running")

    def test_a_second_run_for_the_error_is_ended_too_and_the_file_is_complete(self):
        process = self.start("rolling_disk", "--set", "time.end=100", "--set", "solver.step=1e-3", "--error",
                             "--output", "a.h5")

        def is_complete():
            try:
                with h5py.File(self.folder / "a.h5") as file:
                    return file.attrs["status"] == "complete"
            except (OSError, KeyError):
                return False

        self.wait_for(is_complete, process)
        process.send_signal(signal.SIGTERM)
        out, _ = self.end(process, 128 + signal.SIGTERM)
        self.assertRegex(out, "error at end +not known: interrupted: SIGTERM")
        self.assertIn("in 100000 steps", out)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual((file.attrs["status"], file["report"].attrs["status_code"]), ("complete", 0))
            self.assertNotIn("global_error", file["report"].attrs)

    def test_what_is_ignored_stays_ignored(self):
        process = subprocess.Popen(["nohup", TANDEM, "run", "rolling_disk", *LONG, "--output", "a.h5"], cwd=self.folder,
                                   stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)
        self.wait_for(self.has_rows("a.h5"), process)
        process.send_signal(signal.SIGHUP)
        self.wait_for(self.has_rows("a.h5", 2*self.rows("a.h5", swmr=True) + 1000), process)
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(60), 128 + signal.SIGTERM)


class Disk(Running):
    def check_rescue(self, err, folder=None):
        """The last state is saved as a scene, from which a run can continue."""
        self.assertIn("output_failed", err)
        self.assertIn("is saved: tandem run ", err)
        saved = Path(self.folder, err.split("is saved: tandem run ")[1].split(" continues from it")[0])
        self.assertEqual(saved.parent.resolve(), (folder or self.folder).resolve())
        start = tomllib.loads(saved.read_text())
        t = start["time"]["start"]
        self.assertGreater(t, 0)
        self.tandem("run", str(saved), "--set", f"time.end={t + 0.01}", "--output", "on.h5", "--force")
        with h5py.File(self.folder / "on.h5") as file:
            self.assertEqual(file["trajectory/time"][0], t)
            np.testing.assert_allclose(file["trajectory/q"][0], start["initial"]["q"], rtol=0, atol=1e-13)
        return start

    def check_left(self, path, says):
        """Rows written before the failure are readable, and the file reports the failure."""
        with h5py.File(path) as file:
            self.assertEqual(file.attrs["status"], "failed")
            self.assertRegex(file.attrs["status_message"], f"^output_failed: .*{says}")
            n = min(len(file["trajectory"][name]) for name in ("time", "q", "qd"))
            self.assertGreater(n, 100)
            np.testing.assert_allclose(np.linalg.norm(file["trajectory/q"][:n, 3:7], axis=1), 1, atol=1e-12)

    def test_a_limit_on_the_size_of_files(self):
        process = self.start("rolling_disk", *LONG, "--output", "a.h5", limit=2_000_000)
        _, err = self.end(process, 1)
        self.assertIn("File too large", err)
        self.check_left(self.folder / "a.h5", "File too large")
        self.check_rescue(err)

    def test_a_full_disk(self):
        small, temporary = self.folder / "small", self.folder / "temporary"
        small.mkdir()
        temporary.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", small], capture_output=True).returncode != 0:
            self.skipTest("only root may mount a small disk")
        try:
            out, err = self.end(self.start("rolling_disk", *REPORTED, "--output", "small/a.h5"), 1)
            self.assertIn("No space left on device", err)
            self.assertIn("INCOMPLETE", out)
            self.check_left(small / "a.h5", "No space left on device")
            shutil.copy(small / "a.h5", self.folder / "b.h5")
            # No room beside the result.
            self.check_rescue(err, temporary)
        finally:
            subprocess.run(["umount", small], check=True)
        # Once there is room, the run continues.
        with h5py.File(self.folder / "b.h5") as file:
            left = file["trajectory/time"][-1]
        self.tandem("resume", "b.h5", "--set", f"time.end={left + 1}", "--no-error")
        with h5py.File(self.folder / "b.h5") as file:
            self.assertEqual((file.attrs["status"], file.attrs["status_message"]), ("complete", ""))
            self.assertAlmostEqual(file["trajectory/time"][-1], left + 1, delta=1e-9)

    def test_a_full_disk_leaves_a_complete_result(self):
        small = self.folder / "small"
        small.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", small], capture_output=True).returncode != 0:
            self.skipTest("only root may mount a small disk")
        try:
            self.tandem("run", "rolling_disk", "--set", "time.end=0.1", "--output", "small/a.h5", "--no-error")
            with h5py.File(small / "a.h5") as file:
                before = {key: np.asarray(value).tolist() for key, value in [*file.attrs.items(), *file["report"].attrs.items()]}
            with contextlib.suppress(OSError), open(small / "fill", "wb", buffering=0) as fill:
                while fill.write(bytes(1024)):
                    pass
            self.refused("resume", "small/a.h5", "--set", "time.end=0.2", "--no-error", says="No space left on device")
            with h5py.File(small / "a.h5") as file:
                after = {key: np.asarray(value).tolist() for key, value in [*file.attrs.items(), *file["report"].attrs.items()]}
            self.assertEqual(before, after)
        finally:
            subprocess.run(["umount", small], check=True)

    def test_no_room_at_random_moments(self):
        chance = random.Random(1)
        temporary, small = self.folder / "temporary", self.folder / "small"
        temporary.mkdir()
        small.mkdir()
        for kind, words in KINDS.items():
            for way in ROOMS*["a limit on files", "a full disk"]:
                # The least of them is taken up before the first rows are.
                room = int(1e6*2**chance.uniform(-0.5, 2.5))
                flush = chance.choice(["0.003", "0.03", "1"])
                with self.subTest(kind=kind, way=way, room=room, flush=flush):
                    arguments = ["rolling_disk", *LONG, *words, "--set", f"output.flush={flush}"]
                    if way == "a limit on files":
                        _, err = self.end(self.start(*arguments, "--output", "a.h5", limit=room), 1)
                        (self.folder / "a.h5").rename(self.folder / "b.h5")
                        folder = None
                    elif subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={room//4096*4096}", "tmpfs", small],
                                        capture_output=True).returncode != 0:
                        self.skipTest("only root may mount a small disk")
                    else:
                        process = self.start(*arguments, "--output", "small/a.h5")
                        try:
                            _, err = self.end(process, 1)
                            folder = small if list(small.glob("*.toml")) else temporary
                            for path in small.glob("*.toml"):
                                shutil.copy(path, self.folder / path.name)
                            shutil.copy(small / "a.h5", self.folder / "b.h5")
                            self.check_rescue(err, folder)
                        finally:
                            process.kill()
                            process.wait()
                            subprocess.run(["umount", small], check=True)
                    if folder is None:
                        self.check_rescue(err)
                    self.assertIn("File too large" if folder is None else "No space left on device", err)
                    # Existing contents are undamaged, and the run continues from them once there is room.
                    self.tandem("verify", "b.h5")
                    with h5py.File(self.folder / "b.h5") as file:
                        self.assertIn(file.attrs["status"], ("failed", "running"))
                        end = file["trajectory/time"][-1] + 0.02
                    self.tandem("resume", "b.h5", "--set", f"time.end={end}", "--no-error")
                    self.tandem("verify", "b.h5")
                    (self.folder / "b.h5").unlink()

    def test_nowhere_to_save_the_state(self):
        out, err = self.end(self.start("rolling_disk", *LONG, "--output", "a.h5", limit=300), 2)
        self.assertIn("File too large", err)
        self.assertEqual(out, "")
        # A folder beside the result blocks the name, and there is no folder for temporary files.
        (self.folder / "a.last.toml.new").mkdir()
        process = self.start("rolling_disk", *LONG, "--output", "a.h5", "--force", limit=2_000_000)
        _, err = self.end(process, 1)
        self.assertIn("cannot be saved in a file", err)
        start = tomllib.loads(err[err.index("[scene]"):])
        self.assertEqual(len(start["initial"]["qd"]), 9)
        self.assertGreater(start["time"]["start"], 0)

    def test_a_file_that_vanishes(self):
        for way in "removed", "replaced":
            with self.subTest(way):
                name = f"{way}.h5"
                process = self.start("rolling_disk", *LONG, "--output", name)
                # The first row alone is that of the start.
                self.wait_for(self.has_rows(name, 2), process)
                (self.folder / name).unlink()
                if way == "replaced":
                    (self.folder / name).write_text("mine\n")
                _, err = self.end(process, 1)
                self.assertIn("was removed or replaced during the run", err)
                self.check_rescue(err)
                if way == "replaced":
                    self.assertEqual((self.folder / name).read_text(), "mine\n")

    def test_a_file_that_is_no_disk(self):
        self.refused("run", "rolling_disk", "--output", "/dev/full", "--force", says="/dev/full")


class Memory(Running):
    def peak(self, steps):
        """The largest memory of a run of so many steps, kB."""
        name = f"{steps}.h5"
        process = self.start("articulated_vehicle", "--no-error", "--quiet", "--set", "solver.step=1e-5", "--set", "output.every=10",
                             "--set", f"time.end={steps}e-5", "--output", name)
        _, status, usage = os.wait4(process.pid, 0)
        self.assertEqual(status, 0)
        with h5py.File(self.folder / name) as file:
            self.assertEqual(len(file["trajectory/time"]), steps // 10 + 1)
        return usage.ru_maxrss

    def test_a_million_steps_take_no_more_memory(self):
        few, many = self.peak(100_000), self.peak(1_000_000)
        # One of the smallest pieces of memory, 32 bytes, lost with each of the 90 000 more rows would be 2812 kB. Less is not told
        # from nothing: Linux counts pages for each core on its own, and sums them up by the hundred.
        self.assertLess(many, few + 2048)


class InUse(Running):
    def test_by_another_run(self):
        process = self.start("rolling_disk", *LONG, "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        for force in [], ["--force"]:
            done = self.tandem("run", "rolling_disk", "--output", "a.h5", *force, code=2)
            self.assertIn("a.h5 is in use", done.stderr)
        process.send_signal(signal.SIGTERM)
        self.end(process, 128 + signal.SIGTERM)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(file.attrs["status"], "interrupted")
        self.tandem("run", "rolling_disk", "--set", "time.end=0.1", "--output", "a.h5", "--force")

    def is_complete(self, name):
        """True if the run has closed the file, which it still cuts to its length after the status can be read."""
        path = self.folder / name

        def answer():
            try:
                with h5py.File(path) as file:
                    if file.attrs["status"] != "complete":
                        return False
                return time.time() - path.stat().st_mtime > 0.03
            except (OSError, KeyError, RuntimeError):
                return False

        return answer

    def test_until_the_error_is_known(self):
        process = self.start("rolling_disk", "--set", "time.end=100", "--error", "--quiet", "--output", "a.h5")
        self.wait_for(self.is_complete("a.h5"), process)
        self.refused("run", "rolling_disk", "--output", "a.h5", "--force", says="a.h5 is in use")
        self.end(process, 0)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertIn("global_error", file["report"].attrs)
        self.tandem("run", "rolling_disk", "--set", "time.end=0.1", "--output", "a.h5", "--force")

    def test_another_file_in_its_place_gets_no_error(self):
        self.tandem("run", "rolling_disk", "--set", "time.end=0.1", "--output", "b.h5", "--no-error")
        before = (self.folder / "b.h5").read_bytes()
        process = self.start("rolling_disk", "--set", "time.end=100", "--error", "--quiet", "--output", "a.h5")
        self.wait_for(self.is_complete("a.h5"), process)
        (self.folder / "b.h5").rename(self.folder / "a.h5")
        _, err = self.end(process, 1)
        self.assertIn("removed or replaced", err)
        self.assertEqual((self.folder / "a.h5").read_bytes(), before)

    def test_by_somebody_else(self):
        self.tandem("run", "rolling_disk", "--set", "time.end=0.1", "--output", "a.h5")
        with open(self.folder / "a.h5", "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH)
            self.refused("run", "rolling_disk", "--output", "a.h5", "--force", says="a.h5 is in use")


if __name__ == "__main__":
    unittest.main()
