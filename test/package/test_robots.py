# SPDX-License-Identifier: MIT
"""doc/robots.md: it quotes the files of example/robots, its commands run, and its controllers do as it says."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import tandem
from models import ROOT

EXAMPLES = ROOT / "example" / "robots"
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", (ROOT / "doc" / "robots.md").read_text(), re.M | re.S)
#: Packages of each file, and of --verify.
PACKAGES = {"arm": [], "humanoid": ["mujoco"]}
VERIFIES = {"arm": ["pinocchio"], "humanoid": ["mujoco"]}


def has(packages):
    return all(importlib.util.find_spec(name) for name in packages)


class Tutorial(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        for path in EXAMPLES.iterdir():
            shutil.copy(path, self.folder)

    def python(self, *words):
        done = subprocess.run([sys.executable, *words], cwd=self.folder, capture_output=True, text=True, check=False,
                              env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_quotations(self):
        texts = [path.read_text() for path in EXAMPLES.iterdir()]
        quoted = [block for kind, block in BLOCKS if kind in ("python", "xml")]
        self.assertGreater(len(quoted), 6)
        for block in quoted:
            for part in re.split(r"(?=^  <joint)", block, flags=re.M):
                self.assertTrue(any(part.strip("\n") in text for text in texts), part)

    def test_commands(self):
        lines = [line.split("#")[0].split() for kind, block in BLOCKS if kind == "sh" for line in block.splitlines()]
        self.assertGreater(len(lines), 7)
        for _, *words in lines:
            name = words[1].split(".")[0]
            if not has((VERIFIES if "--verify" in words else PACKAGES)[name]):
                continue
            with self.subTest(words):
                if words[0] in ("check", "run"):
                    tandem.run_program(*words, cwd=self.folder)
                else:
                    self.python("-m", "tandem", *words)
        self.assertIn("upper", (self.folder / "arm.html").read_text())

    def test_arm(self):
        said = self.python("arm.py")
        self.assertLess(float(said.split()[-1]), 1e-5)
        self.assertTrue((self.folder / "arm.html").stat().st_size > 100000)

    @unittest.skipUnless(has(PACKAGES["humanoid"]), "this Python has no package mujoco")
    def test_humanoid(self):
        """Both sides move alike, and the trunk swings about the bar."""
        x, z, difference = map(float, re.findall(r"-?\d+\.\d+(?:e-?\d+)?", self.python("humanoid.py")))
        self.assertLess(difference, 1e-6)
        self.assertGreater(abs(x) + abs(z - 1.4), 0.01)


if __name__ == "__main__":
    unittest.main()
