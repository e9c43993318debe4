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

from test_mjcf import MODEL
from test_output import ROOT
from test_urdf import ROBOT

sys.path.insert(0, str(ROOT / "python" / "src" / "tandem"))
import mjcf  # noqa: E402
import urdf  # noqa: E402

#: Number of random files; MUTATIONS requests more.
MUTATIONS = int(os.environ.get("MUTATIONS", "100"))
#: Limit of each import (s), generous for machines that others use.
LONGEST = 120
LOOP = '<equality><connect body1="door" body2="bob" anchor="1 0 0"/><weld body1="bob" body2="stone" relpose="0 0 0 1 0 0 0"/>' \
    '<joint joint1="hinge" joint2="bolt" polycoef="0 1 0 0 0"/></equality>'
FULL = MODEL.replace("</mujoco>", LOOP + '<option gravity="0 0 -9"><flag limit="disable"/></option></mujoco>')


class Late(Exception):
    pass


def numbers_in(value):
    """All numbers of a scene."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, (dict, list)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from numbers_in(inner)


class Imports(unittest.TestCase):
    def setUp(self):
        self.enterContext(contextlib.chdir(self.enterContext(tempfile.TemporaryDirectory())))

    def imported(self, module, text=None, code=None, file="model.xml", seconds=LONGEST):
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
                found = module.main([module.__name__, file, "--output", "scene.toml", "--force"])
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
        for module, text in ((mjcf, FULL), (urdf, ROBOT)):
            for found in re.finditer(r' (\w+)="[-0-9][-+.0-9e ]*"', text):
                if found[1] in ("effort", "velocity", "version", "kp"):
                    continue
                for wrong in ("", " ", "nan", "-inf", "1e999", "1e31", "1_0", "x", "1 2 3 4 5 6 7 8", "\u0661"):
                    with self.subTest(attribute=found[1], value=wrong):
                        said = self.imported(module, text[:found.start()] + f' {found[1]}="{wrong}"' + text[found.end():], 2)
                        self.assertIn("number", said)

    def test_every_word(self):
        """Words and names of attributes that a file of MuJoCo does not have."""
        for wrong, says in {
            '<compiler angle="grad"/>': "degree, radian", '<compiler autolimits="yes"/>': "false, true",
            '<compiler inertiafromgeom="never"/>': "auto", '<option><flag spring="off"/></option>': "enable, disable",
            '<option><flag sprung="disable"/></option>': "did you mean spring", '<compiler angel="radian"/>': "did you mean angle",
            '<worldbody><body name="b"><joint stifness="1"/></body></worldbody>': "did you mean stiffness",
            '<worldbody><body><joint limited="maybe" range="0 1"/></body></worldbody>': "auto, false, true",
            '<worldbody><body><joint range="1 0"/></body></worldbody>': "is not ascending",
            '<worldbody><body><joint name="a"/><joint name="a"/></body></worldbody>': "two joints have the name a",
            '<worldbody><site name="a"/><site name="a"/></worldbody>': "two sites have the name a",
            '<worldbody><body><frame><joint/></frame></body></worldbody>': "in a <frame>",
            '<worldbody><body><joints/></body></worldbody>': "<joints>",
            '<default><default><joint/></default></default>': "no unique name",
            '<worldbody><body quat="0 0 0 0"/></worldbody>': "length zero",
            '<worldbody><body><joint/><inertial mass="-1" pos="0 0 0" diaginertia="1 1 1"/></body></worldbody>': "below 0",
        }.items():
            with self.subTest(wrong):
                self.assertIn(says, self.imported(mjcf, f"<mujoco>{wrong}</mujoco>", 2))

    def test_what_flags_disable(self):
        """Flags of MuJoCo that disable springs, dampers, equalities, limits, actuators, gravity."""
        def taken(*flags):
            words = " ".join(f'{flag}="disable"' for flag in flags)
            text = FULL.replace('<flag limit="disable"/>', f"<flag {words}/>")
            # Without the loop, whose ends are apart.
            scene = tomllib.loads(self.imported(mjcf, text, 0))
            force = scene.get("force", {})
            return ("stiffness" in force.get("hinge_spring", {}), "damping" in force.get("hinge_spring", {}), "push_motor" in force,
                    "connect1" in scene["joint"], "joint3" in scene.get("constraint", {}), "event" in scene, scene["gravity"]["vector"][2])

        everything = (True, True, True, True, True, True, -9)
        self.assertEqual(taken(), everything)
        for flags, lost in {("spring",): {0}, ("damper",): {1}, ("passive",): {0, 1}, ("actuation",): {2}, ("equality",): {3, 4},
                            ("limit",): {5}, ("constraint",): {3, 4, 5}, ("gravity",): {6}, ("contact", "warmstart", "sensor"): set(),
                            ("spring", "damper", "limit"): {0, 1, 5}}.items():
            with self.subTest(flags):
                expected = tuple((0 if k == 6 else False) if k in lost else value for k, value in enumerate(everything))
                self.assertEqual(taken(*flags), expected)

    def test_deep_files(self):
        """Bodies, frames and classes within each other: as many as are useful, then a message."""
        def nested(count, opening, closing, inside=""):
            return opening.replace("#", "{}").format(*range(opening.count("#"))) if count == 0 else \
                "".join(opening.replace("#", str(k)) for k in range(count)) + inside + closing*count

        body = '<body name="b#" pos="1 0 0"><joint name="j#"/><geom size="0.1"/>'
        chain = f'<mujoco><worldbody>{nested(900, body, "</body>")}</worldbody></mujoco>'
        scene = tomllib.loads(self.imported(mjcf, chain, 0))
        self.assertEqual((len(scene["body"]), len(scene["joint"])), (900, 900))
        self.assertEqual(scene["body"]["b899"]["position"], [900, 0, 0])
        frames = nested(900, '<frame pos="1 0 0">', "</frame>", '<body name="b"><joint/><geom size="0.1"/></body>')
        scene = tomllib.loads(self.imported(mjcf, f"<mujoco><worldbody>{frames}</worldbody></mujoco>", 0))
        self.assertEqual(scene["body"]["b"]["position"], [900, 0, 0])
        classes = nested(900, '<default class="c#">', "</default>").replace('class="c0"', "", 1)
        self.imported(mjcf, f'<mujoco>{classes}<worldbody><body><joint class="c899"/><geom size="0.1"/></body></worldbody></mujoco>', 0)
        for module, root in ((mjcf, "mujoco"), (urdf, "robot")):
            self.assertIn("nested more than", self.imported(module, f"<{root}>{'<body>'*100000}{'</body>'*100000}</{root}>", 2))

    def test_large_files(self):
        for module, root in ((mjcf, "mujoco"), (urdf, "robot")):
            self.assertIn("elements", self.imported(module, f"<{root}>{'<a/>'*300000}</{root}>", 2))
            with open("large.xml", "wb") as file:
                file.truncate(2**33)
            self.assertIn("MB", self.imported(module, code=2, file="large.xml"))

    def test_what_is_no_file(self):
        os.mkfifo("pipe.xml")
        os.mkdir("folder.xml")
        os.symlink("round.xml", "again.xml")
        os.symlink("again.xml", "round.xml")
        for module in (mjcf, urdf):
            self.assertIn("again.xml", self.imported(module, code=2, file="again.xml"))
            self.assertIn("not a regular file", self.imported(module, code=2, file="pipe.xml"))
            self.assertIn("not a regular file", self.imported(module, code=2, file="folder.xml"))
            self.assertIn("none.xml", self.imported(module, code=2, file="none.xml"))
        self.assertIn("not a regular file", self.imported(mjcf, '<mujoco><include file="pipe.xml"/></mujoco>', 2))

    def test_includes(self):
        """Each file once: neither in circles nor twice as many in each of many files."""
        for k in range(30):
            Path(f"part{k}.xml").write_text("<mujoco>" + f'<include file="part{k + 1}.xml"/>'*2 + "</mujoco>")
        self.assertIn("deep", self.imported(mjcf, '<mujoco><include file="part0.xml"/></mujoco>', 2))
        Path("part3.xml").write_text("<mujoco/>")
        self.assertIn("twice", self.imported(mjcf, '<mujoco><include file="part0.xml"/></mujoco>', 2))
        # Beside the first file, otherwise beside the including one.
        os.mkdir("parts")
        Path("parts/one.xml").write_text('<mujoco><include file="two.xml"/></mujoco>')
        body = '<mujoco><worldbody><body name="{}"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
        Path("parts/two.xml").write_text(body.format("beside_it"))
        self.assertIn("[body.beside_it]", self.imported(mjcf, '<mujoco><include file="parts/one.xml"/></mujoco>', 0))
        Path("two.xml").write_text(body.format("beside_first"))
        self.assertIn("[body.beside_first]", self.imported(mjcf, '<mujoco><include file="parts/one.xml"/></mujoco>', 0))

    def test_entities(self):
        bomb = "<!DOCTYPE a [<!ENTITY a 'x'>" + "".join(f"<!ENTITY {b} '{f'&{a};'*10}'>" for a, b in zip("abcdefgh", "bcdefghi")) + "]>"
        for module, root in ((mjcf, "mujoco"), (urdf, "robot")):
            self.assertIn("entities", self.imported(module, f"{bomb}<{root}>&i;</{root}>", 2))

    def test_many_names_alike(self):
        """Names that are cut at the same place: thousands of links in seconds."""
        prefix = "a_name_longer_than_any_name_of_a_body_is_"
        links = "".join(f'<link name="{prefix}{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
                        f'<joint name="{prefix}{k}" type="continuous"><parent link="{f"{prefix}{k - 1}" if k else "root"}"/>'
                        f'<child link="{prefix}{k}"/>' + (f'<mimic joint="{prefix}{k - 1}"/>' if k else "") + "</joint>" for k in range(5000))
        began = time.process_time()
        scene = tomllib.loads(self.imported(urdf, f'<robot name="r"><link name="root"/>{links}</robot>', 0))
        self.assertEqual((len(scene["body"]), len(scene["joint"]), len(scene["constraint"])), (5000, 5000, 4999))
        self.assertLess(time.process_time() - began, 10)

    def test_numbers_that_overflow(self):
        """Products that overflow, and bodies whose mass underflows."""
        chain = "".join(f'<link name="l{k}"><inertial><mass value="1"/></inertial></link><joint name="j{k}" type="continuous"><parent link="'
                        f'{f"l{k - 1}" if k else "root"}"/><child link="l{k}"/>'
                        + (f'<mimic joint="j{k - 1}" multiplier="1e30" offset="1e30"/>' if k else "") + "</joint>" for k in range(20))
        self.assertIn("overflows", self.imported(urdf, f'<robot name="r"><link name="root"/>{chain}</robot>', 2))
        for geom in ('size="1e30" density="1e30"', 'size="1e-30" density="1e-30"', 'type="box" size="1e30 1e-30 1"'):
            self.imported(mjcf, f'<mujoco><compiler settotalmass="1e30"/><worldbody><body><joint/><geom {geom}/></body></worldbody></mujoco>')

    def test_random_files(self):
        """Files with random changes: to values, names, elements and their order, and cut anywhere."""
        random.seed(1)
        values = ("", "nan", "0", "-1", "1e300", "1e30", "1e-320", "0 0 0", "1 2 3", "0 0 0 0", "true", "hinge", "door", "rod", "fixed",
                  "box", "\u00e9", "'", "&#10;", "x"*300)
        codes = {0: 0, 2: 0}
        for k in range(MUTATIONS):
            module, text = ((mjcf, FULL), (urdf, ROBOT))[k % 2]
            for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
                attributes = list(re.finditer(r'(\w+)="([^"]*)"', text))
                elements = list(re.finditer(r"<(\w+)[^<>]*/>", text))
                kind = random.randrange(9)
                if kind < 4 and attributes:
                    one = random.choice(attributes)
                    text = text[:one.start(2)] + random.choice(values) + text[one.end(2):]
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
            with self.subTest(mutation=k, text=text):
                found = self.imported(module, text)
                codes[2 if found.startswith("tandem: ") else 0] += 1
                if not found.startswith("tandem: "):
                    self.assertTrue(all(map(math.isfinite, numbers_in(tomllib.loads(found)))))
        self.assertGreater(min(codes.values()), MUTATIONS//10, codes)


if __name__ == "__main__":
    unittest.main()
