# SPDX-License-Identifier: MIT
"""Damaged result files: `tandem verify` reports the damage, `tandem resume` refuses; neither hangs, crashes or accepts them.

Runs build/tandem, or the program given by the environment variable TANDEM. TANDEM_MUTATIONS is the number of random mutations for each of
the two (default 24), and TANDEM_SEED chooses them. The full check is
TANDEM_MUTATIONS=540 python3 test/python/test_damage.py Mutations
"""

import fcntl
import os
import random
import re
import shutil
import signal
import subprocess
import time
import unittest

import h5py
import numpy as np
from test_crash import Running
from test_output import STRICT, TANDEM, Case

MUTATIONS = int(os.environ.get("TANDEM_MUTATIONS", "24"))
SEED = int(os.environ.get("TANDEM_SEED", "1"))
LONGEST = 10
LIMITED = ["--set", "solver.max_steps=250", "--set", "output.every=10", "--no-error", "--quiet"]
ON = ["--set", "solver.max_steps=100000", "--set", "time.end=0.6", "--no-error", "--quiet"]
EVENTS = '[[event]]\nname = "low"\nwatch = "rz"\nvalue = 0.999\n'


def rows_of(path, most=None):
    """Every dataset that grows, bit by bit, or its first rows."""
    found = {}
    with h5py.File(path) as file:
        for name in ("trajectory", "diagnostics", "events"):
            if name in file:
                for part, item in file[name].items():
                    if item.maxshape[0] is None:
                        found[f"{name}/{part}"] = item.shape[1:], item[:most].tobytes()
    return found


def holds(path, rows, most=None):
    """True if another process reads these rows from a file. The process is separate because a damaged file may crash it."""
    child = os.fork()
    if child == 0:
        signal.alarm(LONGEST)
        same = False
        try:
            same = rows_of(path, most) == rows
        finally:
            os._exit(0 if same else 1)
    return os.waitpid(child, 0)[1] == 0


def fletcher(blocks):
    """Fletcher's checksum of the halves of 64-bit words, word by word, as doc/output.md says."""
    first, second = 1, 0
    for block in blocks:
        for half in np.frombuffer(block, "<u4").tolist():
            first = (first + half) % 0xFFFFFFFF
            second = (second + first) % 0xFFFFFFFF
    return second << 32 | first


class Damaged(Case):
    def call(self, *arguments):
        """Run it; no crash, no hang, and an exit code of the table."""
        try:
            done = subprocess.run([TANDEM, *arguments], cwd=self.folder, env=os.environ | STRICT, capture_output=True, text=True,
                                  errors="replace", timeout=LONGEST, check=False)
        except subprocess.TimeoutExpired:
            self.fail(f"{arguments} has not ended after {LONGEST} s")
        self.assertIn(done.returncode, (0, 1, 2), done.stdout + done.stderr)
        self.assertNotIn("Backtrace", done.stderr)
        if done.returncode:
            self.assertRegex(done.stderr, "^tandem: ")
        return done

    def limited(self, name="run.h5"):
        self.tandem("run", "rolling_disk", *LIMITED, "--output", name, "--force", code=1)
        return (self.folder / name).read_bytes()


class Blocks(Damaged):
    def test_a_bit_of_each_block_with_a_checksum(self):
        """HDF5 would read such a block again and again, and sleep twice as long each time."""
        whole = self.limited()
        places = [found.start() for found in re.finditer(b"OHDR|OCHK|FRHP|FHDB|BTHD|BTLF|EAHD|EAIB|EASB|EADB|FAHD|FADB", whole)]
        self.assertGreater(len(places), 20)
        for place in places:
            for behind in (5, 12, 20):
                with self.subTest(block=whole[place:place + 4], at=place + behind):
                    damaged = bytearray(whole)
                    damaged[place + behind] ^= 8
                    (self.folder / "run.h5").write_bytes(damaged)
                    self.assertIn(self.call("verify", "run.h5").returncode, (1, 2))
                    self.assertEqual(self.call("resume", "run.h5", *ON).returncode, 2)
                    self.assertEqual((self.folder / "run.h5").read_bytes(), damaged)


class Mutations(Damaged):
    def bases(self):
        """Results of several kinds, and what takes each of them up."""
        self.limited("limited.h5")
        yield "limited.h5", ON
        self.tandem("run", "rolling_disk", "--set", "time.end=0.3", "--set", "output.every=1", "--no-error", "--quiet", "--output",
                    "complete.h5")
        yield "complete.h5", ON
        scene = self.disk(solver='stepper = "dop853"\nrtol = 1e-9\nmax_steps = 120\n', time="end = 40.0",
                          output="interval = 0.01\n" + EVENTS)
        self.tandem("run", scene, "--no-error", "--quiet", "--output", "events.h5", code=1)
        yield "events.h5", ["--set", "solver.max_steps=140", "--no-error", "--quiet"]
        process = subprocess.Popen([TANDEM, "run", "rolling_disk", "--set", "output.every=1", "--set", "output.flush=0",
                                    "--set", "time.end=20000", "--no-error", "--quiet", "--output", "killed.h5"], cwd=self.folder,
                                   env=os.environ | STRICT)
        time.sleep(0.5)
        process.kill()
        process.wait()
        with h5py.File(self.folder / "killed.h5") as file:
            last = file["trajectory/time"][-1]
        yield "killed.h5", ["--set", f"time.end={np.floor(last) + 1}", "--no-error", "--quiet"]

    def mutated(self, whole):
        """The data with a random change, half the time at a nonzero byte; and a description of the change."""
        chance, data = self.random, bytearray(whole)
        place = chance.randrange(len(data))
        while chance.random() < 0.5 and data[place] == 0:
            place = chance.randrange(len(data))
        kind = chance.choice(["bit", "bit", "bit", "bytes", "zeros", "cut", "copy", "insert", "remove"])
        length = int(2**chance.uniform(0, 12))
        if kind == "bit":
            data[place] ^= 1 << chance.randrange(8)
        elif kind == "bytes":
            data[place:place + min(length, 64)] = chance.randbytes(len(data[place:place + min(length, 64)]))
        elif kind == "zeros":
            data[place:place + length] = bytes(len(data[place:place + length]))
        elif kind == "cut":
            del data[place:]
        elif kind == "copy":
            data[place:place + length] = data[chance.randrange(len(data)):][:length]
        elif kind == "insert":
            data[place:place] = chance.randbytes(min(length, 64))
        else:
            del data[place:place + min(length, 64)]
        return bytes(data), f"{kind} at {place}, length {length}"

    def test_random_mutations(self):
        self.random = random.Random(SEED)
        bases = []
        for name, on in self.bases():
            shutil.copy(self.folder / name, self.folder / "whole.h5")
            self.tandem("verify", "whole.h5")
            self.tandem("resume", "whole.h5", *on, code=1 if name == "events.h5" else 0)
            # After a kill, rows may follow those that have checksums.
            with h5py.File(self.folder / name) as file:
                sure = max(place[:2].tolist() for place in file["checksums"].values())[1]
            bases.append((name, on, sure, rows_of(self.folder / name, sure), rows_of(self.folder / "whole.h5")))
        told = {"changed rows": 0, "verify refuses": 0, "resume refuses": 0}
        path = self.folder / "mutated.h5"
        for count in range(MUTATIONS):
            name, on, sure, before, after = bases[count % len(bases)]
            data, what = self.mutated((self.folder / name).read_bytes())
            with self.subTest(count=count, file=name, what=what):
                path.write_bytes(data)
                same = holds(path, before, sure)
                verified = self.call("verify", "mutated.h5").returncode
                self.assertEqual(path.read_bytes(), data)
                resumed = self.call("resume", "mutated.h5", *on).returncode
                told["changed rows"] += not same
                told["verify refuses"] += verified != 0
                told["resume refuses"] += resumed == 2
                if not same:
                    self.assertNotEqual(verified, 0)
                    self.assertEqual(resumed, 2)
                elif resumed != 2:
                    self.assertTrue(holds(path, after))
        print("\n" + ", ".join(f"{key}: {value}" for key, value in told.items()), f"of {MUTATIONS}", flush=True)


class Verify(Damaged):
    def test_what_is_whole(self):
        self.limited()
        done = self.tandem("verify", "run.h5")
        self.assertIn('run.h5: 26 rows as they were written, in 9 datasets; status "failed"', done.stdout)
        self.tandem("resume", "run.h5", *ON)
        self.assertIn('61 rows as they were written, in 9 datasets; status "complete"', self.tandem("verify", "run.h5").stdout)
        self.tandem("resume", "run.h5", "--set", "time.end=0.8", "--error", "--quiet")
        self.assertIn("81 rows", self.tandem("verify", "run.h5").stdout)

    def test_the_sums_are_those_that_are_documented(self):
        scene = self.disk(time="end = 3.0", output="every = 7\n" + EVENTS)
        self.tandem("run", scene, "--no-error", "--quiet", "--output", "run.h5")
        self.assertIn("1 event as they were written, in 15 datasets", self.tandem("verify", "run.h5").stdout)
        with h5py.File(self.folder / "run.h5") as file:
            group = file["checksums"]
            names = group.attrs["datasets"].split()
            words = max((place[:] for place in group.values()), key=lambda place: place[0]).astype("u8")
            self.assertEqual((words[1], words[2]), (len(file["trajectory/time"]), len(file["events/time"])))
            self.assertGreater(words[2], 0)
            for name, word in zip(names, words[3:-1], strict=True):
                rows = file[name][:]
                blocks = [text.ljust(rows.dtype.itemsize) for text in rows] if rows.dtype.kind == "S" else [rows.astype("<f8").tobytes()]
                self.assertEqual(fletcher(blocks), int(word), name)

    def test_a_changed_row(self):
        self.limited()
        for name in ("trajectory/time", "trajectory/q", "diagnostics/chart"):
            with self.subTest(name):
                self.limited()
                with h5py.File(self.folder / "run.h5", "r+") as file:
                    if file[name].ndim == 2:
                        file[name][3, 0] = np.nextafter(file[name][3, 0], 9.0)
                    else:
                        file[name][3] += 1
                says = f"the rows of /{name} differ from those that were written"
                self.assertIn(f"run.h5 is damaged: {says}", self.tandem("verify", "run.h5", code=1).stderr)
                self.assertIn(f"cannot resume from run.h5: it is damaged: {says}",
                              self.tandem("resume", "run.h5", *ON, code=2).stderr)

    def test_a_changed_letter(self):
        """Texts stand in the file without a checksum of HDF5's."""
        whole = self.limited()
        for text in (b"omega = [-1.0, 0.01", b"generalized coordinates", b"run rolling_disk", b"row i of every dataset"):
            for place in (found.start() for found in re.finditer(re.escape(text), whole)):
                damaged = bytearray(whole)
                damaged[place + 3] ^= 1
                (self.folder / "run.h5").write_bytes(damaged)
                with self.subTest(text=text, place=place):
                    says = self.call("verify", "run.h5")
                    self.assertEqual(says.returncode, 1)
                    self.assertRegex(says.stderr, "text attributes differ|/checkpoint/(first|second) differs")
        says = "it is damaged: text attributes differ from those that were written"
        with h5py.File(self.folder / "run.h5", "r+") as file:
            file["trajectory/q"].attrs["units"] = [unit.replace("m", "k") for unit in file["trajectory/q"].attrs["units"]]
        self.assertIn(says, self.tandem("resume", "run.h5", *ON, code=2).stderr)

    def test_the_sum_of_texts_is_the_one_that_is_documented(self):
        """Whatever the run has said at its end."""
        self.tandem("run", "rolling_disk", *LIMITED, "--profile", "--output", "run.h5", code=1)
        self.tandem("verify", "run.h5")
        self.tandem("resume", "run.h5", *ON)
        total = 0xCBF29CE484222325

        def add(text):
            nonlocal total
            for byte in text.encode() + b"\0":
                total = (total ^ byte) * 0x100000001B3 % 2**64

        def visit(item, name):
            for attribute in sorted(item.attrs):
                kind = h5py.check_string_dtype(item.attrs.get_id(attribute).dtype)
                ending = name == "/" and attribute.startswith("status")
                if kind is None or kind.length is not None or ending or item.name.startswith("/report"):
                    continue
                add(name)
                add(attribute)
                for text in np.atleast_1d(item.attrs[attribute]):
                    add(text)
            if isinstance(item, h5py.Group):
                for member in sorted(item):
                    visit(item[member], member)

        with h5py.File(self.folder / "run.h5") as file:
            visit(file, "/")
            self.assertEqual(int(file["checksums"].attrs["texts"]) % 2**64, total)

    def test_a_file_without_checksums(self):
        """A file of an earlier program without checksums: it cannot be verified, but resumed."""
        self.limited()
        self.tandem("run", "rolling_disk", "--set", "time.end=0.6", "--set", "output.every=10", "--no-error", "--quiet", "--output", "whole.h5")
        with h5py.File(self.folder / "run.h5", "r+") as file:
            del file["checksums"]
        self.assertIn("has no checksums", self.tandem("verify", "run.h5", code=2).stderr)
        self.tandem("resume", "run.h5", *ON)
        self.assertEqual(rows_of(self.folder / "run.h5"), rows_of(self.folder / "whole.h5"))
        self.limited()
        with h5py.File(self.folder / "run.h5", "r+") as file:
            del file["checksums"]
        whole = (self.folder / "run.h5").read_bytes()
        # Indices of datasets; those of the checksums themselves belong to nothing any more.
        told = [0, 0]
        for place in [found.start() for found in re.finditer(b"EAHD|EAIB", whole)]:
            damaged = bytearray(whole)
            damaged[place + 12] ^= 8
            (self.folder / "run.h5").write_bytes(damaged)
            verified, resumed = self.call("verify", "run.h5"), self.call("resume", "run.h5", *ON)
            told[0] += "could not read" in verified.stderr
            told[1] += resumed.returncode == 2
            self.assertIn(resumed.returncode, (0, 2))
        self.assertGreaterEqual(min(told), 18)

    def test_files_that_are_of_no_run(self):
        """Nothing is wrong with them, and nothing in them can be verified."""
        (self.folder / "sweep.toml").write_text('[sweep]\nscene = "rolling_disk"\nset = ["time.end=0.01"]\n[[vary]]\n'
                                                'key = "initial.tilt"\nvalues = [0.0, 0.1]\n[[keep]]\nquantity = "rz"\n')
        self.tandem("sweep", "sweep.toml", "--quiet", "--output", "sweep.h5")
        self.tandem("linearise", "rolling_disk", "--output", "linearised.h5")
        self.tandem("study", "precision", "rolling_disk", "--set", "time.end=0.02", "--steppers", "rk4", "--samples", "1",
                    "--repeats", "1", "--budget", "0.01", "--output", "study")
        for name in ("sweep.h5", "linearised.h5", "study/precision_rolling_disk.h5"):
            with self.subTest(name):
                says = self.tandem("verify", name, code=2).stderr
                self.assertIn(f"cannot verify {name}: it has no rows of a run", says)
                self.assertNotIn("damaged", says)

    def test_a_damaged_checkpoint(self):
        """One place is enough to go on from, but the file differs from what was written."""
        self.tandem("run", "rolling_disk", *LIMITED, "--set", "output.flush=0", "--output", "run.h5", code=1)
        with h5py.File(self.folder / "run.h5", "r+") as file:
            file["checkpoint/first"][100] += 1
        self.assertIn("/checkpoint/first differs from what was written", self.tandem("verify", "run.h5", code=1).stderr)
        self.tandem("resume", "run.h5", *ON)
        self.tandem("verify", "run.h5")

    def test_damaged_sums(self):
        self.limited()
        with h5py.File(self.folder / "run.h5", "r+") as file:
            for place in file["checksums"].values():
                if place[0] == max(other[0] for other in file["checksums"].values()):
                    place[1] -= 1
                    break
        self.assertIn("its checksums are damaged", self.tandem("verify", "run.h5", code=1).stderr)
        self.assertIn("its checksums are damaged", self.tandem("resume", "run.h5", *ON, code=2).stderr)

    def test_what_is_no_result(self):
        self.refused("verify", says="needs a FILE")
        self.refused("verify", "none.h5", says="cannot verify none.h5: there is no such file")
        (self.folder / "text.h5").write_text("[scene]")
        self.refused("verify", "text.h5", says="it is not a result of tandem")
        whole = self.limited()
        (self.folder / "run.h5").write_bytes(whole[:len(whole)//2])
        self.refused("verify", "run.h5", says="it is damaged: HDF5 cannot open it")

    def test_a_file_in_use(self):
        self.limited()
        with open(self.folder / "run.h5", "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH)
            self.refused("verify", "run.h5", says="it is in use")


class Cut(Running):
    """Somebody cuts the file off while a run writes it."""

    def test_it_is_noticed(self):
        for length in (0, 100, 5000):
            with self.subTest(length):
                name = f"{length}.h5"
                process = self.start("rolling_disk", "--set", "time.end=20000", "--no-error", "--quiet", "--set", "output.every=1",
                                     "--output", name)
                self.wait_for(self.has_rows(name, 2), process)
                os.truncate(self.folder / name, length)
                out, err = self.end(process, 1)
                self.assertIn("output_failed", err)
                self.assertIn("truncated or overwrote the file during the run", err)
                self.assertIn("is saved: tandem run", err)
                self.assertNotIn("resume", out + err)
                # It is not made to look whole again.
                with self.assertRaises(OSError):
                    h5py.File(self.folder / name)

    def test_a_signal_is_heard(self):
        process = self.start("rolling_disk", "--set", "time.end=20000", "--no-error", "--quiet", "--set", "output.flush=1000",
                             "--set", "output.every=1000", "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        # Until what belongs to the first row is there.
        time.sleep(0.3)
        os.truncate(self.folder / "a.h5", 5000)
        process.send_signal(signal.SIGTERM)
        _, err = self.end(process, 128 + signal.SIGTERM)
        self.assertIn("truncated or overwrote the file", err)
        self.assertNotIn("tandem resume", err)

    def test_at_the_very_end(self):
        """No flush comes before the report."""
        process = self.start("rolling_disk", "--set", "time.end=100", "--no-error", "--set", "output.flush=1000", "--set",
                             "output.every=1000", "--output", "a.h5")
        self.wait_for(self.has_rows("a.h5"), process)
        time.sleep(0.1)
        os.truncate(self.folder / "a.h5", 0)
        out, err = self.end(process, 1)
        self.assertIn("truncated or overwrote the file", err)
        self.assertIn("INCOMPLETE", out)


if __name__ == "__main__":
    unittest.main(verbosity=2)
