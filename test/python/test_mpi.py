# SPDX-License-Identifier: MIT
"""Sweeps over ranks of MPI: the same table, and what is left when a process, a rank or the job dies.

Runs build/tandem-mpi by mpirun, and build/tandem beside it; `make mpi` makes them. Without either, all is skipped.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
import unittest
from pathlib import Path

import h5py
from test_sweep import DISKS, KILLS, ROOT, Case, children, table

PROGRAM = os.environ.get("TANDEM_MPI", str(ROOT / "build" / "tandem-mpi"))
#: Root may use mpirun in a container; more ranks than cores may come.
MPIRUN = ["mpirun", "--oversubscribe"]
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


@unittest.skipUnless(shutil.which("mpirun") and os.path.exists(PROGRAM), "mpirun or build/tandem-mpi is not there")
class Ranks(Case):
    def setUp(self):
        super().setUp()
        self.write(DISKS)
        self.random = random.Random(1)

    def ranks(self, n, *arguments, code=0, says=()):
        done = subprocess.run([*MPIRUN, "-n", str(n), PROGRAM, "sweep", "sweep.toml", *arguments], cwd=self.folder,
                              env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        for words in [says] if isinstance(says, str) else says:
            self.assertIn(words, done.stderr)
        return done

    def test_the_table_is_that_of_one_machine(self):
        expected = self.whole()
        for n in (1, 2, 4):
            self.ranks(n, "--output", f"ranks{n}.h5", "--quiet")
            self.assertEqual(table(self.folder / f"ranks{n}.h5"), expected)
        self.ranks(2, "--output", "jobs.h5", "--jobs", "2", "--quiet")
        self.assertEqual(table(self.folder / "jobs.h5"), expected)

    def test_tasks_and_merging(self):
        self.ranks(2, "--output", "ranks.h5", "--cases", "1:30", "--quiet")
        self.ranks(2, "--output", "ranks.h5", "--cases", "31:60", "--quiet")
        self.ranks(2, "--output", "ranks.h5", "--merge", "ranks.h5.1-30.journal", "ranks.h5.31-60.journal", "--quiet")
        self.ranks(1, "--output", "whole.h5", "--quiet")
        self.assertEqual(table(self.folder / "ranks.h5"), table(self.folder / "whole.h5"))

    def test_the_installed_program(self):
        if not (ROOT / "build" / "tandem").exists():
            self.skipTest("build/tandem is not there")
        prefix = self.folder / "prefix"
        library = [sys.executable, str(ROOT / "tools" / "library.py")]
        subprocess.run([*library, "install", "--prefix", str(prefix), "--parts", "program", "mpi"], check=True, capture_output=True)
        environment = {key: value for key, value in ENVIRONMENT.items() if key != "TANDEM_SCENES"}
        subprocess.run([*MPIRUN, "-n", "2", str(prefix / "bin/tandem-mpi"), "sweep", "sweep.toml", "--quiet"], cwd=self.folder,
                       env=environment, check=True, timeout=300)
        self.assertTrue((self.folder / "sweep.h5").exists())
        subprocess.run([*library, "uninstall", "--prefix", str(prefix)], check=True)
        self.assertFalse(prefix.exists() and any(prefix.iterdir()))

    def test_wrong_input_ends_all_ranks(self):
        self.write(DISKS.replace("draws", "drawz"))
        done = self.ranks(3, "--quiet", code=2, says='did you mean "draws"')
        self.assertEqual(done.stderr.count("did you mean"), 1)

    def kill_and_finish(self, kill):
        self.write(DISKS.replace("time.end=0.05", "time.end=2.0"))
        self.ranks(1, "--output", "whole.h5", "--quiet")
        expected = table(self.folder / "whole.h5")
        for _ in range(KILLS):
            process = subprocess.Popen([*MPIRUN, "-n", "3", PROGRAM, "sweep", "sweep.toml", "--output", "killed.h5", "--quiet"],
                                       cwd=self.folder, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            until = time.monotonic() + 20
            while len(children(process.pid)) < 3 and time.monotonic() < until:
                time.sleep(0.01)
            time.sleep(self.random.uniform(0.2, 2.0))
            kill(process)
            self.see_the_end_of(process)
            if not (self.folder / "killed.h5").exists():
                self.ranks(3, "--output", "killed.h5", "--quiet")
            self.assertEqual(table(self.folder / "killed.h5"), expected)
            self.assertEqual(list(self.folder.glob("killed.h5.*")), [])
            (self.folder / "killed.h5").unlink()
            (self.folder / "killed.csv").unlink()

    def see_the_end_of(self, process):
        """mpirun of OpenMPI 4.1 was seen to hang, with all its ranks dead, when one was killed on a machine with much to do: no
        rank can prevent this, and the wait for it is bounded."""
        try:
            process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            for rank in children(process.pid):
                self.assertIn(") Z ", Path(f"/proc/{rank}/stat").read_text(), "a rank outlives the job")
            process.kill()
            process.wait()

    def test_a_rank_that_dies(self):
        def kill(process):
            ranks = children(process.pid)
            if ranks:
                os.kill(self.random.choice(ranks), signal.SIGKILL)

        self.kill_and_finish(kill)

    def test_a_process_of_a_rank_that_dies(self):
        def kill(process):
            workers = [worker for rank in children(process.pid) for worker in children(rank)]
            if workers:
                os.kill(self.random.choice(workers), signal.SIGKILL)

        self.kill_and_finish(kill)

    def test_a_job_that_is_ended(self):
        self.kill_and_finish(lambda process: process.terminate())

    def test_rows_of_one_machine_and_of_ranks(self):
        self.ranks(2, "--quiet")
        with h5py.File(self.folder / "sweep.h5") as file:
            self.assertEqual(file["case"][:].tolist(), list(range(1, 61)))
            self.assertEqual(set(file["status"][:].tolist()), {0})


if __name__ == "__main__":
    unittest.main()
