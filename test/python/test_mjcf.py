# SPDX-License-Identifier: MIT
"""Models of MuJoCo from MJCF files: what the scene says, and how it moves. tools/compare_mjcf.py compares whole models with MuJoCo."""

import subprocess
import sys
import tomllib

import numpy as np
from test_mechanisms import Mechanism
from test_output import ROOT

IMPORT = [sys.executable, str(ROOT / "python" / "src" / "tandem" / "mjcf.py"), "mjcf"]
G = 9.81

# A door on a hinge with a spring, a damper and a motor; a slider on it; a body without joints on the door; a ball and a free one.
MODEL = """<mujoco model="a small model">
  <compiler angle="radian"/>
  <default><geom density="500"/><default class="light"><geom density="50"/></default></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="door" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" stiffness="3" springref="0.2" damping="0.5" range="-1 2"/>
      <geom type="box" size="0.5 0.1 0.2" pos="0.5 0 0"/>
      <body name="knob" pos="1 0 0"><geom type="sphere" size="0.1" mass="2"/></body>
      <body name="bolt" pos="0 0 -0.5" euler="0 1.5707963267948966 0">
        <joint name="bolt" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0.1" mass="4" diaginertia="1 1 1"/>
      </body>
    </body>
    <body name="bob" pos="2 0 2"><joint name="ball" type="ball"/><geom class="light" type="capsule" fromto="0 0 0 0 0 -1" size="0.1"/></body>
    <body name="stone" pos="3 0 3"><freejoint/><geom type="ellipsoid" size="0.1 0.2 0.3"/></body>
  </worldbody>
  <actuator><motor name="push" joint="hinge" gear="5"/><position joint="bolt" kp="1"/></actuator>
</mujoco>
"""
BAR = '<body name="{0}" pos="{1}"><joint name="{0}" axis="0 0 1"/><inertial pos="{2}" mass="1" diaginertia="0.1 0.1 0.08333333333333333"/>{3}</body>'
# The parallelogram of A02, one bay, whose last hinge is a connection.
LOOP = '<mujoco><option gravity="0 -9.81 0"/><worldbody>' + BAR.format("left", "0 0 0", "0 0.5 0", BAR.format("top", "0 1 0", "0.5 0 0", "")) \
    + BAR.format("right", "1 0 0", "0 0.5 0", "") + '</worldbody><equality><connect body1="top" body2="right" anchor="1 0 0"/>{}</equality></mujoco>'


class Models(Mechanism):
    def imported(self, text, *words, code=0):
        (self.folder / "model.xml").write_text(text)
        done = subprocess.run([*IMPORT, "model.xml", "--force", *words], cwd=self.folder, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, code, done.stderr)
        self.said = done.stderr
        return done.stderr if code else (self.folder / "model.toml").read_text()

    def test_what_is_in_it(self):
        text = self.imported(MODEL)
        scene = tomllib.loads(text)
        self.assertEqual(set(scene["body"]), {"door", "bolt", "bob", "stone"})
        # A box of 40 kg and the knob of 2 kg, about their common centre.
        door, x = scene["body"]["door"], (40*0.5 + 2)/42
        self.assertAlmostEqual(door["mass"], 42, places=12)
        self.near(door["position"], [x, 0, 1], 1e-14)
        self.assertAlmostEqual(door["inertia"][1], 40/12*(1 + 0.16) + 40*(x - 0.5)**2 + 2*(0.4*0.01 + (1 - x)**2), places=12)
        # A capsule of length 1: a cylinder and a sphere's two halves.
        r, cylinder, ball = 0.1, 50*np.pi*0.01, 50*4/3*np.pi*1e-3
        bob = scene["body"]["bob"]
        self.assertAlmostEqual(bob["mass"], cylinder + ball, places=12)
        half = 3/8*r
        across = cylinder*(3*r**2 + 1)/12 + ball*(0.4*r**2 - half**2 + (0.5 + half)**2)
        self.near(bob["inertia"], [across, across, cylinder*r**2/2 + 0.4*ball*r**2], 1e-12)
        self.assertEqual({name: joint["type"] for name, joint in scene["joint"].items()},
                         {"hinge": "revolute", "bolt_j": "prismatic", "ball": "spherical"})
        self.assertEqual({event["name"]: event["value"] for event in scene["event"]}, {"hinge_lower": -1, "hinge_upper": 2})
        for said in ("contacts are ignored", "actuator position is ignored"):
            self.assertIn(said, self.said)
            self.assertIn(f"# {said[0].upper()}{said[1:]}", text)
        self.tandem("check", "model.toml")

    def test_how_it_starts(self):
        """The door with its bolt held in mind: by the equations of two degrees of freedom; motor and spring turn it, the stone falls."""
        self.imported(MODEL)
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001", "parameters.ctrl_push=2") as file:
            self.near(file["bodies/stone/acceleration"][0], [0, 0, -G], 1e-12)
            # The bolt's axis is down: it slides along z, its centre 0.1 beside the hinge's line, 0.5 below.
            x, turn = 22/42, 40/12*1.16 + 40*(22/42 - 0.5)**2 + 2*(0.004 + (1 - 22/42)**2)
            mass = np.array([[turn + 42*x**2 + 1 + 4*(0.1**2 + 0.5**2), 4*0.1], [4*0.1, 4]])
            # A turn about y by +1 moves x to -z; the bolt's centre is at x = 0.1, z = -0.5, and slides by -z.
            force = np.array([42*G*x + 4*G*0.1 + 3*0.2 + 5*2, 4*G])
            alpha, slide = np.linalg.solve(mass, force)
            self.near(file["bodies/bolt/acceleration"][0], [-0.5*alpha, 0, -0.1*alpha - slide], 1e-12)

    def test_a_loop(self):
        """A parallelogram whose last hinge is a connection falls as one does: theta'' = c sin(theta)."""
        text = self.imported(LOOP.format(""), "--at", "left=-0.3,top=0.3,right=-0.3")
        self.assertIn("assemble = true", text)
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001") as file:
            alpha = G*(1 + 1)/(2/3 + 1)*np.sin(0.3)
            self.near(file["bodies/right/acceleration"][0], [0.5*alpha*np.cos(0.3), -0.5*alpha*np.sin(0.3), 0], 1e-11)

    def test_a_weld(self):
        """A bar on a hinge with another one that is free, welded to its end, turns as one of both; by sites, a connection likewise."""
        text = '<mujoco><option gravity="0 -9.81 0"/><worldbody>' + BAR.format("a", "0 0 0", "0.5 0 0", '<site name="one" pos="1 0 0"/>') \
            + '<body name="b" pos="1 0 0"><freejoint/><inertial pos="0.5 0 0" mass="1" diaginertia="0.1 0.1 0.08333333333333333"/>' \
            '<site name="two"/></body></worldbody><equality>{}</equality></mujoco>'
        self.imported(text.format('<weld body1="a" body2="b"/>'))
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001") as file:
            # A bar of 2 m and 2 kg: alpha = (3/2) g/l.
            self.near(file["bodies/b/acceleration"][0], [0, -1.5*1.5*G/2, 0], 1e-11)
        self.imported(text.format('<connect site1="one" site2="two"/>'))
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001") as file:
            # Two bars from the horizontal: alpha = (9/7, -3/7) g/l.
            self.near(file["bodies/a/acceleration"][0], [0, -0.5*9/7*G, 0], 1e-11)
            self.near(file["bodies/b/acceleration"][0], [0, -(9/7 - 0.5*3/7)*G, 0], 1e-11)

    def test_a_coupling(self):
        """Two bars one of which turns twice as far, backwards."""
        two = '<mujoco><option gravity="0 -9.81 0"/><worldbody>' + BAR.format("a", "0 0 0", "0.5 0 0", "") + BAR.format("b", "3 0 0", "0.5 0 0", "") \
            + '</worldbody><equality><joint joint1="a" joint2="b" polycoef="0 -2 0 0 0"/>{}</equality></mujoco>'
        self.imported(two.format(""))
        with self.went("model.toml", 'results.joints="all"', "time.end=0.5") as file:
            self.near(file["joints/a_j/angle"][:], -2*file["joints/b_j/angle"][:], 1e-10)
        self.assertIn("not linear", self.imported(two.format('<joint joint1="a" joint2="b" polycoef="0 1 1 0 0"/>')) and self.said)
        self.assertIn("is violated", self.imported(two.format(""), "--at", "a=1", code=2))

    def test_joints_in_one(self):
        """Several joints of a body are one that leaves the same motions."""
        def made(*joints, code=0):
            body = "".join(f'<joint name="j{k}" {words}/>' for k, words in enumerate(joints))
            text = self.imported(f'<mujoco><worldbody><body name="b">{body}<geom size="0.1"/></body></worldbody></mujoco>', code=code)
            if code:
                return text
            self.tandem("check", "model.toml")
            return tomllib.loads(text).get("joint", {}).get("j0")

        x, y, z = ('axis="1 0 0"', 'axis="0 1 0"', 'axis="0 0 1"')
        slide = [f'type="slide" {axis}' for axis in (x, y, z)]
        self.assertEqual(made(slide[0], slide[2], y)["type"], "planar")
        self.assertEqual(made(slide[2], z)["type"], "cylindrical")
        self.assertEqual(made(x, y)["type"], "universal")
        self.assertEqual(made(x, y, z)["type"], "spherical")
        # Along the axis and across it.
        both = made(slide[0], slide[1])
        self.assertEqual([both[key] for key in ("axis", "across", "hold")], [[1, 0, 0], [0, 1, 0], [0, 1, 0, 1, 1, 1]])
        self.assertIsNone(made(*slide, 'type="ball"'))
        self.assertIn("not perpendicular", made(x, 'axis="1 1 0"', code=2))
        self.assertIn("points differ", made(x, 'axis="0 1 0" pos="0 0 1"', code=2))
        self.assertIn("slides must come first", made(y, slide[0], code=2))

    def test_includes_and_classes(self):
        """Included files, classes within classes, and frames."""
        (self.folder / "part.xml").write_text('<mujoco><default><default class="a"><geom mass="3"/><default class="b"><geom size="0.2"/>'
                                              '</default></default></default></mujoco>')
        scene = tomllib.loads(self.imported('<mujoco><include file="part.xml"/><worldbody><frame pos="0 0 1" euler="0 0 90">'
                                            '<body name="b" pos="1 0 0" childclass="b"><freejoint/><geom pos="0 2 0"/></body></frame></worldbody></mujoco>'))
        self.assertEqual(scene["body"]["b"]["mass"], 3)
        self.near(scene["body"]["b"]["position"], [-2, 1, 1], 1e-15)
        self.near(scene["body"]["b"]["inertia"], [3*0.4*0.04]*3, 1e-16)

    def test_the_program(self):
        """`tandem import mjcf` hands over to the package for Python, options, messages and exit code."""
        environment = {"TANDEM_PYTHON": sys.executable, "PYTHONPATH": str(ROOT / "python" / "src")}
        expected = self.imported(MODEL, "--at", "hinge=0.5")
        done = self.tandem("import", "mjcf", "model.xml", "--at", "hinge=0.5", "--output", "again.toml", env=environment)
        self.assertEqual(done.stdout.strip(), "again.toml")
        self.assertIn("contacts are ignored", done.stderr)
        self.assertEqual((self.folder / "again.toml").read_text(), expected)
        self.assertIn("--force", self.tandem("import", "mjcf", "model.xml", "--output", "again.toml", env=environment, code=2).stderr)

    def test_wrong_files(self):
        def body(text):
            return f"<mujoco><worldbody>{text}</worldbody></mujoco>"

        for text, message in {
            "<robot/>": "not <mujoco>", "<mujoco": "not XML", body("<geom size='1'/>"): "nothing moves",
            body('<body name="b"><joint/></body>'): "no mass", body('<body><joint axis="0 0 0"/><geom size="1"/></body>'): "length zero",
            body('<body><joint type="screw"/><geom size="1"/></body>'): 'screw" is unknown',
            body('<body><freejoint/><geom type="box" size="1"/></body>'): "3 positive sizes",
            body('<body><freejoint/><geom type="mesh" mesh="m"/></body>'): "is a mesh",
            body('<body><freejoint/><geom size="1" class="none"/></body>'): 'no default class "none"',
            body('<body name="b"><freejoint/><composite/></body>'): "<composite>",
            body('<body name="a"/><body name="a"/>'): "two bodies have the name a", body('<body pos="1 x 0"/>'): "3 numbers",
            '<mujoco><include file="model.xml"/></mujoco>': "includes are cyclic", '<mujoco><compiler eulerseq="abc"/></mujoco>': "eulerseq",
        }.items():
            with self.subTest(message):
                self.assertIn(message, self.imported(text, code=2))
        self.assertIn("no joint elbow", self.imported(MODEL, "--at", "elbow=1", code=2))

    def test_hostile_names(self):
        """Line breaks in names cannot inject text into the scene."""
        scene = tomllib.loads(self.imported(MODEL.replace('"a small model"', '"a&#10;[body.evil]&#10;mass = 1"').replace('"stone"', '"s&#10;[x]"')))
        self.assertEqual(len(scene["body"]), 4)
        self.assertNotIn("x", scene)


if __name__ == "__main__":
    import unittest

    unittest.main()
