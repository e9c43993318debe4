# SPDX-License-Identifier: MIT
"""Files that `tandem import` must refuse, or take, within a bounded time: an exit code of 0 or 2, one message, no traceback."""

import contextlib
import io
import math
import os
import random
import re
import signal
import sys
import tempfile
import time
import tomllib
import unittest
import warnings
from pathlib import Path

from test_mjcf import HAS_MUJOCO, MODEL
from test_output import ROOT
from test_urdf import ROBOT

sys.path.insert(0, str(ROOT / "python" / "src"))
from tandem import imports  # noqa: E402

#: Number of random files; MUTATIONS requests more.
MUTATIONS = int(os.environ.get("MUTATIONS", "100"))
#: Limit of each import (s), generous for machines that others use.
LONGEST = 120
LOOP = '<equality><connect body1="door" body2="bob" anchor="1 0 0"/><weld body1="bob" body2="stone" relpose="0 0 0 1 0 0 0"/>' \
    '<joint joint1="hinge" joint2="bolt" polycoef="0 1 0 0 0"/></equality>'
FULL = MODEL.replace("</mujoco>", LOOP + '<option gravity="0 0 -9"><flag limit="disable"/></option></mujoco>')
#: Values of attributes in damaged files.
VALUES = ("", "nan", "0", "-1", "1e300", "1e30", "1e-320", "0 0 0", "1 2 3", "0 0 0 0", "true", "hinge", "door", "rod", "fixed", "box", "\u00e9",
          "'", "&#10;", "x"*300)


class Late(Exception):
    pass


def numbers_in(value):
    """All numbers of a scene."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, (dict, list)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from numbers_in(inner)


def damaged(text: str, random) -> str:
    """A file with 1 to 8 changes drawn by `random`."""
    for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
        attributes = list(re.finditer(r'(\w+)="([^"]*)"', text))
        elements = list(re.finditer(r"<(\w+)[^<>]*/>", text))
        kind = random.randrange(9)
        if kind < 4 and attributes:
            one = random.choice(attributes)
            text = text[:one.start(2)] + random.choice(VALUES) + text[one.end(2):]
        elif kind == 4 and attributes:
            one = random.choice(attributes)
            text = text[:one.start()] + text[one.end():]
        elif kind == 5 and attributes:
            one, other = random.choice(attributes), random.choice(attributes)
            text = text[:one.start(1)] + other[1] + text[one.end(1):]
        elif kind == 6 and elements:
            one, other = random.choice(elements), random.choice(elements)
            text = text[:one.start()] + other[0] + random.choice(("", one[0])) + text[one.end():]
        elif kind == 7 and elements:
            one, other = random.choice(elements), random.choice(elements)
            text = text[:one.start(1)] + other[1] + text[one.end(1):]
        elif kind == 8 and random.random() < 0.3:
            place = random.randrange(len(text))
            text = text[:place] + random.choice(("", "<", "\0", "</body>", text[place + random.randrange(50):]))
    return text


class Imports(unittest.TestCase):
    def setUp(self):
        self.enterContext(contextlib.chdir(self.enterContext(tempfile.TemporaryDirectory())))

    def imported(self, text=None, code=None, file="model.xml", seconds=LONGEST, words=()):
        """The message if a file is refused, otherwise the scene."""
        if text is not None:
            Path(file).write_text(text)

        def late(*_):
            raise Late(f"no end after {seconds} s")

        out, said = io.StringIO(), io.StringIO()
        before = signal.signal(signal.SIGALRM, late)
        signal.alarm(seconds)
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said), warnings.catch_warnings():
                warnings.simplefilter("error")
                found = imports.main([file, "--output", "scene.toml", "--force", *words])
        finally:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)
        self.assertIn(found, (0, 2) if code is None else (code,), said.getvalue())
        if found == 2:
            self.assertRegex(said.getvalue(), r"\Atandem: .+\n\Z")
            return said.getvalue()
        return Path("scene.toml").read_text()

    def test_every_number(self):
        """Whatever stands for a number and is none ends with its name."""
        text = ROBOT
        for found in re.finditer(r' (\w+)="[-0-9][-+.0-9e ]*"', text):
            if found[1] in ("effort", "velocity", "version"):
                continue
            for wrong in ("", " ", "nan", "-inf", "1e999", "1e31", "1_0", "x", "1 2 3 4 5 6 7 8", "\u0661"):
                with self.subTest(attribute=found[1], value=wrong):
                    said = self.imported(text[:found.start()] + f' {found[1]}="{wrong}"' + text[found.end():], 2)
                    self.assertIn("number", said)

    @unittest.skipUnless(HAS_MUJOCO, "this Python has no package mujoco")
    def test_what_flags_disable(self):
        """Flags of MuJoCo that disable springs, dampers, equalities, limits, actuators, gravity."""
        def taken(*flags):
            words = " ".join(f'{flag}="disable"' for flag in flags)
            scene = tomllib.loads(self.imported(FULL.replace('<flag limit="disable"/>', f"<flag {words}/>"), 0))
            force = scene.get("force", {})
            return ("stiffness" in force.get("hinge_spring", {}), "damping" in force.get("hinge_spring", {}), "push_motor" in force,
                    "equality0" in scene["joint"], "equality2" in scene.get("constraint", {}), "hinge_stop" in force, scene["gravity"]["vector"][2])

        everything = (True, True, True, True, True, True, -9)
        self.assertEqual(taken(), everything)
        for flags, lost in {("spring",): {0}, ("damper",): {1}, ("actuation",): {2}, ("equality",): {3, 4}, ("limit",): {5},
                            ("constraint",): {3, 4, 5}, ("gravity",): {6}, ("contact", "warmstart", "sensor"): set(),
                            ("spring", "damper", "limit"): {0, 1, 5}}.items():
            with self.subTest(flags):
                expected = tuple((0 if k == 6 else False) if k in lost else value for k, value in enumerate(everything))
                self.assertEqual(taken(*flags), expected)

    @unittest.skipUnless(HAS_MUJOCO, "this Python has no package mujoco")
    def test_deep_files(self):
        """Bodies in each other, and elements nested beyond the limit."""
        body = "".join(f'<body name="b{k}" pos="1 0 0"><joint name="j{k}"/><geom size="0.1"/>' for k in range(200))
        scene = tomllib.loads(self.imported(f"<mujoco><worldbody>{body}{'</body>'*200}</worldbody></mujoco>", 0))
        self.assertEqual((len(scene["body"]), len(scene["joint"])), (200, 200))
        self.assertEqual(scene["body"]["b199"]["position"], [200, 0, 0])
        for root in ("mujoco", "robot"):
            self.assertIn("nested more than", self.imported(f"<{root}>{'<body>'*100000}{'</body>'*100000}</{root}>", 2))

    def test_large_files(self):
        for root in ("mujoco", "robot"):
            self.assertIn("elements", self.imported(f"<{root}>{'<a/>'*300000}</{root}>", 2))
        with open("large.xml", "wb") as file:
            file.truncate(2**33)
        self.assertIn("MB", self.imported(code=2, file="large.xml"))

    def test_what_is_no_file(self):
        os.mkfifo("pipe.xml")
        os.mkdir("folder.xml")
        os.symlink("round.xml", "again.xml")
        os.symlink("again.xml", "round.xml")
        self.assertIn("again.xml", self.imported(code=2, file="again.xml"))
        self.assertIn("not a regular file", self.imported(code=2, file="pipe.xml"))
        self.assertIn("not a regular file", self.imported(code=2, file="folder.xml"))
        self.assertIn("none.xml", self.imported(code=2, file="none.xml"))

    def test_entities(self):
        bomb = "<!DOCTYPE a [<!ENTITY a 'x'>" + "".join(f"<!ENTITY {b} '{f'&{a};'*10}'>" for a, b in zip("abcdefgh", "bcdefghi")) + "]>"
        for root in ("mujoco", "robot"):
            self.assertIn("entities", self.imported(f"{bomb}<{root}>&i;</{root}>", 2))

    def test_many_names_alike(self):
        """Names that are cut at the same place: thousands of links in seconds."""
        prefix = "a_name_longer_than_any_name_of_a_body_is_"
        links = "".join(f'<link name="{prefix}{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
                        f'<joint name="{prefix}{k}" type="continuous"><parent link="{f"{prefix}{k - 1}" if k else "root"}"/>'
                        f'<child link="{prefix}{k}"/>' + (f'<mimic joint="{prefix}{k - 1}"/>' if k else "") + "</joint>" for k in range(5000))
        began = time.process_time()
        scene = tomllib.loads(self.imported(f'<robot name="r"><link name="root"/>{links}</robot>', 0))
        self.assertEqual((len(scene["body"]), len(scene["joint"]), len(scene["constraint"])), (5000, 5000, 4999))
        self.assertLess(time.process_time() - began, 10)

    def test_numbers_that_overflow(self):
        """Products that overflow."""
        chain = "".join(f'<link name="l{k}"><inertial><mass value="1"/></inertial></link><joint name="j{k}" type="continuous"><parent link="'
                        f'{f"l{k - 1}" if k else "root"}"/><child link="l{k}"/>'
                        + (f'<mimic joint="j{k - 1}" multiplier="1e30" offset="1e30"/>' if k else "") + "</joint>" for k in range(20))
        self.assertIn("overflows", self.imported(f'<robot name="r"><link name="root"/>{chain}</robot>', 2))

    def test_random_files(self):
        """Files with random changes: to values, names, elements and their order, and cut anywhere."""
        source = random.Random(1)
        codes = {0: 0, 2: 0}
        for k in range(MUTATIONS):
            text = damaged(FULL if HAS_MUJOCO and k % 4 == 0 else ROBOT, source)
            with self.subTest(mutation=k, text=text):
                found = self.imported(text)
                codes[2 if found.startswith("tandem: ") else 0] += 1
                if not found.startswith("tandem: "):
                    self.assertTrue(all(map(math.isfinite, numbers_in(tomllib.loads(found)))))
        self.assertGreater(min(codes.values()), MUTATIONS//10, codes)


if __name__ == "__main__":
    unittest.main()
